"""Where the work of a press-fit went: into the bodies, into friction, or nowhere."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from macrofit.press import Press

from ._stability_views import Moments, Run, Taken, View, over, views_of


def _balance(run: Run, before: View, after: View) -> tuple[float, float, float, float]:
    """Of one step: work, growth of the energy, dissipation, and how far these are open [N mm].

    The bodies are linear, so that their energy grows by the mean load times the change of displacement; all that is
    left is the interface. The elastic part of the force lies, if it is monotonous there, between its values before and
    after, so that its work is known to half of |change of force| |motion| by the trapezoidal rule; friction dissipates
    at its final value while the traction changes on the way, half of |change of traction| |slip|, and so does pressure
    where contact is made; a facet that is covered a little more has other moments. The law itself is elastic where it
    carries: see `_law_energy`.
    """
    one, other = before.taken.step, after.taken.step
    moved = other.state.displacement - one.state.displacement
    elastic = 0.5 * (one.force - one.friction_force + other.force - other.friction_force)
    work, open_ = (elastic + other.friction_force) * moved, 0.5 * abs((other.force - one.force) * moved)
    grown = other.strain_energy - one.strain_energy
    if before.moments is not None and after.moments is not None:
        grown_in_law, open_in_law = _law_energy(run, before.moments, after.moments)
        grown, open_ = grown + grown_in_law, open_ + open_in_law
        work += _work_on_strain(after.moments)
    return work, grown + _stabilised(run, after) - _stabilised(run, before), other.dissipation, open_


def _law_energy(run: Run, before: Moments, after: Moments) -> tuple[float, float]:
    """What the law takes of the work, W lambda . change of (lambda - s)/gamma, and how far it is open [N mm].

    With s = T u - Q; it is what the springs of a penalty store, and with Nitsche an error of the mesh: the opening in
    contact. theta adds the work of the loads -theta/gamma T' W tau; that of its stiffness is in `_stabilised`.
    """
    facets, theta = run.assembly.seat.line.facets, run.assembly.seat.theta if run.assembly.seat.nitsche else 0.0
    covered = after.contact.covered
    weight, gamma = (after.on_seat(np.stack([x, x]), facets) for x in (covered.weight, covered.gamma))
    gamma[gamma == 0.0] = 1.0
    (t0, t1), (s0, s1), (b0, b1), (q0, q1) = (
        [view.on_seat(getattr(view, name), facets) for view in (before, after)]
        for name in ("traction", "share", "bulk", "axial_share")
    )
    carries = (t0 != 0.0) & (t1 != 0.0)
    grown = np.where(carries, 0.5 * (t0 + t1) * (t1 - s1 - t0 + s0), 0.0)
    grown += theta * 0.5 * (t0 + q0 + t1 + q1) * (b1 - b0)
    slid = after.on_seat(np.abs(after.opening), facets) * np.array([[0.0], [1.0]])
    met = np.where(
        carries, 0.0, after.on_seat(np.abs(after.opening), facets) + before.on_seat(np.abs(before.opening), facets)
    )
    open_ = weight * 0.5 * np.abs(t1 - t0) * np.maximum(slid, met)
    covered_more = np.abs(weight - before.on_seat(np.stack([before.contact.covered.weight] * 2), facets))
    open_ += covered_more / gamma * np.maximum(np.abs(t0 * (t0 - s0)), np.abs(t1 * (t1 - s1)))
    return float((weight / gamma * grown).sum()), float(open_.sum())


def _work_on_strain(moments: Moments) -> float:
    """Work of the pressure's axial share Q on the bodies' strain over the step [N mm].

    The gap follows the wheel's travel along the slope, as small displacements have it, and not how far the seat and
    the bore are strained along it. Q, which the slope makes of the pressure, loads the bodies and so works on both;
    the force knows of the travel alone. Of steel that is next to nothing; a soft axle that sticks follows the travel.
    """
    return float((moments.contact.covered.weight * moments.axial_share * moments.strained).sum())


def _stabilised(run: Run, view: View) -> float:
    """Energy of theta's stiffness -theta/gamma T' W T [N mm]: it lies on the whole seat, faced by the bore or not."""
    stiffness = run.assembly.seat.stabilisation
    u = view.bulk["axle"][run.assembly.bodies["axle"].trace_dofs]
    return 0.0 if stiffness is None else 0.5 * float(u @ (stiffness @ u))


def energy(run: Run, views: Sequence[View], longest: float) -> float | None:
    """Work - growth of the energy - dissipation over the steps, beyond what they leave open, over the larger.

    Steps above ``longest`` [mm], a tenth of a facet, say little: the force rises and falls within a facet. Whatever
    more is missing of the others has come from nowhere. None where no step is that short.
    """
    steps = [
        _balance(run, before, after)
        for before, after in pairwise(views)
        if abs(after.taken.step.state.displacement - before.taken.step.state.displacement) <= longest
    ]
    if not steps:
        return None
    work, grown, lost, open_ = np.array(steps).T
    missing = abs(float((work - grown - lost).sum())) - float(open_.sum())
    return over(
        max(0.0, missing), max(np.abs(work).sum(), lost.sum(), max(view.taken.step.strain_energy for view in views))
    )


def probe(run: Run, share: float = 1e-3) -> float:
    """The same balance over one more step of a ``share`` of a facet, over the largest of its work, growth and loss.

    Forces change so little in it that hardly anything is left open: the force is the energy's derivative there. The
    first of two such steps settles what a longer one before has left, it may turn slip into stick.
    """
    moved = (run.taken[-1].step.state.direction or 1.0) * share * float(run.assembly.seat.line.length.min())
    steps = [run.taken[-1]]
    for _ in range(2):
        state = steps[-1].step.state
        steps.append(Taken(state, Press.trial(run.press, state, state.displacement + moved)))
    before, after = list(views_of(run, steps))[1:]
    work, grown, lost, open_ = _balance(run, before, after)
    last = after.taken.step
    push = max(last.friction_bound, 1e-2 * last.normal_force) * abs(moved)
    return over(max(0.0, abs(work - grown - lost) - open_), max(abs(work), abs(grown), lost, push))
