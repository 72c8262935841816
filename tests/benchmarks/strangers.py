"""Is a damaged or odd file ever read as something else than what was written into it?

    python -m tests.benchmarks strangers [--cases 4000] [--first 0] [--quick]

Curves, heights, tables of friction and TOML as other programs write them, with bits flipped, bytes lost, doubled, cut
off or put in, from seeds (`tests/fuzz.py`). A file is read right or refused in one line; sound ones are never refused.
Ends with 1 where anything else came of one.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from .. import fuzz
from ._measure import head, row

QUICK = 100


def main(arguments: Sequence[str]) -> int:
    """Print a row of each kind of file."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks strangers", description=__doc__)
    parser.add_argument("--cases", type=int, default=4000, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} of each kind")
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + (QUICK if given.quick else given.cases))
    print(f"Seeds {seeds.start} to {seeds.stop - 1}.\n")
    print(head("files", "cases", "read right", "refused in a line", "anything else", "time [ms each]"))
    wrong = []
    for kind in fuzz.KINDS:
        with tempfile.TemporaryDirectory() as folder:
            started = time.process_time()
            counted = fuzz.run(kind, seeds, Path(folder))
        each = 1e3 * (time.process_time() - started) / len(seeds)
        wrong += [f"{kind}, {line}" for line in counted.wrong]
        right = counted.read + counted.refused - len(counted.wrong)
        print(row(kind, len(seeds), counted.read, counted.refused, len(seeds) - right, f"{each:.1f}"), flush=True)
    print("".join(f"\n- {line}" for line in wrong))
    return 1 if wrong else 0
