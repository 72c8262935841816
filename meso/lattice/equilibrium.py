"""Static equilibrium of a lattice under loads and given displacements, without a factor: conjugate gradients.

A plate of spheres is a few layers thick, so that some hundred evaluations of the forces are enough: as much work as
that many time steps, a tenth of a factorisation.
"""

from __future__ import annotations

import numpy as np

from macrofit.base.arrays import FloatArray

from .. import kernels
from ..errors import SettingsError
from .lattice import Lattice

RESIDUAL = 1e-6
"""Residual over its start at which a lattice is in equilibrium [-]: its energy is then right to 1e-7."""
ITERATIONS = 20_000
"""Conjugate gradients at most; 70 to 400 are usual."""
DIGITS = 6
"""Kept in what is derived: what rounding does in another order of the spheres, or elsewhere, is cut off."""


def cut(value: float) -> float:
    """The number to as many digits as an equilibrium is worth."""
    return float(f"{value:.{DIGITS}g}")


def forces(lattice: Lattice, u: FloatArray) -> FloatArray:
    """Forces and moments of all beams, external ones included, -K u, shape (n, 6) [N, N mm]."""
    force = np.zeros_like(u)
    kernels.beam_forces(
        u, force, lattice.rows, lattice.cols, lattice.beams, lattice.anchored, lattice.anchors, lattice.twist
    )
    return force


def settled(lattice: Lattice, start: FloatArray, *, load: FloatArray | float = 0.0, free: FloatArray) -> FloatArray:
    """The displacements in equilibrium (n, 6) [mm, rad], from `start`, by the diagonal as preconditioner.

    Motions that the beams do not resist stay as they are.

    Args:
        lattice: the beams, and what holds the back.
        start: displacements where nothing is free, and a guess elsewhere, shape (n, 6).
        load: forces and moments on the spheres, shape (n, 6) [N, N mm].
        free: 1 for what is free, 0 for what is given, shape (n, 6).

    Raises:
        SettingsError: no equilibrium is found, the beams are too thin.
    """
    inverse = free / _diagonal(lattice)
    u, residual = start.copy(), free * (forces(lattice, start) + load)
    step = z = inverse * residual
    power = first = np.sum(residual * z)
    for _ in range(ITERATIONS):
        if power <= RESIDUAL**2 * first:
            return u
        product = -free * forces(lattice, step)
        length = power / np.sum(step * product)
        u += length * step
        residual -= length * product
        z = inverse * residual
        before, power = power, np.sum(residual * z)
        step = z + power / before * step
    raise SettingsError(
        "beams: the plate's own stiffness is not found, its beams are too thin: take a larger beams.radius_ratio, or "
        "plates.modulus = 'beams' and an engine.speed"
    )


def _diagonal(lattice: Lattice) -> FloatArray:
    """Diagonal of the stiffness, shape (n, 6)."""
    e2, bending = lattice.beams[:, :3] ** 2, lattice.beams[:, kernels.BENDING, None]
    per_length, axial = lattice.beams[:, kernels.PER_LENGTH, None], lattice.beams[:, kernels.AXIAL, None]
    force = 12.0 * bending * per_length**2 * (1.0 - e2) + axial * e2
    both = np.concatenate([force, bending * (4.0 * (1.0 - e2) + (1.0 + lattice.twist) * e2)], axis=1)
    first, last = lattice.first, lattice.cols
    diagonal: FloatArray = np.stack(
        [np.bincount(first, column, lattice.nodes) + np.bincount(last, column, lattice.nodes) for column in both.T],
        axis=1,
    )
    along, across, _, rotation, twist = lattice.anchors.T
    diagonal[lattice.anchored] += np.stack([across, across, along, rotation, rotation, twist], axis=1)
    return diagonal
