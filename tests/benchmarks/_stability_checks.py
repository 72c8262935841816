"""One press-fit, taken step by step, and everything about it that must hold whatever the solver says of itself.

Nothing here asks the increments' equations: the displacements come from a solve of each body's own stiffness under
the loads that a step left, the tractions they ask for from contact everywhere the two lines overlap (the solver leaves
out ends that stand open), the friction from a field that has forgotten nothing and cached nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from mpi4py import MPI

from macrofit.assembly import Assembly
from macrofit.contact import Facing, law
from macrofit.errors import MacrofitError
from macrofit.friction import FrictionField
from macrofit.geometry import FloatArray
from macrofit.interface import pair
from macrofit.press import REACH, Press, State, Step
from macrofit.scene_keys import Scene
from macrofit.seat import CoveredSeat
from macrofit.solution import OPEN, SLIP, STICK, Increment, force_balance
from macrofit.stress import evaluate_stresses

BOUNDS = {
    "converged": 0.0,  # increments that say of themselves that they have not
    "finite": 0.0,  # numbers that are not
    "law": 1e-6,  # |lambda - law(trial)|, trial of the bulk's own solution, over the largest traction
    "cone": 1e-9,  # pressure below 0, shear above mu pressure, over the largest pressure
    "status": 0.0,  # moments whose status is not that of their traction
    "loads": 1e-9,  # nodal loads against the tractions, over the largest load
    "bulk": 1e-7,  # condensed displacements against the bulk's, over the largest
    "facets": 1e-9,  # the record of the facets against the moments, over the largest pressure or slip
    "friction": 1e-12,  # coefficients of the facets against a field asked afresh
    "force": 1e-9,  # pushing force against the loads and the supports' reactions, over the largest force
    "stored": 1e-7,  # strain energy against u'Ku/2 of the bulk, over the largest; below 0
    "slip": 1e-9,  # shear against the sense of the slip that Nitsche's or the penalty law sees
    "energy": 2e-2,  # see `energy`
}
"""What is measured of a case and how large it may be. Rounding of gamma times a displacement sets `law` and `bulk`."""


@dataclass(frozen=True)
class Taken:
    """An accepted step (an increment, or a part of it after a cutback) and the state it started from."""

    before: State
    step: Step


class Watched(Press):
    """A press that keeps every step it accepts."""

    taken: list[Taken]

    def trial(self, state: State, displacement: float) -> Step:
        """As the press does, but remembered."""
        step = super().trial(state, displacement)
        if step.report.converged:
            self.taken.append(Taken(state, step))
        return step


@dataclass
class Run:
    """What a case left, as far as it came."""

    scene: Scene
    assembly: Assembly
    press: Press
    records: list[Increment] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    taken: list[Taken] = field(default_factory=list)
    error: MacrofitError | None = None

    @property
    def cutbacks(self) -> int:
        """All of them."""
        return sum(record.cutbacks for record in self.records)


def press(scene: Scene, assembly: Assembly, friction: FrictionField) -> Run:
    """Step through a scene; an error that the user would be told ends the run and is kept."""
    watched = Watched(scene, assembly.seat, assembly.wheel.line, assembly.engine, friction)
    run = Run(scene, assembly, watched)
    watched.taken = run.taken
    try:
        for record, state in watched.increments(watched.rest()):
            run.records.append(record)
            run.states.append(state)
    except MacrofitError as error:
        run.error = error
    return run


def examine(run: Run, asked_afresh: FrictionField) -> dict[str, float]:
    """Every quantity of BOUNDS, the largest over the run."""
    found = dict.fromkeys(BOUNDS, 0.0)
    found["converged"] = float(sum(not record.converged for record in run.records))
    found["finite"] = float(sum(not finite(record) for record in run.records))
    if not run.taken:
        return found
    axle, wheel = (_bulk(run, name) for name in ("axle", "wheel"))
    for number, taken in enumerate(run.taken):
        mine = {"axle": axle[:, number], "wheel": wheel[:, number]}
        for name, value in chain(_of_step(run, taken, mine, asked_afresh)):
            found[name] = _larger(found[name], value)
    for name, value in _of_records(run):
        found[name] = _larger(found[name], value)
    found["energy"] = energy([taken.step for taken in run.taken])
    return found


def wrong(found: dict[str, float]) -> list[str]:
    """Names of what is not within its bound; NaN never is."""
    return [name for name, value in found.items() if not value <= BOUNDS[name]]
