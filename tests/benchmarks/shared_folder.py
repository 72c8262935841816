"""What do two commands leave that are given the same folder at about the same time?

    python -m tests.benchmarks shared_folder -n 20 --seed 1

The same command twice, the second 0 to 2 s after the first. One must be refused in one line with code 2 (or come when
the other is done), and the files must be those of a command that was alone.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from ._measure import head, row
from ._surroundings import PLATES
from ._trials import Trial, complaints, differences

from small import small_press  # isort: skip

from macrofit.scene import dump_scene

LIMIT_S = 300.0
"""How long both may take together."""


class Kind(NamedTuple):
    """A command: its words but for the place it writes to, and what is not the same in two such places."""

    words: list[str]
    place: str
    compare: Callable[[Path, Path], list[str]]


def other_tables(folder: Path, wanted: Path) -> list[str]:
    """Tables and settings of two friction tests that differ, and drafts that were left."""
    names = sorted({path.name for each in (folder, wanted) for path in each.iterdir()})
    compared = [name for name in names if Path(name).suffix in (".csv", ".toml") or name.startswith(".")]
    return [name for name in compared if _bytes(folder / name) != _bytes(wanted / name)]


def _bytes(path: Path) -> bytes:
    return path.read_bytes() if path.is_file() else b""


def other_samples(database: Path, wanted: Path) -> list[str]:
    """Columns of two databases that differ, but for the time that samples took."""
    with h5py.File(database) as one, h5py.File(wanted) as two:
        names: list[str] = []
        two.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        return [name for name in names if "cpu" not in name and not np.array_equal(one[name][()], two[name][()])]


def kinds(folder: Path) -> dict[str, Kind]:
    """The commands that are tried."""
    scene = folder / "scene.toml"
    scene.write_text(dump_scene(small_press("motion.increment=0.25", fields=True)))
    plates = ["meso", "run", *PLATES, "--micro-friction", "0.05,0.07", "--no-figures", "-o"]
    return {
        "macrofit run": Kind(["macrofit", "run", str(scene), "-o"], "out", differences),
        "macrofit-meso run": Kind(plates, "plates", other_tables),
        "macrofit-surrogate generate": Kind(
            ["surrogate", "generate", "--pairs", "3", *PLATES, "--jobs", "1", "-o"], "db.h5", other_samples
        ),
    }


def twice(kind: Kind, target: Path, delay_s: float) -> tuple[str, list[str]]:
    """Start a command twice; who was refused, and what is wrong."""
    trials = []
    for pause in (delay_s, 0.0):
        trials.append(Trial(words=[*kind.words, target], folder=target.parent).start())
        time.sleep(pause)
    hung = [trial.gone(LIMIT_S) is None for trial in trials]
    codes = [trial.code for trial in trials]
    wrong = ["hangs"] * sum(hung)
    if sorted(str(code) for code in codes) not in (["0", "0"], ["0", "2"]):
        wrong.append(f"codes {codes}")
    for trial in trials:
        lines = complaints(trial.said())
        if "Traceback" in trial.said() or (trial.code == 2 and len(lines) != 1):
            wrong.append(f"says {trial.said()[-500:]}")
    return ("one is refused" if 2 in codes else "one after the other"), wrong


def main(words: Sequence[str]) -> int:
    """Print a row per command; 1 where anything was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks shared_folder", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two of macrofit run")
    parser.add_argument("-n", dest="count", type=int, default=20, help="of macrofit run; a fifth of the others")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(words)
    rng, bad = np.random.default_rng(options.seed), 0
    print(head("command", "pairs", "one is refused", "one after the other", "faults"))
    with tempfile.TemporaryDirectory() as name:
        for key, kind in kinds(Path(name)).items():
            count = options.count if key == "macrofit run" else max(1, options.count // 5)
            if options.quick:
                count = 2 if key == "macrofit run" else 0
            wanted, target = Path(name) / f"alone-{kind.place}", Path(name) / kind.place
            if count:
                alone = Trial(words=[*kind.words, wanted], folder=Path(name)).start()
                alone.gone(LIMIT_S)
            ended = {"one is refused": 0, "one after the other": 0}
            faults: list[str] = []
            for case in range(count):
                delay = float(rng.uniform(0.0, 2.0))
                how, wrong = twice(kind, target, delay)
                ended[how] += 1
                wrong += [f"other {each}" for each in kind.compare(target, wanted)]
                for fault in wrong:
                    print(f"{key}, seed {options.seed}, case {case}, {delay:.2f} s: {fault}", file=sys.stderr)
                faults += wrong
                for left in Path(name).glob(f"{kind.place}*"):
                    shutil.rmtree(left) if left.is_dir() else left.unlink()
            bad += len(faults)
            print(row(key, count, *ended.values(), len(faults)), flush=True)
    print(f"\nSeed {options.seed}.")
    return int(bad > 0)
