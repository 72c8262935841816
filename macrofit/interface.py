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
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from .body import ContactLine
from .elasticity import traction_operator
from .geometry import FloatArray
from .mesh import IntArray
from .scene_keys import ContactKeys

_GAUSS_X = np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)])
_BLOCK = 16  # portions in a block of a Band
_GAUSS_W = np.array([5.0, 8.0, 5.0]) / 9.0


@dataclass(frozen=True)
class Portions:
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


@dataclass(frozen=True)
class SeatRows:
    """Operators of n moments on the axle's trace nodes, rows component-major."""

    weight: FloatArray  # (n,) [mm2]
    jump: sp.csr_matrix  # (2 n, 2 loaded nodes) J
    trial: sp.csr_matrix  # (2 n, 2 trace nodes) J - T/gamma; J for penalty
    load: sp.csr_matrix  # (2 n, 2 loaded nodes) J - theta/gamma T
    load_transposed: sp.csr_matrix
    traction: sp.csr_matrix | None  # (2 n, 2 trace nodes) T [MPa/mm]; None for penalty


@dataclass(frozen=True)
class CoveredSeat:
    """The seat's side at one displacement: n moments, of whole facets and of at most two partly covered ones."""

    full: SeatRows
    partial: SeatRows | None  # the rows of the partly covered moments, anew
    facet: IntArray  # (n,)
    index: IntArray  # (n,) number of the moment among all of the seat; partly covered ones come after these
    weight: FloatArray  # (n,) [mm2]
    gamma: FloatArray  # (n,) [MPa/mm]
    normals: FloatArray  # (n, 2)

    def seat_moments(self, displacement: FloatArray) -> FloatArray:
        """J u (2, n) of a displacement (2 loaded nodes,) of the seat."""
        size = len(self.full.weight)
        values = (self.full.jump @ displacement).reshape(2, -1)
        if self.partial is not None:
            extra = (self.partial.jump @ displacement).reshape(2, -1)
            values = np.concatenate([values[:, :size], extra], axis=1)
        return np.asarray(values[:, self.index])

    def loads(self, forces: FloatArray) -> FloatArray:
        """Nodal forces (2 loaded nodes,) of forces (2, n) on the moments [N]."""
        size = len(self.full.weight)
        spread = np.zeros((2, size + (0 if self.partial is None else len(self.partial.weight))))
        spread[:, self.index] = forces
        nodal = self.full.load_transposed @ spread[:, :size].ravel()
        if self.partial is not None:
            nodal = nodal + self.partial.load_transposed @ spread[:, size:].ravel()
        return np.asarray(nodal)


@dataclass(frozen=True)
class Band:
    """A sparse matrix of moments whose entries lie along a band, as dense blocks of rows for products with matrices."""

    matrix: FloatArray  # (n, columns), zero outside the blocks
    blocks: tuple[tuple[slice, slice], ...]  # rows and columns of each

    def add_product(self, out: FloatArray, scale: FloatArray, dense: FloatArray) -> None:
        """out (n, k) += scale * (matrix @ dense) for ``scale`` (n,), ``dense`` (columns, k); skips zero blocks."""
        for rows, columns in self.blocks:
            if scale[rows].any():
                out[rows] += (scale[rows, None] * self.matrix[rows, columns]) @ dense[columns]


@dataclass(frozen=True)
class Pairing:
    """How the lines face each other at one displacement of the wheel; p covered portions, n moments each."""

    portions: Portions
    normals: FloatArray  # (p n, 2)
    bore: Band  # (p n, bore nodes): moments of one component of the bore's displacement
    slope: FloatArray  # (p n, bore nodes): moments of its derivative along the bore
    gap: FloatArray  # (p n,) moments of the undeformed normal gap [mm]
    lean: FloatArray  # (p n,) moments of the undeformed part of the axial share of the pressure, see contact.py
    clearance: float  # smallest undeformed gap at the ends that were left out [mm]; infinite where none were

    def bore_moments(self, displacement: FloatArray) -> FloatArray:
        """N u (2, p n) of a displacement (2 bore nodes,) of the bore."""
        r, z = (self.bore.matrix @ displacement.reshape(2, -1).T).T
        n_r, n_z = self.normals.T
        return np.stack([n_r * r + n_z * z, n_r * z - n_z * r])

    def bore_loads(self, forces: FloatArray) -> FloatArray:
        """N' f (2 bore nodes,) of forces (2, p n) on the moments [N]."""
        n_r, n_z = self.normals.T
        components = np.stack([n_r * forces[0] - n_z * forces[1], n_z * forces[0] + n_r * forces[1]])
        return np.asarray((components @ self.bore.matrix).ravel())

    def bore_slope(self, displacement: FloatArray) -> FloatArray:
        """n . du/ds (p n,), moments along the bore."""
        r, z = (self.slope @ displacement.reshape(2, -1).T).T
        return np.asarray(self.normals[:, 0] * r + self.normals[:, 1] * z)

    @property
    def bore_rows(self) -> sp.csr_matrix:
        """N as a sparse matrix (2 p n, 2 bore nodes)."""
        n_r, n_z = (sp.diags(self.normals[:, k]) @ sp.csr_matrix(self.bore.matrix) for k in (0, 1))
        return sp.bmat([[n_r, n_z], [-n_z, n_r]], format="csr")


