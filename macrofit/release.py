"""The press lets go: the displacement at which no force is left."""

from __future__ import annotations

import math
from collections.abc import Callable

from .errors import ConvergenceError

FREE = 1e-10
"""Force that is left, over that of the press before it lets go."""

FIRST, LAST = 1e-3, 50.0
"""First and largest way back that is tried [mm]."""

LIMIT = 60
"""Trials before it is given up."""


def free_displacement(start: float, force: float, forced: Callable[[float], float]) -> float:
    """Where the force on the wheel vanishes, by the method of Illinois (a secant that keeps its bracket).

    Args:
        start: displacement before the press lets go [mm].
        force: its force there [N].
        forced: the force after a move from there to a displacement, a rising function [mm -> N].

    Raises:
        ConvergenceError: there is no such displacement within `LAST`.

    Source: Dowell, Jarratt, BIT 11 (1971) 168-174 (doi 10.1007/BF01934364).
    """
    way, tolerance = FIRST, FREE * abs(force)
    near, held = start, force
    far = start - math.copysign(way, force)
    pushed = forced(far)
    while pushed * force > 0.0 and abs(pushed) > tolerance:
        near, held = far, pushed
        way *= 2.0
        if way > LAST:
            raise ConvergenceError(f"motion.release: the wheel is not free of force {LAST:g} mm back either")
        far = start - math.copysign(way, force)
        pushed = forced(far)
    return _narrowed((near, held), (far, pushed), tolerance, forced)


def _narrowed(
    near: tuple[float, float], far: tuple[float, float], tolerance: float, forced: Callable[[float], float]
) -> float:
    """Where the force vanishes between two displacements with forces of opposite signs."""
    (a, held), (b, pushed) = near, far
    for _ in range(LIMIT):
        if abs(pushed) <= tolerance:
            return b
        middle = b - pushed * (b - a) / (pushed - held)
        value = forced(middle)
        if value * pushed < 0.0:
            a, held = b, pushed
        else:
            held *= 0.5
        b, pushed = middle, value
    raise ConvergenceError(f"motion.release: {abs(pushed):.3g} N are left after {LIMIT} trials")
