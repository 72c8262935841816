"""The plastic strain of one body: the load it puts on the elastic body, and what flows under given loads.

The elastic stiffness stays as it is. With the plastic strains eps_p at the Gauss points (weights w = 2 pi r dA),

    K u = P' f_c + f_p,    f_p = sum of w B' D eps_p,    stress = D (B u - eps_p)

Only this rank's body is here; see `yielding` for both and their contact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..base.arrays import FloatArray, IntArray
from ..bodies.body import Body
from ..bodies.elasticity import stiffness_moduli
from ..bodies.gauss import point_matrix
from ..contact.eigen import Eigen
from .law import Hardening, PointState, flow, overshoot
from .path import Path, StrainAlong

NEIGHBOURS = 3
"""Points that a carried value is taken from."""

PART = 0.25
"""Longest sub-step of a step, in facets."""

MOST_PARTS = 8
"""Most sub-steps of a step: twice as many change the force of `wheelset` by 6e-4, the plastic strain by a hundredth."""

MARGIN = 0.1
"""Part of the yield stress by which a point may stay below it and be watched in a step."""


Changes: TypeAlias = Mapping[str, FloatArray | IntArray]
"""What changed in a body within an increment: its points, and all that they remember, as named arrays."""


@dataclass(frozen=True, kw_only=True)
class BodyFlow:
    """What a body's points remember, and what flowed in the last step."""

    state: PointState
    points: IntArray
    """Points that flowed in the last step (m,)."""
    gained: FloatArray
    """Their plastic strain in it (m, 4) [-]."""
    moved: float
    """Travel of the wheel in it [mm]."""

    @staticmethod
    def between(before: PointState, after: PointState, moved: float) -> BodyFlow:
        """The flow from one state to another."""
        grown = after.accumulated > before.accumulated
        points = np.flatnonzero(grown | (after.strain != before.strain).any(axis=1))  # p may swallow what it grew by
        gained = after.strain[points] - before.strain[points]
        return BodyFlow(state=after, points=points, gained=gained, moved=moved)

    def changes(self) -> Changes:
        """The points that flowed, and all that they remember, as named arrays."""
        part = self.state.at(self.points)
        return {"points": self.points} | {name: getattr(part, name) for name in PointState.__dataclass_fields__}


def changed(before: PointState, changes: Changes) -> PointState:
    """The state after `BodyFlow.changes`."""
    own = {name: np.asarray(changes[name], dtype=np.float64) for name in PointState.__dataclass_fields__}
    return before.with_points(np.asarray(changes["points"], dtype=np.int64), PointState(**own))


