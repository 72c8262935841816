"""What is left of a run that is interrupted at any moment?

    python -m tests.benchmarks interruptions -n 20 --seed 1

A short run is sent SIGTERM or SIGINT (its launcher is, under mpirun), or one of its ranks is killed, at a moment drawn
over its whole life. Then all its processes must be gone within 10 s, what it said is one line of its own and no
traceback, and the same command with --resume ends with the same files, to the bit, as the run that nothing disturbed.
Each case is told by the seed and its number.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ._measure import head, row
from ._trials import PATIENCE_S, Trial, complaints, differences

from small import small_press  # isort: skip

from macrofit.scene import dump_scene

HOW = {"SIGTERM": signal.SIGTERM, "SIGINT": signal.SIGINT, "kill -9 of a rank": signal.SIGKILL}
LIMIT_S = 120.0
"""How long a run that is not interrupted may take, on a machine that others load."""


def command(scene: Path, folder: Path, *more: str) -> list[str | Path]:
    """The words of a run."""
    return ["macrofit", "run", scene, "-o", folder, *more]


def undisturbed(scene: Path, folder: Path, ranks: int) -> float:
    """Make the folder that all others are compared with; how long the run lives [s]."""
    for target in (folder, folder.with_name("warm")):  # the first may have compiled something
        started = time.monotonic()
        trial = Trial(words=command(scene, target), folder=scene.parent, ranks=ranks).start()
        if trial.gone(LIMIT_S) is None or trial.code:
            raise SystemExit(f"the run itself fails: {trial.said()}")
        life = time.monotonic() - started
    shutil.rmtree(folder.with_name("warm"))
    return life


def interrupt(trial: Trial, number: int, rng: np.random.Generator, life: float) -> bool:
    """Start, wait, and send the signal; whether the run was still there."""
    trial.start()
    time.sleep(rng.uniform(0.0, life))
    if number != signal.SIGKILL or trial.ranks == 1:
        return trial.signal(number)
    while trial.process is not None and trial.process.poll() is None:
        ranks = trial.of_ranks()
        if ranks and trial.signal(number, int(rng.choice(ranks))):
            return True
        time.sleep(0.01)
    return False


def faults(trial: Trial, number: int, done: float | None, *, whole: bool) -> Iterator[str]:
    """What is wrong with the end of an interrupted run, whose results may be ``whole`` already."""
    if done is None:
        yield f"processes left after {PATIENCE_S:g} s"
    said = trial.said()
    if number != signal.SIGKILL:
        if "Traceback" in said:
            yield "traceback"
        if len(complaints(said)) > 1:
            yield f"{len(complaints(said))} lines"
        if trial.code == 0 and not whole:
            yield "code 0"
        elif trial.ranks == 1 and not complaints(said) and trial.code not in (0, -number):
            yield f"no word, code {trial.code}"


def resumed(scene: Path, folder: Path, wanted: Path, ranks: int) -> Iterator[str]:
    """What is wrong with the run that goes on in the folder."""
    trial = Trial(words=command(scene, folder, "--resume"), folder=scene.parent, ranks=ranks).start()
    if trial.gone(LIMIT_S) is None:
        yield "the resumed run hangs"
    elif trial.code:
        yield f"not resumed: {' '.join(complaints(trial.said())) or trial.said()[-300:]}"
    else:
        yield from (f"other {name}" for name in differences(folder, wanted))


def main(words: Sequence[str]) -> int:
    """Print a row per number of ranks and signal; 1 where anything was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks interruptions", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one SIGTERM on one and on two ranks")
    parser.add_argument("-n", dest="count", type=int, default=20, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 3])
    options = parser.parse_args(words)
    count, every = (1, [1, 2]) if options.quick else (options.count, options.ranks)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    print(head("ranks", "interrupted by", "runs", "before their end", "slowest end s", "faults"))
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        scene = Path(name) / "scene.toml"
        scene.write_text(dump_scene(small_press("motion.increment=0.5", fields=True)))
        for ranks in every:
            wanted = Path(name) / f"undisturbed{ranks}"
            life = undisturbed(scene, wanted, ranks)
            for how, number in list(HOW.items())[: 1 if options.quick else None]:
                found: Counter[str] = Counter()
                slowest, before = 0.0, 0
                for case in range(count):
                    rng = np.random.default_rng([options.seed, ranks, number, case])
                    folder = Path(name) / "out"
                    trial = Trial(words=command(scene, folder), folder=Path(name), ranks=ranks)
                    hit = interrupt(trial, number, rng, life)
                    done = trial.gone(PATIENCE_S if hit else LIMIT_S)
                    slowest, before = max(slowest, done or PATIENCE_S), before + hit
                    whole = not differences(folder, wanted)
                    wrong = list(faults(trial, number, done, whole=whole)) if hit else []
                    wrong += resumed(scene, folder, wanted, ranks)
                    for fault in wrong:
                        print(f"seed {options.seed}, {ranks} ranks, {how}, case {case}: {fault}", file=sys.stderr)
                    if wrong:
                        print(trial.said()[-2000:], file=sys.stderr)
                    found.update(wrong)
                    shutil.rmtree(folder, ignore_errors=True)
                bad += found.total()
                said = "; ".join(f"{n} x {fault}" for fault, n in found.items()) or "0"
                print(row(ranks, how, count, before, f"{slowest:.2g}", said), flush=True)
    print(f"\nSeed {options.seed}.")
    return int(bad > 0)
