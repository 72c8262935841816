"""How exact is a press-fit whose steel yields, what do the increments change, and what does it cost?

    python -m tests.benchmarks plastic_accuracy [--quick]

`wheelset` with linear kinematic hardening of 5 GPa. First table: 180 mm with several yield stresses beside the elastic
run. Second table: 420 MPa up to 100 mm with increments of 2, 1 and 0.5 mm against 0.125 mm, and what closes the energy
balance. CPU times are of runs in one process, each beside an elastic one with the same increments. What it must show:
with 1 mm the force within 0.2 % and the plastic strain within 5 % of the finest, and the energy balance within 1e-3.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from macrofit.scene import load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

from ._measure import head, row

KINEMATIC = 5000.0
YIELDS = (540.0, 420.0, 350.0)
INCREMENTS = (2.0, 1.0, 0.5)
FINEST = 0.125
NO_FIELDS = ("output.fields_at=[]", "output.frames=0")
COARSE = ("mesh.seat_facet=4", "mesh.coarse=40")
BODIES = ("axle", "wheel")


def steel(stress: float) -> tuple[str, ...]:
    """Overrides: both bodies yield at a stress [MPa] and harden kinematically."""
    hardening = ("hardening.law=linear", f"hardening.kinematic={KINEMATIC}")
    return tuple(f"{body}.material.{key}" for body in BODIES for key in (f"yield_stress={stress}", *hardening))


def run(travel: float, increment: float, *overrides: str) -> Solution:
    """`wheelset` up to a travel in increments [mm]."""
    motion = (f"motion.travel={travel}", f"motion.increment={increment}")
    return solve(load_scene("wheelset", [*motion, *NO_FIELDS, *overrides]))


def per_increment(solution: Solution) -> float:
    """CPU milliseconds of an increment."""
    return 1e3 * solution.increments_cpu_s / len(solution.increments)


def iterations(solution: Solution) -> float:
    """Plastic iterations of an increment, on average over those in contact."""
    counts = [record.plastic_iterations for record in solution.increments if record.active_facets]
    return sum(counts) / max(len(counts), 1)


def strains(solution: Solution) -> str:
    """Largest plastic strain of axle and wheel, in per cent."""
    return " / ".join(f"{100.0 * solution.flowed[body].value:.2f}" for body in BODIES)


def by_yield(travel: float, increment: float, coarse: Sequence[str]) -> None:
    """Print the first table."""
    elastic = run(travel, increment, *coarse)
    print(
        head(
            "yield [MPa]", f"force at {travel:g} mm [kN]", "von Mises axle / wheel [MPa]",
            "plastic strain axle / wheel [%]", "flowed down to axle / wheel [mm]", "iterations", "CPU ms an increment",
            "energy balance",
        )
    )  # fmt: skip
    for stress in (None, *YIELDS):
        solution = elastic if stress is None else run(travel, increment, *coarse, *steel(stress))
        share = solution.force[-1] / elastic.force[-1] - 1.0
        depth = " / ".join(f"{zone.depth_mm:.1f}" for zone in solution.flowed.values())
        print(
            row(
                "elastic" if stress is None else f"{stress:g}",
                f"{solution.force[-1] / 1e3:.0f}" + ("" if stress is None else f" ({share:+.1%})"),
                " / ".join(f"{solution.max_von_mises[body].value:.0f}" for body in BODIES),
                "" if stress is None else strains(solution), depth,
                "" if stress is None else f"{iterations(solution):.1f}", f"{per_increment(solution):.1f}",
                f"{solution.energy_balance:.1e}",
            ),
            flush=True,
        )  # fmt: skip


def by_increment(travel: float, increments: Sequence[float], finest: float, coarse: Sequence[str]) -> None:
    """Print the second table."""
    yields = steel(420.0)
    reference = run(travel, finest, *coarse, *yields)
    print(
        head(
            "increment [mm]", f"force at {travel:g} mm [kN]", "difference", "plastic strain axle / wheel [%]",
            "difference of the largest", "energy balance", "iterations", "cutbacks", "CPU ms an increment",
            "the elastic run's", "ratio",
        )
    )  # fmt: skip
    largest = max(reference.flowed[body].value for body in BODIES)
    for increment in (*increments, finest):
        elastic = run(travel, increment, *coarse)
        solution = reference if increment == finest else run(travel, increment, *coarse, *yields)
        force = solution.force[-1] / reference.force[-1] - 1.0
        strain = max(solution.flowed[body].value for body in BODIES) / largest - 1.0
        beside = "" if increment == finest else f"{force:+.2%}", "" if increment == finest else f"{strain:+.1%}"
        print(
            row(
                f"{increment:g}", f"{solution.force[-1] / 1e3:.1f}", beside[0], strains(solution), beside[1],
                f"{solution.energy_balance:.1e}", f"{iterations(solution):.1f}",
                sum(record.cutbacks for record in solution.increments), f"{per_increment(solution):.1f}",
                f"{per_increment(elastic):.1f}", f"{per_increment(solution) / per_increment(elastic):.1f}",
            ),
            flush=True,
        )  # fmt: skip


def main(words: Sequence[str]) -> int:
    """Print the two tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks plastic_accuracy", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse meshes and a short way")
    options = parser.parse_args(words)
    run(30.0, 5.0, *COARSE, *steel(420.0))
    if options.quick:
        by_yield(30.0, 5.0, COARSE)
        print()
        by_increment(30.0, (5.0,), 2.5, COARSE)
        return 0
    by_yield(180.0, 1.0, ())
    print()
    by_increment(100.0, INCREMENTS, FINEST, ())
    return 0
