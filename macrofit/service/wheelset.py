"""The wheelset of a scene in service: its bodies in harmonics, its fit and its loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from ..base.arrays import FloatArray
from ..bodies.body import Body
from ..contact.cooling import warmed
from ..contact.interface import MortarCoupling, couple_lines
from ..contact.seat import gamma_of
from ..errors import SceneError
from ..press import REACH
from ..results.doubts import LARGE_STRAIN
from ..scene.keys import ContactKeys, Scene, ServiceKeys
from .elements import ComplexArray
from .fit import Fit
from .harmonics import HarmonicBody
from .loads import EndFace, Section, front_face, point_load, rim_node, torque_load

MARGIN = 3.0
"""A gap closes at most by that many times what it does in the bonded fit."""


@dataclass(frozen=True, kw_only=True)
class Loads:
    """The loads at the angle 0, and where they stand."""

    keys: ServiceKeys
    face: EndFace
    rail_z: float  # of the wheel on the rail, in the axle's frame [mm]
    rail_radius: float  # mm
    axle: FloatArray  # (nodes, 3) of n = 1
    wheel: FloatArray  # (nodes, 3) of every n
    around: FloatArray  # (nodes, 3) of the wheel, n = 0

    def of_axle(self, n: int) -> ComplexArray:
        """Nodal amplitudes (nodes, 3) on the axle [N]."""
        return self.axle.astype(np.complex128) if n == 1 else np.zeros_like(self.axle, dtype=np.complex128)

    def of_wheel(self, n: int) -> ComplexArray:
        """Nodal amplitudes (nodes, 3) on the wheel [N]."""
        return self.wheel + (1j if n == 0 else 0j) * self.around  # b stands for i u_t

    def moment(self, z: FloatArray) -> FloatArray:
        """Bending moment of the axle at z [N mm], positive where it is compressed at the angle 0."""
        keys = self.keys
        behind = keys.journal_force * (z - self.rail_z) - keys.lateral_force * self.rail_radius
        out = keys.journal_moment + keys.journal_force * (z - self.face.z)
        return np.asarray(out - np.where(z > self.rail_z, behind, 0.0))


@dataclass(frozen=True, kw_only=True)
class Wheelset:
    """What a service computation needs of a scene."""

    scene: Scene
    displacement: float  # mm
    fit: Fit
    loads: Loads

    def section(self, z: FloatArray) -> list[Section]:
        """Sections of the axle at places of the seat [mm]."""
        line = self.fit.lines[0]
        radii = np.interp(z, line.coordinate, line.radius)
        return [Section(outer=float(radius), inner=self.loads.face.section.inner) for radius in radii]

    def nominal_stress(self, z: FloatArray) -> FloatArray:
        """Bending stress of beam theory at the surface [MPa], as in EN 13103-1 before its factor K."""
        moments = self.loads.moment(z)
        return np.array([s.bending_stress(m) for s, m in zip(self.section(z), moments.tolist(), strict=True)])


def touching(whole: Wheelset, gap: FloatArray) -> Wheelset:
    """The wheelset with the moments alone that are in contact or may come into it, by their gaps (m,) [mm]."""
    closed = whole.fit.of_moments(np.flatnonzero(gap == 0.0))
    apart = whole.fit.of_moments(np.flatnonzero(gap > 0.0))
    near = np.zeros(apart.moments)
    for n in (0, 1):
        loads = (whole.loads.of_axle(n), whole.loads.of_wheel(n))
        near += closed.approach(n, loads, apart) * (1.0 + n)
    chosen = np.sort(np.concatenate([closed.chosen, apart.chosen[gap[apart.chosen] < MARGIN * near]]))
    return replace(whole, fit=closed if len(chosen) == closed.moments else whole.fit.of_moments(chosen))


def service_keys(scene: Scene) -> ServiceKeys:
    """The loads of a scene, those of the table's defaults where it has none."""
    return ServiceKeys() if scene.service is None else scene.service


