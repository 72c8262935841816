"""Presses that go from increment to increment together: what they share of each is solved for all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..contact.condensed import Condensed
from ..contact.cooling import warmed
from ..contact.interface import MortarCoupling, couple_lines
from ..contact.lockstep import Lockstep
from ..contact.newton import newton
from ..errors import MacrofitError
from ..press import REACH, Press
from ..state import State, Step
from .stack import of_run, stacked

BLOCK = 8
"""Runs that a product of matrices takes at once: six take a third longer than eight, so that the last is doubled."""


class Group:
    """Members at the same increment are solved together, when the first of them asks for it."""

    def __init__(self) -> None:
        self.members: list[Member] = []

    def press(self, *parts: Any) -> Member:
        """A press of this group, see `Press`."""
        member = Member(*parts)
        member.group = self
        self.members.append(member)
        return member

    def solve(self, asking: Member, displacement: float) -> None:
        """Offer each member at the same increment its step, or the error that ends its run; nothing where it fails."""
        present = [member for member in self.members if member.done == asking.done]
        bore = warmed(asking.bore, asking.scene.thermal_strain_at(asking.done))
        coupling = couple_lines(asking.seat.line, bore, displacement, REACH)
        if (
            len(present) < 2
            or coupling is None
            or any(_alone(member.here, displacement, coupling) for member in present)
        ):
            for member in present:
                member.alone = True
            return
        asked: list[tuple[Member, FloatArray]] = []
        overlaps = asking.overlaps(coupling, displacement)
        for member in present:
            try:
                here = member.here
                asked.append((member, member.friction.facet_friction(overlaps, here.pressure, here.accumulated_slip)))
            except MacrofitError as error:
                member.offered = error
        if asked:
            members, friction = zip(*asked, strict=True)
            _solve(members, np.stack(friction), coupling, displacement)


class Member(Press):
    """A press that takes the step its group offers for its next increment; every other one it solves by itself."""

    group: Group
    here: State  # after the increments that are done
    done: int  # increments
    offered: Step | MacrofitError | None = None
    alone: bool = False  # nothing is offered for this increment

    def resumed(self, states: list[State]) -> State:
        """The state to go on from; the group learns where this member is."""
        self.here, self.done = super().resumed(states), len(states)
        return self.here

    def trial(self, state: State, displacement: float, thermal_strain: float | None = None) -> Step:
        """The step that was offered; another one than that of the whole increment is solved alone."""
        displacements = self.scene.displacements
        if state is self.here and self.done < len(displacements) and displacement == displacements[self.done]:
            if self.offered is None and not self.alone:
                self.group.solve(self, displacement)
            offered, self.offered = self.offered, None
            if isinstance(offered, MacrofitError):
                raise offered
            if offered is not None:
                return offered
        return super().trial(state, displacement, thermal_strain)

    def _committed(self, before: State, after: State) -> State:
        self.here, self.done, self.alone = super()._committed(before, after), self.done + 1, False
        return self.here


def _alone(here: State, displacement: float, coupling: MortarCoupling) -> bool:
    """Whether a press takes this increment in a way of its own: a fit in place, a wheel that cools."""
    return here.thermal_strain != coupling.thermal_strain or here.displacement == displacement


def _solve(
    members: Sequence[Member], facet_friction: FloatArray, coupling: MortarCoupling, displacement: float
) -> None:
    """Offer the steps, if they converge, where the bodies do not move as far as what was left out."""
    one = members[0]
    assert isinstance(one.engine, Condensed)
    spare = [members[-1]] * (-len(members) % BLOCK if len(members) > BLOCK // 2 else 0)
    before = stacked([member.here for member in (*members, *spare)])
    facet_friction = np.concatenate([facet_friction, *(facet_friction[-1:] for _ in spare)])
    posed = one.pose(before, displacement, coupling, one.seat.cover(coupling.portions), facet_friction)
    problem = Lockstep(one.engine, posed.contact)
    report = newton(problem, posed.friction, posed.status, posed.kappa)
    if not report.converged:
        return
    together = one.step(before, posed, report, problem.displacements(report.answer))
    for run, member in enumerate(members):
        step = of_run(together, run)
        if member.near(step, coupling):
            member.offered = step
