"""Does every increment of every built-in scene converge when its steel yields, however soft and however rough?

    python -m tests.benchmarks plastic_stability [SCENE ...] [--set key=value ...] [--quick]

Every built-in scene with yield stresses of 250 to 540 MPa, linear kinematic hardening of 0, 2 and 10 GPa, and friction
of 0, 0.11 and 0.3, each on its own mesh. `wheelset` and `wheelset-en` go 60 mm: both edges have passed by then, and the
plastic zone only grows longer; the softest and roughest go their whole way. A run ends converged, or in one line that
says what is wrong, a limit load for one: friction holds more than the surface of an ideally plastic body bears in
shear. A run that ends is judged by its doubts, and by what must hold whatever the scene: forces in balance, and no
stress beyond the yield stress and what hardening adds to it. What breaks that without a doubt is silently wrong. Ends
with 1 where an increment that was accepted did not converge, or a run was silently wrong.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from macrofit.errors import MacrofitError
from macrofit.results.doubts import doubts
from macrofit.scene import load_scene, scene_names
from macrofit.solution import Solution
from macrofit.solve import solve

from ._measure import head, row

YIELDS = (250.0, 350.0, 420.0, 540.0)
KINEMATIC = (0.0, 2e3, 1e4)
FRICTION = (0.0, 0.11, 0.3)
QUICK = ("contact-patch", "lame-rings")
TRAVEL = {"wheelset": 60.0, "wheelset-en": 60.0}
"""How far the press goes where the plastic zone is developed before the scene ends [mm]."""
LIMIT_LOAD = "its limit load"
"""What an error says that no iteration could help."""

BALANCE = 1e-9
"""Largest |pushing force - reaction| over the force."""
BEYOND = 1e-2
"""Largest part of the yield stress by which a stress may lie beyond it."""
LEFT = 1e-3
"""The same of the stress that the plastic strain stands for: the iterations leave as much of a step's flow."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run: its scene, and how both bodies yield and rub."""

    scene: str
    stress: float
    kinematic: float
    friction: float

    @property
    def overrides(self) -> list[str]:
        """What is changed in the scene."""
        hardening = ("hardening.law=linear", f"hardening.kinematic={self.kinematic}")
        steel = (f"yield_stress={self.stress}", *hardening)
        uniform = ("friction.provider=uniform", f"friction.options={{coefficient = {self.friction}}}")
        bodies = [f"{body}.material.{key}" for body in ("axle", "wheel") for key in steel]
        hardest = (self.stress, self.friction) == (YIELDS[0], FRICTION[-1])
        shorter = [] if hardest or self.scene not in TRAVEL else [f"motion.travel={TRAVEL[self.scene]}"]
        return [*bodies, *uniform, *shorter, "output.fields_at=[]", "output.frames=0"]

    def __str__(self) -> str:
        """In a line."""
        return f"{self.scene}, yield {self.stress:g} MPa, H {self.kinematic:g} MPa, friction {self.friction:g}"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a case ended."""

    case: Case
    solution: Solution | None
    error: str = ""
    doubts: tuple[str, ...] = ()
    broken: tuple[str, ...] = ()

    @property
    def unconverged(self) -> bool:
        """Whether it accepted an increment that did not converge."""
        return self.solution is not None and not all(record.converged for record in self.solution.increments)

    @property
    def limit(self) -> bool:
        """Whether it ended because the steel bears no more."""
        return LIMIT_LOAD in self.error

    @property
    def silent(self) -> bool:
        """Whether something is wrong and nothing was said."""
        return bool(self.broken) and not self.doubts


def broken(case: Case, solution: Solution) -> Iterator[str]:
    """What must hold and does not."""
    numbers = [solution.energy_balance, solution.force_balance or 0.0, *solution.force]
    if not np.isfinite(numbers).all():
        yield "a number that is none"
    if (solution.force_balance or 0.0) > BALANCE:
        yield f"forces out of balance by {solution.force_balance:.1e}"
    for body, extreme in solution.max_von_mises.items():
        strain, modulus = solution.flowed[body].value, getattr(solution.scene, body).material.shear_modulus
        reach = case.stress * (1.0 + BEYOND) + (case.kinematic + LEFT * 3.0 * modulus) * strain
        if extreme.value > reach:
            yield f"{extreme.value:.4g} MPa in the {body}, beyond {reach:.4g}"


def run(case: Case, overrides: Sequence[str] = ()) -> Outcome:
    """Solve a case and judge what it leaves."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            solution = solve(load_scene(case.scene, [*case.overrides, *overrides]))
    except MacrofitError as error:
        return Outcome(case=case, solution=None, error=f"{type(error).__name__}: {error}")
    told = tuple(doubts(solution))
    return Outcome(case=case, solution=solution, doubts=told, broken=tuple(broken(case, solution)))


