"""Two non-matching contact lines facing each other: exact integrals over the segments that both cut out."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray
from ..bodies.body import ContactLine
from .moments import GAUSS_X, CoveredFacets, Entries, covered_facets, entries, quadrature, shape

_BLOCK = 8
"""Portions in a block of a Band: fewer make more products of matrices, more fill them with zeros."""
_SPARSE = 250
"""Columns from which on a Band keeps rows without zeros; for fewer, to make them takes longer than they save."""

Rows: TypeAlias = FloatArray | sp.csr_matrix
"""A matrix, dense or by rows."""


@dataclass(frozen=True)
class Band:
    """A sparse matrix of moments whose entries lie along a band: as rows for vectors, as dense blocks for matrices."""

    matrix: Rows  # (n, columns of the span)
    span: slice  # the columns that have entries lie within
    blocks: tuple[tuple[slice, slice, FloatArray], ...]  # rows, columns counted from the span's first, and entries

    @cached_property
    def transposed(self) -> FloatArray | sp.csc_matrix:
        """The matrix for loads."""
        return self.matrix.T

    def add_product(self, out: FloatArray, scale: FloatArray, dense: FloatArray) -> None:
        """out (n, k) += scale * (matrix @ dense) for ``scale`` (n,), ``dense`` (span, k); skips zero blocks."""
        live = np.logical_or.reduceat(scale != 0.0, [rows.start for rows, *_ in self.blocks]).tolist()
        for (rows, columns, block), needed in zip(self.blocks, live, strict=True):
            if needed:
                out[rows] += (scale[rows, None] * block) @ dense[columns]


@dataclass(frozen=True, kw_only=True)
class MortarCoupling:
    """How the lines face each other at one displacement of the wheel; p covered portions, n moments each."""

    portions: CoveredFacets
    normals: FloatArray  # (p n, 2)
    nodes: int  # of the bore
    bore: Band  # (p n, bore nodes): moments of one component of the bore's displacement
    slope: Rows  # (p n, span of the band): moments of its derivative along the bore
    gap: FloatArray  # (p n,) moments of the undeformed normal gap [mm]
    axial_share_undeformed: (
        FloatArray  # (p n,) moments of the undeformed part of the axial share of the pressure, see `contact.law`
    )
    thermal_strain: float  # of the wheel
    clearance: float  # smallest undeformed gap on the facets that were left out [mm]; infinite where none were

    @cached_property
    def normals_by_component(self) -> FloatArray:
        """n_r and n_z (2, p n)."""
        return np.ascontiguousarray(self.normals.T)

    def bore_moments(self, displacement: FloatArray) -> FloatArray:
        """N u (2, p n) of a displacement (2 bore nodes,) of the bore; (2, runs, p n) of (2, runs, bore nodes)."""
        r, z = self._on_line(self.bore.matrix, displacement)
        n_r, n_z = self.normals_by_component
        moments = np.empty((2, *r.shape))
        moments[0], moments[1] = n_r * r + n_z * z, n_r * z - n_z * r
        return moments

    def bore_loads(self, forces: FloatArray) -> FloatArray:
        """N' f (2 bore nodes,) of forces (2, p n) on the moments [N]; (2, runs, bore nodes) of (2, runs, p n)."""
        n_r, n_z = self.normals_by_component
        components = np.empty(forces.shape)
        components[0], components[1] = n_r * forces[0] - n_z * forces[1], n_z * forces[0] + n_r * forces[1]
        loads = np.zeros((*forces.shape[:-1], self.nodes))
        loads[..., self.bore.span] = _by_rows(self.bore.transposed, components)
        return loads if forces.ndim > 2 else loads.ravel()

    def bore_slope(self, displacement: FloatArray) -> FloatArray:
        """n . du/ds (p n,), moments along the bore; (runs, p n) of (2, runs, bore nodes)."""
        r, z = self._on_line(self.slope, displacement)
        n_r, n_z = self.normals_by_component
        return np.asarray(n_r * r + n_z * z)

    def _on_line(self, matrix: Rows, displacement: FloatArray) -> FloatArray:
        """A band's ``matrix`` on both components of a displacement, or of those of several runs."""
        given = displacement.reshape(2, *displacement.shape[1:-1], self.nodes)[..., self.bore.span]
        return _by_rows(matrix, given)

    @property
    def bore_rows(self) -> sp.csr_matrix:
        """N as a sparse matrix (2 p n, 2 bore nodes)."""
        narrow = sp.csr_matrix(self.bore.matrix)
        shape = (len(self.normals), self.nodes)
        matrix = sp.csr_matrix((narrow.data, narrow.indices + self.bore.span.start, narrow.indptr), shape=shape)
        n_r, n_z = (sp.diags(self.normals[:, k]) @ matrix for k in (0, 1))
        return sp.bmat([[n_r, n_z], [-n_z, n_r]], format="csr")


