"""Does any scene, however odd, end in a traceback, a crash, a hang or a wrong answer without a doubt?

    python -m tests.benchmarks scene_fuzz [-n 2000] [--seed 1] [--first 0] [--quick]

Built-in scenes and those of mesh files, kept small, with one to six keys of the schema overridden by values sane and
insane. Each is read, checked and computed in a process of its own with 20 s and 3 GB; one in 25 with its folder. Ends
with 1 where one was neither computed soundly nor refused in one line. A case is told by its seed and number.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from macrofit.base.toml import parse_toml
from macrofit.bodies.outlook import first_touch
from macrofit.friction import registry
from macrofit.results.doubts import ENERGY_BALANCE
from macrofit.results.foresight import foreseen
from macrofit.results.summary import sentences, summary
from macrofit.run import carry_out
from macrofit.scene import Scene, build_scene, dump_scene, idle_keys, load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

from ._fuzz import COMPUTED, DOUBTED, SILENT, DrawnCase, Fuzz, Judged
from ._scene_cases import BASES, Case, drawn, small, write_files

FUZZ = Fuzz(
    name="scene_fuzz", about=__doc__, count=2000, quick=30, column="scene", kinds=tuple(BASES), most_cpu_s=20,
    most_wall_s=60.0,
)  # fmt: skip
SOUND_BALANCE = 1e-6
"""Largest force that may be missing between the bodies and their supports, over the largest."""
WITH_FOLDER = 25


def main(words: Sequence[str]) -> int:
    """Print a row of each built-in scene; 1 where any case was wrong."""
    options = FUZZ.options(words)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_files(folder)
        warm(folder)

        def case(seed: int, number: int) -> DrawnCase:
            found = drawn(seed, number, folder)
            return DrawnCase(kind=found.base, said=str(found), judge=partial(computed, found, folder, number))

        return FUZZ.run(options, case)


def warm(folder: Path) -> None:
    """Let all be imported and compiled before processes are made of this one."""
    scene = small(load_scene("wheelset", BASES["wheelset"]))
    carry_out(scene, MPI.COMM_SELF, folder / "warm", resume=False, quiet=True)


def computed(case: Case, folder: Path, number: int) -> Judged:
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


def held(scene: Scene, solution: Solution) -> Judged:
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