class PlasticBody:
    """One body's Gauss points (one of P1, three of P2), and the law of its material."""

    def __init__(self, body: Body, law: Hardening) -> None:
        self.body, self.law, gauss = body, law, body.gauss
        self.count, self.per_cell, self.places = len(gauss.cell), gauss.per_cell, gauss.places
        self.weight = 2.0 * math.pi * self.places[:, 0] * gauss.area
        self.scale = np.sqrt(self.weight[:, None] * np.array([1.0, 1.0, 1.0, 0.5]))
        self.moduli = stiffness_moduli(body.material)
        self.shear_modulus = body.material.shear_modulus
        self.operator = point_matrix(body.space, gauss.cell, gauss.strain, by_component=False)
        self._last_carried: tuple[float, sp.csr_matrix] | None = None

    def rest(self) -> BodyFlow:
        """Nothing flowed yet."""
        state = PointState.virgin(self.count, self.law.backs)
        return BodyFlow.between(state, state, 0.0)

    @cached_property
    def along(self) -> StrainAlong:
        """Strain operators at shifted points."""
        return StrainAlong(self.body.space, self.places)

    def displaced(self, state: PointState, loads: FloatArray) -> FloatArray:
        """u (dofs,) [mm] under the loads (2 loaded nodes,) of the contact and the plastic strains of a state."""
        return self.body.solve(self.load(state.strain)[:, None])[:, 0] + self.displace(loads)

    def displace(self, loads: FloatArray) -> FloatArray:
        """u (dofs,) [mm] under the loads (2 loaded nodes,) of the contact alone [N]."""
        return self.body.back_substitute(loads[:, None])[:, 0]

    def expected(self, before: BodyFlow, moved: float) -> tuple[IntArray, FloatArray]:
        """Points that will probably flow in a step, and their plastic strain in it (m, 4).

        What flows is what the edge of the seat passes: it stays where it is in the axle, and moves back in the wheel.
        """
        share = moved / before.moved if before.moved else 0.0
        if not 0.0 < share <= 2.0 or not len(before.points):
            return np.zeros(0, dtype=np.int64), np.zeros((0, 4))
        if self.body.which == "axle":
            return before.points, share * before.gained
        gained = np.zeros((self.count, 4))
        gained[before.points] = share * before.gained
        gained = self._carried(-moved) @ gained
        points = np.flatnonzero(gained.any(axis=1))
        return points, gained[points]

    def _carried(self, along: float) -> sp.csr_matrix:
        """Takes values at the points to where they are carried along the axis [mm], as means of `NEIGHBOURS`."""
        if self._last_carried is not None and self._last_carried[0] == along:
            return self._last_carried[1]
        distance, nearest = cKDTree(self.places + np.array([0.0, along])).query(self.places, k=NEIGHBOURS)
        weight = 1.0 / (distance + 1e-3 * abs(along)) ** 2
        weight /= weight.sum(axis=1, keepdims=True)
        rows = np.repeat(np.arange(self.count), NEIGHBOURS)
        matrix = sp.csr_matrix((weight.ravel(), (rows, nearest.ravel())), shape=(self.count, self.count))
        self._last_carried = along, matrix
        return matrix

    def load(self, plastic: FloatArray) -> FloatArray:
        """f_p (dofs,) [N] of plastic strains (points, 4)."""
        return np.asarray(self.operator.T @ (self.weight[:, None] * (plastic @ self.moduli)).ravel())

    def stress(self, displacement: FloatArray, plastic: FloatArray) -> FloatArray:
        """D (B u - eps_p) (points, 4) [MPa]."""
        return np.asarray(((self.operator @ displacement).reshape(-1, 4) - plastic) @ self.moduli)

    def traction(self, plastic: FloatArray) -> FloatArray:
        """n . D eps_p at the ends of the facets (facets, 2 ends, 2): linear through the points of the cell behind."""
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

    def own_energy(self, displacement: FloatArray, plastic: FloatArray) -> float:
        """What eps_p adds to 1/2 f_c . u to give the elastic energy: 1/2 sum w eps_p D eps_p - 1/2 f_p . u [N mm]."""
        stored = float(self.weight @ ((plastic @ self.moduli) * plastic).sum(axis=1))
        return 0.5 * (stored - float(self.load(plastic) @ displacement))


