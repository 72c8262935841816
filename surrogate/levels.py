"""Levels of pressure at which a network is asked, so that a pair of tiles is not asked anew for every MPa."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from macrofit.base.arrays import FloatArray, IntArray

TOLERANCE = 0.1
"""A pair is answered for a pressure that is off by this share at most [-]. Half the pressure is worth 1.8 % of a
coefficient, this share 0.2 %."""


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
