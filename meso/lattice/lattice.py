"""The lattice: spheres as mass points, a cylindrical Euler-Bernoulli beam where two touch, external faces behind.

An external face stands for the solid behind a plate of thickness H, up to a cube of edge L: each sphere along the
back is tied to a point L - H behind the plate that is held.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import bsr_matrix, csc_matrix

from macrofit.base.arrays import FloatArray, IntArray

from ..errors import SettingsError
from ..material import Beams, ExternalFace, ExternalModulus, Material
from ..packing.pack import Packing
from .blocks import Blocks, arranged

BACK = 1.25
"""A sphere belongs to the back of its plate where its centre is closer than this many radii [-]."""


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """Nodes and beams in the layout of `meso.kernels`; a plate, or two joined."""

    centres: FloatArray
    """Centres of the spheres, shape (n, 3) [mm]."""
    radii: FloatArray
    """Shape (n,) [mm]."""
    masses: FloatArray
    """Shape (n,) [t]; a sphere's moment of inertia is 2/5 m r^2."""
    rows: IntArray
    """Compressed rows of the beams, shape (n + 1,)."""
    cols: IntArray
    """The later end of each beam, shape (bonds,)."""
    beams: FloatArray
    """Axis (3), 1/length [1/mm], EA/l [N/mm], EI/l [N mm], shape (bonds, 6)."""
    anchored: IntArray
    """Nodes on the back, shape (m,)."""
    anchors: FloatArray
    """What holds each of them (see `meso.kernels`), shape (m, 5)."""
    twist: float
    """-nu/(1 + nu) of the beams [-]."""
    scaling: float = 1.0
    """Factor on the moduli of the beams that makes the plate as stiff as its material [-]; 1 where it is not known."""
    modulus: float | None = None
    """Young's modulus of the plate by itself, see `own_modulus` [MPa]; None where nobody has pulled it."""

    @property
    def nodes(self) -> int:
        """Number of spheres."""
        return len(self.radii)

    @property
    def first(self) -> IntArray:
        """The earlier end of each beam, shape (bonds,)."""
        return np.repeat(np.arange(self.nodes), np.diff(self.rows))

    @cached_property
    def inverse(self) -> FloatArray:
        """1/m and 1/I of each sphere, shape (n, 2)."""
        return np.stack([1.0 / self.masses, 2.5 / (self.masses * self.radii**2)], axis=1)

    @cached_property
    def blocks(self) -> Blocks:
        """The same in the order in which the explicit engine goes through it."""
        return arranged(self.first, self.cols, self.beams, self.inverse, self.anchored, self.anchors)

    def stiffness(self) -> csc_matrix:
        """K (6n, 6n) of all beams, external ones included, with node i at rows 6 i ... 6 i + 5."""
        i, j = self.first, self.cols
        near, far, cross = _blocks(self.beams, self.twist)
        nodes = np.arange(self.nodes)
        diagonal = np.zeros((self.nodes, 6, 6))
        np.add.at(diagonal, i, near)
        np.add.at(diagonal, j, far)
        diagonal[self.anchored] += _held(self.anchors)
        row = np.concatenate([nodes, i, j])
        col = np.concatenate([nodes, j, i])
        order = np.lexsort((col, row))
        data = np.concatenate([diagonal, cross, cross.transpose(0, 2, 1)])[order]
        indptr = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=self.nodes))])
        return bsr_matrix((data, col[order], indptr), shape=(6 * self.nodes, 6 * self.nodes)).tocsc()


def build(
    packing: Packing,
    material: Material,
    beams: Beams,
    *,
    cube: float | None = None,
    external_face: ExternalFace = "solid",
    external_modulus: ExternalModulus = "series",
) -> Lattice:
    """The lattice of a plate: section pi (r~ (r_i + r_j)/2)^2, mass rho_M / f times the volume of each sphere.

    With `cube` = L [mm] an external face is added behind the plate (thickness H, area A, N spheres of radius R along
    its back), of the modulus

        "series"  E_m = E_M A / (N pi R^2): N bars of length L - H as stiff as the solid they replace; the default
        "paper"   E_m = E_M (L - H)^2 / (N pi R^2), as printed in Lalleman et al.

    with N pi R^2 the sum over the spheres, and of the kind

        "solid"   each bar resists shear as the solid does, G_M A / (L - H) in all; the default
        "beams"   each bar is a beam of radius R that bends and does not rotate at its far end, as in Lalleman et al.;
                  in shear they are tens of times softer than the solid, so the plates sway and snap

    `tests/verification/test_external_faces.py` shows which of them gives the steel cube's stiffness.

    Raises:
        SettingsError: the cube is not higher than the plate.
    """
    i, j = packing.contacts.T
    counts = np.bincount(i, minlength=len(packing.radii))
    radius = beams.radius_ratio * 0.5 * (packing.radii[i] + packing.radii[j])
    axis = packing.centres[j] - packing.centres[i]
    volumes = 4.0 / 3.0 * np.pi * packing.radii**3
    back, anchors = np.empty(0, dtype=np.int64), np.empty((0, 5))
    if cube is not None:
        back, anchors = _external_face(packing, material, beams, cube, external_face, external_modulus)
    return Lattice(
        centres=packing.centres,
        radii=packing.radii,
        masses=material.density / packing.solid_fraction * volumes,
        rows=np.concatenate([[0], np.cumsum(counts)]),
        cols=np.ascontiguousarray(j),
        beams=_beams(axis, radius, beams.youngs_modulus),
        anchored=back,
        anchors=anchors,
        twist=beams.twist,
    )


