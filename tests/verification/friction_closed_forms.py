"""Closed forms of fits held by friction: the pressure of long rings, and the elastic bar in a rigid sleeve.

The bar of stiffness E A lies in a sleeve that resists with q = mu p pi d per unit length. A force F at its end makes
it slip over the length F / q; behind that it sticks and carries nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


def ring_pressure(youngs_modulus: float, radius: float, interference: float, outer_radius: float) -> float:
    """Lame's pressure [MPa] of a long ring on a solid shaft, same material, radial interference [mm].

    p = E delta / (2 R) (1 - R^2 / Ro^2)
    """
    return youngs_modulus * interference / (2.0 * radius) * (1.0 - (radius / outer_radius) ** 2)


def sleeve_pressure(youngs_modulus: float, radius: float, interference: float) -> float:
    """Pressure [MPa] of a rigid sleeve on a solid shaft without Poisson effect: p = E delta / R."""
    return youngs_modulus * interference / radius


@dataclass(frozen=True)
class FrictionBar:
    """An elastic bar in a rigid sleeve, pulled or pushed over a free length outside the sleeve."""

    youngs_modulus: float  # MPa
    radius: float  # mm
    pressure: float  # MPa
    friction: float
    free_length: float  # mm

    @property
    def stiffness(self) -> float:
        """E A [N]."""
        return self.youngs_modulus * math.pi * self.radius**2

    @property
    def resistance(self) -> float:
        """q = mu p pi d [N/mm]."""
        return self.friction * self.pressure * 2.0 * math.pi * self.radius

    def slip_length(self, force: float) -> float:
        """l = F / q [mm]."""
        return force / self.resistance

    def loaded(self, force: float) -> float:
        """Displacement [mm] under a first load: F L / (E A) + F^2 / (2 E A q)."""
        return force / self.stiffness * (self.free_length + 0.5 * force / self.resistance)

    def turned(self, change: float) -> float:
        """Displacement [mm] since the load turned, for its change D.

        D L / (E A) + D^2 / (4 E A q): friction changes by 2 q where slip reverses.
        """
        return change / self.stiffness * (self.free_length + 0.25 * change / self.resistance)

    def loop_area(self, change: float) -> float:
        """Work [N mm] lost in a cycle of unloading by D and reloading: D^3 / (12 E A q)."""
        return change**3 / (12.0 * self.stiffness * self.resistance)
