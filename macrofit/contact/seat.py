"""The seat's side of the interface: its operators of moments, for whole facets once and for any covering."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray
from ..bodies.body import ContactLine
from ..bodies.elasticity import traction_operator
from ..scene.keys import ContactKeys
from .moments import CoveredFacets, covered_facets, entries, quadrature, scalar_rows, shape, vector_rows


@dataclass(frozen=True, kw_only=True)
class SeatRows:
    """Operators of n moments on the axle's trace nodes, rows component-major."""

    weight: FloatArray  # (n,) [mm2]
    jump: sp.csr_matrix  # (2 n, 2 loaded nodes) J
    trial: sp.csr_matrix  # (2 n, 2 trace nodes) J - T/gamma; J for penalty
    load: sp.csr_matrix  # (2 n, 2 loaded nodes) J - theta/gamma T
    load_transposed: sp.csr_matrix
    traction: sp.csr_matrix | None  # (2 n, 2 trace nodes) T [MPa/mm]; None for penalty


@dataclass(frozen=True, kw_only=True)
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
        """J u (2, n) of a displacement (2 loaded nodes,) of the seat; (2, runs, n) of (2, runs, loaded nodes)."""
        return self._moments([applied(rows.jump, displacement) for rows in self._rows])

    def trial_moments(self, displacement: FloatArray) -> FloatArray:
        """(J - T / gamma) u (2, n) of a displacement (2 trace nodes,) of the axle; J u for penalty."""
        return self._moments([rows.trial @ displacement for rows in self._rows])

    @property
    def _rows(self) -> list[SeatRows]:
        return [self.full] if self.partial is None else [self.full, self.partial]

    def _moments(self, values: list[FloatArray]) -> FloatArray:
        """The covered moments (2, n) among those of the whole seat and of the partly covered facets."""
        split = [
            part.reshape(2, *part.shape[1:-1], len(rows.weight)) for part, rows in zip(values, self._rows, strict=True)
        ]
        return np.asarray(np.concatenate(split, axis=-1)[..., self.index])

    def loads(self, forces: FloatArray) -> FloatArray:
        """Nodal forces (2 loaded nodes,) of forces (2, n) on the moments [N], (2, runs, nodes) of (2, runs, n)."""
        size = len(self.full.weight)
        spread = np.zeros((*forces.shape[:-1], size + (0 if self.partial is None else len(self.partial.weight))))
        spread[..., self.index] = forces
        whole, part = spread[..., :size], spread[..., size:]
        if forces.ndim == 2:
            whole, part = whole.ravel(), part.ravel()
        nodal = applied(self.full.load_transposed, whole)
        if self.partial is not None:
            nodal = nodal + applied(self.partial.load_transposed, part)
        return nodal


def applied(operator: sp.csr_matrix, vectors: FloatArray) -> FloatArray:
    """A sparse operator between components (2 n,), applied to a vector or to those (2, runs, n) of several runs."""
    if vectors.ndim == 1:
        return np.asarray(operator @ vectors)
    columns = operator @ vectors.swapaxes(1, 2).reshape(operator.shape[1], -1)
    return np.asarray(columns.reshape(2, -1, columns.shape[1]).swapaxes(1, 2))


class Seat:
    """The seat's operators for every facet fully covered, and for any covering."""

    def __init__(self, line: ContactLine, keys: ContactKeys) -> None:
        self.line, self.nitsche, self.theta = line, keys.formulation == "nitsche", float(keys.theta)
        self.gamma = gamma_of(keys, line.material.youngs_modulus, line.length)
        self.loaded = line.trace_nodes if self.nitsche and keys.theta else len(line.nodes)
        s = line.coordinate
        portions = covered_facets(line, np.arange(line.facets), s[:-1], s[1:])
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

    def rows(self, portions: CoveredFacets) -> SeatRows:
        """The operators on ``portions``."""
        line, (count, n) = self.line, portions.weight.shape
        s, which, test = quadrature(line, portions, np.arange(count), portions.start, portions.end)
        facet = portions.facet[which]
        x = line.coordinate
        t = (s - x[facet]) / (x[facet + 1] - x[facet])
        values, _ = shape(line.order, t)
        columns = line.order * facet[:, None] + np.arange(line.order + 1)
        normals = np.repeat(line.normals[portions.facet], n, axis=0)
        jump = trial = load = vector_rows(entries(test, values, which, columns), normals, line.trace_nodes)
        traction = None
        if self.nitsche:
            traction = _traction_rows(line, portions, which, test, facet, t)
            scaled = sp.diags(np.tile(1.0 / np.repeat(self.gamma[portions.facet], n), 2)) @ traction
            trial = (jump - scaled).tocsr()
            load = (jump - self.theta * scaled).tocsr() if self.theta else jump
        nodes = np.arange(self.loaded)
        loaded = np.concatenate([nodes, line.trace_nodes + nodes])
        jump, load = jump[:, loaded], load[:, loaded]
        return SeatRows(
            weight=portions.weight.ravel(),
            jump=jump,
            trial=trial,
            load=load,
            load_transposed=load.T.tocsr(),
            traction=traction,
        )

    def cover(self, portions: CoveredFacets) -> CoveredSeat:
        """The operators on the covered portions; only those of partly covered facets are computed."""
        s, m, facets = self.line.coordinate, self.moments, portions.facet
        whole = (portions.start == s[facets]) & (portions.end == s[facets + 1])
        part = np.flatnonzero(~whole)
        base = facets * m
        base[part] = self.size + m * np.arange(len(part))
        index = (base[:, None] + np.arange(m)).ravel()
        partial = None
        if len(part):
            partial = self.rows(covered_facets(self.line, facets[part], portions.start[part], portions.end[part]))
        facet = np.repeat(facets, m)
        return CoveredSeat(
            full=self.full,
            partial=partial,
            facet=facet,
            index=index,
            weight=portions.weight.ravel(),
            gamma=self.gamma[facet],
            normals=self.line.normals[facet],
        )


def gamma_of(keys: ContactKeys, youngs_modulus: float, length: FloatArray) -> FloatArray:
    """gamma [MPa/mm] of facets of ``length`` [mm]: gamma0 E / h (Nitsche), or the penalty stiffness."""
    if keys.formulation == "penalty":
        stiffness = 10.0 * youngs_modulus if keys.penalty_stiffness is None else keys.penalty_stiffness
        return np.full_like(length, stiffness)
    gamma0 = (30.0 if keys.theta == 1 else 10.0) if keys.gamma0 is None else keys.gamma0
    return gamma0 * youngs_modulus / length


def _traction_rows(
    line: ContactLine, portions: CoveredFacets, which: IntArray, test: FloatArray, facet: IntArray, t: FloatArray
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
        [scalar_rows(entries(test, rows, which, columns), shape) for rows in (normal_row, tangential_row)],
        format="csr",
    )