def _by_rows(matrix: Rows | sp.csc_matrix, values: FloatArray) -> FloatArray:
    """The products (..., n) of a matrix (n, m) with vectors (..., m), taken at once."""
    products = matrix @ values.reshape(-1, values.shape[-1]).T
    return np.asarray(products.T.reshape(*values.shape[:-1], -1))


def couple_lines(seat: ContactLine, bore: ContactLine, travel: float, reach: float = np.inf) -> MortarCoupling | None:
    """Face the bore, moved by ``travel`` [mm], with the seat; None where they do not overlap.

    With a finite ``reach`` the facets at either end are left out where the undeformed gap is nowhere smaller than
    ``reach`` times the deepest interpenetration, and None is returned where the gap is open all along.
    """
    shift = travel if seat.radial else 0.0
    s, b = seat.coordinate, bore.coordinate + shift
    low, high = max(s[0], b[0]), min(s[-1], b[-1])
    if high - low <= 1e-9 * float(seat.length.min()):
        return None
    inner = np.concatenate([s[(s > low) & (s < high)], b[(b > low) & (b < high)]])
    cuts = np.concatenate([[low], np.sort(inner), [high]])
    same = 1e-12 * (high - low)  # distance of nodes that are one but for rounding
    cuts = cuts[np.append(True, np.diff(cuts) > same)]
    cuts[-1] = high
    clearance = np.inf
    if np.isfinite(reach):
        gap = open_gap(seat, bore, travel, cuts)
        depth = -float(gap.min())
        if depth <= -0.02 * float(seat.length.max()):
            return None
        if depth > 0.0:
            near = cuts[gap < reach * depth]
            ends = np.concatenate([[-np.inf], s, [np.inf]])  # the facet on either side of a near node is near
            before = ends[np.searchsorted(s, near[0] - same, side="left")]
            after = ends[np.searchsorted(s, near[-1] + same, side="right") + 1]
            clearance = float(gap[(cuts <= before + same) | (cuts >= after - same)].min(initial=np.inf))
            low, high = max(low, before), min(high, after)
            cuts = cuts[(cuts >= low - same) & (cuts <= high + same)]
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    facet = np.searchsorted(s, middle, side="right") - 1
    bore_facet = np.searchsorted(b, middle, side="right") - 1
    first, last = int(facet[0]), int(facet[-1])
    covered = np.arange(first, last + 1)
    portions = covered_facets(seat, covered, np.maximum(s[covered], low), np.minimum(s[covered + 1], high))
    q, which, test = quadrature(seat, portions, facet - first, cuts[:-1], cuts[1:])
    return _coupling(seat, bore, travel, clearance, portions, np.repeat(bore_facet, len(GAUSS_X)), q, which, test)


def open_gap(seat: ContactLine, bore: ContactLine, travel: float, s: FloatArray) -> FloatArray:
    """Undeformed gap [mm] at coordinates s of the seat, in the direction of the heights; < 0: interpenetration."""
    shift = travel if seat.radial else 0.0
    height = bore.generatrix.height(s - shift) - seat.generatrix.height(s)
    if seat.radial:
        return np.asarray(height)
    return np.asarray((height + travel) * np.sign(seat.normals[0, 1]))


def _coupling(
    seat: ContactLine,
    bore: ContactLine,
    travel: float,
    clearance: float,
    portions: CoveredFacets,
    bore_facet: IntArray,
    s: FloatArray,
    which: IntArray,
    test: FloatArray,
) -> MortarCoupling:
    x = bore.coordinate
    extent = x[bore_facet + 1] - x[bore_facet]
    zeta = s - (travel if seat.radial else 0.0)
    values, slopes = shape(bore.order, (zeta - x[bore_facet]) / extent)
    nodes = bore.order * bore_facet[:, None] + np.arange(bore.order + 1)
    span = slice(int(nodes[0, 0]), int(nodes[-1, -1]) + 1)
    columns = nodes - span.start
    normals = np.repeat(seat.normals[portions.facet], test.shape[1], axis=0)
    normal = seat.normals[portions.facet[which]]
    height = bore.generatrix.height(zeta) - seat.generatrix.height(s)
    if seat.radial:
        gap = height * normal[:, 0]
        axial_share_undeformed = bore.generatrix.slope(zeta) * normal[:, 0] + normal[:, 1]
    else:
        gap, axial_share_undeformed = (height + travel) * normal[:, 1], np.zeros_like(s)
    bore_entries = entries(test, values, which, columns)
    places = _Places.between(which, columns, test.shape[1])
    matrix = places.matrix(bore_entries)
    return MortarCoupling(
        portions=portions,
        normals=normals,
        nodes=len(bore.nodes),
        bore=Band(matrix, span, places.blocks(bore_entries, matrix)),
        slope=places.matrix(entries(test, slopes / extent[:, None], which, columns), matrix),
        gap=_mean(test, gap, which, len(portions.facet)),
        axial_share_undeformed=_mean(test, axial_share_undeformed, which, len(portions.facet)),
        thermal_strain=bore.generatrix.thermal_strain,
        clearance=clearance,
    )


