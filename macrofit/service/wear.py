"""Prototype: wear of the seat by slip over many revolutions, after Archard, in jumps over cycles.

A revolution takes the depth q = k times the integral of p |dw| off both surfaces together, the mean all around, k the
coefficient of wear [1/MPa]. The fit that has lost the depth h is the same one whose lines close by h more: tractions
change by S h. A jump over N revolutions is a step of the backward Euler rule in this,

    (I + N k diag(s) S) dh = N q,   s = q / (k p),

which is stable however long it is; the slip s is that of the revolution before. Left out: debris, third bodies, a
coefficient that changes, roughness. Not in any command yet.

Source: McColl, Ding, Leen, Wear 256 (2004) 1114-1127 (doi 10.1016/j.wear.2003.07.001).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray
from .rotation import Moment, Revolution, Rotation


@dataclass(frozen=True, kw_only=True)
class Worn:
    """A fit after some revolutions."""

    revolutions: float
    depth: FloatArray  # (m,) lost by both surfaces together [mm]
    last: Revolution  # before the last jump


def depth_of(revolution: Revolution, coefficient: float) -> FloatArray:
    """The depth q (m,) [mm] that a revolution takes off, with a coefficient of wear [1/MPa]."""
    depth = np.zeros(revolution.moments[0].traction.shape[2])
    for before, after in zip(revolution.moments[:-1], revolution.moments[1:], strict=True):
        pressure = -0.5 * (before.traction[:, 0] + after.traction[:, 0])
        way = np.hypot(*np.moveaxis((after.slip - before.slip)[:, 1:], 1, 0))
        depth += coefficient * (pressure * way).mean(axis=0)
    return depth


def mean_pressure(revolution: Revolution) -> FloatArray:
    """Mean pressure (m,) [MPa] of a revolution, all around."""
    return np.asarray(-np.mean([moment.traction[:, 0] for moment in revolution.moments[1:]], axis=(0, 1)))


def jump(revolution: Revolution, stiffness: FloatArray, coefficient: float, count: float) -> FloatArray:
    """The depth (m,) [mm] that ``count`` revolutions take off; ``stiffness`` is S (m, m), normal, n = 0 [MPa/mm]."""
    q, pressure = depth_of(revolution, coefficient), mean_pressure(revolution)
    slip = np.divide(q, pressure, out=np.zeros_like(q), where=pressure > 0.0)  # k s
    return np.linalg.solve(np.eye(len(q)) + count * slip[:, None] * stiffness, count * q)


def wear_away(rotation: Rotation, start: Moment, jumps: Sequence[float], coefficient: float) -> Iterator[Worn]:
    """The fit after each of the jumps, which are numbers of revolutions; one revolution is followed before each.

    Raises:
        ConvergenceError: the worn fit does not carry its loads.
    """
    here, turned = start, 0.0
    depth = np.zeros(rotation.kernel.fit.moments)
    for count in jumps:
        last = rotation.revolve(here)
        more = jump(last, rotation.kernel.normal_stiffness, coefficient, count)
        here, turned, depth = rotation.worn(last.moments[-1], more), turned + count, depth + more
        yield Worn(revolutions=turned, depth=depth, last=last)
