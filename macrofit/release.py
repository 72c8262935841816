"""The press lets go: the wheel goes back until no force is left."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from .contact.release import FIRST_WAY, force_free
from .errors import ConvergenceError
from .state import State, Step

PARTS = 16
"""Steps in which the press lets go, the first the shortest: force and slip change most at once."""

HELD = 1e-9
"""Force from outside over the loads of the contact below which the press holds nothing: a mesh leaves 2e-10."""


class Steps(Protocol):
    """What solves a step (see `press.Press`)."""

    def trial(self, state: State, displacement: float) -> Step:
        """Solve one displacement from a state."""
        ...

    def advance_to(self, state: State, displacement: float) -> tuple[list[Step], int]:
        """The converged steps that lead to a displacement, and their cutbacks."""
        ...


def is_held(state: State) -> bool:
    """Whether there is a force to let go of."""
    return abs(state.axial_force) > HELD * float(np.abs(state.seat_load).sum())


def let_go(press: Steps, state: State) -> tuple[list[Step], int]:
    """The steps in which the press lets go, and their cutbacks: the wheel moves back until no force is left.

    One step tells how far. The way is then gone in `PARTS`, for friction turns along it from the ends of the fit.

    Raises:
        ConvergenceError: there is no such displacement, or no equilibrium at it.
    """
    way = _free(press, state).state.displacement - state.displacement
    steps: list[Step] = []
    cutbacks, here = 0, state
    for part in range(1, PARTS):
        more, cut = press.advance_to(here, state.displacement + way * (part / PARTS) ** 2)
        if more[-1].force * state.axial_force <= 0.0:
            break
        steps, cutbacks, here = steps + more, cutbacks + cut, more[-1].state
    left = abs(state.displacement + way - here.displacement)
    return [*steps, _free(press, here, 0.5 * left)], cutbacks


def _free(press: Steps, state: State, first: float = FIRST_WAY) -> Step:
    """The single step to where no force is left."""

    def fit_at(displacement: float) -> Step:
        return press.trial(state, displacement)

    free = force_free(fit_at, state.displacement, state.axial_force, first)
    if free is None:
        free = force_free(fit_at, state.displacement, state.axial_force)
    if free is None and state.friction_force == 0.0:
        raise ConvergenceError(
            f"motion.release: without friction nothing holds the wheel at {state.displacement:.6g} mm, and no "
            f"displacement without force was found; leave release out, or give a coefficient of friction"
        )
    if free is None or not free.report.converged:
        raise ConvergenceError(
            f"motion.release: no displacement without force was found from {state.displacement:.6g} mm on; "
            f"leave release out, and move the wheel back by motion.displacements"
        )
    return free
