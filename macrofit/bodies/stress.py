"""Stress of a body from its displacements: at the Gauss points, and recovered at the nodes."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..base.arrays import BoolArray, FloatArray
from .body import Body
from .elasticity import stiffness_moduli
from .gauss import point_matrix
from .recovery import Patches


class StressEvaluator:
    """The stress of one body at its Gauss points."""

    def __init__(self, body: Body) -> None:
        self.body, self.places = body, body.gauss.places
        values = stiffness_moduli(body.material) @ body.gauss.strain
        self._operator = point_matrix(body.space, body.gauss.cell, values, by_component=True)

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
        return float(distance.max()), float(self.body.gauss.area[chosen].sum())