def line(scene: str, outcomes: Sequence[Outcome]) -> str:
    """A scene's row of the table."""
    solutions = [outcome.solution for outcome in outcomes if outcome.solution is not None]
    records = [record for solution in solutions for record in solution.increments]
    sound = [o.solution.energy_balance for o in outcomes if o.solution is not None and not o.doubts]
    return row(
        scene,
        len(outcomes),
        len(records),
        sum(outcome.unconverged for outcome in outcomes),
        sum(outcome.limit for outcome in outcomes),
        sum(bool(outcome.error) and not outcome.limit for outcome in outcomes),
        sum(record.cutbacks for record in records),
        sum(bool(outcome.doubts) for outcome in outcomes),
        sum(outcome.silent for outcome in outcomes),
        max((record.plastic_iterations for record in records), default=0),
        f"{np.mean([record.plastic_iterations for record in records] or [0]):.1f}",
        f"{max(sound, default=0.0):.1e}",
        f"{max((record.plastic_strain for record in records), default=0.0):.2g}",
    )


def main(words: Sequence[str]) -> int:
    """Run all cases; print a row of each scene, and what was said of which run."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks plastic_stability", description=__doc__)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="built-in scenes; all of them by default")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--quick", action="store_true", help="two scenes and elements of order 1")
    options = parser.parse_args(words)
    if options.quick:
        options.scenes, options.overrides = QUICK, [*options.overrides, "mesh.order=1"]
    print(
        head(
            "scene", "runs", "increments", "not converged", "limit load", "other clear error", "cutbacks", "doubtful",
            "silently wrong", "most iterations in one", "on average", "energy balance without a doubt",
            "largest plastic strain",
        )
    )  # fmt: skip
    every: list[Outcome] = []
    for scene in options.scenes or scene_names():
        outcomes = []
        for stress, kinematic, friction in product(YIELDS, KINEMATIC, FRICTION):
            case = Case(scene=scene, stress=stress, kinematic=kinematic, friction=friction)
            outcomes.append(run(case, options.overrides))
            print(case, outcomes[-1].error, *outcomes[-1].doubts, sep="; ", file=sys.stderr, flush=True)
        print(line(scene, outcomes), flush=True)
        every += outcomes
    return said(every)


def said(outcomes: Sequence[Outcome]) -> int:
    """Print what was doubtful, failed or silently wrong, a line of each kind; 1 where anything but a doubt was."""
    failed = sum(outcome.unconverged or outcome.silent for outcome in outcomes)
    told: dict[tuple[str, str], list[str]] = {}
    for outcome in outcomes:
        silent = outcome.broken if outcome.silent else ()
        for text in filter(None, (outcome.error, *silent, *outcome.doubts)):
            kind = f"silently wrong, {text}" if text in silent else text
            told.setdefault((outcome.case.scene, kind.partition(":")[0]), []).append(f"{outcome.case}: {text}")
    print(
        f"\n{len(outcomes)} runs, {sum(o.limit for o in outcomes)} ended at a limit load, "
        f"{sum(bool(o.error) and not o.limit for o in outcomes)} in another clear error, {failed} were not converged "
        "or silently wrong.\n"
    )
    for (scene, kind), texts in told.items():
        print(f"- {scene}, {kind}: {len(texts)}. The last is {texts[-1]}")
    return int(bool(failed))
