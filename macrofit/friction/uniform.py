"""One coefficient of friction everywhere."""

from __future__ import annotations

from typing import ClassVar

import msgspec
import numpy as np

from macrofit.errors import ProviderError
from macrofit.friction.contract import LIMIT, BuildContext, FloatArray, TilePairs


class Uniform(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The same coefficient of friction mu on every pair of tiles; its own options and its own provider.

    Raises:
        ProviderError: the coefficient is not in 0 <= mu < 2.
    """

    coefficient: float = 0.11
    """Coefficient of friction mu [-]."""

    depends_on: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        if not 0.0 <= self.coefficient < LIMIT:
            raise ProviderError(f"coefficient = {self.coefficient} is out of bounds: take 0 <= coefficient < {LIMIT:g}")

    def build(self, context: BuildContext) -> Uniform:
        """Itself: there is nothing to prepare."""
        return self

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu for each pair [-], shape (n,)."""
        return np.full(pairs.seat.shape, self.coefficient, dtype=np.float64)
