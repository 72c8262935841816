"""Solutions of K u = f by the kept factor K = P' L L' P, where the load is known and where the displacement is wanted.

A load on few unknowns fills y = L^-1 P f only at their supernodes and those above them in the tree of the elimination;
displacements of few unknowns need no other supernodes of u = P' L'^-1 y either. What contact and plastic zone need is
a part of the factor, and one y serves them both: that of the plastic strains gives u_p on the contact line, and with
the y of the contact's loads added the whole displacement of the zone.

Source: Gilbert, Peierls, SIAM J. Sci. Stat. Comput. 9 (1988) 862-874, for what a sparse right-hand side reaches.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..base.arrays import FloatArray, IntArray
from ..base.cholmod import Factor


class Substitution:
    """Forward and backward substitution on parts of a factor; a part is ascending supernodes with all above them."""

    def __init__(self, factor: Factor) -> None:
        self._factor = factor  # owns the memory of the arrays below
        self._order = factor.permutation
        self._arrays = first, begin, _, rows, _ = factor.supernodes
        wide = np.diff(first)
        self._own = np.repeat(np.arange(len(wide)), wide)
        below = begin[:-1] + wide
        parent = np.full(len(wide), -1, dtype=np.int64)
        has = below < begin[1:]
        parent[has] = self._own[rows[below[has]]]
        self._parent = parent
        self._row = np.empty(len(self._order), dtype=np.int64)
        self._row[self._order] = np.arange(len(self._order))

    @cached_property
    def everything(self) -> IntArray:
        """The part that is all of the factor."""
        return np.arange(len(self._parent))

    def reached(self, unknowns: IntArray) -> IntArray:
        """The part that loads on some unknowns fill, and that their displacements need."""
        from .kernels import reached_from

        return np.flatnonzero(reached_from(self._row[unknowns], self._own, self._parent))

    def forward(self, load: FloatArray, part: IntArray) -> FloatArray:
        """The vector y (dofs,) of a load (dofs,) [N] that acts within a part."""
        from .kernels import forward

        y = load[self._order]
        forward(part, *self._arrays, y)
        return y

    def backward(self, y: FloatArray, part: IntArray) -> FloatArray:
        """The displacement (dofs,) [mm] of a y within a part; what stands elsewhere has no meaning."""
        from .kernels import backward

        u, out = y.copy(), np.empty_like(y)
        backward(part, *self._arrays, u)
        out[self._order] = u
        return out
