"""The loads of a wheelset in service as amplitudes of harmonics, and the nominal stress that beam theory gives.

The angle is 0 where the wheel stands on the rail. There the rail pushes the wheel towards the axis with the force P.
The journal, beyond the front end of the drawn axle, is pushed down with the same P: at the front end stand P and a
moment M_0. The held end is a plane of symmetry, which carries the moment. A lateral force along the axle acts on the
wheel at the rail, a torque all around its rim; the held end carries both.

The front end is loaded by the stresses of a beam, bending and Saint-Venant's shear (Love, *Theory of Elasticity*,
chapter on flexure), which a circular ring of radii a < b has as

    tau_rz = k (a^2 + b^2 - r^2 - a^2 b^2 / r^2) cos t,   k = V (3 + 2 nu) / (8 (1 + nu) I)
    tau_tz = -k (a^2 + b^2 - (1 - 2 nu) / (3 + 2 nu) r^2 + a^2 b^2 / r^2) sin t
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray, IntArray
from ..bodies.discretisation import Discretisation
from ..contact.moments import shape
from ..errors import MeshError, SceneError

ROUNDING = 1e-9
_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(4)  # type: ignore[no-untyped-call]


@dataclass(frozen=True, kw_only=True)
class Section:
    """A cross-section of the axle."""

    outer: float  # mm
    inner: float  # mm, 0: solid

    @property
    def second_moment(self) -> float:
        """I = pi / 4 (b^4 - a^4) [mm4]."""
        return 0.25 * math.pi * (self.outer**4 - self.inner**4)

    def bending_stress(self, moment: float) -> float:
        """Nominal stress M b / I at the surface [MPa] of a moment [N mm], as in EN 13103-1 before its factor K."""
        return moment * self.outer / self.second_moment

    def shear(self, force: float, poisson_ratio: float, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """tau_rz and tau_tz [MPa] of a shear force [N] at radii r, without cos t and sin t."""
        nu, a, b = poisson_ratio, self.inner, self.outer
        k = force * (3.0 + 2.0 * nu) / (8.0 * (1.0 + nu) * self.second_moment)
        hole = np.divide(a * a * b * b, r * r, out=np.zeros_like(r), where=r > 0.0)
        whole, share = a * a + b * b, (1.0 - 2.0 * nu) / (3.0 + 2.0 * nu)
        return k * (whole - r * r - hole), -k * (whole - share * r * r + hole)


@dataclass(frozen=True, kw_only=True)
class EndFace:
    """A plane face across the axle: its edges (e, order + 1) and its section."""

    edges: IntArray
    z: float  # mm
    section: Section

    def loads(self, space: Discretisation, shear: float, moment: float, poisson_ratio: float) -> FloatArray:
        """Nodal amplitudes (nodes, 3) [N] for n = 1 of a beam's stresses: V across [N], M [N mm].

        The face looks along -z; V points to the angle 0, M compresses the axle there.
        """
        out = np.zeros((len(space.nodes), 3))
        at, weight = 0.5 * (1.0 + _GAUSS_X), 0.5 * _GAUSS_W
        values, _ = shape(space.order, at)
        ends = space.nodes[self.edges[:, [0, -1]], 0]
        r = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * at
        scale = 2.0 * math.pi * r * np.abs(ends[:, 1:] - ends[:, :1]) * weight
        radial, around = self.section.shear(shear, poisson_ratio, r)
        axial = moment * r / self.section.second_moment
        for component, traction in enumerate((radial, around, axial)):
            np.add.at(out[:, component], self.edges, 0.5 * (scale * traction) @ values)
        return out


def front_face(space: Discretisation, *, last: bool = False) -> EndFace:
    """The end of the axle with the smallest z, or with the largest.

    Raises:
        MeshError: there is no plane face across the axis.
    """
    corners = space.cells[:, :3]
    pairs = np.concatenate([corners[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
    middles = space.cells[:, [5, 3, 4]].T.ravel() if space.order == 2 else pairs[:, 0]
    z = space.nodes[:, 1]
    end = z.max() if last else z.min()
    on = (np.abs(z[pairs] - end) < 1e-6 * np.ptp(z)).all(axis=1)
    if not on.any():
        raise MeshError("mesh.axle: the axle has no plane front end, where the journal's force acts")
    chosen = [pairs[on, :1], middles[on, None], pairs[on, 1:]] if space.order == 2 else [pairs[on, :1], pairs[on, 1:]]
    edges = np.concatenate(chosen, axis=1)
    radii = space.nodes[edges, 0]
    outer, inner = float(radii.max()), float(radii.min())
    solid = inner < ROUNDING * outer  # a mesher leaves nodes beside the axis by rounding
    return EndFace(edges=edges, z=float(end), section=Section(outer=outer, inner=0.0 if solid else inner))


def rim_node(space: Discretisation, offset: float) -> int:
    """The node of the wheel on the rail: of the largest radius, nearest to the rim's middle + offset [mm].

    Raises:
        SceneError: the offset is beyond the rim.
    """
    r, z = space.nodes.T
    outer = np.flatnonzero(r > r.max() * (1.0 - 1e-6))
    middle, half = 0.5 * (z[outer].min() + z[outer].max()), 0.5 * float(np.ptp(z[outer]))
    if abs(offset) > half * (1.0 + 1e-9):
        raise SceneError(f"service.rim_offset: {offset:g} mm is beyond the rim, which ends {half:g} mm from its middle")
    return int(outer[np.argmin(np.abs(z[outer] - middle - offset))])


def point_load(space: Discretisation, node: int, force: tuple[float, float]) -> FloatArray:
    """Nodal amplitudes (nodes, 3) of a point force (radial, axial) [N] at the angle 0, the same in every harmonic."""
    out = np.zeros((len(space.nodes), 3))
    out[node, 0], out[node, 2] = force
    return out


def torque_load(space: Discretisation, node: int, torque: float) -> FloatArray:
    """Nodal amplitudes (nodes, 3) of a torque [N mm] around the circle of a node, n = 0."""
    out = np.zeros((len(space.nodes), 3))
    out[node, 1] = torque / space.nodes[node, 0]
    return out
