"""Exact solutions the solver is held against: pure functions of the drawing and of what was measured.

Lengths in mm, forces in N, stresses in MPa; pressures are positive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from macrofit.scene import Disc, Hub, Shaft
from macrofit.scene.material import Material

FloatArray = npt.NDArray[np.float64]


# Rings in plane stress: Timoshenko, Goodier, Theory of Elasticity (3rd ed., 1970), section 28, Lamé's solution


def shaft_compliance(radius: float, inner: float, material: Material) -> float:
    """-u_r(a) / p [mm/MPa] of a shaft of radius a under an outer pressure p, free axially (sigma_z = 0).

    u_r(a) = -(p a / E) [(a^2 + i^2) / (a^2 - i^2) - nu], i the radius of its hole.
    """
    shape = (radius**2 + inner**2) / (radius**2 - inner**2)
    return radius / material.youngs_modulus * (shape - material.poisson_ratio)


def ring_compliance(radius: float, outer: float, material: Material) -> float:
    """u_r(b) / p [mm/MPa] of a ring of inner radius b under an inner pressure p, free axially (sigma_z = 0).

    u_r(b) = (p b / E) [(c^2 + b^2) / (c^2 - b^2) + nu], c its outer radius.
    """
    shape = (outer**2 + radius**2) / (outer**2 - radius**2)
    return radius / material.youngs_modulus * (shape + material.poisson_ratio)


def drawn_rings_pressure(axle: Shaft, wheel: Hub) -> float:
    """Pressure [MPa] on the seat of two flush rings whose radii are those of the drawing, at small strain.

    The shaft of radius a carries p. The two surfaces are b and a apart before, and each is deformed where it is
    drawn: the ring of bore b receives the same force over the smaller area, p a / b, and

        a - b = u_w(b) - u_a(a) = p [ (a / b) C_w(b) + C_a(a) ].

    It differs from the pressure at a nominal radius by the order of (a - b) / a.
    """
    a, b = axle.seat_radius, wheel.bore_radius
    flexibility = shaft_compliance(a, axle.inner_radius, axle.material)
    flexibility += a / b * ring_compliance(b, wheel.hub_outer_radius, wheel.material)
    return (a - b) / flexibility


def press_fit_pressure(axle: Shaft, wheel: Hub, radius: float) -> float:
    """Pressure [MPa] of a press-fit at one nominal radius: the plane-stress formula of DIN 7190-1 (elastic range).

    p = delta_d / (d [ (1/E_h) ((D^2 + d^2)/(D^2 - d^2) + nu_h) + (1/E_a) ((d^2 + d_i^2)/(d^2 - d_i^2) - nu_a) ])
    with the diametral interference delta_d, written here with radii.
    """
    flexibility = shaft_compliance(radius, axle.inner_radius, axle.material)
    flexibility += ring_compliance(radius, wheel.hub_outer_radius, wheel.material)
    return (axle.seat_radius - wheel.bore_radius) / flexibility


def solid_press_fit_pressure(axle: Shaft, wheel: Hub, radius: float) -> float:
    """The same for a solid axle and a wheel of one material: p = E delta / (2 R) (1 - R^2 / R_o^2), delta radial."""
    delta = axle.seat_radius - wheel.bore_radius
    return axle.material.youngs_modulus * delta / (2.0 * radius) * (1.0 - (radius / wheel.hub_outer_radius) ** 2)


# Half-spaces: Johnson, Contact Mechanics (1985)


def contact_modulus(one: Material, other: Material) -> float:
    """E* [MPa]: 1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2."""
    return 1.0 / sum((1.0 - m.poisson_ratio**2) / m.youngs_modulus for m in (one, other))


@dataclass(frozen=True)
class Hertz:
    """A sphere of radius R pressed by a force P onto a flat; equations 4.22 to 4.24 of Johnson."""

    force: float
    sphere_radius: float
    modulus: float  # E*

    @property
    def contact_radius(self) -> float:
        """a = (3 P R / 4 E*)^(1/3) [mm]."""
        return math.cbrt(0.75 * self.force * self.sphere_radius / self.modulus)

    @property
    def peak_pressure(self) -> float:
        """p0 = 3 P / (2 pi a^2) [MPa]."""
        return 1.5 * self.force / (math.pi * self.contact_radius**2)

    @property
    def approach(self) -> float:
        """a^2 / R [mm], of points far from the contact."""
        return self.contact_radius**2 / self.sphere_radius

    def mean_pressures(self, edges: FloatArray) -> FloatArray:
        """Means of p = p0 sqrt(1 - r^2/a^2) over the rings between radii ``edges`` (n + 1,) [MPa]."""
        outside = np.maximum(1.0 - (edges / self.contact_radius) ** 2, 0.0) ** 1.5
        return _ring_means(self.force * (1.0 - outside), edges)


def hertz_force(approach: float, ball: Disc, flat: Disc) -> float:
    """P = (4/3) E* sqrt(R) approach^(3/2) [N], equation 4.23 of Johnson."""
    modulus = contact_modulus(ball.material, flat.material)
    return 4.0 / 3.0 * modulus * math.sqrt(ball.crown_radius * approach) * approach


def punch_force(radius: float, approach: float, modulus: float) -> float:
    """P = 2 E* a approach [N] under a rigid flat punch of radius a; section 3.4 (b) of Johnson."""
    return 2.0 * modulus * radius * approach


def punch_mean_pressures(force: float, radius: float, edges: FloatArray) -> FloatArray:
    """Means of p = P / (2 pi a sqrt(a^2 - r^2)) over the rings between radii ``edges`` (n + 1,) [MPa]."""
    return _ring_means(force * (1.0 - np.sqrt(np.maximum(1.0 - (edges / radius) ** 2, 0.0))), edges)


def _ring_means(carried: FloatArray, edges: FloatArray) -> FloatArray:
    """Mean pressures of rings from the force ``carried`` inside each radius."""
    return np.asarray(np.diff(carried) / (math.pi * np.diff(edges**2)))
