"""What is the limit load of an ideally plastic press-fit, and where does a run end in it?

    python -m tests.benchmarks plastic_limit [--quick]

`wheelset` of 250 MPa on 3 mm facets (preset fast), pressed 45 mm. A surface bears k = 250 / sqrt(3) = 144 MPa of shear
and no more, unless the steel hardens. Where friction would hold more, mu p > k, the wheel does not slide there: the
steel flows along the surface, by as much as the wheel moves, and in one row of elements. First table: ideal plasticity
with more and more friction, then the roughest with a little hardening. Given is friction's largest share of k on the
way, the largest plastic strain, and how much of the press's work of the last 10 mm the steel took. Second table: the
force of ideal and of hardening steel in steps of 2, 1 and 0.5 mm. The steel's share is above 100 % where elastic energy
is let go.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

from macrofit.base.errors import MacrofitError
from macrofit.scene import load_scene
from macrofit.solution import Increment
from macrofit.solve import solve

from ._measure import head, row

STRESS = 250.0
FRICTION = (0.11, 0.2, 0.25, 0.3)
KINEMATIC = (50.0, 200.0, 2000.0)
INCREMENTS = (2.0, 1.0, 0.5)
LAST = 10.0
"""How far back from the end work is summed [mm]."""


class Kept:
    """A monitor that keeps the increments, those before an error too."""

    def __init__(self) -> None:
        self.records: list[Increment] = []

    def started(self, *_: object) -> None:
        """Nothing to do."""

    def increment(self, record: Increment) -> None:
        """Keep one."""
        self.records.append(record)

    def finished(self) -> None:
        """Nothing to do."""


def press(travel: float, increment: float, friction: float, kinematic: float) -> tuple[list[Increment], str]:
    """The increments of a run of `wheelset`, and the error it ended in."""
    keys = (f"yield_stress={STRESS}", "hardening.law=linear", f"hardening.kinematic={kinematic}")
    steel = [f"{body}.material.{key}" for body in ("axle", "wheel") for key in keys]
    way = [f"motion.travel={travel}", f"motion.increment={increment}", f"friction.options.coefficient={friction}"]
    kept = Kept()
    try:
        solve(
            load_scene("wheelset", ["preset=fast", "output.stress=false", "output.fields_at=[]", *steel, *way]),
            monitor=kept,
        )
    except MacrofitError as error:
        return kept.records, str(error)
    return kept.records, ""


def cells(records: list[Increment], friction: float) -> list[str]:
    """What the first table says of a run."""
    most = max(friction * record.max_pressure for record in records) / (STRESS / math.sqrt(3.0))
    end = records[-1]
    last = [record for record in records if record.displacement > end.displacement - LAST]
    share = sum(record.plastic_work for record in last) / sum(record.work for record in last)
    against = end.force / (friction * end.normal_force)
    return [
        f"{end.displacement:g}", f"{most:.2f}", f"{100.0 * end.plastic_strain:.3g}", f"{100.0 * share:.0f}",
        f"{1e-3 * end.force:.0f}", f"{against:.2f}", f"{sum(r.plastic_iterations for r in records) / len(records):.0f}",
    ]  # fmt: skip


def reached(records: list[Increment], error: str) -> str:
    """The last force of a run [kN], and where it is where it ended in an error."""
    end = records[-1]
    return f"{1e-3 * end.force:.0f}" + (f" at {end.displacement:g} mm, where it ends" if error else "")


def main(words: Sequence[str]) -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks plastic_limit", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a short way")
    options = parser.parse_args(words)
    travel = 16.0 if options.quick else 45.0
    print(
        head(
            "H [MPa]", "friction", "displacement [mm]", "mu p / k", "plastic strain [%]",
            f"steel's share of the work of the last {LAST:g} mm [%]", "force [kN]", "force / mu N", "iterations", "end",
        )
    )  # fmt: skip
    for kinematic, friction in [*((0.0, mu) for mu in FRICTION), *((h, FRICTION[-1]) for h in KINEMATIC)]:
        records, error = press(travel, 1.0, friction, kinematic)
        print(row(f"{kinematic:g}", friction, *cells(records, friction), error or "converged"), flush=True)
    print("\n" + head("H [MPa]", "friction", *(f"force [kN], {each:g} mm" for each in INCREMENTS)))
    for kinematic, friction in ((0.0, FRICTION[0]), (0.0, FRICTION[-1]), (KINEMATIC[-1], FRICTION[-1])):
        forces = [reached(*press(travel, each, friction, kinematic)) for each in INCREMENTS]
        print(row(f"{kinematic:g}", friction, *forces), flush=True)
    return 0
