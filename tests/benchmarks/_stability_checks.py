"""What must hold of a press-fit whatever the solver says of itself, and how far it may be missed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from macrofit.base.arrays import FloatArray, IntArray
from macrofit.contact.law import return_mapping
from macrofit.contact.newton import NO_SLIP, RESIDUAL
from macrofit.contact.status import OPEN, SLIP, STICK
from macrofit.friction import FrictionField
from macrofit.solution import Increment, force_balance
from macrofit.state import Step
from macrofit.stress import evaluate_stresses

from ._stability_energy import energy, probe
from ._stability_views import BoolArray, Moments, Run, Taken, View, larger, over, relative, views_of

BOUNDS = {
    "converged": 0.0,  # increments that say of themselves that they have not
    "finite": 0.0,  # increments with a number that is not, largest stresses included
    "law": 1e-6,  # lambda - law(trial), trial of the bulk's own solution, over the largest traction
    "cone": 1e-9,  # pressure below 0, shear above mu pressure, over the largest pressure
    "status": 0.0,  # moments whose status is not that of their traction
    "loads": 1e-8,  # nodal loads against the tractions, over the largest load
    "bulk": 1e-6,  # condensed displacements against the bulk's, over the largest
    "facets": 1e-8,  # the records of the facets against the moments, over the largest traction or displacement
    "friction": 1e-12,  # coefficients of the facets in contact against a field asked afresh
    "force": 1e-7,  # pushing force against the loads and the supports' reactions, over the largest force
    "stored": 1e-6,  # strain energy against u'Ku/2 of the bulk, over the largest; infinite below 0
    "dissipated": 1e-9,  # energy that friction gives, over what it takes in the run
    "energy": 2e-3,  # work that went nowhere over the steps, see `energy`
    "probe": 5e-2,  # and over one last short step, see `probe`
}
"""What is measured of a case and how large it may be.

