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
from ..contact.eigen import Eigen
from .law import Hardening, PointState, flow, overshoot
from .path import Path, StrainAlong, Strains
from .substitution import Substitution

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
class Ended:
    """What the plastic strains of a state and the loads of the contact do together."""

    displacement: FloatArray
    """Displacement u (dofs,) [mm]."""
    own: FloatArray
    """Its part u_p by the plastic strains alone, at the trace nodes (2 trace nodes,) [mm]."""
    load: FloatArray
    """Load f_p of the plastic strains (dofs,) [N]."""


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
    ended: Ended | None = None
    """Where it led to; None where that must be computed from the state and the loads, to the same bits."""

    @staticmethod
    def between(before: PointState, after: PointState, moved: float, ended: Ended | None = None) -> BodyFlow:
        """The flow from one state to another."""
        grown = after.accumulated > before.accumulated
        points = np.flatnonzero(grown | (after.strain != before.strain).any(axis=1))  # p may swallow what it grew by
        gained = after.strain[points] - before.strain[points]
        return BodyFlow(state=after, points=points, gained=gained, moved=moved, ended=ended)

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
        every = np.arange(self.count)
        self.strains = Strains(operators=gauss.strain, unknowns=body.space.unknowns(gauss.cell), points=every)
        self._held, self.trace = np.flatnonzero(body.supported.ravel()), body.trace_dofs
        self._last_carried: tuple[float, sp.csr_matrix] | None = None

    def rest(self) -> BodyFlow:
        """Nothing flowed yet."""
        state = PointState.virgin(self.count, self.law.backs)
        return BodyFlow.between(state, state, 0.0)

    @cached_property
    def along(self) -> StrainAlong:
        """Strain operators at shifted points."""
        return StrainAlong(self.body.space, self.places)

    @cached_property
    def kept(self) -> Substitution:
        """The kept factor of the body, for solutions in parts."""
        return Substitution(self.body.kept_factor)

    @cached_property
    def line_part(self) -> IntArray:
        """What displacements of the contact line need of the factor."""
        return self.kept.reached(self.trace)

    def forward(self, load: FloatArray, part: IntArray | None = None) -> FloatArray:
        """The first half of a solution, see `Substitution`, for a load (dofs,) [N]; on supports it does nothing."""
        self.body.back_substitutions += 1
        load[self._held] = 0.0
        return self.kept.forward(load, self.kept.reached(np.flatnonzero(load)) if part is None else part)

    def contact_load(self, loads: FloatArray) -> FloatArray:
        """Nodal loads (dofs,) [N] of those of the contact (2 loaded nodes,)."""
        out = np.zeros(self.body.dofs)
        out[self.trace.reshape(2, -1)[:, : len(loads) // 2].ravel()] = loads
        return out

    def ended(self, state: PointState, loads: FloatArray) -> Ended:
        """What a state and the loads (2 loaded nodes,) of the contact lead to."""
        load, own = np.zeros(self.body.dofs), np.zeros(len(self.trace))
        y = np.zeros(self.body.dofs)
        if state.accumulated.any():
            load = self.load(state.strain)
            y = self.forward(load.copy())
            own = self.kept.backward(y, self.line_part)[self.trace]
        if loads.any():
            y += self.forward(self.contact_load(loads))
        return Ended(displacement=self.kept.backward(y, self.kept.everything), own=own, load=load)

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
        points = np.flatnonzero(plastic.any(axis=1))
        return self.load_at(points, plastic[points])

    def load_at(self, points: IntArray, plastic: FloatArray) -> FloatArray:
        """f_p (dofs,) [N] of plastic strains (m, 4) of some points."""
        return self.strains.at(points).load(self.weight[points, None] * (plastic @ self.moduli), self.body.dofs)

    def stress(self, displacement: FloatArray, plastic: FloatArray) -> FloatArray:
        """D (B u - eps_p) (points, 4) [MPa]."""
        return np.asarray((self.strains.of(displacement) - plastic) @ self.moduli)

    def traction(self, plastic: FloatArray, facets: IntArray | None = None) -> FloatArray:
        """n . D eps_p at the ends of facets, of all by default: linear through the points of the cell behind.

        Returns:
            Normal and tangential part (facets, 2 ends, 2) [MPa].
        """
        line, which = self.body.line, np.arange(self.body.line.facets) if facets is None else facets
        stress = plastic.reshape(-1, self.per_cell, 4)[self.body.line_cells[which]] @ self.moduli
        if self.per_cell == 1:
            ends = np.repeat(stress, 2, axis=1)
        else:  # 5/3 of the nearest, -1/3 of the others at a vertex
            corners = np.einsum("vp,fpi->fvi", 2.0 * np.eye(3) - 1.0 / 3.0, stress)
            ends = np.take_along_axis(corners, line.ends[which][:, :, None], axis=1)
        n_r, n_z = line.normals[which].T[:, :, None]
        t_r, t_z = n_r * ends[..., 0] + n_z * ends[..., 3], n_r * ends[..., 3] + n_z * ends[..., 1]
        return np.stack([n_r * t_r + n_z * t_z, n_r * t_z - n_z * t_r], axis=2)

    def own_energy(self, ended: Ended, plastic: FloatArray) -> float:
        """What eps_p adds to 1/2 f_c . u to give the elastic energy: 1/2 sum w eps_p D eps_p - 1/2 f_p . u [N mm]."""
        stored = float(self.weight @ ((plastic @ self.moduli) * plastic).sum(axis=1))
        return 0.5 * (stored - float(ended.load @ ended.displacement))


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
        self._loads, self._started = loads, before.ended
        self._elastic: FloatArray | None = None  # the displacement under the first loads, for it was looked at whole
        self._flowed_before = bool(before.state.accumulated.any())
        self._whole = before.state.strain.copy()
        self._chosen = np.zeros(body.count, dtype=bool)
        points, gained = body.expected(before, moved)
        self._chosen[points] = True
        self._take()
        self.x = self._part.strain.copy()
        self.x[np.searchsorted(self.points, points)] += gained

    @property
    def _start(self) -> Ended:
        """Displacement before the step."""
        if self._started is None:
            self._started = self.body.ended(self.before, self._loads)
        return self._started

    @cached_property
    def _traction(self) -> FloatArray:
        """Traction of the plastic strains before the step; only the axle's is looked for."""
        return self.body.traction(self.before.strain)

    def _take(self) -> None:
        body = self.body
        self._path: Path | None = None
        self.points = np.flatnonzero(self._chosen)
        self._strains = body.strains.at(self.points)
        self._inner_part = body.kept.reached(self._strains.reach)
        self._zone_part = self._inner_part
        self._part = self.before.at(self.points)
        self.scale = body.scale[self.points]
        behind = self._chosen.reshape(-1, body.per_cell).any(axis=1)
        self._facets = np.flatnonzero(behind[body.body.line_cells])

    def displace(self) -> FloatArray:
        """u_p of the plastic strains x at the trace nodes (2 trace nodes,) [mm]."""
        body = self.body
        if not self._flowed_before and not len(self.points):
            self._y = np.zeros(body.body.dofs)
            return np.zeros(len(body.trace))
        load = body.load_at(self.points, self.x - self._part.strain)
        self._y = body.forward(load, self._inner_part)
        return self._start.own + body.kept.backward(self._y, body.line_part)[body.trace]

    def eigen(self, displacement: FloatArray) -> Eigen:
        """What the plastic strains x and their displacement u_p at the trace nodes do at the contact line."""
        if self.body.body.which != "axle":
            return Eigen(displacement=displacement, traction=None)
        self._whole[self.points] = self.x
        traction = self._traction.copy()
        traction[self._facets] = self.body.traction(self._whole, self._facets)
        return Eigen(displacement=displacement, traction=traction)

    def press(self, loads: FloatArray) -> None:
        """Take the loads of the contact (2 loaded nodes,) [N] that follow from x."""
        if (loads != self._loads).any():
            self._y += self.body.forward(self.body.contact_load(loads - self._loads))

    def flowed(self) -> FloatArray:
        """g(x): the plastic strains that the law gives under these loads."""
        body = self.body
        self._after = flow(self._path_strains(), self._part, body.law, body.shear_modulus)
        return self._after.strain

    def _path_strains(self) -> FloatArray:
        """Total strains along the step (parts, points, 4), the last at its end."""
        body = self.body
        if not len(self.points):
            return np.zeros((1, 0, 4))
        if self._path is None and self._parts > 1:
            way = self._moved if body.body.which == "axle" else -self._moved
            self._path = Path(body.along, self.points, self._start.displacement, way, self._parts)
            reach = np.concatenate([self._strains.reach, *(each.reach for each in self._path.after)])
            self._zone_part = body.kept.reached(reach)
            self._path.choose(self._strains.of(self._displacement(self._zone_part)))
        u = self._displacement(self._zone_part)
        after = self._strains.of(u)
        if self._path is None:
            return after[None]
        return np.concatenate([self._path.strains(u, after), after[None]])

    def _displacement(self, part: IntArray) -> FloatArray:
        """The displacement (dofs,) under these loads, right within a part of the factor."""
        return self._start.displacement + self.body.kept.backward(self._y, part)

    def widened(self, ended: Ended | None = None) -> int:
        """How many points that were left out flow, now or at an end; they and what is near are taken in."""
        body = self.body
        if ended is None:
            self._elastic = u = self._displacement(body.kept.everything)
        elif ended.displacement is self._elastic:
            return 0  # these stresses were looked at
        else:
            u = ended.displacement
        over = overshoot(body.stress(u, self.before.strain), self.before, body.law)
        missed = int(((over > 0.0) & ~self._chosen).sum())
        if missed:
            before, old = self.x, self.points
            self._chosen |= over > -MARGIN * body.law.yield_stress
            self._take()
            self.x = self._part.strain.copy()
            self.x[np.searchsorted(self.points, old)] = before
        return missed

    def gained_square(self) -> float:
        """Sum of w e : e of what the law gave the points in this step [mm3]."""
        return float(np.square(self.scale * (self._after.strain - self._part.strain)).sum())

    def ended(self, loads: FloatArray) -> Ended:
        """What g(x) and the loads (2 loaded nodes,) of the contact lead to; known where nothing has ever flowed."""
        if self._elastic is not None and not self._flowed_before and not len(self.points):
            none = np.zeros(self.body.body.dofs)
            return Ended(displacement=self._elastic, own=np.zeros(len(self.body.trace)), load=none)
        return self.body.ended(self.before.with_points(self.points, self._after), loads)

    def finished(self, ended: Ended) -> tuple[BodyFlow, FloatArray]:
        """The flow of the step, and three numbers: energy, work of the step, largest plastic strain.

        The work takes the mean of the stress before and after, as elastic energy and force do in an energy balance.
        """
        body = self.body
        after = self.before.with_points(self.points, self._after)
        flowed = BodyFlow.between(self.before, after, self._moved, ended)
        here = flowed.points
        energy = body.own_energy(ended, after.strain) if after.accumulated.any() else 0.0
        spent = 0.0
        if len(here):
            strains = body.strains.at(here).of(self._start.displacement + ended.displacement)
            stress = (strains - self.before.strain[here] - after.strain[here]) @ body.moduli
            work = 0.5 * (stress * flowed.gained).sum(axis=1)
            after.work[here] += work
            spent = float(body.weight[here] @ work)
        return flowed, np.array([energy, spent, after.accumulated.max(initial=0.0)])
