"""The smallest ball around a history of points.

The ball shrinks onto its support: the centre walks towards the centre of the circle through the support points until a
further point stops it, which joins; a point that the centre lies beyond leaves. Fischer, Gaertner, Kutz, *Fast
smallest-enclosing-ball computation in high dimensions*, ESA 2003 (doi 10.1007/978-3-540-39658-1_57).
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import FloatArray

ROUNDING = 1e-12
STEPS = 1000


def smallest_ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Centre (d,) and radius of the smallest ball around points (n, d)."""
    spread = float(np.ptp(points, axis=0).max(initial=0.0))
    if spread <= 0.0:
        return points[0].copy(), 0.0
    centre = points.mean(axis=0)
    support = [int(np.argmax(_squares(points - centre)))]
    for _ in range(STEPS):
        target, shares = _circle(points[support], centre)
        way = target - centre
        if np.abs(way).max() <= ROUNDING * spread:
            if shares.min() >= -ROUNDING or len(support) == 1:
                break
            support.pop(int(np.argmin(shares)))
            continue
        along, stop = _stopped(points, support, centre, way)
        centre = centre + along * way
        if stop is not None:
            support.append(stop)
    return centre, float(np.sqrt(_squares(points - centre).max()))


def _squares(vectors: FloatArray) -> FloatArray:
    return np.asarray((vectors * vectors).sum(axis=-1))


def _circle(support: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The point of the support's affine hull that is nearest to the centre, and its shares in the points."""
    edges = support[1:] - support[0]
    if not len(edges):
        return support[0], np.ones(1)
    parts = np.linalg.lstsq(edges.T, centre - support[0], rcond=None)[0]
    return support[0] + parts @ edges, np.append(1.0 - parts.sum(), parts)


def _stopped(points: FloatArray, support: list[int], centre: FloatArray, way: FloatArray) -> tuple[float, int | None]:
    """How far the centre can go along its way until a point outside the support stops it, and which."""
    reach = points[support[0]]
    apart = points - reach
    slope = 2.0 * (apart @ -way)
    room = float(_squares(reach - centre)) - _squares(points - centre)
    closing = slope > ROUNDING * float(_squares(way))
    closing[support] = False
    if not closing.any():
        return 1.0, None
    where = np.flatnonzero(closing)
    limits = np.maximum(room[where], 0.0) / slope[where]
    first = int(np.argmin(limits))
    return (1.0, None) if limits[first] >= 1.0 else (float(limits[first]), int(where[first]))
