"""What does a press-fit cost on each mesh, and what does condensing it on the interface save?

    python -m tests.benchmarks cost [--quick]

For each mesh of `wheelset`: unknowns, CPU seconds of the set-up and of the whole run of 180 increments, CPU
milliseconds of an increment, the same by the monolithic solver (five increments at 90 mm, where half the seat is in
contact), and the differences of the final force and of the largest von Mises stress from P2 with 0.25 mm facets.
Every time is the median of three runs of a warm process, with its range for the whole run; the two solvers are
compared at the same five increments, in turn. What else a choice changes, and which is best, says work_precision.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from statistics import median

from macrofit.scene import load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

from ._measure import Cost, head, row

# order, seat facet [mm], growth of the elements away from the contact line
MESHES = [
    (1, 2.0, 0.35),
    (1, 1.0, 0.35),
    (1, 0.5, 0.35),
    (2, 2.0, 0.35),
    (2, 1.0, 0.35),
    (2, 1.0, 0.24),
    (2, 0.5, 0.35),
]
PART = ("motion.start=86", "motion.travel=90", "output.stress=false", "output.fields_at=[]")


def run(order: int, facet: float, *overrides: str) -> Solution:
    """One run of `wheelset` on a mesh of an order and a facet length [mm]."""
    return solve(load_scene("wheelset", [f"mesh.order={order}", f"mesh.seat_facet={facet}", *overrides]))


def per_increment(solution: Solution) -> float:
    """CPU milliseconds of an increment."""
    return 1e3 * solution.increments_cpu_s / len(solution.increments)


def measured(order: int, facet: float, growth: float, repeats: int, reference: Solution) -> str:
    """One line of the table."""
    graded = f"mesh.growth={growth}"
    run(order, facet, graded, *PART)
    runs = [run(order, facet, graded) for _ in range(repeats)]
    last = runs[-1]
    total = Cost(tuple(s.setup_cpu_s + s.increments_cpu_s + s.stress_cpu_s for s in runs))
    condensed, monolithic = [], []
    for _ in range(repeats):
        condensed.append(per_increment(run(order, facet, graded, *PART)))
        monolithic.append(per_increment(run(order, facet, graded, *PART, 'solver="monolithic"')))
    force = last.force[-1] / reference.force[-1] - 1.0
    stress = [last.max_von_mises[b].value / reference.max_von_mises[b].value - 1.0 for b in ("axle", "wheel")]
    grading = "" if growth == MESHES[0][2] else f", growth {growth:g}"
    return row(
        f"P{order}, {facet:g} mm{grading}", f"{last.dofs / 1000:.1f}k", f"{median(s.setup_cpu_s for s in runs):.2f}",
        f"{median(per_increment(s) for s in runs):.1f}", total, f"{median(condensed):.1f} / {median(monolithic):.0f}",
        f"{median(monolithic) / median(condensed):.0f}", f"{force:+.1e}", f"{stress[0]:+.1%}, {stress[1]:+.1%}",
    )  # fmt: skip


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks cost", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="Two coarse meshes, once.")
    options = parser.parse_args(words)
    meshes = [(1, 4.0, 0.35), (2, 4.0, 0.35)] if options.quick else MESHES
    reference = run(2, 2.0 if options.quick else 0.25)
    print(
        head(
            "mesh", "dofs", "set-up CPU s", "increment CPU ms", "run CPU s", "condensed / monolithic CPU ms", "ratio",
            "force", "von Mises axle, wheel",
        )
    )  # fmt: skip
    for order, facet, growth in meshes:
        print(measured(order, facet, growth, 1 if options.quick else 3, reference), flush=True)
    return 0
