"""Stress at the nodes of a contact line where steel flowed.

Neither the strain of the surface helps there, for eps_p is steep (0.1 % of strain is 230 MPa), nor a quadratic around a
vertex, which swings beyond the yield stress. The Gauss points within a facet of the line are right to 2 %, so that a
plane through those nearest to a node gives its stress, back-stress X and accumulated plastic strain p. Then two things
are known and are put in: the traction, which is the part s_n, tau of the stress; and that nothing lies beyond the
yield surface. With a = s_m - s_n, b = s_t - s_n and tau, all of s - X,

    a^2 - a b + b^2 + 3 tau^2 <= R(p)^2

and where that is broken, a and b are drawn back to it in proportion; the traction stays.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..base.arrays import BoolArray, FloatArray, IntArray
from ..bodies.elasticity import von_mises
from ..bodies.surface import from_line, line_traction, to_line
from .body import PlasticBody
from .law import PointState

POINTS = 10
"""Gauss points that the plane of a node is fitted to; with 6 or 16 it is 1 % of the largest stress worse."""

BESIDE = 2
"""Nearest Gauss points one of which flowed where a node is taken to have flowed."""

NEAREST = 0.05
"""Distance, in that of the farthest, at which a point's weight of 1 / distance stops growing."""


class SurfaceFit:
    """The planes through the Gauss points nearest to each node of a body's contact line."""

    def __init__(self, body: PlasticBody) -> None:
        self.body, nodes = body, body.body.line.nodes
        distance, self._near = cKDTree(body.places).query(nodes, k=min(POINTS, body.count))
        reach = distance.max(axis=1)[:, None]
        offset = (body.places[self._near] - nodes[:, None]) / reach[:, :, None]
        root = (distance / reach + NEAREST)[:, :, None] ** -0.5
        terms = np.concatenate([np.ones_like(root), offset], axis=2) * root
        self._weights = np.linalg.pinv(terms)[:, 0] * root[:, :, 0]

    def flowed(self, accumulated: FloatArray, elastic: FloatArray) -> BoolArray:
        """At which nodes of the line (n,) steel flowed, from the accumulated plastic strain (points,).

        One of the nearest points flowed, and so did the surface by the plane: it may stay elastic above what flowed. Or
        the stress (n, 4) [MPa] of an elastic surface would lie beyond the yield stress.
        """
        beside = (accumulated[self._near[:, :BESIDE]] > 0.0).any(axis=1)
        above = self.at(np.arange(len(self._near)), accumulated) > 0.0
        return np.asarray((beside & above) | (von_mises(elastic.T) > self.body.law.yield_stress))

    def at(self, nodes: IntArray, values: FloatArray) -> FloatArray:
        """Values (m, ...) at some nodes of the line, of those at the points (points, ...)."""
        return np.asarray(np.einsum("nk,nk...->n...", self._weights[nodes], values[self._near[nodes]]))

    def stress(self, nodes: IntArray, stress: FloatArray, state: PointState, traction: FloatArray) -> FloatArray:
        """Stress (m, 4) [MPa] at nodes of the line that flowed.

        Args:
            nodes: their numbers on the line (m,).
            stress: at the points (4, points) [MPa].
            state: what the points remember.
            traction: (t_r, t_z) in the middle of each facet (facets, 2) [MPa].
        """
        n_r, n_z, normal, shear = line_traction(self.body.body, traction)[:, nodes]
        _, along, around, _ = to_line(n_r, n_z, self.at(nodes, stress.T))
        x_n, x_m, x_t, x_s = to_line(n_r, n_z, self.at(nodes, state.back.sum(axis=1)))
        radius, _ = self.body.law.radius(np.maximum(self.at(nodes, state.accumulated), 0.0))
        a, b = along - x_m - (normal - x_n), around - x_t - (normal - x_n)
        left = np.maximum(radius**2 - 3.0 * (shear - x_s) ** 2, 0.0)
        size = a**2 - a * b + b**2
        back = np.sqrt(left / np.maximum(size, np.maximum(left, np.finfo(float).tiny)))
        base = normal - x_n
        return from_line(n_r, n_z, np.stack([normal, base + x_m + a * back, base + x_t + b * back, shear]))
