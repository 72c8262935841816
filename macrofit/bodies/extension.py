"""The interior of a body under given displacements of its contact nodes: many at a time, at few unknowns.

With the contact nodes c last in P K P' = L L' and no load on the interior i,

    u_i = -L_ii'^-1 L_ci' u_c,

and what is wanted of u_i needs no more of L than the supernodes of its unknowns and those above them.
Source: Gilbert, Peierls, SIAM J. Sci. Stat. Comput. 9 (1988) 862-874.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import blas

from ..base.arrays import FloatArray, IntArray
from ..base.cholmod import Factor

COLUMNS = 512
"""Displacements that are extended at once: what is held of the interior stays near the processor."""


def extend(factor: Factor, wanted: IntArray, given: FloatArray) -> FloatArray:
    """The displacements of unloaded unknowns under given ones of the contact nodes.

    Args:
        factor: of the stiffness K (n, n), its m contact unknowns last.
        wanted: numbers of interior unknowns in K, shape (w,).
        given: displacements of the contact unknowns in the factor's order, shape (m, k) [mm].

    Returns:
        Displacements of the wanted unknowns, shape (w, k) [mm].
    """
    size, trailing = len(factor.permutation), len(given)
    row = np.empty(size, dtype=np.int64)
    row[factor.permutation] = np.arange(size)
    panels = list(_panels(factor, row[wanted], size - trailing))
    # the rows of L that are computed, in their order, and after them the given ones
    held = np.concatenate([*(np.arange(first, first + L.shape[1]) for first, L, _ in panels[::-1]), np.arange(0)])
    place = np.full(size, -1, dtype=np.int64)
    place[held], place[size - trailing :] = np.arange(len(held)), len(held) + np.arange(trailing)
    steps = [(place[first], L, place[below]) for first, L, below in panels]
    out, chosen = np.empty((len(wanted), given.shape[1])), place[row[wanted]]
    for start in range(0, given.shape[1], COLUMNS):
        part = given[:, start : start + COLUMNS]
        u = np.empty((len(held) + trailing, part.shape[1]))
        u[len(held) :] = part
        for first, L, below in steps:
            wide = L.shape[1]
            own = u[first : first + wide]
            np.matmul(L[wide:].T, u[below], out=own)
            blas.dtrsm(-1.0, L[:wide], own.T, side=1, lower=1, overwrite_b=1)
        out[:, start : start + COLUMNS] = u[chosen]
    return out


def _panels(factor: Factor, rows: IntArray, interior: int) -> Iterator[tuple[int, FloatArray, IntArray]]:
    """The needed supernodes from the last to the first: first row, columns of the interior, rows below them."""
    first, begin, place, index, values = factor.supernodes
    own = np.repeat(np.arange(len(first) - 1), np.diff(first))
    count = int(np.searchsorted(first[:-1], interior))  # supernodes that begin in the interior
    needed = np.zeros(len(first), dtype=bool)
    needed[own[rows]] = True
    below = begin[:count] + np.diff(first[: count + 1])
    for k in range(count):
        if needed[k] and below[k] < begin[k + 1]:
            needed[own[index[below[k]]]] = True
    for k in np.flatnonzero(needed[:count])[::-1]:
        high, wide = begin[k + 1] - begin[k], min(first[k + 1], interior) - first[k]
        panel = values[place[k] : place[k] + high * wide].reshape(wide, high).T
        yield int(first[k]), panel, np.asarray(index[begin[k] + wide : begin[k + 1]], dtype=np.int64)
