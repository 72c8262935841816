"""The profiles that the keys of a scene draw, with sharp corners, and how deep one reaches into the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .keys import Hub, Shaft

Profile = list[tuple[float, float]]
"""Points (z, r) [mm] in ascending z, joined by straight lines."""

SMALL_STRAIN = 0.02
"""Largest interference that the linear theory is asked for, in radii of the seat, and largest deviation of a radius."""

SAMPLES = 64
"""At most so many displacements are looked at, the first, the last and the farthest among them."""


def seat_profile(axle: Shaft) -> Profile:
    """Taper and seat; the seat's entrance is z = 0."""
    seat, length = axle.seat_radius, axle.seat_length
    points = [(0.0, seat), (length, seat + 0.5 * axle.taper * length)]
    return [(-axle.taper_length, seat - axle.taper_height), *points] if axle.taper_length > 0.0 else points


def bore_profile(wheel: Hub) -> Profile:
    """Bore and chamfer; the leading face is z = 0."""

    def radius(z: float) -> float:
        return wheel.bore_radius + 0.5 * wheel.bore_taper * z

    points = [(-wheel.hub_length, radius(-wheel.hub_length))]
    if wheel.chamfer_length > 0.0:
        points.append((-wheel.chamfer_length, radius(-wheel.chamfer_length)))
    return [*points, (0.0, wheel.bore_radius + wheel.chamfer_height)]


def sampled(displacements: Sequence[float], count: int = SAMPLES) -> list[float]:
    """Some of the displacements [mm], evenly among them, with the least and the greatest."""
    if len(displacements) <= count:
        return list(displacements)
    chosen = np.linspace(0, len(displacements) - 1, count).round().astype(int)
    return [*(displacements[k] for k in chosen), min(displacements), max(displacements)]


def overlap(inner: Profile, outer: Profile, displacement: float) -> float:
    """How deep the outer profile, moved along z, reaches below the inner one [mm]; -inf where they do not face."""
    s, h = np.array(inner).T
    t, k = np.array(outer).T
    t = t + displacement
    low, high = max(s[0], t[0]), min(s[-1], t[-1])
    if high - low <= 1e-9:
        return -np.inf
    z = np.concatenate([[low, high], s[(s > low) & (s < high)], t[(t > low) & (t < high)]])
    return float((np.interp(z, s, h) - np.interp(z, t, k)).max())
