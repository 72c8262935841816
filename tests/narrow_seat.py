"""A seat much narrower than its radius: two half planes for who stands on it, on a thick shaft in a thick ring."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from revolved import mesh_of

from macrofit.base.arrays import FloatArray
from macrofit.bodies.body import _contact_line
from macrofit.contact.interface import couple_lines
from macrofit.scene.material import Material
from macrofit.service.bonded import Harmonic
from macrofit.service.fit import Fit
from macrofit.service.harmonics import HarmonicBody
from macrofit.service.kernel import Kernel
from macrofit.service.loads import front_face
from macrofit.service.slipping import Law, solve_step

HALF = 20.0
"""Half the width a of the contact [mm]."""
RADIUS = 160.0 * HALF
"""Radius of the shaft, thickness and half the length of both bodies [mm]; they change slip by some HALF / RADIUS."""
FACETS = 40
MODULUS = 206e3


def graded(step: float, end: float) -> FloatArray:
    """Places from 0 to ``end``, the first ``step`` apart, each distance 1.3 times the one before."""
    count = math.ceil(math.log(1.0 + 0.3 * end / step, 1.3))
    places = step * (1.3 ** np.arange(count + 1) - 1.0) / 0.3
    return np.asarray(places * (end / places[-1]))


@cache
def narrow_fit(poisson_ratio: float) -> Fit:
    """The two bodies, in contact at |z| < HALF; the shaft is held at its last z."""
    step = 2.0 * HALF / FACETS
    away = HALF + graded(step, RADIUS)[1:]
    z = np.concatenate([-away[::-1], np.linspace(-HALF, HALF, FACETS + 1), away])
    steel = Material(youngs_modulus=MODULUS, poisson_ratio=poisson_ratio)
    depth = graded(step, RADIUS)
    depth[-1] = RADIUS  # the shaft is solid
    bodies, lines = [], []
    for name, r in (("axle", RADIUS - depth[::-1]), ("wheel", RADIUS + depth)):
        space = mesh_of(r, z, inside=name == "wheel")
        line, trace, _ = _contact_line(
            space, "seat", name, None, steel, middles=None, beside=np.zeros((0, 2, 2)), radial=True, with_cells=False
        )
        lines.append(line)
        bodies.append(HarmonicBody(space, steel, trace, floats=name == "wheel", name=name))
    coupling = couple_lines(lines[0], lines[1], 0.0)
    assert coupling is not None
    chosen = np.flatnonzero(np.abs(coupling.portions.points.ravel()) < HALF)
    gamma = np.full(lines[0].facets, 10.0 * MODULUS)
    return Fit(bodies[0], bodies[1], (lines[0], lines[1]), coupling, gamma, chosen)


class NarrowSeat:
    """Hertz' pressure on the seat, and loads that come up in steps."""

    def __init__(self, pressure: float, friction: float, *, poisson_ratio: float = 0.0, harmonics: int = 0) -> None:
        """The largest pressure [MPa], the coefficient of friction, and how many harmonics there are beside n = 0."""
        self.fit, self.friction = narrow_fit(poisson_ratio), friction
        self.normal_force = 0.5 * math.pi * pressure * HALF  # N/mm
        self.angles = 2 * harmonics + 1
        axle, wheel = ((len(body.space.nodes), 3) for body in (self.fit.axle, self.fit.wheel))
        self._axle, self._wheel = (np.zeros((harmonics + 1, *size), dtype=np.complex128) for size in (axle, wheel))
        self._traction = np.zeros((self.angles, 3, self.fit.moments))
        self._traction[:, 0] = -pressure * np.sqrt(1.0 - (self.z / HALF) ** 2)
        self.still, self.slip = self._traction.copy(), np.zeros_like(self._traction)
        self.work = 0.0
        """Friction work of the steps so far, over the circumference [N]."""

    @property
    def z(self) -> FloatArray:
        """Places of the moments [mm]."""
        return self.fit.z

    def pull(self, stress: float) -> None:
        """Pull at the shaft's front end [MPa]."""
        face, nodes = front_face(self.fit.axle.space), self.fit.axle.space.nodes
        for start, middle, end in face.edges:
            first, last = nodes[start, 0], nodes[end, 0]
            share = 2.0 * math.pi * abs(last - first) * stress / 6.0
            self._axle[0, [start, middle, end], 2] -= share * np.array([first, 2.0 * (first + last), last])

    def bend(self, stress: float) -> None:
        """Bend the shaft, pulled with this stress [MPa] at the surface at the angle 0."""
        face = front_face(self.fit.axle.space)
        moment = -stress * face.section.second_moment / face.section.outer
        self._axle[1] += face.loads(self.fit.axle.space, 0.0, moment, 0.0)

    def twist(self, stress: float) -> None:
        """Twist the shaft's front end, with this shear stress [MPa] at the surface."""
        face = front_face(self.fit.axle.space)
        moment = -2.0 * stress * face.section.second_moment / face.section.outer
        self._axle[0, :, 1] += 1j * face.loads(self.fit.axle.space, 0.0, moment, 0.0)[:, 2]  # b stands for i u_t

    def push(self, along: float, around: float) -> None:
        """Push the ring with forces per length of the circumference [N/mm], at its bore far from the contact."""
        for node in self.fit.wheel.trace[[0, -1]]:
            self._wheel[0, node, 2] += math.pi * RADIUS * along
            self._wheel[0, node, 1] += 1j * math.pi * RADIUS * around

    def kernel(self) -> Kernel:
        """What the fit answers to the loads."""
        found = []
        for n, (axle, wheel) in enumerate(zip(self._axle, self._wheel, strict=True)):
            jump, balance = self.fit.jump(n, axle, wheel)
            traction, none = self.fit.response(n).traction(-jump, balance), np.zeros(0, dtype=np.complex128)
            found.append(Harmonic(jump=jump, balance=balance, moved=none, traction=traction, stress=none))
        return Kernel(self.fit, found)

    def follow(self, path: FloatArray) -> FloatArray:
        """Tractions (K, 3, m) [MPa] when the loads have followed the shares ``path`` of what they are."""
        kernel = self.kernel()
        loads = kernel.load_at(0.0).reshape(self.still.shape)
        for share in path:
            law = Law(friction=np.full(self.fit.moments, self.friction), before=self.slip)
            solved = solve_step(kernel, law, self.still + share * loads, self.slip)
            assert solved.converged
            mean = 0.5 * (solved.traction + self._traction)
            each = ((solved.slip - self.slip) * mean)[:, 1:].sum(axis=1)
            self.work -= float((each @ self.fit.weight).sum()) / (self.angles * 2.0 * math.pi * RADIUS)
            self._traction, self.slip = solved.traction, solved.slip
        return self._traction
