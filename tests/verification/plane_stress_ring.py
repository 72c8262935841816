"""A ring in plane stress or plane strain that yields: one dimension, its own return mapping, nothing of the solver's.

Displacement u(r) on N linear elements with one point each; J2 with linear isotropic hardening in plane stress by the
projected return mapping of Simo and Hughes, Computational Inelasticity, 3.4.1:

    ((s1 + s2) / (1 + E dg / (3 (1 - nu))))^2 / 4 + 3 ((s1 - s2) / (1 + 2 G dg))^2 / 4 = R^2,   d eps_p = dg P s

In plane strain by radial return, 3.3.1, with the plastic strain along the axis as a third component.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_banded
from scipy.optimize import brentq

FloatArray = npt.NDArray[np.float64]

P = np.array([[2.0, -1.0], [-1.0, 2.0]]) / 3.0


@dataclass
class Ring:
    """A ring from its bore to its outer radius [mm], under a pressure on the bore [MPa]."""

    bore: float
    outer: float
    youngs_modulus: float
    poisson_ratio: float
    yield_stress: float
    hardening: float = 0.0
    elements: int = 800
    strain: FloatArray = field(init=False)
    accumulated: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.nodes = np.linspace(self.bore, self.outer, self.elements + 1)
        self.middle = 0.5 * (self.nodes[1:] + self.nodes[:-1])
        self.size = np.diff(self.nodes)
        E, nu = self.youngs_modulus, self.poisson_ratio
        self.moduli = E / (1.0 - nu**2) * np.array([[1.0, nu], [nu, 1.0]])
        self.strain, self.accumulated = np.zeros((self.elements, 2)), np.zeros(self.elements)
        self.displacement = np.zeros(self.elements + 1)

    def _returned(self, total: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Stress, plastic strain and accumulated strain at total strains (elements, 2)."""
        E, nu = self.youngs_modulus, self.poisson_ratio
        shear = E / (2.0 * (1.0 + nu))
        trial = (total - self.strain) @ self.moduli
        add, sub = trial.sum(axis=1), trial[:, 0] - trial[:, 1]

        def squared(dg: FloatArray) -> FloatArray:
            a, b = add / (1.0 + E * dg / (3.0 * (1.0 - nu))), sub / (1.0 + 2.0 * shear * dg)
            return np.asarray(0.25 * (a**2 + 3.0 * b**2))

        low, high = np.zeros(self.elements), np.full(self.elements, 1e-3)
        flows = squared(low) > (self.yield_stress + self.hardening * self.accumulated) ** 2
        for _ in range(70):
            dg = 0.5 * (low + high)
            size = np.sqrt(squared(dg))
            outside = size > self.yield_stress + self.hardening * (self.accumulated + 2.0 / 3.0 * dg * size)
            low, high = np.where(outside, dg, low), np.where(outside, high, dg)
        dg = np.where(flows, 0.5 * (low + high), 0.0)
        size = np.sqrt(squared(dg))
        left_add, left_sub = add / (1.0 + E * dg / (3.0 * (1.0 - nu))), sub / (1.0 + 2.0 * shear * dg)
        stress = 0.5 * np.stack([left_add + left_sub, left_add - left_sub], axis=1)
        return stress, self.strain + dg[:, None] * (stress @ P), self.accumulated + 2.0 / 3.0 * dg * size

    def _total(self, u: FloatArray) -> FloatArray:
        return np.stack([np.diff(u) / self.size, 0.5 * (u[1:] + u[:-1]) / self.middle], axis=1)

    def _force(self, u: FloatArray) -> FloatArray:
        """Nodal forces by thickness and radian [N/mm]."""
        stress = self._returned(self._total(u))[0] * (self.middle * self.size)[:, None]
        radial, hoop = stress[:, 0] / self.size, 0.5 * stress[:, 1] / self.middle
        out = np.zeros(self.elements + 1)
        out[1:] += radial + hoop
        out[:-1] += -radial + hoop
        return out

    def stretch(self, opening: float, *, keep: bool = True) -> float:
        """Move the bore outward [mm]; the pressure that takes [MPa]. Newton's method, its tangent by differences."""
        nu, r = self.poisson_ratio, self.nodes
        elastic = (1.0 - nu) * r + (1.0 + nu) * self.outer**2 / r  # Lame's, to start from
        u = self.displacement + (opening - self.displacement[0]) * elastic / elastic[0]
        for _ in range(60):
            force = self._force(u)
            if np.abs(force[1:]).max() < 1e-9 * self.yield_stress:
                break
            bands, step = np.zeros((3, self.elements + 1)), 1e-7
            for first in range(3):  # every third node at once: their forces do not meet
                moved = u.copy()
                moved[first::3] += step
                change, nodes = (self._force(moved) - force) / step, np.arange(first, self.elements + 1, 3)
                for beside in (-1, 0, 1):
                    there = nodes[(nodes + beside >= 0) & (nodes + beside <= self.elements)]
                    bands[1 + beside, there] = change[there + beside]
            u[1:] -= solve_banded((1, 1), bands[:, 1:], force[1:])
        if keep:
            self.displacement = u
            _, self.strain, self.accumulated = self._returned(self._total(u))
        return float(force[0] / self.bore)

    def stress(self) -> FloatArray:
        """Radial and hoop stress (elements, 2) [MPa] at the elements' middles."""
        return self._returned(self._total(self.displacement))[0]


class PlaneStrainRing(Ring):
    """The same ring held along its axis."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.strain = np.zeros((self.elements, 3))

    def _returned(self, total: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Stress (elements, 2), plastic strain (elements, 3) and accumulated strain at total strains (elements, 2)."""
        E, nu = self.youngs_modulus, self.poisson_ratio
        shear, bulk = E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))
        whole = np.pad(total, ((0, 0), (0, 1)))
        volume = whole.sum(axis=1, keepdims=True)
        trial = 2.0 * shear * (whole - volume / 3.0 - self.strain)
        size = np.sqrt(1.5 * (trial**2).sum(axis=1))
        over = size - self.yield_stress - self.hardening * self.accumulated
        grown = np.maximum(over, 0.0) / (3.0 * shear + self.hardening)
        flow = 1.5 * trial * (grown / np.maximum(size, 1e-12))[:, None]
        stress = trial - 2.0 * shear * flow + bulk * volume
        return stress[:, :2], self.strain + flow, self.accumulated + grown


def shrink_fit(ring: Ring, shaft_radius: float, compliance: float, overlap: float, steps: int = 8) -> float:
    """Pressure [MPa] on an elastic shaft of this radius, -u_a = compliance p, that overlaps the ring's bore [mm].

    The shaft carries p, the bore the same force over its own area, p a / b. The overlap grows in steps.
    """
    share = ring.bore / shaft_radius
    for part in np.linspace(0.0, overlap, steps + 1)[1:]:

        def left(opening: float, part: float = part) -> float:
            return opening + compliance * share * ring.stretch(opening, keep=False) - part

        ring.stretch(brentq(left, ring.displacement[0], part, xtol=1e-10))
    return share * ring.stretch(ring.displacement[0])
