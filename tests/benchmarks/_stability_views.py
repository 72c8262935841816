"""A press-fit taken step by step, and each step seen from outside of the solver.

Nothing here asks the increments' equations: the displacements come from a solve of each body's own stiffness under
the loads that a step left, and contact is looked for wherever the two lines overlap (the solver leaves out ends that
stand open).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from macrofit.assembly import Assembly
from macrofit.base.arrays import FloatArray, IntArray
from macrofit.contact.interface import MortarCoupling, couple_lines
from macrofit.contact.law import ContactProblem
from macrofit.contact.seat import CoveredSeat
from macrofit.contact.status import OPEN
from macrofit.errors import MacrofitError
from macrofit.friction import FrictionField
from macrofit.press import REACH, Press
from macrofit.scene.keys import Scene
from macrofit.solution import Increment
from macrofit.state import State, Step

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Taken:
    """An accepted step (an increment, or a part of it after a cutback) and the state it started from."""

    before: State
    step: Step


class Watched(Press):
    """A press that keeps every step it accepts, and from where: that of a fit in place is the fit without friction."""

    taken: list[Taken]
    solved_from: list[tuple[State, Step]]  # of the present trial

    def trial(self, state: State, displacement: float, thermal_strain: float | None = None) -> Step:
        """As the press does, but remembered."""
        self.solved_from = []
        step = super().trial(state, displacement, thermal_strain)
        if step.report.converged:
            before = next((own for own, each in self.solved_from if each.report.answer is step.report.answer), state)
            self.taken.append(Taken(before, step))
        return step

    def _solve(
        self,
        state: State,
        displacement: float,
        coupling: MortarCoupling,
        facet_friction: FloatArray,
        given: float = 0.0,
    ) -> Step:
        step = super()._solve(state, displacement, coupling, facet_friction, given)
        self.solved_from.append((replace(state, displacement=state.displacement - given), step))
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


def larger(a: float, b: float) -> float:
    """The larger of both; NaN wins."""
    return b if not b <= a else a


def over(difference: FloatArray | float, scale: float) -> float:
    """Largest difference over a scale, itself where that is zero."""
    largest = float(np.abs(np.atleast_1d(difference)).max(initial=0.0))
    return largest / scale if scale > 0.0 else largest


def relative(one: FloatArray | float, other: FloatArray | float) -> float:
    """Largest difference over the largest of both."""
    one, other = np.atleast_1d(one), np.atleast_1d(other)
    return over(one - other, float(max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0))))


@dataclass(frozen=True)
class Moments:
    """A step's moments on all facets that face each other, n of them; zero where the solver left them out."""

    contact: ContactProblem
    facet: IntArray  # (n,)
    used: BoolArray  # (n,) the solver looked for contact here
    traction: FloatArray  # (2, n) lambda
    axial_share: FloatArray  # (2, n) Q, the axial share of the pressure
    kind: IntArray  # (n,)
    opening: FloatArray  # (2, n) of the bulk's displacements [mm]
    bulk: FloatArray  # (2, n) T u of the bulk's displacements; zero for penalty
    strained: FloatArray  # (2, n) how much the jump grew over the step by the bodies' strain alone [mm]

    @property
    def share(self) -> FloatArray:
        """What the law leaves to the bulk, T u - Q (2, n); zero for penalty."""
        return self.bulk - self.axial_share if self.contact.nitsche else self.bulk

    def on_seat(self, values: FloatArray, facets: int) -> FloatArray:
        """Values (2, n) on all moments of the seat (2, facets * moments), zero where nothing faces them."""
        each = len(self.facet) // (self.facet[-1] - self.facet[0] + 1)
        every = np.zeros((2, facets * each))
        every[:, self.facet[0] * each : (self.facet[-1] + 1) * each] = values
        return every


@dataclass(frozen=True)
class View:
    """A step seen from outside of the solver."""

    taken: Taken
    bulk: dict[str, FloatArray]  # displacement of every node of axle and wheel under the step's loads
    moments: Moments | None  # None where the bodies overlap nowhere


def views_of(run: Run, steps: Sequence[Taken]) -> Iterator[View]:
    """Solve both bodies under the loads of the steps, and face their contact lines."""
    states, bodies = [taken.step.state for taken in steps], run.assembly.bodies
    axle = bodies["axle"].back_substitute(np.stack([state.seat_load for state in states], axis=1))
    wheel = bodies["wheel"].back_substitute(np.stack([state.bore_load for state in states], axis=1))
    for number, taken in enumerate(steps):
        bulk = {"axle": axle[:, number], "wheel": wheel[:, number]}
        yield View(taken, bulk, _moments(run, taken, bulk))


def _moments(run: Run, taken: Taken, bulk: dict[str, FloatArray]) -> Moments | None:
    before, state, seat, bore = taken.before, taken.step.state, run.assembly.seat, run.assembly.wheel.line
    whole = couple_lines(seat.line, bore, state.displacement)
    if whole is None:
        return None
    covered = seat.cover(whole.portions)
    moved = state.displacement - before.displacement
    old = covered.seat_moments(before.seat_displacement) - whole.bore_moments(before.bore_displacement)
    slip = moved * covered.normals[:, 0] + old[1] + before.held[whole.portions.facet].ravel()
    contact = ContactProblem(
        covered=covered,
        coupling=whole,
        undeformed=np.stack([whole.gap, slip]),
        radial=seat.line.radial,
        nitsche=seat.nitsche,
    )
    traction, kind, used = _spread(run, taken.step, covered)
    trace = {name: bulk[name][body.trace_dofs] for name, body in run.assembly.bodies.items()}
    own = trace["axle"].reshape(2, -1)[:, : seat.loaded].ravel()
    axial_share = contact.total(traction, contact.kappa(trace["wheel"])) - traction
    stress = _bulk_traction(covered, trace["axle"]) if seat.nitsche else np.zeros_like(traction)
    opening = contact.opening(own, trace["wheel"])
    strained = covered.seat_moments(own) - whole.bore_moments(trace["wheel"]) - old
    return Moments(contact, covered.facet, used, traction, axial_share, kind, opening, stress, strained)


def _spread(run: Run, step: Step, covered: CoveredSeat) -> tuple[FloatArray, IntArray, BoolArray]:
    """Traction and status of the step on all covered moments, and which of them it had."""
    line, answer = run.assembly.seat.line, step.report.answer
    used = np.zeros(len(covered.facet), dtype=bool)
    if answer.traction.shape[1] == len(used):
        used[:] = True
    elif answer.traction.shape[1]:
        near = couple_lines(line, run.assembly.wheel.line, step.state.displacement, REACH)
        assert near is not None
        used = np.isin(covered.facet, near.portions.facet)
    traction, kind = np.zeros((2, len(used))), np.full(len(used), OPEN)
    traction[:, used], kind[used] = answer.traction, step.report.status.kind
    return traction, kind, used


def _bulk_traction(covered: CoveredSeat, trace: FloatArray) -> FloatArray:
    """T u (2, n) [MPa] of a displacement (2 trace nodes,) of the axle."""
    parts = [part.traction @ trace for part in (covered.full, covered.partial) if part is not None]
    return np.concatenate([part.reshape(2, -1) for part in parts], axis=1)[:, covered.index]
