"""Axisymmetric linear elasticity: the only file that knows about the hoop strain and the 2 pi r measure.

Strains and stresses are ordered (rr, zz, tt, rz), with the engineering shear 2 eps_rz; forces are for the full
ring.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..scene.material import Material
from .discretisation import tabulate


def weak_form(u: Any, v: Any, x: Any, constants: Any) -> Any:
    """a(u, v) = int sigma(u) : eps(v) 2 pi r dr dz with the strain diag(u_r,r, u_z,z, u_r/r) and its shear."""
    import ufl

    lame_lambda, shear_modulus = constants

    def strain(w: Any) -> Any:
        return ufl.as_tensor(
            (
                (w[0].dx(0), 0, 0.5 * (w[0].dx(1) + w[1].dx(0))),
                (0, w[0] / x[0], 0),
                (0.5 * (w[0].dx(1) + w[1].dx(0)), 0, w[1].dx(1)),
            )
        )

    stress = lame_lambda * ufl.tr(strain(u)) * ufl.Identity(3) + 2.0 * shear_modulus * strain(u)
    return ufl.inner(stress, strain(v)) * 2.0 * math.pi * x[0] * ufl.dx(metadata={"quadrature_degree": 6})


def stiffness_moduli(material: Material) -> FloatArray:
    """D (4, 4) [MPa]: stress = D strain in the order (rr, zz, tt, rz)."""
    lam, mu = material.lame_lambda, material.shear_modulus
    moduli = np.full((4, 4), lam)
    moduli[3, :] = moduli[:, 3] = 0.0
    return np.asarray(moduli + np.diag([2.0 * mu, 2.0 * mu, 2.0 * mu, mu]))


def strain_operator(order: int, corners: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """B (p, 4, 2 b) with strain = B u at one reference point of each cell, and the points' (r, z) (p, 2).

    corners (p, 3, 2) [mm] of the cells; points (p, 2) on the reference triangle; the unknowns of a cell are
    (node 0 r, node 0 z, node 1 r, ...).
    """
    values, gradients = tabulate(order, points)
    jacobian = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    gradients = gradients @ np.linalg.inv(jacobian)
    place = corners[:, 0] + np.einsum("pij,pj->pi", jacobian, points)
    operator = np.zeros((len(corners), 4, 2 * values.shape[1]))
    operator[:, 0, 0::2] = gradients[:, :, 0]
    operator[:, 1, 1::2] = gradients[:, :, 1]
    operator[:, 2, 0::2] = values / place[:, [0]]
    operator[:, 3, 0::2] = gradients[:, :, 1]
    operator[:, 3, 1::2] = gradients[:, :, 0]
    return operator, place


def traction_operator(
    order: int, corners: FloatArray, points: FloatArray, normals: FloatArray, material: Material
) -> FloatArray:
    """(p, 2, 2 b): the traction sigma(u) n = (t_r, t_z) [MPa] at one reference point of each cell."""
    strain, _ = strain_operator(order, corners, points)
    stress = stiffness_moduli(material) @ strain
    n_r, n_z = normals[:, [0]], normals[:, [1]]
    return np.stack([n_r * stress[:, 0] + n_z * stress[:, 3], n_r * stress[:, 3] + n_z * stress[:, 1]], axis=1)


def von_mises(stress: FloatArray) -> FloatArray:
    """sqrt(((rr - zz)^2 + (zz - tt)^2 + (tt - rr)^2) / 2 + 3 rz^2) over the first axis of (4, ...)."""
    rr, zz, tt, rz = stress
    total = (rr - zz) ** 2  # in place from here on: new memory costs as much as the sums
    total += (zz - tt) ** 2
    total += (tt - rr) ** 2
    total *= 0.5
    total += 3.0 * rz**2
    return np.asarray(np.sqrt(total))
