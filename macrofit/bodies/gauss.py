"""The Gauss points of a body: where they lie, what they stand for, and the strain at them."""

from __future__ import annotations

import numpy as np

from ..base.arrays import FloatArray, IntArray
from .discretisation import Discretisation
from .elasticity import strain_operator


def gauss_points(order: int) -> tuple[FloatArray, FloatArray]:
    """Points (k, 2) on the reference triangle where stresses are taken, and their weights (k,): one, or three of P2."""
    if order == 2:
        return np.array([[1.0, 1.0], [4.0, 1.0], [1.0, 4.0]]) / 6.0, np.full(3, 1.0 / 6.0)
    return np.array([[1.0, 1.0]]) / 3.0, np.array([0.5])


class GaussPoints:
    """The n Gauss points of a body, cell by cell (one of each for P1, three for P2)."""

    per_cell: int
    """Points of a cell."""
    cell: IntArray
    """Cell of each point (n,)."""
    places: FloatArray
    """Their (r, z) (n, 2) [mm]."""
    area: FloatArray
    """Share of the section that belongs to each (n,) [mm2]."""
    strain: FloatArray
    """B at each (n, 4, 2 b) [1/mm], see `elasticity.strain_operator`."""

    def __init__(self, space: Discretisation) -> None:
        self.space = space
        points, weights = gauss_points(space.order)
        count = len(space.cells)
        self.per_cell, self.cell = len(points), np.repeat(np.arange(count), len(points))
        corners = space.nodes[space.cells[:, :3]]
        self.strain, self.places = strain_operator(space.order, corners[self.cell], np.tile(points, (count, 1)))
        sides = corners[:, 1:] - corners[:, :1]
        twice = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        self.area = (twice[:, None] * weights).ravel()
