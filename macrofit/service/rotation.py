"""The rotation: the loads come up, then they turn around the axle step by step, revolution after revolution.

Time is counted in revolutions: from -1 to 0 the loads grow as they turn, from 0 on they are whole. Everything is
counted from the released fit. A step starts from the slips before it, turned on by its angle, or as they are, first
from what helped last; where Newton's method gets nowhere from both, it takes shorter ways, and then the step is halved.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray
from ..errors import ConvergenceError
from .kernel import Kernel
from .slipping import Law, Solved, search_step, solve_step
from .wheelset import Loads

HALVINGS = 6
PRESSED = 3.0
"""Loads press the fit together at most that many times as much as if it were bonded; opening shifts pressure."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """The fit at one time."""

    time: float  # revolutions
    traction: FloatArray  # (K, 3, m) [MPa]
    slip: FloatArray  # (K, 3, m): what is open, < 0, and slips from the released fit on [mm]


@dataclass(frozen=True, kw_only=True)
class Revolution:
    """What a revolution took, and its steps, the one before the first included."""

    moments: list[Moment]
    friction_work: float  # N mm, by the trapezoidal rule
    load_work: float  # N mm
    iterations: int


class Rotation:
    """A released fit under loads that turn."""

    def __init__(self, kernel: Kernel, residual: FloatArray, gap: FloatArray, friction: FloatArray, steps: int) -> None:
        """The tractions (3, m) [MPa], gaps (m,) [mm] and friction (m,) of the released fit; steps of a revolution."""
        self.kernel, self.friction = kernel, friction
        self._traction = np.repeat(residual[None], kernel.angles, axis=0)
        self._slip = np.zeros_like(self._traction)
        self._slip[:, 0] = -gap
        flat = self._slip.reshape(kernel.angles, -1)
        self.still = self._traction - kernel.respond(flat).reshape(self._slip.shape)
        self.steps = kernel.angles * math.ceil(steps / kernel.angles)
        self.iterations, self._turns = 0, True
        self.tell: Callable[[str], None] = lambda _: None  # hears how far it is, before every attempt

    def rest(self) -> Moment:
        """The released fit, without loads."""
        return Moment(time=-1.0, traction=self._traction, slip=self._slip)

    def loaded(self) -> Moment:
        """The fit when the loads have come up.

        Raises:
            ConvergenceError: it does not carry them.
        """
        here = self.rest()
        for step in range(1, self.steps + 1):
            here = self.advance(here, step / self.steps - 1.0)
        return here

    def worn(self, here: Moment, depth: FloatArray) -> Moment:
        """The fit that has lost a depth (m,) [mm], before it finds its equilibrium; the rotation goes on with it."""
        closed = np.zeros_like(self.still)
        closed[:, 0] = depth
        change = self.kernel.respond(closed.reshape(len(closed), -1)).reshape(closed.shape)
        self.still = self.still + change
        return Moment(time=here.time, traction=here.traction + change, slip=here.slip)

    def revolve(self, start: Moment) -> Revolution:
        """A whole revolution from a time on.

        Raises:
            ConvergenceError: the wheel slides or lifts off.
        """
        first, moments, counted = round(start.time), [start], self.iterations
        friction = load = 0.0
        for step in range(1, self.steps + 1):
            before, after = moments[-1], self.advance(moments[-1], first + step / self.steps)
            friction += self._friction_work(before, after)
            load += self._load_work(before, after)
            moments.append(after)
        return Revolution(moments=moments, friction_work=friction, load_work=load, iterations=self.iterations - counted)

    def advance(self, start: Moment, time: float) -> Moment:
        """The fit at a later time, in shorter steps where one is too long.

        Raises:
            ConvergenceError: no halved step helps.
        """
        here, halvings = start, 0
        while True:
            ahead = min(time, here.time + (time - start.time) * 0.5**halvings)
            ahead = time if time - ahead < 1e-9 else ahead
            solved = self._step(here, ahead)
            if solved is not None:
                here = Moment(time=ahead, traction=solved.traction, slip=solved.slip)
                if ahead == time:
                    return here
            else:
                halvings += 1
                if halvings > HALVINGS:
                    raise ConvergenceError(self._lost(here.time))

    def _step(self, here: Moment, time: float) -> Solved | None:
        law = Law(friction=self.friction, before=here.slip)
        still = self.still + self._load(time).reshape(here.slip.shape)
        flat = here.slip.reshape(len(here.slip), -1)
        turned = self.kernel.turned(flat, 2.0 * math.pi * (time - here.time)).reshape(here.slip.shape)
        for turns in (True, False) if self._turns else (False, True):
            self.tell(f"Turning         {_place(time)}")
            solved = solve_step(self.kernel, law, still, turned if turns else here.slip)
            self.iterations += solved.iterations
            if solved.converged:
                self._turns = turns  # what helped last is tried first: a guess that does not help takes longest
                return solved
        for guess in (here.slip, turned):
            self.tell(f"Turning         {_place(time)}, by shorter ways")
            solved = search_step(self.kernel, law, still, guess)
            self.iterations += solved.iterations
            if solved.converged:
                return solved
        return None

    def _load(self, time: float) -> FloatArray:
        scale, angle = _load_at(time)
        return scale * self.kernel.load_at(angle)

    def _friction_work(self, before: Moment, after: Moment) -> float:
        mean = 0.5 * (before.traction + after.traction)
        each = (mean * (after.slip - before.slip))[:, 1:].sum(axis=1)
        return -float((each @ self.kernel.fit.weight).sum()) / self.kernel.angles

    def _load_work(self, before: Moment, after: Moment) -> float:
        (was, at), (scale, angle) = _load_at(before.time), _load_at(after.time)
        flat = (len(after.slip), -1)
        change = (after.traction - before.traction).reshape(flat)
        return self.kernel.work((at, angle), (was, scale), change, (after.slip - before.slip).reshape(flat))

    def _lost(self, time: float) -> str:
        return (
            f"service: no equilibrium was found beyond {_place(time)}: the wheel slides "
            f"on its seat or lifts off; lower the loads, raise the friction or the interference, or try more "
            f"service.steps"
        )


def _load_at(time: float) -> tuple[float, float]:
    """What part of the loads acts at a time, and their angle [rad]."""
    return min(1.0, 1.0 + time), 2.0 * math.pi * time


def _place(time: float) -> str:
    """A time in words: what part of the loads acts, and at which angle."""
    scale, angle = _load_at(time)
    turned = f" of revolution {math.floor(time) + 1}" if time >= 0.0 else ""
    return f"{scale:.0%} of the loads at {math.degrees(angle) % 360.0:.0f} degrees{turned}"


def check_grip(rotation: Rotation, loads: Loads) -> None:
    """See that friction can hold the lateral force and the torque in the first step.

    Both are held by shear alone, which friction mu keeps below mu p: hypot(F, T / r) <= sum of mu p. The loads press
    the fit together by at most PRESSED times what they press the bonded one. On a cone pressure holds too.

    Raises:
        ConvergenceError: it cannot, so that the wheel slides; how far beyond, a step would only find out by trying.
    """
    fit, kernel, m = rotation.kernel.fit, rotation.kernel, rotation.kernel.fit.moments
    grip = rotation.friction + np.abs(fit.normals[:, 1] / fit.normals[:, 0])
    held = float((grip * fit.weight) @ -rotation.rest().traction[:, 0].mean(axis=0))
    more = PRESSED * float(grip.max() * (np.abs(kernel.load_at(0.0)[:, :m]).mean(axis=0) @ fit.weight))
    asked = math.hypot(loads.keys.lateral_force, loads.keys.torque / float(fit.lines[0].radius.max()))
    if asked <= rotation.steps * held + more:
        return
    scale = held / (asked - more)
    raise ConvergenceError(
        f"service: no equilibrium is possible beyond {scale:.2g} of the loads at {360.0 * scale:.2g} degrees: friction "
        f"holds {held / 1e3:.4g} kN, and service.lateral_force with service.torque over the radius asks for "
        f"{asked / 1e3:.4g} kN; lower them (N, N mm), or raise the friction or the interference"
    )