def with_service(scene: Scene) -> Scene:
    """The scene with its table [service] written out, which it may leave out."""
    return msgspec.structs.replace(scene, service=service_keys(scene))


def wheelset(
    scene: Scene,
    bodies: Mapping[str, Body],
    displacement: float | None = None,
    coupling: MortarCoupling | None = None,
    revolved: Callable[[Body, str], HarmonicBody] | None = None,
) -> Wheelset:
    """The wheelset of a scene, its wheel pressed to a displacement [mm], on facets that face each other.

    ``revolved`` gives the bodies in harmonics where they are there already.

    Raises:
        SceneError: nothing can bend here, the wheel is not on its seat, or the loads bend the axle out of all measure.
    """
    if scene.direction != "radial":
        raise SceneError("service: bends a wheel on an axle, and the gap is axial here")
    keys = service_keys(scene)
    where = scene.displacements[-1] if displacement is None else displacement
    make = in_harmonics if revolved is None else revolved
    axle, wheel = (make(bodies[name], name) for name in ("axle", "wheel"))
    lines = (bodies["axle"].line, bodies["wheel"].line)
    if coupling is None:
        strain = scene.thermal_strain_at(len(scene.displacements) - 1)
        coupling = couple_lines(lines[0], warmed(lines[1], strain), where, REACH)
    if coupling is None or float(coupling.gap.min()) >= 0.0:
        raise SceneError(
            f"service: at {where:g} mm nothing presses the wheel onto its seat; change motion.travel or the radii"
        )
    line, every = lines[0], np.arange(len(coupling.normals))
    stiffness = scene.contact.penalty_stiffness if scene.contact.formulation == "penalty" else None
    penalty = ContactKeys(formulation="penalty", penalty_stiffness=stiffness)
    gamma = gamma_of(penalty, line.material.youngs_modulus, line.length)
    fit = Fit(axle, wheel, lines, coupling, gamma, every)
    whole = Wheelset(scene=scene, displacement=where, fit=fit, loads=loads_of(keys, axle, wheel, where))
    _check_bending(whole)
    return whole


def _check_bending(whole: Wheelset) -> None:
    """See that the axle bends within what small strains describe."""
    stress, keys = np.abs(whole.nominal_stress(whole.fit.z)), whole.loads.keys
    top = int(np.argmax(stress))
    strain = float(stress[top]) / whole.fit.lines[0].material.youngs_modulus
    if strain > LARGE_STRAIN:
        raise SceneError(
            f"service: {keys.journal_force:.4g} N on the journal, {keys.lateral_force:.4g} N along the axle and "
            f"{keys.journal_moment:.4g} N mm at the front end bend the axle at z = {whole.fit.z[top]:.1f} mm by a "
            f"strain of {strain:.2g}, at every angle, where small strains end at {LARGE_STRAIN:g}; state "
            f"service.journal_force and lateral_force in N, journal_moment in N mm, or lower them"
        )


def in_harmonics(body: Body, name: str) -> HarmonicBody:
    """The axle or the wheel in harmonics."""
    trace = body.trace[: len(body.line.nodes)]
    return HarmonicBody(body.space, body.material, trace, floats=name == "wheel", name=name)


def loads_of(keys: ServiceKeys, axle: HarmonicBody, wheel: HarmonicBody, displacement: float) -> Loads:
    """The loads on the bodies, the wheel pressed to a displacement [mm]."""
    face = front_face(axle.space)
    node = rim_node(wheel.space, keys.rim_offset)
    radius, z = wheel.space.nodes[node].tolist()
    nu = axle.material.poisson_ratio
    return Loads(
        keys=keys,
        face=face,
        rail_z=z + displacement,
        rail_radius=radius,
        axle=face.loads(axle.space, keys.journal_force, keys.journal_moment, nu),
        wheel=point_load(wheel.space, node, (-keys.journal_force, keys.lateral_force)),
        around=torque_load(wheel.space, node, keys.torque),
    )
