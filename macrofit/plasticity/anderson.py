"""Anderson's acceleration of a fixed point x = g(x), for a vector whose parts live on several ranks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..base.arrays import FloatArray

DEPTH = 8
"""Differences that are kept."""

SINGULAR = 1e-12
"""Directions whose part in the residuals is below this are dropped."""


class Anderson:
    """x_next = g_k - sum of c_j (g_(j+1) - g_j), where the c make the residual r_k - sum of c_j (r_(j+1) - r_j) least.

    Args:
        dot: the products of two lists of vectors, summed over all ranks in the same order everywhere:
            (k vectors (n,), m vectors (n,)) -> (k, m).

    Source: Walker, Ni, SIAM J. Numer. Anal. 49 (2011) 1715-1735 (doi 10.1137/10078356X).
    """

    def __init__(self, dot: Callable[[FloatArray, FloatArray], FloatArray]) -> None:
        self._dot = dot
        self._last: tuple[FloatArray, FloatArray] | None = None
        self._residuals: list[FloatArray] = []
        self._values: list[FloatArray] = []

    def next(self, x: FloatArray, value: FloatArray) -> FloatArray:
        """The next x, from x (n,) and g(x) (n,)."""
        residual = value - x
        if self._last is not None:
            self._residuals.append(residual - self._last[0])
            self._values.append(value - self._last[1])
            del self._residuals[:-DEPTH], self._values[:-DEPTH]
        self._last = residual, value
        if not self._residuals:
            return value
        changes = np.stack(self._residuals)
        products = self._dot(changes, np.concatenate([changes, residual[None]]))
        gram, right = products[:, :-1], products[:, -1]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
        share, *_ = np.linalg.lstsq(gram * scale[:, None] * scale, right * scale, rcond=SINGULAR)
        return np.asarray(value - (share * scale) @ np.stack(self._values))
