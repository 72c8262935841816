"""Numba kernels of the pairs that may meet: where two plates first touch, and which spheres come near each other."""

from __future__ import annotations

import numpy as np
from numba import njit

from macrofit.base.caches import ensure_cache
from macrofit.base.compiled import check_compiled

ensure_cache()  # numba looks for it where a kernel is declared


@njit(cache=True)
def first_touch(wheel, wheel_radii, axle, axle_radii, order, x):
    """Height of the wheel's plate at which it first touches the axle's when carried to slide x [mm]; -inf if never.

    order: the axle's spheres sorted by y.
    """
    y = axle[order, 1]
    widest = axle_radii.max()
    height = -np.inf
    for i in range(len(wheel)):
        reach = wheel_radii[i] + widest
        for q in range(np.searchsorted(y, wheel[i, 1] - reach), np.searchsorted(y, wheel[i, 1] + reach)):
            j = order[q]
            dx, dy = axle[j, 0] - wheel[i, 0] - x, axle[j, 1] - wheel[i, 1]
            square = (wheel_radii[i] + axle_radii[j]) ** 2 - dx * dx - dy * dy
            if square > 0.0:
                height = max(height, axle[j, 2] - wheel[i, 2] + np.sqrt(square))
    return height


@njit(cache=True)
def find_candidates(wheel, wheel_radii, axle, axle_radii, order, low, high, travel, margin):
    """Pairs that may touch while the wheel is carried from x = 0 to `travel`, its height within low ... high [mm].

    Returns the pairs (p, 2) and the slides (p, 2) between which their gap may be below `margin` [mm].
    """
    y = axle[order, 1]
    widest = axle_radii.max()
    pairs = np.empty((64 * len(wheel), 2), np.int64)
    spans = np.empty((64 * len(wheel), 2))
    count = 0
    for i in range(len(wheel)):
        reach = wheel_radii[i] + widest + margin
        for q in range(np.searchsorted(y, wheel[i, 1] - reach), np.searchsorted(y, wheel[i, 1] + reach)):
            j = order[q]
            dz = wheel[i, 2] - axle[j, 2]
            dz = max(0.0, dz + low, -dz - high)
            dy = axle[j, 1] - wheel[i, 1]
            square = (wheel_radii[i] + axle_radii[j] + margin) ** 2 - dy * dy - dz * dz
            if square <= 0.0:
                continue
            middle, half = axle[j, 0] - wheel[i, 0], np.sqrt(square)
            if middle + half < 0.0 or middle - half > travel:
                continue
            if count == len(pairs):
                more = np.empty((2 * count, 2), np.int64)
                more[:count] = pairs
                pairs = more
                wider = np.empty((2 * count, 2))
                wider[:count] = spans
                spans = wider
            pairs[count, 0] = i
            pairs[count, 1] = j
            spans[count, 0] = middle - half
            spans[count, 1] = middle + half
            count += 1
    return pairs[:count], spans[:count]


check_compiled(first_touch)