A solver's residual is 1e-11, that of a bulk whose Poisson's ratio is 0.4999 and whose partner is a thousand times
stiffer 1e-7 (Cholesky of a condition of 1e9): `bulk`, `force` and `stored` leave ten times that.
"""


ROUNDING = 1e-16
"""What a number of double precision cannot tell from nothing, relative [-]."""


def examine(run: Run, asked_afresh: FrictionField) -> dict[str, float]:
    """Every quantity of BOUNDS, the largest over the run."""
    found = dict.fromkeys(BOUNDS, 0.0)
    found["converged"] = float(sum(not record.converged for record in run.records))
    found["finite"] = float(sum(not finite(record) for record in run.records))
    if not run.taken:
        return found
    views = list(views_of(run, run.taken))
    for view in views:
        for name, value in _of_step(run, view, asked_afresh):
            found[name] = larger(found[name], value)
    for name, value in _of_records(run):
        found[name] = larger(found[name], value)
    losses, stored = zip(*((taken.step.dissipation, taken.step.strain_energy) for taken in run.taken), strict=True)
    # where all stick the losses are roundings of tractions times displacements, some 1e-18 of what is stored
    found["dissipated"] = over(min(0.0, *losses), sum(map(abs, losses)) + ROUNDING / BOUNDS["dissipated"] * max(stored))
    account = energy(run, views, 0.1 * float(run.assembly.seat.line.length.min()))
    if account is not None:
        found["energy"] = account
    found["probe"] = probe(run)
    return found


def wrong(found: dict[str, float]) -> list[str]:
    """Names of what is not within its bound; NaN never is."""
    return [name for name, value in found.items() if not value <= BOUNDS[name]]


def finite(record: Increment) -> bool:
    """Whether every number of an increment and of its facets is finite; a deviation that nobody states is NaN."""
    facets = [np.isfinite(getattr(record.facets, name)).all() for name in record.facets.__dataclass_fields__]
    numbers = [getattr(record, name) for name in record.__dataclass_fields__ if name not in ("facets", "friction_sd")]
    return all(facets) and all(math.isfinite(number) for number in numbers)


def _of_step(run: Run, view: View, asked_afresh: FrictionField) -> Iterator[tuple[str, float]]:
    taken, moments, bodies = view.taken, view.moments, run.assembly.bodies
    step, state = taken.step, taken.step.state
    trace = {name: view.bulk[name][body.trace_dofs] for name, body in bodies.items()}
    own = trace["axle"].reshape(2, -1)[:, : run.assembly.seat.loaded].ravel()
    yield "bulk", relative(state.seat_displacement, own)
    yield "bulk", relative(state.bore_displacement, trace["wheel"])
    stored = sum(0.5 * float(u @ (bodies[name].space.stiffness @ u)) for name, u in view.bulk.items())
    yield "stored", relative(step.strain_energy, stored) if step.strain_energy >= 0.0 else math.inf
    axial = [float(load.reshape(2, -1)[1].sum()) for load in (state.seat_load, state.bore_load)]
    yield (
        "force",
        over(np.array([axial[0] - step.force, axial[1] + step.force]), max(step.normal_force, abs(step.force))),
    )
    if moments is None:
        yield "facets", 0.0 if not step.facets.status.any() and step.force == 0.0 else math.inf
        return
    solved = max(np.abs(state.seat_displacement - own).max(), np.abs(state.bore_displacement - trace["wheel"]).max())
    yield from _of_moments(moments, step, float(solved))
    yield "friction", _friction(run, view.taken, moments, asked_afresh)
    yield "facets", _facets(taken, moments)


def _of_moments(moments: Moments, step: Step, solved: float) -> Iterator[tuple[str, float]]:
    """The law; ``solved`` [mm] is how well the displacements are known."""
    contact, traction, kind = moments.contact, moments.traction, moments.kind
    gamma = contact.covered.gamma
    total = contact.total(traction, contact.kappa(step.state.bore_displacement))
    seat_load, bore_load = contact.loads(total)
    yield "loads", max(relative(step.state.seat_load, seat_load), relative(step.state.bore_load, bore_load))
    trial = moments.share + gamma * moments.opening
    friction = step.facets.friction[moments.facet]
    largest = float(np.abs(traction).max())
    moved = max(np.abs(u).max(initial=0.0) for u in (step.state.seat_displacement, step.state.bore_displacement))
    rounding = gamma * (4.0 * solved + 1e-9 * moved + 1e-13 * np.abs(contact.approach).max())
    allowed = largest + float(rounding.max()) / BOUNDS["law"]
    yield "law", over(traction - return_mapping(trial, friction), allowed)
    pressure, shear, small = -traction[0], np.abs(traction[1]), BOUNDS["cone"] * largest
    yield "cone", over(max(float(-pressure.min()), float((shear - friction * pressure).max()), 0.0), largest)
    held = np.where(kind == OPEN, (pressure == 0.0) & (shear == 0.0), pressure >= -small)
    held &= (kind != SLIP) | (np.abs(shear - friction * pressure) <= small)
    held &= (kind != STICK) | (shear <= friction * pressure + small)
    yield "status", float((~held).sum())


def _friction(run: Run, taken: Taken, moments: Moments, asked_afresh: FrictionField) -> float:
    """Largest difference of the coefficients in contact from those of a field asked with the state before."""
    portions = moments.contact.coupling.portions
    near = np.isin(portions.facet, moments.facet[moments.used])
    s = run.assembly.seat.line.coordinate
    start, end = s[:-1].copy(), s[:-1].copy()
    start[portions.facet[near]], end[portions.facet[near]] = portions.start[near], portions.end[near]
    overlaps = run.press.tiling.overlaps(start, end, taken.step.state.displacement)
    expected = asked_afresh.facet_friction(overlaps, taken.before.pressure, taken.before.accumulated_slip)
    difference = taken.step.facets.friction - expected
    return float(np.abs(difference[moments.facet[moments.kind != OPEN]]).max(initial=0.0))


def _facets(taken: Taken, moments: Moments) -> float:
    """Largest difference of the recorded facets from their moments, over the largest traction or displacement."""
    step, facets, size = taken.step, taken.step.facets, len(taken.step.facets.pressure)
    weight = moments.contact.covered.weight
    gap, along = moments.contact.opening(step.state.seat_displacement, step.state.bore_displacement)
    after = step.state.held[moments.contact.coupling.portions.facet].ravel()

    def mean(values: FloatArray) -> FloatArray:
        area = np.bincount(moments.facet, weight, size)
        return np.bincount(moments.facet, weight * values, size) / np.where(area > 0.0, area, 1.0)

    slid = np.where(moments.kind == SLIP, along - after, 0.0)
    stress = float(np.abs(moments.traction).max())
    length = float(np.abs(moments.contact.approach).max())
    held, unclear = _held(taken, moments, slid, stress)
    slip, used = mean(np.where(held, 0.0, slid)), np.zeros(size, dtype=bool)
    used[moments.facet[moments.used]] = True
    status = np.zeros(size, dtype=np.int64)
    np.maximum.at(status, moments.facet, np.where((moments.kind == SLIP) & held, STICK, moments.kind))
    return max(
        over(facets.pressure - mean(-moments.traction[0]), stress),
        over(facets.traction - mean(moments.traction[1]), stress),
        relative(step.normal_force, float(weight @ -moments.traction[0])),
        over(step.dissipation - float(weight @ (moments.traction[1] * slid)), step.normal_force * length),
        over((facets.gap - mean(gap))[used], length),
        over(facets.slip - slip, length),
        over(facets.accumulated_slip - taken.before.accumulated_slip - np.abs(slip), length),
        0.0 if ((facets.status == status) | np.isin(np.arange(size), unclear)).all() else math.inf,
    )


def _held(taken: Taken, moments: Moments, slid: FloatArray, stress: float) -> tuple[BoolArray, IntArray]:
    """Moments that slip too little to be slipping, and facets where that is for rounding to say."""
    moved = taken.step.state.displacement - taken.before.displacement
    least = np.maximum(NO_SLIP * abs(moved), RESIDUAL * stress / moments.contact.covered.gamma)
    near = np.abs(np.abs(slid) - least) <= 1e-12 * float(np.abs(moments.contact.approach).max()) + 1e-6 * least
    held = (np.abs(slid) <= least) & (taken.step.facets.friction[moments.facet] > 0.0)
    return held, moments.facet[near & (moments.kind == SLIP)]


def _of_records(run: Run) -> Iterator[tuple[str, float]]:
    """The records against the last steps, and the supports' reactions and the stresses as the product finds them."""
    last = {id(taken.step.facets): taken.step for taken in run.taken}
    for record in run.records:
        step = last.get(id(record.facets))
        same = step is not None and (record.force, record.strain_energy) == (step.force, step.strain_energy)
        yield "facets", 0.0 if same else math.inf
    if run.records:
        stresses = evaluate_stresses(run.scene, run.assembly, run.states, run.records)
        yield "finite", float(not all(math.isfinite(extreme.value) for extreme in stresses.extremes.values()))
        yield "force", force_balance(run.records, stresses.reactions) or 0.0