def portions_of(line: ContactLine, facet: IntArray, start: FloatArray, end: FloatArray) -> Portions:
    """The portions [start, end] of the facets, with their weighted centroid, variance and area."""
    s, r = line.coordinate, line.radius
    extent = s[facet + 1] - s[facet]
    slope = (r[facet + 1] - r[facet]) / extent
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    radius = r[facet] + slope * (middle - s[facet])
    density = 2.0 * math.pi * line.length[facet] / extent
    area = density * 2.0 * half * radius
    if line.order == 1:
        return Portions(facet, start, end, density, middle[:, None], area[:, None])
    shift = slope * half**2 / (3.0 * radius)
    spread = np.sqrt(half**2 / 3.0 - shift**2)
    points = np.stack([middle + shift - spread, middle + shift + spread], axis=1)
    return Portions(facet, start, end, density, points, np.stack([0.5 * area, 0.5 * area], axis=1))


def _quadrature(
    line: ContactLine, portions: Portions, portion: IntArray, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Gauss points s (q,) of the intervals [a, b], their portion (q,), and (q, n) weight * basis / W."""
    s = (0.5 * (a + b))[:, None] + 0.5 * (b - a)[:, None] * _GAUSS_X
    which = np.repeat(portion, len(_GAUSS_X))
    s = s.ravel()
    weight = (0.5 * (b - a)[:, None] * _GAUSS_W).ravel() * portions.density[which]
    facet = portions.facet[which]
    x, r = line.coordinate, line.radius
    weight *= r[facet] + (r[facet + 1] - r[facet]) * (s - x[facet]) / (x[facet + 1] - x[facet])
    return s, which, weight[:, None] * portions.basis(which, s)


def _shape(order: int, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lagrange basis on [0, 1] and its derivative, (q, order + 1)."""
    if order == 1:
        return np.stack([1.0 - t, t], axis=1), np.stack([-np.ones_like(t), np.ones_like(t)], axis=1)
    values = np.stack([(1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)], axis=1)
    return values, np.stack([4.0 * t - 3.0, 4.0 - 8.0 * t, 4.0 * t - 1.0], axis=1)


def _entries(
    test: FloatArray, values: FloatArray, portion: IntArray, columns: IntArray
) -> tuple[FloatArray, IntArray, IntArray]:
    """Entries sum_q test[q, i] values[q, b] at row portion[q] n + i, column columns[q, b]: data, rows, columns."""
    n = test.shape[1]
    shape = (len(test), n, values.shape[1])
    rows = np.broadcast_to((portion[:, None] * n + np.arange(n))[:, :, None], shape)
    return (
        (test[:, :, None] * values[:, None, :]).ravel(),
        rows.ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )


def _scalar_rows(entries: tuple[FloatArray, IntArray, IntArray], shape: tuple[int, int]) -> sp.csr_matrix:
    data, rows, columns = entries
    return sp.csr_matrix((data, (rows, columns)), shape=shape)


def _vector_rows(entries: tuple[FloatArray, IntArray, IntArray], normals: FloatArray, nodes: int) -> sp.csr_matrix:
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


class Seat:
    """The seat's operators for every facet fully covered, and for any covering."""

    def __init__(self, line: ContactLine, keys: ContactKeys) -> None:
        self.line, self.nitsche, self.theta = line, keys.formulation == "nitsche", float(keys.theta)
        self.gamma = gamma_of(keys, line.material.youngs_modulus, line.length)
        self.loaded = line.trace_nodes if self.nitsche and keys.theta else len(line.nodes)
        s = line.coordinate
        portions = portions_of(line, np.arange(line.facets), s[:-1], s[1:])
        self.moments = portions.points.shape[1]  # per facet
        self.size = line.facets * self.moments
        self.full = self.rows(portions)

    @cached_property
    def stabilisation(self) -> sp.csr_matrix | None:
        """-theta T' W / gamma T on the trace degrees of freedom; None where it vanishes."""
        if self.full.traction is None or self.theta == 0.0:
            return None
        scale = -self.theta * self.full.weight / np.repeat(self.gamma, self.moments)
        return (self.full.traction.T @ sp.diags(np.tile(scale, 2)) @ self.full.traction).tocsr()

    def rows(self, portions: Portions) -> SeatRows:
        """The operators on ``portions``."""
        line, (count, n) = self.line, portions.weight.shape
        s, which, test = _quadrature(line, portions, np.arange(count), portions.start, portions.end)
        facet = portions.facet[which]
        x = line.coordinate
        t = (s - x[facet]) / (x[facet + 1] - x[facet])
        values, _ = _shape(line.order, t)
        columns = line.order * facet[:, None] + np.arange(line.order + 1)
        normals = np.repeat(line.normals[portions.facet], n, axis=0)
        jump = trial = load = _vector_rows(_entries(test, values, which, columns), normals, line.trace_nodes)
        traction = None
        if self.nitsche:
            traction = _traction_rows(line, portions, which, test, facet, t)
            scaled = sp.diags(np.tile(1.0 / np.repeat(self.gamma[portions.facet], n), 2)) @ traction
            trial = (jump - scaled).tocsr()
            load = (jump - self.theta * scaled).tocsr() if self.theta else jump
        nodes = np.arange(self.loaded)
        loaded = np.concatenate([nodes, line.trace_nodes + nodes])
        jump, load = jump[:, loaded], load[:, loaded]
        return SeatRows(portions.weight.ravel(), jump, trial, load, load.T.tocsr(), traction)

    def cover(self, portions: Portions) -> CoveredSeat:
        """The operators on the covered portions; only those of partly covered facets are computed."""
        s, m, facets = self.line.coordinate, self.moments, portions.facet
        whole = (portions.start == s[facets]) & (portions.end == s[facets + 1])
        part = np.flatnonzero(~whole)
        base = facets * m
        base[part] = self.size + m * np.arange(len(part))
        index = (base[:, None] + np.arange(m)).ravel()
        partial = None
        if len(part):
            partial = self.rows(portions_of(self.line, facets[part], portions.start[part], portions.end[part]))
        facet = np.repeat(facets, m)
        return CoveredSeat(
            self.full,
            partial,
            facet,
            index,
            portions.weight.ravel(),
            self.gamma[facet],
            self.line.normals[facet],
        )


def gamma_of(keys: ContactKeys, youngs_modulus: float, length: FloatArray) -> FloatArray:
    """gamma [MPa/mm] of facets of ``length`` [mm]: gamma0 E / h (Nitsche), or the penalty stiffness."""
    if keys.formulation == "penalty":
        stiffness = 10.0 * youngs_modulus if keys.penalty_stiffness is None else keys.penalty_stiffness
        return np.full_like(length, stiffness)
    gamma0 = (30.0 if keys.theta == 1 else 10.0) if keys.gamma0 is None else keys.gamma0
    return gamma0 * youngs_modulus / length


def _traction_rows(
    line: ContactLine, portions: Portions, which: IntArray, test: FloatArray, facet: IntArray, t: FloatArray
) -> sp.csr_matrix:
    vertices = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    start, end = vertices[line.ends[facet, 0]], vertices[line.ends[facet, 1]]
    points = start + t[:, None] * (end - start)
    normal = line.normals[facet]
    operator = traction_operator(line.order, line.corners[facet], points, normal, line.material)
    n_r, n_z = normal[:, 0, None], normal[:, 1, None]
    normal_row = np.asarray(n_r * operator[:, 0] + n_z * operator[:, 1], dtype=np.float64)
    tangential_row = np.asarray(-n_z * operator[:, 0] + n_r * operator[:, 1], dtype=np.float64)
    cells = line.cells[facet]
    columns = np.stack([cells, line.trace_nodes + cells], axis=2).reshape(len(facet), -1)
    shape = (portions.weight.size, 2 * line.trace_nodes)
    return sp.vstack(
        [_scalar_rows(_entries(test, rows, which, columns), shape) for rows in (normal_row, tangential_row)],
        format="csr",
    )


def pair(seat: ContactLine, bore: ContactLine, travel: float, reach: float = np.inf) -> Pairing | None:
    """Face the bore, moved by ``travel`` [mm], with the seat; None where they do not overlap.

    With a finite ``reach`` the facets at either end are left out where the undeformed gap is wider than ``reach`` times
    the deepest interpenetration, and None is returned where the gap is open all along.
    """
    shift = travel if seat.radial else 0.0
    s, b = seat.coordinate, bore.coordinate + shift
    low, high = max(s[0], b[0]), min(s[-1], b[-1])
    if high - low <= 1e-9 * float(seat.length.min()):
        return None
    inner = np.concatenate([s[(s > low) & (s < high)], b[(b > low) & (b < high)]])
    cuts = np.concatenate([[low], np.sort(inner), [high]])
    keep = np.append(True, np.diff(cuts) > 1e-12 * (high - low))
    cuts = cuts[keep]
    cuts[-1] = high
    clearance = np.inf
    if np.isfinite(reach):
        gap = open_gap(seat, bore, travel, cuts)
        depth = -float(gap.min())
        if depth <= -0.02 * float(seat.length.max()):
            return None
        if depth > 0.0:
            near = np.flatnonzero(gap < reach * depth)
            low = max(low, s[np.searchsorted(s, cuts[near[0]], side="right") - 1])
            high = min(high, s[min(np.searchsorted(s, cuts[near[-1]], side="left"), len(s) - 1)])
            kept = (cuts >= low) & (cuts <= high)
            clearance = float(gap[~kept].min(initial=np.inf))
            cuts = cuts[kept]
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    facet = np.searchsorted(s, middle, side="right") - 1
    bore_facet = np.searchsorted(b, middle, side="right") - 1
    first, last = int(facet[0]), int(facet[-1])
    covered = np.arange(first, last + 1)
    portions = portions_of(seat, covered, np.maximum(s[covered], low), np.minimum(s[covered + 1], high))
    q, which, test = _quadrature(seat, portions, facet - first, cuts[:-1], cuts[1:])
    return _pairing(seat, bore, travel, clearance, portions, np.repeat(bore_facet, len(_GAUSS_X)), q, which, test)


def open_gap(seat: ContactLine, bore: ContactLine, travel: float, s: FloatArray) -> FloatArray:
    """Undeformed gap [mm] at coordinates s of the seat, in the direction of the heights; < 0: interpenetration."""
    shift = travel if seat.radial else 0.0
    height = bore.generatrix.height(s - shift) - seat.generatrix.height(s)
    if seat.radial:
        return np.asarray(height)
    return np.asarray((height + travel) * np.sign(seat.normals[0, 1]))


def _pairing(
    seat: ContactLine,
    bore: ContactLine,
    travel: float,
    clearance: float,
    portions: Portions,
    bore_facet: IntArray,
    s: FloatArray,
    which: IntArray,
    test: FloatArray,
) -> Pairing:
    x = bore.coordinate
    extent = x[bore_facet + 1] - x[bore_facet]
    zeta = s - (travel if seat.radial else 0.0)
    values, slopes = _shape(bore.order, (zeta - x[bore_facet]) / extent)
    columns = bore.order * bore_facet[:, None] + np.arange(bore.order + 1)
    normals = np.repeat(seat.normals[portions.facet], test.shape[1], axis=0)
    normal = seat.normals[portions.facet[which]]
    height = bore.generatrix.height(zeta) - seat.generatrix.height(s)
    if seat.radial:
        gap = height * normal[:, 0]
        lean = bore.generatrix.slope(zeta) * normal[:, 0] + normal[:, 1]
    else:
        gap, lean = (height + travel) * normal[:, 1], np.zeros_like(s)
    shape = (len(normals), len(bore.nodes))
    return Pairing(
        portions,
        normals,
        Band(_dense_rows(_entries(test, values, which, columns), shape), _blocks(which, columns, test.shape[1])),
        _dense_rows(_entries(test, slopes / extent[:, None], which, columns), shape),
        _mean(test, gap, which, len(portions.facet)),
        _mean(test, lean, which, len(portions.facet)),
        clearance,
    )


def _dense_rows(entries: tuple[FloatArray, IntArray, IntArray], shape: tuple[int, int]) -> FloatArray:
    data, rows, columns = entries
    flat = np.bincount(rows * shape[1] + columns, data, minlength=shape[0] * shape[1])
    return np.asarray(flat.reshape(shape), dtype=np.float64)


def _blocks(portion: IntArray, columns: IntArray, moments: int) -> tuple[tuple[slice, slice], ...]:
    """Rows and columns of the blocks of a band whose points come in ascending portions and columns."""
    count = int(portion[-1]) + 1
    starts = np.arange(0, count, _BLOCK)
    ends = np.minimum(starts + _BLOCK, count)
    low = columns[np.searchsorted(portion, starts), 0]
    high = columns[np.searchsorted(portion, ends) - 1, -1] + 1
    rows = zip(starts * moments, ends * moments, low, high, strict=True)
    return tuple((slice(a, b), slice(c, d)) for a, b, c, d in rows)


def _mean(test: FloatArray, values: FloatArray, which: IntArray, count: int) -> FloatArray:
    """Moments (p n,) of point values (q,)."""
    columns = [np.bincount(which, test[:, i] * values, minlength=count) for i in range(test.shape[1])]
    return np.asarray(np.stack(columns, axis=1).ravel(), dtype=np.float64)