class BodyStep:
    """One step of one body: the points that may flow in it, and their plastic strains x (points, 4).

    Points that stay within their yield surface by more than `MARGIN` are left out, unless it turns out that they flow.

    Args:
        body: its points and law.
        before: what they remember.
        moved: travel of the wheel in this step [mm].
        loads: nodal loads of the contact before the step (2 loaded nodes,) [N].
    """

    def __init__(self, body: PlasticBody, before: BodyFlow, moved: float, loads: FloatArray) -> None:
        self.body, self.before, self._moved = body, before.state, moved
        self._parts = max(
            1, min(MOST_PARTS, math.ceil(abs(moved) / (PART * float(body.body.line.length.min())) - 1e-9))
        )
        self._loads = loads
        self._path: Path | None = None
        self._flowed_before = bool(before.state.accumulated.any())
        self._whole = before.state.strain.copy()
        self._chosen = np.zeros(body.count, dtype=bool)
        points, gained = body.expected(before, moved)
        self._chosen[points] = True
        self._take()
        self.x = self._part.strain.copy()
        self.x[np.searchsorted(self.points, points)] += gained

    def _over(self, displacement: FloatArray) -> FloatArray:
        """How far all points would be beyond their yield surface at a displacement (dofs,) [MPa]."""
        return overshoot(self.body.stress(displacement, self.before.strain), self.before, self.body.law)

    @cached_property
    def _base(self) -> FloatArray:
        """f_p (dofs,) [N] of what flowed before the step."""
        return self.body.load(self.before.strain)

    @cached_property
    def _start(self) -> FloatArray:
        """Displacement before the step (dofs,) [mm]."""
        return self.body.displaced(self.before, self._loads)

    def _take(self) -> None:
        self._path = None
        self.points = np.flatnonzero(self._chosen)
        rows = (4 * self.points[:, None] + np.arange(4)).ravel()
        self._operator = self.body.operator[rows]
        self._part = self.before.at(self.points)
        self._weight = self.body.weight[self.points]
        self.scale = self.body.scale[self.points]

    def displace(self) -> FloatArray:
        """u_p (dofs,) [mm] of the plastic strains x; no solve where nothing ever flowed."""
        if not self._flowed_before and not len(self.points):
            return np.zeros(self.body.body.dofs)
        gained = self._weight[:, None] * ((self.x - self._part.strain) @ self.body.moduli)
        return self.body.body.solve((self._base + self._operator.T @ gained.ravel())[:, None])[:, 0]

    def eigen(self, displacement: FloatArray) -> Eigen:
        """What the plastic strains x and their displacement u_p do at the contact line."""
        self._whole[self.points] = self.x
        trace = self.body.body.trace_dofs
        return Eigen(displacement=displacement[trace], traction=self.body.traction(self._whole))

    def flowed(self, displacement: FloatArray) -> FloatArray:
        """g(x): the plastic strains that the law gives at a displacement (dofs,)."""
        body = self.body
        self._after = flow(self._strains(displacement), self._part, body.law, body.shear_modulus)
        return self._after.strain

    def _strains(self, displacement: FloatArray) -> FloatArray:
        """Total strains along the step (parts, points, 4), the last at its end."""
        after = (self._operator @ displacement).reshape(1, -1, 4)
        if self._parts == 1 or not len(self.points):
            return np.asarray(after)
        if self._path is None:
            way = self._moved if self.body.body.which == "axle" else -self._moved
            self._path = Path(self.body.along, self.points, self._start, way, self._parts)
            self._path.choose(after[0])
        return np.concatenate([self._path.strains(displacement, after[0]), after])

    def widened(self, displacement: FloatArray) -> int:
        """How many points that were left out flow at this displacement; they and what is near are taken in."""
        over = self._over(displacement)
        missed = int(((over > 0.0) & ~self._chosen).sum())
        if missed:
            before, old = self.x, self.points
            self._chosen |= over > -MARGIN * self.body.law.yield_stress
            self._take()
            self.x = self._part.strain.copy()
            self.x[np.searchsorted(self.points, old)] = before
        return missed

    def gained_square(self) -> float:
        """Sum of w e : e of what the law gave the points in this step [mm3]."""
        return float(np.square(self.scale * (self._after.strain - self._part.strain)).sum())

    def finished(self, displacement: FloatArray) -> tuple[BodyFlow, FloatArray]:
        """The flow of the step, and three numbers: energy, work of the step, largest plastic strain.

        The work takes the mean of the stress before and after, as elastic energy and force do in an energy balance.
        """
        body = self.body
        after = self.before.with_points(self.points, self._after)
        flowed = BodyFlow.between(self.before, after, self._moved)
        here = flowed.points
        if not len(here):
            energy = body.own_energy(displacement, after.strain) if after.accumulated.any() else 0.0
            return flowed, np.array([energy, 0.0, after.accumulated.max(initial=0.0)])
        rows = (4 * here[:, None] + np.arange(4)).ravel()
        strains = (body.operator[rows] @ np.stack([self._start, displacement], axis=1)).reshape(-1, 4, 2)
        stress = (strains.sum(axis=2) - self.before.strain[here] - after.strain[here]) @ body.moduli
        work = 0.5 * (stress * flowed.gained).sum(axis=1)
        after.work[here] += work
        numbers = [body.own_energy(displacement, after.strain), float(body.weight[here] @ work)]
        return flowed, np.array([*numbers, after.accumulated.max(initial=0.0)])
