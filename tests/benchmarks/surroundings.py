"""Do the commands work, or end in one line, where caches, disk, home or terminal are not as they should be?

    python -m tests.benchmarks surroundings --seed 1

Each command that writes, on toy inputs: without a home or any cache to write to, from a package that cannot be
written, with damaged compiled code, with stdout closed or full, on disks of 4 kB to 1 MB. It must work, or say one line
and exit with 2.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ._measure import head, row
from ._surroundings import DAMAGE, Place, Said, commands, damage_caches, make_inputs, places

QUICK = ("no cache, no home", "stdout closed", "files of 20 kB at most")


def tried(place: Place, words: list[str], target: Path) -> Said:
    """The command in a place, into an empty folder."""
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir()
    return place.run(words)


def main(words: Sequence[str]) -> int:
    """Print a row per place; 1 where anything was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surroundings", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="macrofit run in three places")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="places whose names hold a word")
    options = parser.parse_args(words)
    rng, bad = np.random.default_rng(options.seed), 0
    with tempfile.TemporaryDirectory() as name:
        folder, target = Path(name), Path(name) / "out"
        make_inputs(folder, database=not options.quick)
        every = commands(target, folder)
        chosen = {key: every[key] for key in every if not options.quick or key == "macrofit run"}
        print(head("place", *chosen))
        for place in places(folder, target):
            if options.quick and place.name not in QUICK:
                continue
            if options.only and not any(word in place.name for word in options.only):
                continue
            cells = []
            for key, command in chosen.items():
                if (how := place.name.removeprefix("caches ")) in DAMAGE:
                    damage_caches(folder, how, rng)
                said = tried(place, command, target)
                cells.append(said.fault or ("works" if said.code == 0 else "one line"))
                if said.fault:
                    bad += 1
                    print(
                        f"{place.name}, {key}, seed {options.seed}: {said.fault}\n{said.err[-3000:]}", file=sys.stderr
                    )
            print(row(place.name, *cells), flush=True)
    print(f"\nSeed {options.seed}.")
    return int(bad > 0)