def join(wheel: Lattice, axle: Lattice) -> Lattice:
    """Two lattices in one numbering, the wheel's nodes first; nothing connects them."""
    if wheel.twist != axle.twist:
        raise SettingsError("the beams of both plates must have the same poisson_ratio")
    return Lattice(
        centres=np.concatenate([wheel.centres, axle.centres]),
        radii=np.concatenate([wheel.radii, axle.radii]),
        masses=np.concatenate([wheel.masses, axle.masses]),
        rows=np.concatenate([wheel.rows, axle.rows[1:] + wheel.rows[-1]]),
        cols=np.concatenate([wheel.cols, axle.cols + wheel.nodes]),
        beams=np.concatenate([wheel.beams, axle.beams]),
        anchored=np.concatenate([wheel.anchored, axle.anchored + wheel.nodes]),
        anchors=np.concatenate([wheel.anchors, axle.anchors]),
        twist=wheel.twist,
    )


def turned_over(lattice: Lattice, height: float) -> Lattice:
    """The lattice mirrored in z and moved up: z <- height - z [mm]; the wheel's plate faces down."""
    return replace(
        lattice,
        centres=lattice.centres * np.array([1.0, 1.0, -1.0]) + np.array([0.0, 0.0, height]),
        beams=lattice.beams * np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0]),
        anchors=lattice.anchors * np.array([1.0, 1.0, -1.0, 1.0, 1.0]),
    )


def _external_face(
    packing: Packing, material: Material, beams: Beams, cube: float, kind: ExternalFace, modulus: ExternalModulus
) -> tuple[IntArray, FloatArray]:
    depth = cube - packing.thickness
    if depth <= 0.0:
        raise SettingsError(f"cube = {cube:g} mm must be larger than the plate's thickness, {packing.thickness:g} mm")
    back = np.flatnonzero(packing.centres[:, 2] < BACK * packing.radii)
    radius = packing.radii[back]
    section = np.pi * radius**2
    area = packing.size[0] * packing.size[1] if modulus == "series" else depth**2
    length = depth + packing.centres[back, 2]  # up to the centres: what lies below them is not part of the lattice
    axial = material.youngs_modulus * area / section.sum() * section / length
    anchors = np.zeros((len(back), 5))
    anchors[:, 0] = axial
    if kind == "solid":
        anchors[:, 1] = axial / (2.0 * (1.0 + material.poisson_ratio))
    else:
        bending = axial * radius**2 / 4.0  # EI/l = (EA/l) R^2/4
        anchors[:, 1] = 12.0 * bending / length**2
        anchors[:, 2] = -6.0 * bending / length  # the far end lies at -z
        anchors[:, 3] = 4.0 * bending
        anchors[:, 4] = bending * (1.0 + beams.twist)
    return back, anchors


def _held(anchors: FloatArray) -> FloatArray:
    """Stiffness blocks of what holds the back, shape (m, 6, 6)."""
    block = np.zeros((len(anchors), 6, 6))
    along, across, couple, rotation, twist = anchors.T
    block[:, 0, 0] = block[:, 1, 1] = across
    block[:, 2, 2] = along
    block[:, 3, 3] = block[:, 4, 4] = rotation
    block[:, 5, 5] = twist
    block[:, 0, 4] = block[:, 4, 0] = couple
    block[:, 1, 3] = block[:, 3, 1] = -couple
    return block


def _beams(axis: FloatArray, radius: FloatArray, modulus: float) -> FloatArray:
    length = np.linalg.norm(axis, axis=1)
    axial = modulus * np.pi * radius**2 / length
    bending = modulus * np.pi * radius**4 / (4.0 * length)
    return np.column_stack([axis / length[:, None], 1.0 / length, axial, bending])


def _blocks(beams: FloatArray, twist: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stiffness blocks (i, i), (j, j) and (i, j) of each beam, shapes (bonds, 6, 6).

    With P = e e^T, Q = 1 - P and the cross product X = [e]x (X Q = X): forces 12 b/l^2 Q + k P, couplings
    6 b/l X, moments b (4 Q + (1 + twist) P) on the diagonal and b (2 Q - (1 + twist) P) beside it; b = EI/l.
    """
    e, per_length, axial, b = beams[:, :3], beams[:, 3], beams[:, 4], beams[:, 5]
    along = e[:, :, None] * e[:, None, :]
    across = np.eye(3) - along
    cross = np.zeros((len(e), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -e[:, 2], e[:, 1], -e[:, 0]
    cross -= cross.transpose(0, 2, 1)
    force = (12.0 * b * per_length**2)[:, None, None] * across + axial[:, None, None] * along
    couple = (6.0 * b * per_length)[:, None, None] * cross
    torsion = (1.0 + twist) * along
    near = np.empty((len(e), 6, 6))
    near[:, :3, :3], near[:, 3:, 3:] = force, b[:, None, None] * (4.0 * across + torsion)
    near[:, :3, 3:], near[:, 3:, :3] = -couple, couple
    far = near.copy()
    far[:, :3, 3:], far[:, 3:, :3] = couple, -couple
    mixed = np.empty_like(near)
    mixed[:, :3, :3], mixed[:, 3:, 3:] = -force, b[:, None, None] * (2.0 * across - torsion)
    mixed[:, :3, 3:], mixed[:, 3:, :3] = -couple, -couple
    return near, far, mixed
