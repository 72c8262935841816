"""Which spheres of the two rough faces may meet while one plate slides over the other, and when.

The way of the wheel is known before it starts, so the neighbour list of the whole slide is made at once: every pair
whose gap may fall below a margin, with the slides at which it may begin and end. The margin covers what is not
known beforehand, the elastic displacements of the spheres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from . import kernels
from .lattice import Lattice
from .material import Material

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Encounters:
    """Pairs in the order in which they begin, in the layout of `meso.kernels`."""

    pair: IntArray
    """Wheel node, axle node in the numbering of the joined lattice, shape (p, 2)."""
    apart: FloatArray
    """Centre of the axle sphere minus that of the wheel sphere before any motion, shape (p, 3) [mm]."""
    law: FloatArray
    """Radii of the wheel and axle sphere [mm], k_n, k_t [N/mm], shape (p, 4)."""
    first: FloatArray
    """Slide at which each may begin, ascending, shape (p,) [mm]."""
    last: FloatArray
    """Slide at which each has ended, shape (p,) [mm]."""

    def at_rest(self) -> FloatArray:
        """The history of pairs that have not met yet, shape (p, 9)."""
        history = np.zeros((len(self.pair), 9))
        history[:, 0] = np.inf
        return history

    def remembering(self, old: Encounters, history: FloatArray) -> FloatArray:
        """The history of these pairs, where those known from `old` keep theirs, shape (p, 9)."""
        mine = self.at_rest()
        if len(old.pair) and len(self.pair):
            nodes = 1 + max(int(self.pair.max()), int(old.pair.max()))
            key, known = (pair @ np.array([nodes, 1]) for pair in (self.pair, old.pair))
            order = np.argsort(key)
            place = order[np.minimum(np.searchsorted(key[order], known), len(key) - 1)]
            same = key[place] == known
            mine[place[same]] = history[same]
        return mine


NOBODY = Encounters(np.empty((0, 2), np.int64), np.empty((0, 3)), np.empty((0, 4)), np.empty(0), np.empty(0))
"""No encounter at all."""


class Faces:
    """The two rough faces of a joined lattice, the wheel's nodes first."""

    def __init__(self, lattice: Lattice, wheel_nodes: int) -> None:
        split = slice(None, wheel_nodes), slice(wheel_nodes, None)
        self.wheel, self.axle = (np.ascontiguousarray(lattice.centres[part]) for part in split)
        self.wheel_radii, self.axle_radii = (lattice.radii[part] for part in split)
        self._order = np.argsort(self.axle[:, 1], kind="stable")

    def first_touch(self, slide: float = 0.0) -> float:
        """Height at which the wheel's plate first touches the axle's at this slide [mm]."""
        return float(kernels.first_touch(self.wheel, self.wheel_radii, self.axle, self.axle_radii, self._order, slide))

    def encounters(
        self,
        heights: tuple[float, float],
        travel: float,
        margin: float,
        material: Material,
        normal_stiffness: float,
        tangential_ratio: float,
    ) -> Encounters:
        """Every pair whose gap may fall below `margin` [mm] on the way from 0 to `travel`, within these heights [mm].

        k_n = normal_stiffness E_M (r_i + r_j)/2 and k_t = tangential_ratio k_n [N/mm].
        """
        low, high = heights
        pair, span = kernels.meetings(
            self.wheel, self.wheel_radii, self.axle, self.axle_radii, self._order, low, high, travel, margin
        )
        order = np.lexsort((pair[:, 1], pair[:, 0], span[:, 0]))
        (i, j), span = pair[order].T, span[order]
        law = np.empty((len(i), 4))
        law[:, 0], law[:, 1] = self.wheel_radii[i], self.axle_radii[j]
        law[:, 2] = normal_stiffness * material.youngs_modulus * 0.5 * (law[:, 0] + law[:, 1])
        law[:, 3] = tangential_ratio * law[:, 2]
        return Encounters(
            pair=np.stack([i, j + len(self.wheel)], axis=1),
            apart=self.axle[j] - self.wheel[i],
            law=law,
            first=np.ascontiguousarray(span[:, 0]),
            last=np.ascontiguousarray(span[:, 1]),
        )
