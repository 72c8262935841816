"""What does rough friction cost: the enriched fit against the uniform one, and a study against a single run?

    python -m tests.benchmarks enriched_cost [--quick] [--seeds N]

CPU seconds of `wheelset` on one core, beyond imports, in one process: uniform, on the network (the share of the
provider beside it), the paper's six curves (five micro coefficients and uniform 0.11) in lockstep and one after the
other on one assembly, and the identification of the micro coefficient of the uniform curve. Then the whole commands, in
processes of their own. Medians of three, in turns. `--seeds 200` adds a study of surfaces on two ranks.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from macrofit.assembly import Assembly, assemble
from macrofit.base.arrays import FloatArray
from macrofit.friction import FrictionField
from macrofit.identify.fit import identify
from macrofit.identify.measured import Measured
from macrofit.lockstep.solve import Run, solve_together
from macrofit.monitor import Silent
from macrofit.scene import Scene, load_scene
from macrofit.solution import Solution
from macrofit.solve import solve
from tests.launcher import launcher_environment

from ._measure import head, row
from .startup import Command
from .startup import started as command_cost

ROOT = Path(__file__).parents[2]

MICRO = (0.01, 0.03, 0.05, 0.07, 0.09)


class Watch:
    """Adds up the time that friction fields spend in asking their providers."""

    def __init__(self) -> None:
        self.cpu_s = 0.0
        self._asked = FrictionField._asked

    def __enter__(self) -> Watch:
        watch, asked = self, self._asked

        def timed(field: FrictionField, *arguments: Any) -> Any:
            started = time.process_time()
            try:
                return asked(field, *arguments)
            finally:
                watch.cpu_s += time.process_time() - started

        FrictionField._asked = timed  # type: ignore[method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        FrictionField._asked = self._asked  # type: ignore[method-assign]


def timed(*overrides: str) -> tuple[float, float, dict[str, int]]:
    """CPU seconds of a run from its scene on, those of its provider, and its counters."""
    scene = load_scene("wheelset", overrides)
    started = time.process_time()
    with Watch() as watch:
        solution = solve(scene)
    return time.process_time() - started, watch.cpu_s, solution.counters


def scenes_of(seed: int, *overrides: str) -> list[Scene]:
    """The six scenes of the paper's figure: uniform 0.11 and five micro coefficients."""
    changes = ["friction.provider=surrogate", f"friction.options.seed={seed}"]
    return [
        load_scene("wheelset", overrides),
        *(load_scene("wheelset", [*overrides, *changes, f"friction.options.micro_friction={mu}"]) for mu in MICRO),
    ]


class Study(NamedTuple):
    """What six runs took."""

    cpu_s: float
    bodies: int  # factorisations
    interface: int
    forces: list[FloatArray]


def study(seed: int, *overrides: str) -> Study:
    """The six runs in lockstep, as `macrofit study` has them."""
    scenes = scenes_of(seed, *overrides)
    started = time.process_time()
    assembly = assemble(scenes[0], MPI.COMM_SELF)
    runs = [Run(scene=scene, monitor=Silent()) for scene in scenes]
    found = solve_together(runs, MPI.COMM_SELF, assembly)
    return _told([each for each in found if isinstance(each, Solution)], started, assembly)


def run_by_run(seed: int, *overrides: str) -> Study:
    """The six runs one after the other, on one assembly."""
    scenes = scenes_of(seed, *overrides)
    started = time.process_time()
    assembly = assemble(scenes[0], MPI.COMM_SELF)
    return _told([solve(scene, MPI.COMM_SELF, assembly=assembly) for scene in scenes], started, assembly)


def _told(found: Sequence[Solution], started: float, assembly: Assembly) -> Study:
    taken = time.process_time() - started
    interface = sum(solution.counters["interface_factorisations"] for solution in found)
    return Study(taken, assembly.work()["factorisations"], interface, [solution.force for solution in found])


def identification(seed: int, target: Solution, *overrides: str) -> tuple[float, int]:
    """CPU seconds and curves of finding the micro coefficient that matches the uniform one."""
    changes = ["friction.provider=surrogate", f"friction.options.seed={seed}", "friction.options.fallback=warning"]
    measured = Measured(target.displacement, target.force)
    started = time.process_time()
    found = identify("wheelset", measured, [*overrides, *changes], comm=MPI.COMM_SELF)
    return time.process_time() - started, found.runs


