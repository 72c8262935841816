"""The interface of two non-matching contact lines: moments over the seat's facets, integrated exactly.

Every quantity of the interface (gap, jump, traction of the bulk stress) is projected on each covered portion of a
seat facet, in the weight 2 pi r ds, onto constants (P1) or linear functions (P2). The projection is represented by
n = 1 or 2 values ("moments") per facet: with the centroid c and the variance v of the portion in that weight, the
basis functions are 1, or the two linear functions that are 1 at c -+ sqrt(v) and 0 at the other of these points.
They are orthogonal in the weight, so that each moment is a weighted mean, each has the weight W = (area) / n, and the
traction law can be applied to each by itself. The integrals are taken over the segments that the breakpoints of both
lines cut out: exact for polynomials, hence for the patch test.

Rows are component-major: the normal components of all moments, then the tangential ones, in the frame of the facet,
n = (n_r, n_z) outward from the axle and t = (-n_z, n_r).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray
from ..bodies.body import ContactLine

GAUSS_X = np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)])
"""Points of an interval [-1, 1], exact to degree 5: basis (1) times shape (2) times radius (1) is 4."""
_GAUSS_W = np.array([5.0, 8.0, 5.0]) / 9.0

Entries = tuple[FloatArray, IntArray, IntArray]
"""Data, rows and columns of a sparse matrix; equal places add up."""


@dataclass(frozen=True, kw_only=True)
class CoveredFacets:
    """Covered portions of seat facets and the basis of their moments."""

    facet: IntArray  # (p,)
    start: FloatArray  # (p,) coordinates [mm]
    end: FloatArray
    density: FloatArray  # (p,) 2 pi (facet length) / (its extent in the coordinate)
    points: FloatArray  # (p, n) where each basis function is 1 [mm]
    weight: FloatArray  # (p, n) W [mm2]

    def basis(self, portion: IntArray, s: FloatArray) -> FloatArray:
        """(q, n): the basis functions of ``portion`` (q,) at coordinates s (q,), divided by their W."""
        x, weight = self.points[portion], self.weight[portion]
        if x.shape[1] == 1:
            return 1.0 / weight
        span = x[:, 1] - x[:, 0]
        values = np.stack([(x[:, 1] - s) / span, (s - x[:, 0]) / span], axis=1)
        return np.asarray(values / weight)


def covered_facets(line: ContactLine, facet: IntArray, start: FloatArray, end: FloatArray) -> CoveredFacets:
    """The portions [start, end] of the facets, with their weighted centroid, variance and area."""
    s, r = line.coordinate, line.radius
    extent = s[facet + 1] - s[facet]
    slope = (r[facet + 1] - r[facet]) / extent
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    radius = r[facet] + slope * (middle - s[facet])
    density = 2.0 * math.pi * line.length[facet] / extent
    area = density * 2.0 * half * radius
    if line.order == 1:
        return CoveredFacets(
            facet=facet, start=start, end=end, density=density, points=middle[:, None], weight=area[:, None]
        )
    shift = slope * half**2 / (3.0 * radius)
    spread = np.sqrt(half**2 / 3.0 - shift**2)
    points = np.stack([middle + shift - spread, middle + shift + spread], axis=1)
    return CoveredFacets(
        facet=facet,
        start=start,
        end=end,
        density=density,
        points=points,
        weight=np.stack([0.5 * area, 0.5 * area], axis=1),
    )


def quadrature(
    line: ContactLine, portions: CoveredFacets, portion: IntArray, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Gauss points s (q,) of the intervals [a, b], their portion (q,), and (q, n) weight * basis / W."""
    s = (0.5 * (a + b))[:, None] + 0.5 * (b - a)[:, None] * GAUSS_X
    which = np.repeat(portion, len(GAUSS_X))
    s = s.ravel()
    weight = (0.5 * (b - a)[:, None] * _GAUSS_W).ravel() * portions.density[which]
    facet = portions.facet[which]
    x, r = line.coordinate, line.radius
    weight *= r[facet] + (r[facet + 1] - r[facet]) * (s - x[facet]) / (x[facet + 1] - x[facet])
    return s, which, weight[:, None] * portions.basis(which, s)


def shape(order: int, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lagrange basis on [0, 1] and its derivative, (q, order + 1)."""
    if order == 1:
        return np.stack([1.0 - t, t], axis=1), np.stack([-np.ones_like(t), np.ones_like(t)], axis=1)
    values = np.stack([(1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)], axis=1)
    return values, np.stack([4.0 * t - 3.0, 4.0 - 8.0 * t, 4.0 * t - 1.0], axis=1)


def entries(test: FloatArray, values: FloatArray, portion: IntArray, columns: IntArray) -> Entries:
    """Entries sum_q test[q, i] values[q, b] at row portion[q] n + i, column columns[q, b]: data, rows, columns."""
    n = test.shape[1]
    shape = (len(test), n, values.shape[1])
    rows = np.broadcast_to((portion[:, None] * n + np.arange(n))[:, :, None], shape)
    return (
        (test[:, :, None] * values[:, None, :]).ravel(),
        rows.ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )


def scalar_rows(entries: Entries, shape: tuple[int, int]) -> sp.csr_matrix:
    """The entries as a sparse matrix of a shape."""
    data, rows, columns = entries
    return sp.csr_matrix((data, (rows, columns)), shape=shape)


def vector_rows(entries: Entries, normals: FloatArray, nodes: int) -> sp.csr_matrix:
    """Rows (normal; tangential) on columns (r; z) of a displacement, from the entries for either component."""
    data, rows, columns = entries
    count = len(normals)
    n_r, n_z = normals[rows].T
    parts = [(rows, columns, n_r * data), (count + rows, nodes + columns, n_r * data)]
    sloping = n_z != 0.0
    if sloping.any():
        rows, columns, data, n_z = rows[sloping], columns[sloping], data[sloping], n_z[sloping]
        parts += [(rows, nodes + columns, n_z * data), (count + rows, columns, -n_z * data)]
    all_rows, all_columns, all_data = (np.concatenate(part) for part in zip(*parts, strict=True))
    return sp.csr_matrix((all_data, (all_rows, all_columns)), shape=(2 * count, 2 * nodes))
