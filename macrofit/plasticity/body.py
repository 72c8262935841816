"""The plastic strain of one body: the load it puts on the elastic body, and what flows under given loads.

The elastic stiffness stays as it is. With the plastic strains eps_p at the Gauss points (weights w = 2 pi r dA),

    K u = P' f_c + f_p,    f_p = sum of w B' D eps_p,    stress = D (B u - eps_p)

Only this rank's body is here; see `yielding` for both and their contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray
from ..bodies.body import Body
from ..bodies.elasticity import stiffness_moduli, strain_operator
from ..bodies.stress import gauss_points
from .law import Hardening, PointState, flow


@dataclass(frozen=True, kw_only=True)
class Eigen:
    """What the plastic strain of a body does at its contact line."""

    displacement: FloatArray
    """u_p = K^-1 f_p of the trace nodes (2 trace nodes,) [mm]."""
    traction: FloatArray
    """n . D eps_p (facets, 2 ends, 2): its normal and tangential parts at the ends of each facet [MPa]."""


class PlasticBody:
    """One body's Gauss points (one of P1, three of P2), and the law of its material."""

    def __init__(self, body: Body, law: Hardening) -> None:
        self.body, self.law = body, law
        space = body.space
        points, weights = gauss_points(space.order)
        self.count, self.per_cell = len(space.cells) * len(points), len(points)
        corners = np.repeat(space.nodes[space.cells[:, :3]], self.per_cell, axis=0)
        strain, self.places = strain_operator(space.order, corners, np.tile(points, (len(space.cells), 1)))
        sides = corners[:, 1:] - corners[:, :1]
        area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        self.weight = 2.0 * math.pi * self.places[:, 0] * area * np.tile(weights, len(space.cells))
        self.scale = np.sqrt(self.weight[:, None] * np.array([1.0, 1.0, 1.0, 0.5]))
        self.moduli = stiffness_moduli(body.material)
        self.shear_modulus = body.material.shear_modulus
        cells = np.repeat(space.cells, self.per_cell, axis=0)
        columns = np.stack([2 * cells, 2 * cells + 1], axis=2).reshape(self.count, 1, -1)
        rows = np.arange(4 * self.count).reshape(self.count, 4, 1)
        data, rows, columns = np.broadcast_arrays(strain, rows, columns)
        shape = (4 * self.count, body.dofs)
        self.operator = sp.csr_matrix((data.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
        self.spread = self.operator.T.tocsr()

    def rest(self) -> PointState:
        """The state before anything flowed."""
        return PointState.virgin(self.count, self.law.backs)

    def load(self, plastic: FloatArray) -> FloatArray:
        """f_p (dofs,) [N] of plastic strains (points, 4)."""
        return np.asarray(self.spread @ (self.weight[:, None] * (plastic @ self.moduli)).ravel())

    def displace(self, load: FloatArray) -> FloatArray:
        """K^-1 of a nodal load (dofs,) [N]: (dofs,) [mm]."""
        return self.body.solve(load[:, None])[:, 0]

    def displace_trace(self, load: FloatArray) -> FloatArray:
        """K^-1 of a load on the trace nodes (2 loaded nodes,) [N]: (dofs,) [mm]."""
        return self.body.back_substitute(load[:, None])[:, 0]

    def eigen(self, displacement: FloatArray, plastic: FloatArray) -> Eigen:
        """What plastic strains (points, 4) and their displacement K^-1 f_p (dofs,) do at the contact line."""
        return Eigen(displacement=displacement[self.body.trace_dofs], traction=self._traction(plastic))

    def _traction(self, plastic: FloatArray) -> FloatArray:
        """n . D eps_p at the ends of the facets: linear through the points of the cell behind each."""
        line = self.body.line
        stress = plastic.reshape(-1, self.per_cell, 4)[self.body.line_cells] @ self.moduli
        if self.per_cell == 1:
            ends = np.repeat(stress, 2, axis=1)
        else:  # 5/3 of the nearest, -1/3 of the others at a vertex
            corners = np.einsum("vp,fpi->fvi", 2.0 * np.eye(3) - 1.0 / 3.0, stress)
            ends = np.take_along_axis(corners, line.ends[:, :, None], axis=1)
        n_r, n_z = line.normals.T[:, :, None]
        t_r, t_z = n_r * ends[..., 0] + n_z * ends[..., 3], n_r * ends[..., 3] + n_z * ends[..., 1]
        return np.stack([n_r * t_r + n_z * t_z, n_r * t_z - n_z * t_r], axis=2)

    def stress(self, displacement: FloatArray, plastic: FloatArray) -> FloatArray:
        """D (B u - eps_p) (points, 4) [MPa]."""
        return np.asarray(((self.operator @ displacement).reshape(-1, 4) - plastic) @ self.moduli)

    def flowed(self, displacement: FloatArray, before: PointState) -> PointState:
        """The state that the law gives at a displacement (dofs,), from that before the step."""
        return flow(self.stress(displacement, before.strain), before, self.law, self.shear_modulus)

    def square(self, strains: FloatArray) -> float:
        """Sum of w e : e over the points, of strains (points, 4) with the engineering shear [mm3]."""
        return float(np.square(self.scale * strains).sum())

    def finished(
        self, before: PointState, after: PointState, displacement: FloatArray
    ) -> tuple[PointState, FloatArray]:
        """The state with its work, and three numbers of the body: energy, work of the step, largest plastic strain.

        The work takes the mean of the stress before and after, as elastic energy and force are in an energy balance.
        """
        plastic = after.strain
        moved = np.flatnonzero(after.accumulated > before.accumulated)
        end = self.stress(displacement, plastic)
        gained = plastic[moved] - before.strain[moved]
        work = 0.5 * ((before.stress[moved] + end[moved]) * gained).sum(axis=1)
        total = after.work.copy()
        total[moved] += work
        numbers = [self.own_energy(displacement, plastic), float(self.weight[moved] @ work)]
        out = replace(after, work=total, stress=end)
        return out, np.array([*numbers, after.accumulated.max(initial=0.0)])

    def own_energy(self, displacement: FloatArray, plastic: FloatArray) -> float:
        """What eps_p adds to 1/2 f_c . u to give the elastic energy: 1/2 sum w eps_p D eps_p - 1/2 f_p . u [N mm]."""
        stored = float(self.weight @ ((plastic @ self.moduli) * plastic).sum(axis=1))
        return 0.5 * (stored - float(self.load(plastic) @ displacement))
