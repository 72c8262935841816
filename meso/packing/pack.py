"""Fill the hull of a plate with polydisperse spheres that conform to its rough face.

A flat box is packed once: spheres thrown at random into it, relaxed as harmonic spheres (FIRE), and swollen in
small steps until they touch 6.1 others on average. The packing is then morphed onto a surface, z + h(x, y) z / H,
and relaxed again against the rough wall. So the seed of the packing and that of the surface are independent, and
the flat packing can be kept on disk.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from macrofit.base.arrays import FloatArray, IntArray

from ..errors import PackingError
from ..surfaces.surface import Surface
from . import kernels as kernels

SPREAD = 0.25
"""Radii are uniform in mean (1 -+ SPREAD) [-]: enough that no crystal grows along the walls."""
START_FRACTION = 0.62
"""Solid fraction at which the swelling starts [-]."""
COORDINATION = 6.1
"""Mean number of contacts per sphere at which it ends [-], as in Andre et al. 2012."""
SWELLING = 1.002
"""Factor on the radii per step [-]."""
TOLERANCE = 0.03
"""Rms residual force over the mean contact force at which a relaxation ends [-]."""
SPHERES_ACROSS = 2.0
"""A plate thinner than this many mean diameters is refused [-]."""


@dataclass(frozen=True)
class Packing:
    """Spheres in a plate 0 <= x <= size[0], 0 <= y <= size[1], 0 <= z <= thickness + h(x, y)."""

    centres: FloatArray
    """Shape (n, 3) [mm], in Morton order, so that neighbours in space are neighbours in memory."""
    radii: FloatArray
    """Shape (n,) [mm]."""
    surface: Surface
    """The rough face, outward from the nominal one at z = thickness."""
    thickness: float
    """H, from the flat back to the nominal rough face [mm]."""

    @property
    def size(self) -> tuple[float, float]:
        """Length along the slide and width [mm]."""
        return self.surface.size

    @cached_property
    def contacts(self) -> IntArray:
        """Pairs i < j of touching spheres, shape (n, 2), sorted by i: where the beams will be."""
        pairs: IntArray = kernels.neighbours(self.centres, self.radii, 0.0)
        return pairs

    @property
    def volume(self) -> float:
        """Volume of the hull [mm3]."""
        along, across = self.surface.weights
        return self.size[0] * self.size[1] * (self.thickness + float(along @ self.surface.heights @ across))

    @property
    def solid_fraction(self) -> float:
        """f = sum of the spheres' volumes over that of the hull [-]."""
        return float(4.0 / 3.0 * np.pi * np.sum(self.radii**3) / self.volume)

    @property
    def coordination(self) -> float:
        """Mean number of contacts per sphere [-]."""
        return 2.0 * len(self.contacts) / len(self.radii)

    @property
    def largest_overlap(self) -> float:
        """Largest overlap of two spheres, over their mean radius [-]."""
        i, j = self.contacts.T
        reach = self.radii[i] + self.radii[j]
        distance = np.linalg.norm(self.centres[j] - self.centres[i], axis=1)
        return float(np.max((reach - distance) / (0.5 * reach)))

    def envelope(self, shape: tuple[int, int]) -> FloatArray:
        """Height of the spheres' upper envelope over the nominal face at the nodes of a grid [mm], (shape).

        Where no sphere covers a node (rare: the packing is dense) the envelope is that of its lowest neighbourhood.
        """
        top: FloatArray = kernels.envelope(self.centres, self.radii, np.array(self.size), shape) - self.thickness
        return np.maximum(top, top[np.isfinite(top)].min())

    def envelope_error(self) -> tuple[float, float]:
        """Mean and standard deviation of envelope minus surface [mm], a mean diameter away from the plate's edges.

        Spheres touch the surface from below, so the mean is negative, about half a radius; at the edges the envelope
        drops between them.
        """
        x, y = self._inner
        error = self.inner_envelope.heights - self.surface.at(x[:, None], y[None, :])
        return float(error.mean()), float(error.std())

    @cached_property
    def inner_envelope(self) -> Surface:
        """The spheres' upper envelope, a mean diameter away from the plate's edges, six points to a diameter."""
        shape = tuple(len(coordinates) + 12 for coordinates in self._inner)
        x, y = self._inner
        return Surface(self.envelope((shape[0], shape[1]))[6:-6, 6:-6], (float(np.ptp(x)), float(np.ptp(y))))

    @property
    def _inner(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates of the inner points of a grid, a third of a mean radius apart [mm]."""
        step = self.radii.mean() / 3.0
        x, y = (np.linspace(0.0, length, int(length / step) + 2)[6:-6] for length in self.size)
        return x, y


def pack(rng: np.random.Generator, *, spheres: int, size: tuple[float, float], thickness: float) -> Packing:
    """A flat box filled with about `spheres` spheres: some may be lost that touch nothing.

    Raises:
        PackingError: no sphere; a box with an edge that is not positive, or thinner than two spheres.
    """
    if spheres < 1:
        raise PackingError(f"spheres = {spheres}: a plate needs some, try 1000 per mm2")
    box = np.array([*size, thickness], dtype=np.float64)
    if not (np.all(np.isfinite(box)) and np.all(box > 0.0)):
        raise PackingError(f"a plate of {size[0]:g} x {size[1]:g} x {thickness:g} mm cannot be: every edge must be > 0")
    radii = rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, spheres)
    radii *= np.cbrt(START_FRACTION * np.prod(box) / (4.0 / 3.0 * np.pi * np.sum(radii**3)))
    if box.min() < 2.0 * SPHERES_ACROSS * radii.mean():
        needed = START_FRACTION * np.prod(box) / (np.pi / 6.0 * (box.min() / SPHERES_ACROSS) ** 3)
        raise PackingError(
            f"{spheres} spheres of {2e3 * radii.mean():.0f} um are too large for an edge of {box.min():g} mm: "
            f"try at least {int(1.2 * needed) + 1} spheres in this plate of {size[0]:g} x {size[1]:g} mm"
        )
    centres = rng.uniform(0.0, 1.0, (spheres, 3)) * box
    return _settled(centres, radii, Surface.flat(size), thickness, iterations=2000)


def morph(packing: Packing, surface: Surface) -> Packing:
    """The packing of a flat box carried onto a surface of the same size: z <- z + h(x, y) z / H, then relaxed.

    Raises:
        PackingError: another size; the surface is as deep as the plate is thick.
    """
    if not np.allclose(surface.size, packing.size, rtol=1e-12, atol=0.0):
        raise PackingError(f"a surface of {surface.size} mm does not fit a plate of {packing.size} mm")
    amplitude, depth = float(np.abs(surface.heights).max()), packing.thickness
    if amplitude >= 0.5 * depth:
        raise PackingError(
            f"the surface reaches {1e3 * amplitude:.0f} um from its plane, in a plate {1e3 * depth:.0f} um thick: "
            f"take a thickness above {2.0 * amplitude:.3g} mm or a smaller max_height"
        )
    if amplitude == 0.0:
        return packing
    centres = packing.centres.copy()
    centres[:, 2] += surface.at(centres[:, 0], centres[:, 1]) * centres[:, 2] / depth
    along, across = surface.weights
    radii = packing.radii * np.cbrt(1.0 + float(along @ surface.heights @ across) / depth)
    return _settled(centres, radii, surface, depth, iterations=350)


def _settled(centres: FloatArray, radii: FloatArray, surface: Surface, thickness: float, iterations: int) -> Packing:
    """Relax, swell until the coordination is reached, keep what hangs together, sort."""
    size = np.array(surface.size)
    kernels.quench(centres, radii, size, thickness, surface.heights, iterations, TOLERANCE)
    while True:
        contacts = kernels.neighbours(centres, radii, 0.0)
        if 2 * len(contacts) >= COORDINATION * len(radii):
            break
        if np.sum(radii**3) * 4.0 / 3.0 * np.pi > 0.74 * size.prod() * thickness:
            raise PackingError(
                f"{len(radii)} spheres reach no coordination of {COORDINATION} in "
                f"{size[0]:g} x {size[1]:g} x {thickness:g} mm: too many touch a wall, take more spheres"
            )
        radii = radii * SWELLING
        kernels.quench(centres, radii, size, thickness, surface.heights, 400, TOLERANCE)
    keep = _main_component(contacts, len(radii))
    centres, radii = centres[keep], radii[keep]
    order = _morton_order(centres, radii.mean())
    return Packing(np.ascontiguousarray(centres[order]), radii[order], surface, thickness)


def _main_component(pairs: IntArray, count: int) -> IntArray:
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    return np.flatnonzero(label == np.bincount(label).argmax())


def _morton_order(centres: FloatArray, spacing: float) -> IntArray:
    """Order along a Z curve through cells of one mean diameter."""
    cells = ((centres - centres.min(axis=0)) / (2.0 * spacing)).astype(np.uint64)
    code = np.zeros(len(cells), dtype=np.uint64)
    for bit in range(16):
        for axis in range(3):
            code |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")
