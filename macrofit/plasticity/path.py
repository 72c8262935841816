"""The path of the strain within a step: straight, or carried along the axis with the edges that pass.

An edge of the other body passes a point within one or two millimetres of travel, and its stress rises and falls
meanwhile. A straight path from the strain before a step to that after it knows nothing of the peak between them. The
field of a moving edge hardly changes in the edge's own frame, so that at a share a of the step

    eps(P, a) = (1 - a) eps_before(P - a c) + a eps_after(P + (1 - a) c)

is nearly exact, with c the way of the other body in this body's frame. A point takes the path that describes its change
better: the straight one where |eps_after(P) - eps_before(P)| < |eps_after(P) - eps_before(P - c)|.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..base.arrays import BoolArray, FloatArray, IntArray
from ..bodies.elasticity import strain_operator
from ..bodies.fenics import Discretisation
from ..bodies.gauss import point_matrix

CANDIDATES = 12
"""Cells whose centres are nearest to a point, among which the one that holds it is looked for."""

KEPT = 32
"""Shifts whose operators are kept."""

OUTSIDE = 0.2
"""How far, in barycentric coordinates, a point may lie beyond the nearest cell and be evaluated there."""


class StrainAlong:
    """Strain operators at the Gauss points of a body, shifted along the axis."""

    def __init__(self, space: Discretisation, places: FloatArray) -> None:
        self.space, self.places = space, places
        self._corners = space.nodes[space.cells[:, :3]]
        self._tree = cKDTree(self._corners.mean(axis=1))
        self._known: dict[float, tuple[sp.csr_matrix, BoolArray]] = {}

    def at(self, shift: float) -> tuple[sp.csr_matrix, BoolArray]:
        """B (4 points, dofs) at the points moved along the axis [mm], and which of these lie in the body."""
        if shift not in self._known:
            if len(self._known) == KEPT:
                self._known.clear()
            self._known[shift] = self._operator(shift)
        return self._known[shift]

    def _operator(self, shift: float) -> tuple[sp.csr_matrix, BoolArray]:
        places = self.places + np.array([0.0, shift])
        cells, points, inside = self._located(places)
        strain, _ = strain_operator(self.space.order, self._corners[cells], points)
        return point_matrix(self.space, cells, strain, by_component=False), inside

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
        self.shares = (np.arange(1, parts) / parts)[:, None, None]
        rows = (4 * points[:, None] + np.arange(4)).ravel()
        inside = np.ones(len(points), dtype=bool)

        def strains(shift: float) -> FloatArray:
            """Strains of the displacement before, at the shifted points (m, 4)."""
            operator, there = along.at(round(shift, 9))
            inside[:] &= there[points]
            return np.asarray((operator @ before).reshape(-1, 4)[points])

        self._here, self._whole = strains(0.0), strains(-carried)
        self._before = np.stack([strains(-share * carried) for share in self.shares.ravel()])
        after = [along.at(round((1.0 - share) * carried, 9)) for share in self.shares.ravel()]
        self._after = sp.vstack([operator[rows] for operator, _ in after], format="csr")
        self._stays = ~np.logical_and.reduce([inside, *(there[points] for _, there in after)])

    def choose(self, after: FloatArray) -> None:
        """Decide between the paths for the strains (m, 4) after the step."""
        straight = np.abs(after - self._here).sum(axis=1)
        self._stays |= straight <= np.abs(after - self._whole).sum(axis=1)

    def strains(self, displacement: FloatArray, after: FloatArray) -> FloatArray:
        """The strains (parts - 1, m, 4) at the end of each sub-step but the last."""
        straight = (1.0 - self.shares) * self._here + self.shares * after
        carried = (1.0 - self.shares) * self._before + self.shares * (self._after @ displacement).reshape(
            self._before.shape
        )
        return np.where(self._stays[:, None], straight, carried)
