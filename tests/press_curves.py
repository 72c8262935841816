"""Made pressing curves for a seat of 190 mm in diameter and 180 mm of length, for what judges them."""

from __future__ import annotations

import numpy as np

DIAMETER, LENGTH = 190.0, 180.0  # mm
FINAL = 1.0e6  # N, inside EN 13260's 646 to 1102 kN and GOST 11018's 745 to 1117 kN
SPACING = 0.25  # mm
PLACES = np.linspace(0.0, LENGTH, int(LENGTH / SPACING) + 1)


def convex(final: float = FINAL, bend: float = 0.6, places: np.ndarray = PLACES) -> np.ndarray:
    """A parabola that bulges by bend / 6 of its end [N]."""
    x = places / places[-1]
    return final * (x * (1.0 + bend) - bend * x**2)


def ramp(final: float = FINAL) -> np.ndarray:
    """A straight line from nothing to the end [N]."""
    return convex(final, 0.0)


def through(*points: tuple[float, float]) -> np.ndarray:
    """Straight lines through points (mm, N)."""
    return np.interp(PLACES, *zip(*points, strict=True))


def dipped(start: float, end: float, depth: float, force: np.ndarray | None = None) -> np.ndarray:
    """A force [N] that hangs lower by ``depth`` [N] between two places [mm]."""
    force = convex() if force is None else force
    return np.where((start < PLACES) & (end > PLACES), np.interp(start, PLACES, force) - depth, force)


def many_dips(length: float, depth: float = 2e4) -> np.ndarray:
    """The convex curve with four dips [mm, N]."""
    force = convex()
    for start in (40.0, 70.0, 100.0, 130.0):
        force = dipped(start, start + length, depth, force)
    return force


def saw_tooth(share: float = 0.014, period: float = 6.0) -> np.ndarray:
    """A convex curve with teeth of +- a share of its end, over the whole length [N]."""
    phase = (PLACES / period) % 1.0
    return np.maximum(convex(0.98 * FINAL) + share * FINAL * (2.0 * phase - 1.0) * (PLACES > 0.0), 0.0)


def nine_curves() -> dict[str, np.ndarray]:
    """The curves that a verdict on the end force alone accepts, every one."""
    stepped = np.where(PLACES > 120.0, 0.4 * FINAL, 0.0) + convex(0.6 * FINAL, 1.0)
    return {
        "ramp": ramp(),
        "flat after 60 mm": through((0.0, 0.0), (60.0, FINAL), (LENGTH, FINAL)),
        "no force for 100 mm": through((0.0, 0.0), (100.0, 0.0), (LENGTH, FINAL)),
        "start jump": 0.3 * FINAL + convex(0.7 * FINAL),
        "step": stepped,
        "peak before the end": through((0.0, 0.0), (165.0, 1.12e6), (LENGTH, 1.09e6)),
        "drop at the end": through((0.0, 0.0), (177.0, FINAL), (LENGTH, 0.971 * FINAL)),
        "saw-tooth": saw_tooth(),
        "oil groove": dipped(120.0, 122.0, 0.032 * FINAL),
    }
