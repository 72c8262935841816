"""Stress of a body from its displacements: at the Gauss points, and recovered at the nodes."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..base.arrays import BoolArray, FloatArray
from .body import Body
from .elasticity import stiffness_moduli, strain_operator
from .recovery import Patches


def gauss_points(order: int) -> tuple[FloatArray, FloatArray]:
    """Points (k, 2) on the reference triangle where stresses are taken, and their weights (k,): one, or three of P2."""
    if order == 2:
        return np.array([[1.0, 1.0], [4.0, 1.0], [1.0, 4.0]]) / 6.0, np.full(3, 1.0 / 6.0)
    return np.array([[1.0, 1.0]]) / 3.0, np.array([0.5])


class StressEvaluator:
    """The stress of one body at the Gauss points of its cells (one for P1, three for P2)."""

    def __init__(self, body: Body) -> None:
        self.body = body
        space = body.space
        self.points, _ = gauss_points(space.order)
        count, k = len(space.cells), len(self.points)
        corners = np.repeat(space.nodes[space.cells[:, :3]], k, axis=0)
        strain, self.places = strain_operator(space.order, corners, np.tile(self.points, (count, 1)))
        stress = stiffness_moduli(body.material) @ strain
        cells = np.repeat(space.cells, k, axis=0)
        columns = np.stack([2 * cells, 2 * cells + 1], axis=2).reshape(count * k, 1, -1)
        rows = np.arange(4)[:, None, None] * (count * k) + np.arange(count * k)[None, :, None]
        shape = (4 * count * k, 2 * len(space.nodes))
        data, rows, columns = np.broadcast_arrays(stress.transpose(1, 0, 2), rows, columns.transpose(1, 0, 2))
        self._operator = sp.csr_matrix((data.ravel(), (rows.ravel(), columns.ravel())), shape=shape)

    def stress(self, displacement: FloatArray) -> FloatArray:
        """(4, points, k) [MPa] at the Gauss points, for displacements (dofs, k)."""
        return np.asarray((self._operator @ displacement).reshape(4, -1, displacement.shape[1]))

    @cached_property
    def patches(self) -> Patches:
        """What recovers stresses at the nodes; made when a field is first asked for."""
        return Patches(self.body, self.places)

    def extent(self, chosen: BoolArray) -> tuple[float, float]:
        """Largest distance of chosen points (points,) from the contact line [mm], and their area [mm2]."""
        if not chosen.any():
            return 0.0, 0.0
        from scipy.spatial import cKDTree  # 0.05 s that a body which does not yield need not wait for

        distance, _ = cKDTree(self.body.line.nodes).query(self.places[chosen])
        corners = self.body.space.nodes[self.body.space.cells[:, :3]]
        sides = corners[:, 1:] - corners[:, :1]
        area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / len(self.points)
        return float(distance.max()), float(np.repeat(area, len(self.points))[chosen].sum())
