"""The path of the strain within a step: straight, or carried along the axis with the edges that pass.

An edge of the other body passes a point within one or two millimetres of travel, and its stress rises and falls
meanwhile. A straight path from the strain before a step to that after it knows nothing of the peak between them. The
field of a moving edge hardly changes in the edge's own frame, so that at a share a of the step

    eps(P, a) = (1 - a) eps_before(P - a c) + a eps_after(P + (1 - a) c)

is nearly exact, with c the way of the other body in this body's frame. A point takes the path that describes its change
better: the straight one where |eps_after(P) - eps_before(P)| < |eps_after(P) - eps_before(P - c)|.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..base.arrays import BoolArray, FloatArray, IntArray
from ..bodies.elasticity import strain_operator
from ..bodies.fenics import Discretisation

CANDIDATES = 12
"""Cells whose centres are nearest to a point, among which the one that holds it is looked for."""

OUTSIDE = 0.2
"""How far, in barycentric coordinates, a point may lie beyond the nearest cell and be evaluated there."""


class StrainAlong:
    """Strain operators at the Gauss points of a body, shifted along the axis."""

    def __init__(self, space: Discretisation, places: FloatArray) -> None:
        self.space, self.places = space, places
        self._corners = space.nodes[space.cells[:, :3]]
        self._tree = cKDTree(self._corners.mean(axis=1))

    @lru_cache(maxsize=32)
    def at(self, shift: float) -> tuple[sp.csr_matrix, BoolArray]:
        """B (4 points, dofs) at the points moved by ``shift`` [mm] along the axis, and which of them lie in the body."""
        places = self.places + np.array([0.0, shift])
        cells, points, inside = self._located(places)
        corners = self._corners[cells]
        strain, _ = strain_operator(self.space.order, corners, points)
        nodes = self.space.cells[cells]
        columns = np.stack([2 * nodes, 2 * nodes + 1], axis=2).reshape(len(places), 1, -1)
        rows = np.arange(4 * len(places)).reshape(-1, 4, 1)
        data, rows, columns = np.broadcast_arrays(strain, rows, columns)
        shape = (4 * len(places), 2 * len(self.space.nodes))
        return sp.csr_matrix((data.ravel(), (rows.ravel(), columns.ravel())), shape=shape), inside

    def _located(self, places: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
        """For each place its cell, the point on the reference triangle, and whether it is in the cell or near it."""
        _, near = self._tree.query(places, k=min(CANDIDATES, len(self._corners)))
        corners = self._corners[near]
        sides = np.stack([corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]], axis=3)
        reference = np.linalg.solve(sides, (places[:, None] - corners[:, :, 0])[..., None])[..., 0]
        least = np.minimum(reference.min(axis=2), 1.0 - reference.sum(axis=2))
        best = least.argmax(axis=1)
        row = np.arange(len(places))
        return near[row, best], reference[row, best], least[row, best] > -OUTSIDE


class Path:
    """The strains of some points along one step, from the displacement before it.

    Args:
        along: the operators.
        points: numbers of the points (m,).
        before: displacement of the body before the step (dofs,) [mm].
        carried: the way c of the other body in this body's frame [mm].
        parts: sub-steps of the step.
    """

    def __init__(self, along: StrainAlong, points: IntArray, before: FloatArray, carried: float, parts: int) -> None:
        self.shares = np.arange(1, parts) / parts
        rows = (4 * points[:, None] + np.arange(4)).ravel()
        self._before, self._after, held = [], [], np.ones(len(points), dtype=bool)

        def strains(shift: float) -> tuple[sp.csr_matrix, BoolArray]:
            operator, inside = along.at(round(shift, 9))
            return operator[rows], inside[points]

        for share in self.shares:
            for where, shift in ((self._before, -share * carried), (self._after, (1.0 - share) * carried)):
                operator, inside = strains(shift)
                held &= inside
                where.append((operator @ before).reshape(-1, 4) if where is self._before else operator)
        operator, inside = strains(-carried)
        self._stays = ~(held & inside)
        self._whole = (operator @ before).reshape(-1, 4)
        here, _ = strains(0.0)
        self._here = (here @ before).reshape(-1, 4)
        self._chosen = False

    def choose(self, after: FloatArray) -> None:
        """Decide between the paths for the strains (m, 4) after the step."""
        straight = np.abs(after - self._here).sum(axis=1)
        self._stays |= straight <= np.abs(after - self._whole).sum(axis=1)

    def strains(self, displacement: FloatArray, after: FloatArray) -> list[FloatArray]:
        """The strains (m, 4) at the end of each sub-step but the last."""
        out = []
        for share, before, operator in zip(self.shares, self._before, self._after, strict=True):
            straight = (1.0 - share) * self._here + share * after
            carried = (1.0 - share) * before + share * (operator @ displacement).reshape(-1, 4)
            out.append(np.where(self._stays[:, None], straight, carried))
        return out
