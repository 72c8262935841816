"""Presses that go from increment to increment together: what they share of each is solved for all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..contact.condensed import Condensed
from ..contact.cooling import warmed
from ..contact.interface import MortarCoupling, couple_lines
from ..contact.lockstep import Lockstep
from ..contact.newton import newton
from ..errors import MacrofitError
from ..friction import FacingPairs, announce
from ..press import REACH, Press
from ..state import State, Step
from .stack import of_run, stacked


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
        for member in present:
            member.asked = True
        if len(present) < 2 or asking.here.displacement == displacement:  # a fit in place, or a wheel that cools
            return
        strain = asking.scene.thermal_strain_at(asking.done)
        line, bore = asking.seat.line, warmed(asking.bore, strain)
        coupling = couple_lines(line, bore, displacement, REACH)
        if coupling is None:
            for member in present:
                member.offered = member.apart(member.here, displacement, strain)
            return
        wide = _offer(present, coupling, displacement)
        everything = couple_lines(line, bore, displacement) if wide else None
        if everything is not None:
            _offer(wide, everything, displacement)


class Member(Press):
    """A press that takes the step its group offers for its next increment; every other one it solves by itself."""

    group: Group
    here: State  # after the increments that are done
    done: int  # increments
    offered: Step | MacrofitError | None = None
    asked: bool = False  # whether the group was asked for this increment

    @cached_property
    def places(self) -> tuple[float, ...]:
        """The displacements of its scene [mm]."""
        return self.scene.displacements

    def resumed(self, states: list[State]) -> State:
        """The state to go on from; the group learns where this member is."""
        self.here, self.done = super().resumed(states), len(states)
        return self.here

    def trial(self, state: State, displacement: float, thermal_strain: float | None = None) -> Step:
        """The step that was offered; another one than that of the whole increment is solved alone."""
        places = self.places
        if state is self.here and self.done < len(places) and displacement == places[self.done]:
            if not self.asked:
                self.group.solve(self, displacement)
            offered, self.offered = self.offered, None
            if isinstance(offered, MacrofitError):
                raise offered
            if offered is not None:
                return offered
        return super().trial(state, displacement, thermal_strain)

    def _committed(self, before: State, after: State) -> State:
        self.here, self.done, self.asked = super()._committed(before, after), self.done + 1, False
        return self.here


def _offer(members: Sequence[Member], coupling: MortarCoupling, displacement: float) -> list[Member]:
    """Offer the members their steps on one coupling; gives those that move as far as what it leaves out."""
    left, frictions = _asked(members, coupling, displacement)
    if len(left) < 2:
        return []
    wide = []
    for member, step in zip(left, _solved(left, frictions, coupling, displacement), strict=False):
        if member.near(step, coupling):
            member.offered = step
        else:
            wide.append(member)
    return wide


def _asked(
    members: Sequence[Member], coupling: MortarCoupling, displacement: float
) -> tuple[list[Member], list[FloatArray]]:
    """The friction of the members' facets, without those whose provider fails: they are offered the error.

    What all of them will ask is announced first, so that providers of the same surfaces prepare a pair of tiles once,
    and all new ones together.
    """
    overlaps = max(members, key=lambda member: member.friction.per_pair).overlaps(coupling, displacement)
    facing, left, frictions = FacingPairs.of(overlaps), [], []
    asked = [member.friction.question(facing, member.here.pressure, member.here.accumulated_slip) for member in members]
    announce(zip((member.friction for member in members), asked, strict=True))
    for member, question in zip(members, asked, strict=True):
        try:
            frictions.append(member.friction.answer(question))
        except MacrofitError as error:
            member.offered = error
        else:
            left.append(member)
    return left, frictions


def _solved(
    members: Sequence[Member], frictions: list[FloatArray], coupling: MortarCoupling, displacement: float
) -> list[Step]:
    """The step of each member; none where they do not converge together."""
    one = members[0]
    assert isinstance(one.engine, Condensed)
    before, friction = stacked([member.here for member in members]), np.stack(frictions)
    posed = one.pose(before, displacement, coupling, one.seat.cover(coupling.portions), friction)
    problem = Lockstep(one.engine, posed.contact)
    report = newton(problem, posed.friction, posed.status, posed.kappa)
    if not report.converged:
        return []
    step = one.step(before, posed, report, problem.displacements(report.answer))
    return [of_run(step, run) for run in range(len(members))]
