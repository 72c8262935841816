"""What does rough friction cost: the enriched fit against the uniform one, and a study against a single run?

    python -m tests.benchmarks enriched_cost [--quick]

CPU seconds of `wheelset` on one core, beyond imports, in one process: uniform, on the network (the share of the
provider beside it), and the paper's six curves (five micro coefficients and uniform 0.11) on one assembly. Medians of
three.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from statistics import median
from typing import Any

from mpi4py import MPI

from macrofit.assembly import assemble
from macrofit.friction import FrictionField
from macrofit.scene import load_scene
from macrofit.solve import solve

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


def study(seed: int, *overrides: str) -> tuple[float, int]:
    """CPU seconds and factorisations of the six runs."""
    changes = ["friction.provider=surrogate", f"friction.options.seed={seed}"]
    scenes = [load_scene("wheelset", overrides)]
    scenes += [load_scene("wheelset", [*overrides, *changes, f"friction.options.micro_friction={mu}"]) for mu in MICRO]
    started = time.process_time()
    assembly = assemble(scenes[0], MPI.COMM_SELF)
    for scene in scenes:
        solve(scene, MPI.COMM_SELF, assembly=assembly)
    return time.process_time() - started, assembly.work()["factorisations"]


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks enriched_cost", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="A coarse mesh, few increments, once.")
    options = parser.parse_args(words)
    small = ["mesh.seat_facet=5", "motion.travel=40", "motion.increment=5"] if options.quick else []
    repeats = 1 if options.quick else 3
    seeds = iter(range(1, 100))
    timed(*small), timed(*small, "friction.provider=surrogate", "friction.options.seed=0")  # warm
    uniform = [timed(*small) for _ in range(repeats)]
    rough = [
        timed(*small, "friction.provider=surrogate", f"friction.options.seed={next(seeds)}") for _ in range(repeats)
    ]
    one = median(cpu for cpu, _, _ in rough)
    asking = median(cpu for _, cpu, _ in rough)
    studies = [study(next(seeds), *small) for _ in range(repeats)]
    six, factorisations = median(cpu for cpu, _ in studies), studies[0][1]
    alone = rough[0][2]["factorisations"]
    print("| | CPU s | of the enriched run | pairs | factorisations |")
    print("|---|---|---|---|---|")
    print(f"| uniform | {median(cpu for cpu, _, _ in uniform):.2f} | | | {alone} |")
    print(f"| enriched | {one:.2f} | 1 | {rough[0][2]['pairs_asked']} | {alone} |")
    print(f"| of it the provider | {asking:.2f} | {asking / one:.0%} | | |")
    print(f"| study of five and a reference | {six:.2f} | {six / one:.2f} | | {factorisations} |")
    return int(factorisations != alone)
