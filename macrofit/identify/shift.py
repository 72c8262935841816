"""An offset of the measured displacements: a record that began late, or a zero that was set elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray
from .measured import FEWEST, Measured

WIDEST = 0.2
"""Largest offset that is looked for, relative to the scene's way [-]."""
STEPS = 200
"""Offsets tried on either side."""
FINEST = 1e-4
"""Step at which an offset is found [mm]."""
MOST_POINTS = 2000
"""Points of the curve that are looked at."""


@dataclass(frozen=True)
class Tangent:
    """The computed curve near a value of the parameter, linear in it: F(p + dp, x) = force + dp slope."""

    places: FloatArray  # (m,) ascending [mm]
    force: FloatArray  # (m,) [N]
    slope: FloatArray  # (m,) [N per unit of the parameter]


@dataclass(frozen=True)
class Offset:
    """An offset s of the measured displacements, and what goes with it."""

    shift: float  # s [mm], to be added
    step: float  # dp, of the parameter
    deviation: float  # root of the mean square residual [N]


def best_offset(measured: Measured, tangent: Tangent) -> Offset:
    """The s for which measured(x) and F(p + dp, x + s) are nearest, dp the best one for each s.

    Only points within the computed displacements count, and at least half as many as can.
    """
    thin = slice(None, None, max(1, len(measured.force) // MOST_POINTS))
    x, force = measured.displacement[thin], measured.force[thin]
    limit = WIDEST * float(np.ptp(tangent.places))
    tried = np.linspace(-limit, limit, 2 * STEPS + 1)
    most = max(_inside(x + s, tangent).sum() for s in tried)
    least = max(FEWEST, int(most) // 2)
    found = [_at(x, force, s, tangent, least) for s in tried.tolist()]
    best = min(found, key=lambda each: each.deviation)
    width = limit / STEPS
    while width > FINEST:
        width *= 0.5
        near = [_at(x, force, best.shift + side * width, tangent, least) for side in (-1.0, 1.0)]
        best = min([best, *near], key=lambda each: each.deviation)
    return best


def offset_at(measured: Measured, tangent: Tangent, shift: float = 0.0) -> Offset:
    """The best dp for a given offset s."""
    return _at(measured.displacement, measured.force, shift, tangent, 1)


def standard_errors(at: FloatArray, tangent: Tangent, residual: FloatArray) -> tuple[float, float]:
    """Standard errors of the parameter and of the offset [mm]: sigma (J'J)^-1/2, J = (dF/dp, dF/ds).

    Args:
        at: places x + s of the points used [mm], (n,).
        tangent: at the value found.
        residual: measured - fitted [N], (n,).
    """
    h = 0.5 * float(np.ptp(tangent.places)) / len(tangent.places)
    along = (np.interp(at + h, tangent.places, tangent.force) - np.interp(at - h, tangent.places, tangent.force)) / (
        2 * h
    )
    jacobian = np.column_stack([np.interp(at, tangent.places, tangent.slope), along])
    scale = np.sqrt((jacobian**2).sum(axis=0))
    scaled = jacobian / np.where(scale > 0.0, scale, 1.0)
    variance = float(residual @ residual) / max(1, len(at) - 2) * np.diag(np.linalg.pinv(scaled.T @ scaled))
    errors = np.sqrt(variance) / np.where(scale > 0.0, scale, np.inf)
    return float(errors[0]), float(errors[1])


def _inside(x: FloatArray, tangent: Tangent) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    return np.asarray((x >= tangent.places[0] - 1e-9) & (x <= tangent.places[-1] + 1e-9))


def _at(x: FloatArray, force: FloatArray, shift: float, tangent: Tangent, least: int) -> Offset:
    inside = _inside(x + shift, tangent)
    if inside.sum() < least:
        return Offset(shift, 0.0, np.inf)
    at = x[inside] + shift
    slope = np.interp(at, tangent.places, tangent.slope)
    residual = force[inside] - np.interp(at, tangent.places, tangent.force)
    squares = float(slope @ slope)
    step = float(slope @ residual) / squares if squares > 0.0 else 0.0
    return Offset(shift, step, float(np.sqrt(np.mean((residual - step * slope) ** 2))))
