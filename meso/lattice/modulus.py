"""How stiff a plate of spheres is: pulled statically through its thickness, and its beams scaled to the material.

The beams are calibrated on cubes of 2000 spheres. In a plate a larger part of the spheres lies at a wall. What touches
a wall carries nothing there but takes room, so the rest touch each other more often and the plate is stiffer: by 15 %
with 1000 spheres, by 30 to 70 % with 150 to 300. Each plate is therefore pulled once, on its own surface, and its beams
are scaled: E_mu <- E_mu E_M / E of the plate.

The ends are free to narrow. Held instead, they stiffen the plate as much as they stiffen a solid of that shape (1.2
times, 1 x 1 x 0.4 mm), for any number of spheres, so one of the two is enough. The strain is that of the ends, for the
middle of a thin plate is a layer or two; in a block, half as thick as wide or more, it is the middle's and the mean
over the axes, as in `meso.calibrate`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from macrofit.base.arrays import BoolArray, FloatArray

from .. import kernels
from ..packing.pack import Packing
from .equilibrium import cut, forces, settled
from .lattice import BACK, Lattice

STRAIN = 1e-3
"""Nominal strain of a tensile test [-]; the lattice is linear, so it is only a scale."""
SECTION = 0.5
"""Part of the length, in the middle, where the strain of a block is measured [-]."""
BLOCK = 0.5
"""Thickness over the shorter edge from which a plate is a block [-]."""


def own_modulus(packing: Packing, lattice: Lattice) -> float:
    """Young's modulus of a plate or block by itself, without what holds its back [MPa].

    Args:
        packing: of the plate.
        lattice: its beams; it may be turned over.

    Raises:
        SettingsError: no equilibrium is found, the beams are too thin.
    """
    if packing.thickness < BLOCK * min(packing.size):
        stress, _ = _pulled(packing, lattice, 2)
        return stress / STRAIN
    found = []
    for axis in range(3):
        stress, u = _pulled(packing, lattice, axis)
        found.append(stress / middle_strain(packing, u, axis)[axis])
    return float(np.mean(found))


def scaled_to(modulus: float, packing: Packing, lattice: Lattice) -> Lattice:
    """The lattice with its beams, not its back, scaled so that its own modulus is this [MPa].

    Raises:
        SettingsError: as `own_modulus`.
    """
    before = own_modulus(packing, lattice)
    factor = cut(modulus / before)
    beams = lattice.beams.copy()
    beams[:, [kernels.AXIAL, kernels.BENDING]] *= factor
    return replace(lattice, beams=beams, scaling=factor * lattice.scaling, modulus=factor * before)


def middle_strain(packing: Packing, u: FloatArray, axis: int) -> FloatArray:
    """Normal strains along x, y, z, shape (3,), in the middle half along an axis: slopes of the fit u = a + B x.

    Args:
        packing: a flat box.
        u: displacements of its spheres, shape (n, 6), of which the first three columns are read [mm].
        axis: 0 to 2.
    """
    edges = np.array([*packing.size, packing.thickness])
    place = packing.centres - 0.5 * edges
    middle = np.abs(place[:, axis]) < 0.5 * SECTION * edges[axis]
    terms = np.column_stack([np.ones(middle.sum()), place[middle]])
    slopes = np.linalg.lstsq(terms, u[middle, :3], rcond=None)[0][1:]
    return np.diag(slopes).copy()


def _pulled(packing: Packing, lattice: Lattice, axis: int) -> tuple[float, FloatArray]:
    """Mean stress [MPa] and displacements (n, 6) [mm] where both ends move as a uniform strain would move them."""
    bare = replace(lattice, anchored=lattice.anchored[:0], anchors=lattice.anchors[:0])
    near, far = _ends(packing, axis)
    free = np.ones((lattice.nodes, 6))
    free[near | far, axis] = 0.0
    start = np.zeros((lattice.nodes, 6))
    start[:, axis] = STRAIN * packing.centres[:, axis]
    u = settled(bare, start, free=free)
    force = forces(bare, u)[far, axis].sum()
    area = np.prod([*packing.size, packing.thickness]) / (*packing.size, packing.thickness)[axis]
    return float(-force / area), u


def _ends(packing: Packing, axis: int) -> tuple[BoolArray, BoolArray]:
    """Spheres at the near and at the far end, at the rough face where the axis is z."""
    x, reach = packing.centres.T, BACK * packing.radii
    far = packing.size[axis] if axis < 2 else packing.thickness + packing.surface.at(x[0], x[1])
    return x[axis] < reach, far - x[axis] < reach