@dataclass(frozen=True)
class _Places:
    """Where the entries of a band lie whose points come in ascending portions and columns."""

    low: IntArray  # (p,) first column of each portion
    high: IntArray  # (p,) one beyond its last
    moments: int  # rows of a portion

    @classmethod
    def between(cls, portion: IntArray, columns: IntArray, moments: int) -> _Places:
        """The rows for points (q,) of portions with entries in ``columns`` (q, b)."""
        first = np.searchsorted(portion, np.arange(int(portion[-1]) + 2))
        return cls(columns[first[:-1], 0], columns[first[1:] - 1, -1] + 1, moments)

    def matrix(self, entries: Entries, other: Rows | None = None) -> Rows:
        """The sum of the entries, by rows; of ``other`` entries at the same places the structure is shared."""
        if self.high[-1] < _SPARSE:
            return self._dense(entries)
        data, first = self._windows(entries, 1)
        if other is not None:
            out: sp.csr_matrix = copy(other)
            out.data = data.ravel()
            return out
        width = data.shape[1]
        indices = (np.repeat(first, self.moments)[:, None] + np.arange(width)).astype(np.int32)
        starts = np.arange(0, data.size + 1, width, dtype=np.int32)
        return sp.csr_matrix((data.ravel(), indices.ravel(), starts), shape=(len(data), int(self.high[-1])))

    def blocks(self, entries: Entries, matrix: Rows) -> tuple[tuple[slice, slice, FloatArray], ...]:
        """The sum of the entries, which is the ``matrix``, some portions at a time."""
        height, stop = _BLOCK * self.moments, self.moments * len(self.low)
        rows = [slice(start, min(start + height, stop)) for start in range(0, stop, height)]
        if isinstance(matrix, np.ndarray):
            starts = np.arange(0, len(self.low), _BLOCK)
            ends = self.high[np.minimum(starts + _BLOCK, len(self.low)) - 1]
            columns = map(slice, self.low[starts].tolist(), ends.tolist())
            return tuple((own, across, matrix[own, across]) for own, across in zip(rows, columns, strict=True))
        data, first = self._windows(entries, _BLOCK)
        width = data.shape[1]
        return tuple((own, slice(low, low + width), data[own]) for own, low in zip(rows, first.tolist(), strict=True))

    def _dense(self, entries: Entries) -> FloatArray:
        """The sum of the entries, with all zeros."""
        data, rows, columns = entries
        shape = len(self.low) * self.moments, int(self.high[-1])
        flat = np.bincount(rows * shape[1] + columns, data, minlength=shape[0] * shape[1])
        return np.asarray(flat.reshape(shape), dtype=np.float64)

    def _windows(self, entries: Entries, together: int) -> tuple[FloatArray, IntArray]:
        """The rows (n, w) with w columns each, the first of which is the same for ``together`` portions."""
        data, rows, columns = entries
        starts = np.arange(0, len(self.low), together)
        last = np.minimum(starts + together, len(self.low)) - 1
        width = int((self.high[last] - self.low[starts]).max())
        first = np.minimum(self.low[starts], self.high[-1] - width)
        place = rows * width + columns - first[rows // (together * self.moments)]
        flat = np.bincount(place, data, minlength=len(self.low) * self.moments * width)
        return np.asarray(flat.reshape(-1, width), dtype=np.float64), np.asarray(first)


def _mean(test: FloatArray, values: FloatArray, which: IntArray, count: int) -> FloatArray:
    """Moments (p n,) of point values (q,)."""
    columns = [np.bincount(which, test[:, i] * values, minlength=count) for i in range(test.shape[1])]
    return np.asarray(np.stack(columns, axis=1).ravel(), dtype=np.float64)