def commands(repeats: int, *overrides: str) -> tuple[float, float]:
    """CPU seconds of the whole commands, start and figures included: a run on the network, and the study."""
    changes = " ".join(f"--set {override}" for override in (*overrides, "friction.provider=surrogate"))
    vary = f"--vary friction.options.micro_friction={','.join(map(str, MICRO))} --reference uniform=0.11"
    both = [Command(f"macrofit run wheelset {changes}"), Command(f"macrofit study wheelset {changes} {vary}")]
    taken = [[command_cost(command)[1] for command in both] for _ in range(repeats + 1)][1:]  # the first one warms
    run, six = (median(each) for each in zip(*taken, strict=True))
    return run, six


def surfaces(seeds: int, *overrides: str) -> None:
    """Print how long a study of so many surfaces takes on two ranks, on the clock."""
    words = [each for override in (*overrides, "friction.provider=surrogate") for each in ("--set", override)]
    with TemporaryDirectory() as folder:
        begun = time.perf_counter()
        command = ["study", "wheelset", *words, "--vary", f"friction.options.seed=1:{seeds}", "-o", f"{folder}/out"]
        subprocess.run(
            ["mpirun", "-n", "2", sys.executable, "-m", "macrofit", *command, "--quiet"],
            cwd=ROOT, env=launcher_environment(), check=True,
        )  # fmt: skip
    print(f"\n{seeds} surfaces on two ranks: {time.perf_counter() - begun:.0f} s on the clock.")


def difference(one: Sequence[FloatArray], two: Sequence[FloatArray]) -> float:
    """Largest difference of forces, relative to the largest of each run."""
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(one, two, strict=True))


def main(words: Sequence[str]) -> int:
    """Print the table; 1 where bodies are factored more often than once, or lockstep changes a force by 1e-9."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks enriched_cost", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="A coarse mesh, few increments, once, no commands.")
    parser.add_argument("--seeds", type=int, default=0, help="A study of so many surfaces on two ranks as well.")
    options = parser.parse_args(words)
    small = ["mesh.seat_facet=5", "motion.travel=40", "motion.increment=5"] if options.quick else []
    repeats = 1 if options.quick else 3
    seeds = iter(range(1, 100))
    timed(*small), timed(*small, "friction.provider=surrogate", "friction.options.seed=0")  # warm
    uniform, rough, studies, singly, found = [], [], [], [], []
    target = solve(load_scene("wheelset", [*small, "output.stress=false", "output.fields=[]"]))
    for _ in range(repeats):  # in turns: a machine's mood cancels out
        seed = next(seeds)
        uniform.append(timed(*small))
        rough.append(timed(*small, "friction.provider=surrogate", f"friction.options.seed={next(seeds)}"))
        studies.append(study(seed, *small))
        singly.append(run_by_run(seed, *small))
        found.append(identification(next(seeds), target, *small))
    one = median(cpu for cpu, _, _ in rough)
    asking = median(cpu for _, cpu, _ in rough)
    six, each, identified = (median(row[0] for row in rows) for rows in (studies, singly, found))
    alone, pairs = rough[0][2]["factorisations"], rough[0][2]["pairs_asked"]
    apart = max(difference(a.forces, b.forces) for a, b in zip(studies, singly, strict=True))
    print(head("", "CPU s", "of the enriched run", "pairs", "factorisations", "of the interface"))
    print(row("uniform", f"{median(cpu for cpu, _, _ in uniform):.2f}", "", "", alone, ""))
    print(row("enriched", f"{one:.2f}", 1, pairs, alone, rough[0][2]["interface_factorisations"]))
    print(row("of it the provider", f"{asking:.2f}", f"{asking / one:.0%}", "", "", ""))
    print(row("study of five and a reference", f"{six:.2f}", f"{six / one:.2f}", "", *studies[0][1:3]))
    print(row("the same, run by run", f"{each:.2f}", f"{each / one:.2f}", "", *singly[0][1:3]))
    print(row(f"identify, {found[0][1]} curves", f"{identified:.2f}", f"{identified / one:.2f}", "", "", ""))
    if not options.quick:
        run, whole = commands(repeats, *small)
        print(row("command `run`, enriched", f"{run:.2f}", "", "", "", ""))
        print(row("command `study` of the six", f"{whole:.2f}", f"{whole / run:.2f} of the command", "", "", ""))
    print(f"\nLockstep changes a force by {apart:.0e} of the run's largest at most.")
    if options.seeds:
        surfaces(options.seeds, *small)
    return int(studies[0].bodies != alone or apart > 1e-9)
