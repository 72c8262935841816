"""Does any scene, however odd, end in a traceback, a crash, a hang or a wrong answer without a doubt?

    python -m tests.benchmarks scene_fuzz [-n 2000] [--seed 1] [--first 0] [--quick]

Built-in scenes and those of mesh files, kept small, with one to six keys of the schema overridden by values sane and
insane. Each is read, checked and computed in a process of its own with 20 s and 3 GB; one in 25 with its folder. Ends
with 1 where one was neither computed soundly nor refused in one line. A case is told by its seed and number.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from macrofit.base.toml import parse_toml
from macrofit.bodies.outlook import first_touch
from macrofit.errors import MacrofitError
from macrofit.friction import registry
from macrofit.results.doubts import ENERGY_BALANCE
from macrofit.results.foresight import foreseen
from macrofit.results.summary import sentences, summary
from macrofit.run import carry_out
from macrofit.scene import Scene, build_scene, dump_scene, idle_keys, load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

from ._alone import ABORTED, UNFINISHED, alone
from ._measure import head, row
from ._scene_cases import BASES, Case, drawn, small, write_files

QUICK = 30
MOST_CPU_S, MOST_BYTES = 20, 3 * 10**9
SOUND_BALANCE = 1e-6
"""Largest force that may be missing between the bodies and their supports, over the largest."""
WITH_FOLDER = 25
COMPUTED, DOUBTED, REFUSED = "computed", "computed, doubted", "refused in a line"
TRACEBACK, ABORT, LATE, SILENT = "tracebacks", "aborts", f"unfinished in {MOST_CPU_S} s", "wrong without a doubt"
GOOD, BAD = (COMPUTED, DOUBTED, REFUSED), (TRACEBACK, ABORT, LATE, SILENT)


def main(words: Sequence[str]) -> int:
    """Print a row of each built-in scene; 1 where any case was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks scene_fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=2000, help="how many")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--told", action="store_true", help="say what became of each, on stderr")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} cases")
    options = parser.parse_args(words)
    count = QUICK if options.quick else options.n
    counted: dict[str, Counter[str]] = {base: Counter() for base in BASES}
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_files(folder)
        warm(folder)
        for number in range(options.first, options.first + count):
            case = drawn(options.seed, number, folder)
            said, why = bounded(case, folder, number)
            counted[case.base][said] += 1
            line = f"{said}: {number} of seed {options.seed}: {case}: {why}"
            wrong += [line] if said in BAD else []
            if options.told or said in BAD:
                print(line, file=sys.stderr, flush=True)
    print(head("scene", "cases", *GOOD, *BAD))
    for base, counts in [*counted.items(), ("all", sum(counted.values(), Counter()))]:
        print(row(base, counts.total(), *(counts[said] for said in (*GOOD, *BAD))))
    print(f"\nSeed {options.seed}, numbers {options.first} to {options.first + count - 1}.")
    print("".join(f"\n- {line.splitlines()[0]}" for line in wrong))
    return int(bool(wrong))


def warm(folder: Path) -> None:
    """Let all be imported and compiled before processes are made of this one."""
    scene = small(load_scene("wheelset", BASES["wheelset"]))
    carry_out(scene, MPI.COMM_SELF, folder / "warm", resume=False, quiet=True)


def bounded(case: Case, folder: Path, number: int) -> tuple[str, str]:
    """What became of a case in a process of its own, and why."""
    told, how = alone(lambda: "\n".join(judge(case, folder, number)), most_cpu_s=MOST_CPU_S, most_bytes=MOST_BYTES)
    if how in (ABORTED, UNFINISHED):
        return ABORT if how == ABORTED else LATE, told
    said, _, why = told.partition("\n")
    return said, why


def judge(case: Case, folder: Path, number: int) -> tuple[str, str]:
    """Read, check and compute a scene; what became of it, and why."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            return computed(case, folder, number)
    except MacrofitError as error:
        line = str(error)
        return (REFUSED, line) if line.strip() and "\n" not in line else (TRACEBACK, f"no line: {error}")
    except (Exception, SystemExit):
        return TRACEBACK, traceback.format_exc()


def computed(case: Case, folder: Path, number: int) -> tuple[str, str]:
    """As the commands `check` and `run` do, the second with the small scene."""
    scene = load_scene(case.source(folder), case.overrides)
    idle_keys(scene)
    registry.load(scene.friction.provider, scene.friction.options)
    first_touch(scene)
    foreseen(scene)
    if build_scene(parse_toml(dump_scene(scene), "scene.toml")) != scene:
        return SILENT, "the scene is written otherwise than it is"
    few = small(scene)
    if number % WITH_FOLDER == 0:
        carry_out(few, MPI.COMM_SELF, folder / str(number), resume=False, quiet=True)
    return held(few, solve(few, MPI.COMM_SELF))


def held(scene: Scene, solution: Solution) -> tuple[str, str]:
    """A solution against what any must be, whatever its scene."""
    numbers = summary(solution)
    sentences(numbers)
    doubts: list[str] = numbers["doubts"]
    told = {sentence.partition(":")[0] for sentence in doubts}
    if not solution.energy_balance <= ENERGY_BALANCE and "energy balance" not in told:
        return SILENT, f"energy balance {solution.energy_balance:.2g}"
    if not np.isfinite([(each.force, each.normal_force, each.strain_energy) for each in solution.increments]).all():
        return SILENT, "not finite"
    if solution.force_balance is not None and not solution.force_balance <= SOUND_BALANCE:
        return SILENT, f"force balance {solution.force_balance:.2g}"
    if len(solution.increments) < len(scene.displacements):
        return SILENT, "increments are missing"
    return (DOUBTED, "; ".join(doubts)) if doubts else (COMPUTED, "")
