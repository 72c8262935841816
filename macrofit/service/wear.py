"""Prototype: wear of the seat by slip over many revolutions, after Archard, in jumps over cycles.

A revolution takes the depth q = k times the integral of p |dw| off both surfaces together, the mean all around, k the
coefficient of wear [1/MPa]. The fit that has lost the depth h is the same one whose lines close by h more: tractions
change by S h. A jump over N revolutions is a step of the backward Euler rule in this,

    (I + N k diag(s) S) dh = N q,   s = q / (k p),

which is stable however long it is; the slip s is that of the revolution before. Where roughness wears with it, the
coefficient of friction falls as that of the provider `evolving`, by the work per area W = h / k that has been done:

    mu = mu_flat + (mu_0 - mu_flat) exp(-W / w)

The worn seat can be written as a profile (`axle.profile`), which the next press takes. Left out: debris, third bodies,
how the depth is shared by the two surfaces (half each). No command uses it; `docs/examples/worn_seat.py` does.

Source: McColl, Ding, Leen, Wear 256 (2004) 1114-1127 (doi 10.1016/j.wear.2003.07.001).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.arrays import FloatArray
from ..base.files import write_text
from .fit import Fit
from .rotation import Moment, Revolution, Rotation

BESIDE = 0.1
"""How far beside the fit the seat is as it was [mm]."""


@dataclass(frozen=True, kw_only=True)
class Worn:
    """A fit after some revolutions."""

    revolutions: float
    depth: FloatArray  # (m,) lost by both surfaces together [mm]
    friction: FloatArray  # (m,) coefficients then
    last: Revolution  # before the last jump


@dataclass(frozen=True, kw_only=True)
class Smoothing:
    """Roughness that wears away, as options of the provider `evolving` have it."""

    flat_coefficient: float  # mu_flat of the smoothed faces
    work: float  # w [N/mm]

    def friction(self, first: FloatArray, done: FloatArray) -> FloatArray:
        """mu (m,) after a work per area (m,) [N/mm], of what it was at first."""
        return np.asarray(self.flat_coefficient + (first - self.flat_coefficient) * np.exp(-done / self.work))


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


def wear_away(
    rotation: Rotation,
    start: Moment,
    jumps: Sequence[float],
    coefficient: float,
    roughness: Smoothing | None = None,
) -> Iterator[Worn]:
    """The fit after each of the jumps, which are numbers of revolutions; one revolution is followed before each.

    Args:
        rotation: of the new fit; it goes on with the worn one.
        start: where it stands.
        jumps: numbers of revolutions.
        coefficient: of wear, k [1/MPa].
        roughness: how friction falls as the faces get smooth; None: it stays.

    Raises:
        ConvergenceError: the worn fit does not carry its loads.
    """
    here, turned = start, 0.0
    depth, first = np.zeros(rotation.kernel.fit.moments), rotation.friction
    for count in jumps:
        last = rotation.revolve(here)
        more = jump(last, rotation.kernel.normal_stiffness, coefficient, count)
        here, turned, depth = rotation.worn(last.moments[-1], more), turned + count, depth + more
        if roughness is not None:
            rotation.friction = roughness.friction(first, depth / coefficient)
        yield Worn(revolutions=turned, depth=depth, friction=rotation.friction, last=last)


def write_worn_profile(target: Path, fit: Fit, depth: FloatArray, share: float = 0.5) -> None:
    """Write what the seat has lost as a profile for `axle.profile`: nothing beyond the fit.

    Args:
        target: the file.
        fit: where the depth (m,) [mm] stands.
        depth: lost by both surfaces together.
        share: of the seat in it.

    Raises:
        OutputError: it cannot be written.
    """
    portions, used = fit.coupling.portions, fit.chosen // fit.coupling.portions.points.shape[1]
    start, end, seat = portions.start[used[0]], portions.end[used[-1]], fit.lines[0].coordinate
    before = [min(float(seat[0]), start - 2.0 * BESIDE), start - BESIDE, start]
    behind = [end, end + BESIDE, max(float(seat[-1]), end + 2.0 * BESIDE)]
    z = np.concatenate([before, fit.z, behind])
    lost = np.concatenate([[0.0, 0.0, depth[0]], depth, [depth[-1], 0.0, 0.0]])
    rows = [f"{place!r},{-1e3 * share * gone!r}" for place, gone in zip(z.tolist(), lost.tolist(), strict=True)]
    write_text(target, "\n".join(["z_mm,deviation_um", *rows]) + "\n")
