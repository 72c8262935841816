"""The increments of a press-fit: trial, accept or cut back, commit."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .base.arrays import FloatArray
from .bodies.body import ContactLine
from .contact.cooling import cooled, heat_work, thermal_slip, warmed
from .contact.eigen import Eigen, shifted
from .contact.interface import MortarCoupling, couple_lines
from .contact.law import ContactProblem, LinearSolution, Status, StatusArray
from .contact.newton import LinearProblem, Report, newton, settled_status
from .contact.release import release
from .contact.seat import CoveredSeat, Seat
from .contact.status import OPEN, SLIP
from .errors import ConvergenceError
from .friction import FrictionField, TileOverlaps
from .friction.tiles import NO_OVERLAPS
from .release import is_held, let_go
from .scene.keys import Scene
from .solution import TILE, FacetState, Increment, PairFrictionMap, Tiling, tiles
from .state import (
    Posed,
    State,
    Step,
    accepted,
    covered_moments,
    elastic_energy,
    first_guess,
    first_kappa,
    nothing_touches,
    remedy,
    slip_work,
)

if TYPE_CHECKING:
    from .plasticity.yielding import Loads, Settled, Yielding

REACH = 1.5
"""Facets at the ends are left out where their gap is wider than this times the deepest interpenetration."""


class Engine(Protocol):
    """What solves the linear problems: the condensed interface or the whole sparse system."""

    factorisations: int

    def problem(self, contact: ContactProblem) -> LinearProblem:
        """The linear problems of one increment."""
        ...


class Press:
    """A press-fit: the two contact lines, an engine, the friction field, and one increment at a time."""

    def __init__(
        self,
        scene: Scene,
        seat: Seat,
        bore: ContactLine,
        engine: Engine,
        friction: FrictionField,
        yielding: Yielding | None = None,
    ) -> None:
        self.scene, self.seat, self.bore, self.engine, self.friction = scene, seat, bore, engine, friction
        self.yielding = yielding

    def rest(self) -> State:
        """The undeformed state before the first increment."""
        line = self.seat.line
        moments = np.zeros((line.facets, self.seat.moments), dtype=np.int64)
        return State(
            displacement=self.scene.displacements[0],
            direction=0.0,
            friction_force=0.0,
            seat_displacement=np.zeros(2 * self.seat.loaded),
            bore_displacement=np.zeros(2 * len(self.bore.nodes)),
            seat_load=np.zeros(2 * self.seat.loaded),
            bore_load=np.zeros(2 * len(self.bore.nodes)),
            pressure=np.zeros(line.facets),
            accumulated_slip=np.zeros(line.facets),
            kind=moments,
            sign=moments,
            kappa=moments.astype(np.float64),
            held=moments.astype(np.float64),
            shear=moments.astype(np.float64),
            thermal_strain=self.scene.thermal_strain_at(0),
            flow=None if self.yielding is None else self.yielding.rest(),
        )

    def increments(self, state: State, first: int = 0) -> Iterator[tuple[Increment, State]]:
        """The increments of the scene from number ``first`` on, each with the state it leaves.

        A press that finds no place to let go is warned of; the increments end without its release.

        Raises:
            ConvergenceError: no cutback helps.
            ProviderError: friction cannot be had.
        """
        for index, displacement in enumerate(self.scene.displacements[first:], start=first):
            started = time.perf_counter()
            strain = self.scene.thermal_strain_at(index)
            before, (steps, cutbacks) = state, self.advance_to(state, displacement, strain)
            state = self._committed(before, steps[-1].state)
            spread = self.friction_deviation(steps[-1])
            yield accepted(index, before, steps, cutbacks, time.perf_counter() - started, spread), state
        planned = len(self.scene.displacements)
        if self.scene.motion.release and first <= planned and is_held(state):
            started = time.perf_counter()
            try:
                steps, cutbacks = let_go(self, state)
            except ConvergenceError as error:  # what was pressed stays, and a doubt says that it is not released
                warnings.warn(str(error), stacklevel=2)
                return
            after = self._committed(state, steps[-1].state)
            spread = 0.0 * self.friction_deviation(steps[-1])  # its force is none; where that is may deviate
            yield accepted(planned, state, steps, cutbacks, time.perf_counter() - started, spread), after

    def _committed(self, before: State, after: State) -> State:
        """The state after an increment; where steel may yield, with what changed in it."""
        if self.yielding is None or before.flow is None or after.flow is None:
            return after
        flow, changes = self.yielding.increment(
            before.flow, after.flow, after.displacement - before.displacement, after.displacement
        )
        return replace(after, flow=flow, changes=changes)

    def resumed(self, states: list[State]) -> State:
        """The state to go on from after those of a journal."""
        if not states:
            return self.rest()
        if self.yielding is None:
            return states[-1]
        before = states[-2].displacement if len(states) > 1 else self.scene.displacements[0]
        changes = [state.changes or {} for state in states]
        return replace(states[-1], flow=self.yielding.restored(changes, states[-1].displacement - before))

    def advance_to(
        self, state: State, displacement: float, thermal_strain: float | None = None
    ) -> tuple[list[Step], int]:
        """The converged steps that lead to a displacement: one, or several shorter ones after cutbacks.

        The wheel gets its thermal strain in the first of them; left out, it keeps the one it has.

        Raises:
            ConvergenceError: a step would get shorter than 2^-max_cutbacks of the increment.
        """
        whole = displacement - state.displacement
        steps: list[Step] = []
        halvings = cutbacks = 0
        target = displacement
        while True:
            step = self.trial(state, target, thermal_strain)
            if step.report.converged:
                steps.append(step)
                state = step.state
                if target == displacement:
                    return steps, cutbacks
            else:
                if halvings == self.scene.motion.max_cutbacks or whole == 0.0:
                    cools = thermal_strain not in (None, state.thermal_strain)
                    raise ConvergenceError(
                        f"no convergence between displacements {state.displacement:.6g} and {target:.6g} mm after "
                        f"{cutbacks} cutbacks (residual {step.report.residual:.1e}); try "
                        f"{remedy(self.scene, state, step, cools=cools)}"
                    )
                halvings, cutbacks = halvings + 1, cutbacks + 1
            target = state.displacement + whole * 0.5**halvings
            if abs(displacement - target) <= 1e-9 * abs(whole) or (displacement - target) * whole < 0.0:
                target = displacement

    def trial(self, state: State, displacement: float, thermal_strain: float | None = None) -> Step:
        """Solve one displacement from a committed state, which is left as it is.

        Ends of the lines that stand wide open are left out, unless the bodies turn out to move as far as that.
        """
        strain = state.thermal_strain if thermal_strain is None else thermal_strain
        bore = warmed(self.bore, strain)
        coupling = couple_lines(self.seat.line, bore, displacement, REACH)
        if coupling is None:
            return self.apart(state, displacement, strain)
        step = self._resolve(state, displacement, coupling)
        if self.near(step, coupling):
            return step
        everything = couple_lines(self.seat.line, bore, displacement)
        assert everything is not None
        return self._resolve(state, displacement, everything)

    def near(self, step: Step, coupling: MortarCoupling) -> bool:
        """Whether the bodies move less than the ends that were left out stand open."""
        height = 0 if self.seat.line.radial else 1
        bodies = (step.state.seat_displacement, step.state.bore_displacement)
        return sum(float(np.abs(u.reshape(2, -1)[height]).max()) for u in bodies) < coupling.clearance

    def _resolve(self, state: State, displacement: float, coupling: MortarCoupling) -> Step:
        """The motion to a displacement; where none led there, a fit in place if the bodies overlap."""
        moved = displacement - state.displacement
        if coupling.thermal_strain != state.thermal_strain:
            friction = self.facet_friction(coupling, state, displacement)
            return cooled(lambda given: self._solve(state, displacement, coupling, friction, given))
        if moved == 0.0 and self.seat.line.radial and float(coupling.gap.min()) < 0.0:
            return self._fit_in_place(state, coupling)
        return self._solve(state, displacement, coupling, self.facet_friction(coupling, state, displacement))

    def _fit_in_place(self, state: State, coupling: MortarCoupling) -> Step:
        """Resolve the interference as a shrink fit does: without friction; then friction, and no force from outside.

        What the sloping interface pushes along the axis is left to friction: the wheel gives way within stick until
        its support is free of force. Where friction does not hold it (a steep cone), the support does.
        """
        here = state.displacement
        shrunk = self._solve(state, here, coupling, np.zeros(self.seat.line.facets))
        fitted = replace(shrunk.state, accumulated_slip=state.accumulated_slip)
        friction = self.facet_friction(coupling, fitted, here)
        if not (shrunk.report.converged and shrunk.normal_force > 0.0 and friction.any()):
            return shrunk
        steps = [shrunk]

        def fit_at(given: float) -> Step:
            steps.append(self._solve(fitted, here, coupling, friction, given))
            return steps[-1]

        step = release(fit_at, -float(coupling.gap.min()) / shrunk.normal_force)
        iterations = sum(each.report.iterations for each in steps)
        settled = step.settled
        if settled is not None and shrunk.settled is not None and step is not shrunk:
            settled = replace(settled, work=settled.work + shrunk.settled.work)
        return replace(step, report=replace(step.report, iterations=iterations), settled=settled)

    def _solve(
        self,
        state: State,
        displacement: float,
        coupling: MortarCoupling,
        facet_friction: FloatArray,
        given: float = 0.0,  # mm, how far the wheel's support moves beside the displacement
    ) -> Step:
        posed = self.pose(state, displacement, coupling, self.seat.cover(coupling.portions), facet_friction, given)
        problem = self.engine.problem(posed.contact)
        if self.yielding is None:
            report = newton(problem, posed.friction, posed.status, posed.kappa)
            return self.step(state, posed, report, problem.displacements(report.answer))
        report, contact, settled = self._settle(state, posed, problem)
        moved_to = self._with_eigen(problem.displacements(report.answer), settled)
        return self.step(state, replace(posed, contact=contact), report, moved_to, settled)

    def pose(
        self,
        state: State,
        displacement: float,
        coupling: MortarCoupling,
        covered: CoveredSeat,
        facet_friction: FloatArray,
        given: float = 0.0,
    ) -> Posed:
        """What Newton's method is to solve for a displacement, and where it starts.

        States of several runs that are at one place (see `lockstep.stack`) are posed as one problem.
        """
        moved = displacement - state.displacement + given
        slip_old = (covered.seat_moments(state.seat_displacement) - coupling.bore_moments(state.bore_displacement))[1]
        slip_old += covered_moments(state.held, coupling)
        if coupling.thermal_strain != state.thermal_strain:
            slip_old += thermal_slip(self.bore, coupling, coupling.thermal_strain - state.thermal_strain)
        contact = ContactProblem(
            covered=covered,
            coupling=coupling,
            undeformed=np.stack(np.broadcast_arrays(coupling.gap, moved * covered.normals[:, 0] + slip_old)),
            radial=self.seat.line.radial,
            nitsche=self.seat.nitsche,
        )
        friction = facet_friction[..., covered.facet]
        return Posed(
            displacement=displacement,
            moved=moved,
            contact=contact,
            friction=friction,
            status=first_guess(state, self.seat.line, contact, friction, moved),
            kappa=first_kappa(state, contact),
        )

    def _settle(self, state: State, posed: Posed, problem: LinearProblem) -> tuple[Report, ContactProblem, Settled]:
        """Contact and plastic strains that fit each other."""
        assert self.yielding is not None
        assert state.flow is not None
        undeformed = problem.contact
        reports: list[Report] = []

        def contact(eigen: dict[str, Eigen]) -> Loads:
            """Solve for what the plastic strains do, from the status before."""
            problem.contact = shifted(undeformed, self.seat.line.coordinate, eigen)
            start = (reports[-1].status, reports[-1].answer.kappa) if reports else (posed.status, posed.kappa)
            reports.append(newton(problem, posed.friction, *start))
            return problem.contact.loads(reports[-1].answer.total)

        settled = self.yielding.settle(state.flow, posed.moved, (state.seat_load, state.bore_load), contact)
        report, spent = reports[-1], sum(each.iterations for each in reports)
        converged = report.converged and settled.converged
        return replace(report, iterations=spent, converged=converged), problem.contact, settled

    def _with_eigen(
        self, displacements: tuple[FloatArray, FloatArray], settled: Settled
    ) -> tuple[FloatArray, FloatArray]:
        """Whole displacements of the loaded and the bore's nodes."""
        seat, bore = displacements
        if "axle" in settled.eigen:
            seat = seat + settled.eigen["axle"].displacement.reshape(2, -1)[:, : self.seat.loaded].ravel()
        if "wheel" in settled.eigen:
            bore = bore + settled.eigen["wheel"].displacement
        return seat, bore

    def facet_friction(self, coupling: MortarCoupling, state: State, displacement: float) -> FloatArray:
        """Coefficient of friction of every facet of the seat, asked of the field once per trial."""
        return self.friction.facet_friction(
            self.overlaps(coupling, displacement), state.pressure, state.accumulated_slip
        )

    def friction_deviation(self, step: Step) -> float:
        """Standard deviation of the friction of a step over its normal force [-], see `FrictionField.deviation`."""
        line, pressure = self.seat.line, step.facets.pressure
        weighed = pressure if line.radial else pressure * line.coordinate[1:]
        return self.friction.deviation(weighed, step.facets.status == SLIP)

    def overlaps(self, coupling: MortarCoupling, displacement: float) -> TileOverlaps:
        """Which pairs of tiles the facets of the seat face; none where friction does not ask."""
        if not self.friction.per_pair:
            return NO_OVERLAPS
        s, facets = self.seat.line.coordinate, coupling.portions.facet
        start, end = s[:-1].copy(), s[:-1].copy()
        start[facets], end[facets] = coupling.portions.start, coupling.portions.end
        return self.tiling.overlaps(start, end, displacement)

    @cached_property
    def tiling(self) -> Tiling:
        """Where the tiles of both lines lie."""
        s, b = self.seat.line.coordinate, self.bore.coordinate
        ends = (float(b[0]), float(b[-1]))
        return Tiling(
            size=TILE,
            seat_origin=float(s[0]),
            seat_tiles=tiles(s),
            bore_ends=ends,
            bore_tiles=tiles(b),
            radial=self.seat.line.radial,
        )

    def pair_friction(self) -> PairFrictionMap | None:
        """What is known of the pairs of tiles met so far; None where all have the same coefficient."""
        if not self.friction.per_pair:
            return None
        known = self.friction.state()._asdict()
        return PairFrictionMap(tiling=self.tiling, **known, lasting=self.friction.lasting)

    def step(
        self,
        state: State,
        posed: Posed,
        report: Report,
        displacements: tuple[FloatArray, FloatArray],
        settled: Settled | None = None,
    ) -> Step:
        """What the answer to a posed problem leaves: the next state, resultants and energies; of several runs, all."""
        contact, friction, moved = posed.contact, posed.friction, posed.moved
        answer, weight = report.answer, contact.covered.weight
        seat_load, bore_load = contact.loads(answer.total)
        gap, along = contact.opening(*displacements)
        slip = (answer.trial[1] - answer.traction[1]) / contact.covered.gamma
        held = np.where(report.status.kind == OPEN, 0.0, along - slip)
        status = settled_status(report, contact, friction, slip, moved)
        facets = self._facet_state(state, contact, answer, status, friction, gap, slip)
        friction_force = _number((answer.traction[1] * contact.covered.normals[:, 0]) @ weight)
        after = State(
            displacement=posed.displacement,
            direction=float(np.sign(moved)) or state.direction,
            friction_force=friction_force,
            seat_displacement=displacements[0],
            bore_displacement=displacements[1],
            seat_load=seat_load,
            bore_load=bore_load,
            pressure=facets.pressure,
            accumulated_slip=facets.accumulated_slip,
            kind=self._by_moment(contact, report.status.kind).astype(np.int64),
            sign=self._by_moment(contact, report.status.sign).astype(np.int64),
            kappa=self._by_moment(contact, answer.kappa),
            held=self._by_moment(contact, held),
            shear=self._by_moment(contact, weight * answer.traction[1]),
            thermal_strain=contact.coupling.thermal_strain,
            flow=None if settled is None else settled.flow,
        )
        pressure = -answer.traction[0]
        line = self.seat.line
        radius = np.interp(contact.coupling.portions.points.ravel(), line.coordinate, line.radius)
        return Step(
            state=after,
            report=report,
            facets=facets,
            force=_number(contact.axial_force(answer.total)),
            normal_force=_number(pressure @ weight),
            friction_force=friction_force,
            friction_bound=_number((friction * pressure) @ weight),
            torque=_number((friction * pressure * radius) @ weight),
            strain_energy=elastic_energy(after, self.seat.stabilisation) + (0.0 if settled is None else settled.energy),
            dissipation=_number((answer.traction[1] * slip) @ weight),
            slip_work=_number(slip_work(state, after, moved * self.seat.line.normals[:, 0], contact, slip)),
            heat=heat_work(self.bore, (state.bore_load, bore_load), after.thermal_strain - state.thermal_strain),
            settled=settled,
        )

    def _by_moment(self, contact: ContactProblem, values: FloatArray | StatusArray) -> FloatArray:
        every = np.zeros((*values.shape[:-1], self.seat.line.facets, self.seat.moments))
        every[..., contact.coupling.portions.facet, :] = _by_facet(values, self.seat.moments)
        return every

    def _facet_state(
        self,
        state: State,
        contact: ContactProblem,
        answer: LinearSolution,
        status: StatusArray,
        friction: FloatArray,
        gap: FloatArray,
        slip: FloatArray,
    ) -> FacetState:
        facets, m = contact.coupling.portions.facet, self.seat.moments
        weight = contact.covered.weight.reshape(-1, m)
        area, kinds = weight.sum(axis=1), _by_facet(status, m)

        def mean(values: FloatArray) -> FloatArray:
            every = np.zeros((*values.shape[:-1], self.seat.line.facets))
            every[..., facets] = (weight * _by_facet(values, m)).sum(axis=-1) / area
            return every

        slipped = mean(np.where(status == SLIP, slip, 0.0))
        kind = np.zeros(slipped.shape, dtype=np.int64)
        kind[..., facets] = np.where((kinds == SLIP).any(axis=-1), SLIP, kinds.max(axis=-1))
        return FacetState(
            pressure=mean(-answer.traction[0]),
            traction=mean(answer.traction[1]),
            gap=mean(gap),
            slip=slipped,
            accumulated_slip=state.accumulated_slip + np.abs(slipped),
            status=kind,
            friction=mean(friction),
        )

    def apart(self, state: State, displacement: float, thermal_strain: float) -> Step:
        """The bodies face each other nowhere: everything is zero, but what plastic strains leave."""
        rest = self.rest()
        after = replace(
            rest, displacement=displacement, direction=state.direction, accumulated_slip=state.accumulated_slip,
            thermal_strain=thermal_strain,
        )  # fmt: skip
        moved = displacement - state.displacement
        settled = None
        if self.yielding is not None and state.flow is not None:
            loads, none = (state.seat_load, state.bore_load), (rest.seat_load, rest.bore_load)
            settled = self.yielding.settle(state.flow, moved, loads, lambda _: none)
            seat, bore = self._with_eigen((rest.seat_displacement, rest.bore_displacement), settled)
            after = replace(after, seat_displacement=seat, bore_displacement=bore, flow=settled.flow)
        nothing = np.zeros((2, 0))
        report = Report(
            answer=LinearSolution(nothing, nothing, nothing, np.zeros(0)),
            status=Status(np.zeros(0, dtype=np.int8), np.zeros(0, dtype=np.int8)),
            iterations=0,
            residual=0.0,
            converged=settled is None or settled.converged,
        )
        return Step(
            state=after,
            report=report,
            facets=nothing_touches(state.accumulated_slip),
            force=0.0,
            normal_force=0.0,
            friction_force=0.0,
            friction_bound=0.0,
            strain_energy=0.0 if settled is None else settled.energy,
            dissipation=0.0,
            slip_work=-0.5 * moved * float(self.seat.line.normals[:, 0] @ state.shear.sum(axis=1)),
            settled=settled,
        )


def _by_facet(values: Any, moments: int) -> Any:
    """(..., portions, moments) of values (..., n)."""
    return values.reshape(*values.shape[:-1], -1, moments)


def _number(value: Any) -> Any:
    """A resultant as a number; those of several runs as they are."""
    return value if np.ndim(value) else float(value)
