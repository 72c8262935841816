"""Fourier elements: the stiffness of a body of revolution under loads that vary around its axis.

With the displacement of the harmonic n

    u_r = a cos n t,   u_t = b sin n t,   u_z = c cos n t,

the strains are, in the order (rr, zz, tt, rz, rt, tz), the first four times cos n t and the last two times sin n t,

    a_r,  c_z,  (a + n b) / r,  a_z + c_r,  b_r - b / r - n a / r,  b_z - n c / r

so that B_n = B_0 + n B_1 and K_n = K_0 + n K_1 + n^2 K_2: three matrices, assembled once, serve every harmonic. The
weight is 2 pi r for all n. Amplitudes are those of a two-sided series: u_r = sum over all n of a_n exp(i n t), and
likewise u_z, u_t = sum of -i b_n exp(i n t), with a_-n the conjugate of a_n; loads in the same way. The same real K_n
then serves every direction of a load. A point force F has the amplitude F in every harmonic, a load that turns with
cos t has half its size in n = 1.

Source: Zienkiewicz, Taylor, *The Finite Element Method*, chapter on semi-analytical processes; Wilson, AIAA J. 3 (1965)
2269-2274 (doi 10.2514/3.3356).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from ..base.arrays import FloatArray
from ..bodies.discretisation import Discretisation, tabulate
from ..scene.material import Material

ComplexArray: TypeAlias = npt.NDArray[np.complex128]

Products: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], list[FloatArray]]
"""Matrices of cells from B_0, B_1, D and the weights of the points, summed over these."""

CELLS = 2048
"""Cells whose stiffness is computed at once."""

TRIANGLE = (
    (0.249286745170910, 0.116786275726379),
    (0.063089014491502, 0.050844906370207),
)
"""Coordinate and weight of the two threefold orbits of the rule with 12 points, exact to degree 6 (Dunavant 1985)."""
SIXFOLD = (0.053145049844817, 0.310352451033784, 0.082851075618374)
"""Two coordinates and the weight of its sixfold orbit."""


@dataclass(frozen=True, kw_only=True)
class Stiffness:
    """K_0, K_1 and K_2 of a body; the unknown 3 node + component is a, b or c of the node."""

    parts: tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix]

    def at(self, n: int) -> sp.csr_matrix:
        """The stiffness K_n of a harmonic [N/mm]."""
        first, second, third = self.parts
        return (first + float(n) * second + float(n * n) * third).tocsr()


def moduli(material: Material) -> FloatArray:
    """D (6, 6) [MPa]: stress = D strain in the order (rr, zz, tt, rz, rt, tz)."""
    lam, mu = material.lame_lambda, material.shear_modulus
    out = np.zeros((6, 6))
    out[:3, :3] = lam
    return np.asarray(out + np.diag([2.0 * mu] * 3 + [mu] * 3))


def quadrature_points() -> tuple[FloatArray, FloatArray]:
    """Points (q, 2) and weights (q,) on the reference triangle, exact to degree 6."""
    points, weights = [], []
    for x, weight in TRIANGLE:
        points += [(x, x), (x, 1.0 - 2.0 * x), (1.0 - 2.0 * x, x)]
        weights += [weight] * 3
    x, y, weight = SIXFOLD
    z = 1.0 - x - y
    points += [(x, y), (y, x), (x, z), (z, x), (y, z), (z, y)]
    weights += [weight] * 6
    return np.array(points), 0.5 * np.array(weights) / sum(weights)


def strain_operators(order: int, corners: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """B_0 and B_1 (m, q, 6, 3 b) at reference points (q, 2) of cells with corners (m, 3, 2), and the radii (m, q)."""
    values, gradients = tabulate(order, points)
    jacobian = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    slopes = np.einsum("qbi,mij->mqbj", gradients, np.linalg.inv(jacobian))
    radius = corners[:, None, 0, 0] + np.einsum("mj,qj->mq", jacobian[:, 0], points)
    over_r = values / radius[:, :, None]
    first, second = np.zeros((2, len(corners), len(points), 6, 3 * values.shape[1]))
    first[:, :, 0, 0::3] = slopes[..., 0]
    first[:, :, 1, 2::3] = slopes[..., 1]
    first[:, :, 2, 0::3] = over_r
    first[:, :, 3, 0::3] = slopes[..., 1]
    first[:, :, 3, 2::3] = slopes[..., 0]
    first[:, :, 4, 1::3] = slopes[..., 0] - over_r
    first[:, :, 5, 1::3] = slopes[..., 1]
    second[:, :, 2, 1::3] = over_r
    second[:, :, 4, 0::3] = -over_r
    second[:, :, 5, 2::3] = -over_r
    return first, second, radius


def assemble_harmonics(space: Discretisation, material: Material) -> Stiffness:
    """The three matrices of a body, for all harmonics."""
    first, second, third = _assembled(space, material, _products)
    return Stiffness(parts=(first, second, third))


def assemble_harmonic(space: Discretisation, material: Material, n: int) -> sp.csr_matrix:
    """K_n alone, in half the time of all three matrices."""

    def product(first: FloatArray, second: FloatArray, D: FloatArray, scale: FloatArray) -> list[FloatArray]:
        B = first + float(n) * second
        flat = (len(B), -1, B.shape[-1])
        return [np.swapaxes((D @ (scale * B)).reshape(flat), 1, 2) @ B.reshape(flat)]

    return _assembled(space, material, product)[0]


def _assembled(space: Discretisation, material: Material, products: Products) -> list[sp.csr_matrix]:
    """The matrices whose blocks ``products`` gives, cell by cell."""
    points, weights = quadrature_points()
    corners = space.nodes[space.cells[:, :3]]
    unknowns = (3 * space.cells[:, :, None] + np.arange(3)).reshape(len(space.cells), -1)
    D, blocks = moduli(material), []
    for k in range(0, len(corners), CELLS):
        part = corners[k : k + CELLS]
        first, second, radius = strain_operators(space.order, part, points)
        sides = part[:, 1:] - part[:, :1]
        twice = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        scale = (2.0 * math.pi * twice[:, None] * weights * radius)[:, :, None, None]
        blocks.append(products(first, second, D, scale))
    shape = (3 * len(space.nodes),) * 2
    rows, columns = np.broadcast_arrays(unknowns[:, :, None], unknowns[:, None, :])
    place = (rows.ravel(), columns.ravel())
    parts = [np.concatenate(part).ravel() for part in zip(*blocks, strict=True)]
    return [sp.csr_matrix((part, place), shape=shape) for part in parts]


def _products(first: FloatArray, second: FloatArray, D: FloatArray, scale: FloatArray) -> list[FloatArray]:
    """The matrices of cells: B_0' D B_0, B_0' D B_1 and its transpose, B_1' D B_1, summed over the points."""
    m, q, six, b = first.shape
    flat = (m, q * six, b)
    left = [np.swapaxes((D @ (scale * B)).reshape(flat), 1, 2) for B in (first, second)]
    right = [B.reshape(flat) for B in (first, second)]
    mixed = left[0] @ right[1]
    return [left[0] @ right[0], mixed + np.swapaxes(mixed, 1, 2), left[1] @ right[1]]
