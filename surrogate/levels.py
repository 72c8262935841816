"""Levels of pressure at which a network is asked, so that a pair of tiles is not asked anew for every MPa."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from macrofit.base.arrays import BoolArray, FloatArray, IntArray

TOLERANCE = 0.1
"""A pair is answered for a pressure that is off by this share at most [-], which is worth 0.2 % of a coefficient."""
HALVED = 0.018
"""What half the pressure is worth of a coefficient [-]."""
LEAST, MOST = 1.0, 5000.0
"""Pressures between which the plates are asked, where no level serves a pair [MPa]."""


@dataclass(frozen=True)
class PressureLevels:
    """Pressures p_k = low ((1 + t) / (1 - t))^k; each serves those within a share t of it.

    A level follows from the pressure alone, so that an answer does not depend on what was asked before.

    Args:
        low: smallest level [MPa]; what lies below is answered for it.
        high: largest pressure that the levels reach [MPa]; what lies above is answered for the last of them.
        tolerance: t [-].
    """

    low: float
    high: float
    tolerance: float = TOLERANCE

    @cached_property
    def count(self) -> int:
        """Number of levels."""
        return 1 + max(0, math.ceil(math.log(self.high / self.low) / self._step - 0.5))

    def beyond(self, pressure: FloatArray) -> IntArray:
        """The level of each pressure [MPa] as `of`, but where none serves it the level that would, if there were more.

        That is below 0 or above the last, down to `LEAST` and up to `MOST`; what is not pressed has level 0.
        """
        level = self.of(pressure)
        below, above = self.outside(pressure)
        out = np.flatnonzero(below | above)
        if out.size:
            steps = np.log(np.clip(pressure[out], LEAST, MOST) / self.low) / self._step
            nearest = np.rint(steps).astype(np.int64)
            level[out] = np.where(below[out], np.minimum(nearest, -1), np.maximum(nearest, self.count))
        return level

    def outside(self, pressure: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Which pressures [MPa] are below and which above what the levels serve; what is not pressed is neither."""
        below = (pressure > 0.0) & (pressure < self.low * (1.0 - self.tolerance))
        return below, np.asarray(pressure > self.high * (1.0 + self.tolerance))

    def octaves(self, pressure: FloatArray) -> FloatArray:
        """How far each pressure [MPa] is `outside`, in factors of two from the nearer end; 0 within."""
        below, above = self.outside(pressure)
        far = np.zeros(len(pressure))
        far[below] = np.log2(self.low / pressure[below])
        far[above] = np.log2(pressure[above] / self.high)
        return far

    @cached_property
    def _ends(self) -> FloatArray:
        """Where each level but the last ends [MPa]: sqrt(p_k p_(k+1))."""
        return np.asarray(self.low * np.exp(self._step * (np.arange(self.count - 1) + 0.5)))

    @cached_property
    def _step(self) -> float:
        return math.log((1.0 + self.tolerance) / (1.0 - self.tolerance))

    def of(self, pressure: FloatArray) -> IntArray:
        """The level that serves each pressure [MPa], of the same shape."""
        return np.searchsorted(self._ends, pressure)

    def pressure(self, level: IntArray) -> FloatArray:
        """The pressure of each level [MPa]."""
        return np.asarray(self.low * np.exp(self._step * level))


def distinct_pairs(
    seat: IntArray, bore: IntArray, level: IntArray
) -> tuple[tuple[IntArray, IntArray, IntArray], IntArray]:
    """Each pair at a level once, sorted, and the number of each among them."""
    if np.all((seat[1:] > seat[:-1]) | ((seat[1:] == seat[:-1]) & (bore[1:] > bore[:-1]))):
        return (seat, bore, level), np.arange(seat.size)  # as the solver asks
    columns = [np.unique(column, return_inverse=True) for column in (seat, bore, level)]
    shape = tuple(max(1, len(values)) for values, _ in columns)
    distinct, which = np.unique(np.ravel_multi_index([at for _, at in columns], shape), return_inverse=True)
    places = np.unravel_index(distinct, shape)
    first, second, third = (values[at] for (values, _), at in zip(columns, places, strict=True))
    return (first, second, third), which
