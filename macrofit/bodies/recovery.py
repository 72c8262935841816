"""Stress recovered at the nodes by superconvergent patches, with the traction of the contact in the fit.

At the Gauss points of degree 2 the stress of quadratic elements is of one order better than elsewhere (in the middle of
linear ones likewise). Around each vertex a polynomial (quadratic, or linear for P1) is fitted by least squares to the
values at the points of the cells that share it; where these are few, at boundaries, to those of the next ring too. The
vertex takes its value, the node in the middle of an edge the mean of both ends' polynomials.

On the contact line the traction is known, t = sigma n, in the middle of each facet. It is part of the fit of the
vertices there, with the weight `TRACTION`, and couples the components rr, zz, rz:

    least of sum_p |P(x_p) - sigma_p|^2 + TRACTION sum_f |P(x_f) n_f - t_f|^2

That serves the nodes beside the line; those on it take their stress from `surface`, or from `plasticity.surface` where
steel flowed.

Source: Zienkiewicz, Zhu, Int. J. Numer. Meth. Eng. 33 (1992) 1331-1364 (doi 10.1002/nme.1620330702); with boundary
tractions in the patch: Blacker, Belytschko, ibid. 37 (1994) 517-536 (doi 10.1002/nme.1620370309).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray
from .body import Body

TRACTION = 4.0
"""Weight of the two equations of a facet's traction over those of a Gauss point."""

FACETS = 2
"""Facets of the contact line nearest to a vertex of it whose traction is part of its fit."""

LEAST = 1.4
"""Points of a patch over the terms of its polynomial, below which the next ring of cells is taken in."""

_IN_PLANE = [0, 1, 3]  # rr, zz, rz of (rr, zz, tt, rz)


class Patches:
    """The fits around all vertices of a body, for stresses at its Gauss points ``places`` (points, 2) [mm]."""

    def __init__(self, body: Body, places: FloatArray) -> None:
        self.body, space = body, body.space
        self.order = space.order
        corners = space.cells[:, :3]
        self.vertices, local = np.unique(corners, return_inverse=True)
        local = local.reshape(-1, 3)
        k = len(places) // len(corners)
        cells = self._rings(local, k)
        count = np.diff(cells.indptr)
        slot = np.arange(count.max())
        there = slot < count[:, None]
        chosen = np.where(there, cells.indices[np.minimum(cells.indptr[:-1, None] + slot, cells.nnz - 1)], 0)
        self._points = (k * chosen[:, :, None] + np.arange(k)).reshape(len(chosen), -1)
        centre = space.nodes[self.vertices]
        offset = places[self._points] - centre[:, None]
        used = np.repeat(there, k, axis=1)
        self._scale = np.sqrt((offset**2).sum(axis=2).max(axis=1, where=used, initial=0.0))
        self._basis = self._terms(offset / self._scale[:, None, None]) * used[:, :, None]
        normal = np.asarray(np.swapaxes(self._basis, 1, 2) @ self._basis, dtype=np.float64)
        self._inverse = np.linalg.inv(normal)
        self._edges(corners, local)
        self._line(normal)

    def recover(self, stress: FloatArray, traction: FloatArray | None = None) -> FloatArray:
        """(nodes, 4) of stresses (4, points) and tractions (facets, 2) = (t_r, t_z) on the body's contact line [MPa].

        Without tractions the vertices of the contact line are fitted as any others.
        """
        values = stress.T[self._points]
        moments = np.swapaxes(self._basis, 1, 2) @ values
        terms = self._inverse @ moments
        if traction is not None:
            self._constrain(terms, moments, traction)
        nodes = np.empty((len(self.body.space.nodes), 4))
        nodes[self.vertices] = terms[:, 0]
        if self.order == 2:
            ends = np.einsum("est,estc->ec", self._middle_terms, terms[self._ends])
            nodes[self._middles] = 0.5 * ends
        return nodes

    def _rings(self, local: IntArray, k: int) -> sp.csr_matrix:
        """Which cells the patch of each vertex has (vertices, cells)."""
        m = len(local)
        incidence = sp.csr_matrix(
            (np.ones(3 * m), (local.ravel(), np.repeat(np.arange(m), 3))), shape=(len(self.vertices), m)
        )
        terms = 6 if self.order == 2 else 3
        few = k * np.diff(incidence.indptr) < LEAST * terms
        wider = incidence @ (incidence.T @ incidence)
        keep = sp.diags((~few).astype(float)) @ incidence + sp.diags(few.astype(float)) @ wider
        keep = keep.tocsr()
        keep.eliminate_zeros()
        return keep

    def _terms(self, offset: FloatArray) -> FloatArray:
        """The monomials at scaled offsets (..., 2)."""
        x, y = offset[..., 0], offset[..., 1]
        linear = [np.ones_like(x), x, y]
        return np.stack(linear if self.order == 1 else [*linear, x * x, x * y, y * y], axis=-1)

    def _edges(self, corners: IntArray, local: IntArray) -> None:
        """Middles of edges, with the ends whose polynomials they take."""
        if self.order == 1:
            return
        space, pairs = self.body.space, [(1, 2), (2, 0), (0, 1)]
        middles = space.cells[:, 3:].ravel()
        ends = local[:, pairs].reshape(-1, 2)
        self._middles, first = np.unique(middles, return_index=True)
        self._ends = ends[first]
        offset = space.nodes[self._middles][:, None] - space.nodes[self.vertices[self._ends]]
        self._middle_terms = self._terms(offset / self._scale[self._ends][..., None])

    def _line(self, normal: FloatArray) -> None:
        """The coupled fits of the vertices on the contact line."""
        line = self.body.line
        on_line = self.body.trace[: len(line.nodes) : line.order]
        self._on_line = np.searchsorted(self.vertices, on_line)
        facets = line.facets
        near = np.clip(np.arange(facets + 1)[:, None] + np.arange(-FACETS // 2, FACETS // 2), 0, facets - 1)
        middle = 0.5 * (line.nodes[: -line.order : line.order] + line.nodes[line.order :: line.order])
        offset = middle[near] - line.nodes[:: line.order][:, None]
        terms = self._terms(offset / self._scale[self._on_line][:, None, None])
        n_r, n_z = (line.normals[near, i][..., None] for i in (0, 1))
        zero = np.zeros_like(terms)
        rows = np.concatenate(
            [
                np.concatenate([n_r * terms, zero, n_z * terms], axis=2),
                np.concatenate([zero, n_z * terms, n_r * terms], axis=2),
            ],
            axis=1,
        )
        t = normal.shape[1]
        matrix = TRACTION * np.swapaxes(rows, 1, 2) @ rows
        for i in range(3):
            matrix[:, i * t : (i + 1) * t, i * t : (i + 1) * t] += normal[self._on_line]
        self._near, self._rows, self._coupled = near, rows, np.linalg.inv(matrix)

    def _constrain(self, terms: FloatArray, moments: FloatArray, traction: FloatArray) -> None:
        """Fit the vertices of the contact line with the tractions of the facets next to them, in place."""
        given = np.concatenate([traction[self._near, 0], traction[self._near, 1]], axis=1)
        right = np.swapaxes(moments[self._on_line][:, :, _IN_PLANE], 1, 2).reshape(len(self._on_line), -1)
        right = right + TRACTION * np.einsum("vri,vr->vi", self._rows, given)
        solved = np.einsum("vij,vj->vi", self._coupled, right).reshape(len(right), 3, -1)
        rows = terms[self._on_line]
        rows[:, :, _IN_PLANE] = np.swapaxes(solved, 1, 2)
        terms[self._on_line] = rows
