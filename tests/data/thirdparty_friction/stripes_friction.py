"""A seat ground in stripes: its even tiles are smooth, its odd tiles are rough."""

from typing import ClassVar

import msgspec
import numpy as np

from macrofit.friction import BuildContext, FloatArray, TilePairs


class Stripes(msgspec.Struct, frozen=True):
    """The coefficient of friction of the smooth and of the rough tiles [-]."""

    smooth: float = 0.08
    rough: float = 0.16

    depends_on: ClassVar[frozenset[str]] = frozenset({"tiles"})

    def build(self, context: BuildContext) -> "Stripes":
        """Nothing to prepare."""
        return self

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """By the parity of the seat tile."""
        return np.where(pairs.seat % 2 == 0, self.smooth, self.rough)
