"""Which spheres of the two rough faces may meet while one plate slides over the other, and when.

The way of the wheel is known before it starts, so the neighbour list of the whole slide is made at once: every pair
whose gap may fall below a margin, with the slides at which it may begin and end. The margin covers what is not
known beforehand, the elastic displacements of the spheres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from macrofit.base.arrays import FloatArray, IntArray

from .. import kernels
from ..material import Material
from .kernels import find_candidates, first_touch
from .lattice import Lattice

FACE = 2.0
"""Spheres of a face over n^(2/3) of its plate, about."""
ROUNDING = 1e-9
"""Difference of heights that is taken for rounding [mm]."""

STILL = np.zeros(3)
"""Faces that have not moved beside the way of the wheel [mm]."""


@dataclass(frozen=True, kw_only=True)
class ContactCandidates:
    """Pairs in the order in which they begin, in the layout of `meso.kernels`."""

    pair: IntArray
    """Wheel node, axle node in the numbering of the joined lattice, shape (p, 2)."""
    offset: FloatArray
    """Centre of the axle sphere minus that of the wheel sphere before any motion, shape (p, 3) [mm]."""
    parameters: FloatArray
    """Radii of the wheel and axle sphere [mm], k_n, k_t [N/mm], shape (p, 4)."""
    first: FloatArray
    """Slide at which each may begin, ascending, shape (p,) [mm]."""
    last: FloatArray
    """Slide at which each has ended, shape (p,) [mm]."""

    @property
    def reach(self) -> FloatArray:
        """Distance of the centres at which each pair touches, shape (p,) [mm]."""
        return self.parameters[:, kernels.WHEEL_RADIUS] + self.parameters[:, kernels.AXLE_RADIUS]

    @property
    def normal_stiffness(self) -> FloatArray:
        """k_n of each pair, shape (p,) [N/mm]."""
        return self.parameters[:, kernels.NORMAL_STIFFNESS]

    def at_rest(self) -> FloatArray:
        """The history of pairs that have not met yet, shape (p, 9)."""
        history = np.zeros((len(self.pair), 9))
        history[:, 0] = np.inf
        return history

    def remembering(self, old: ContactCandidates, history: FloatArray) -> FloatArray:
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


NOBODY = ContactCandidates(
    pair=np.empty((0, 2), np.int64),
    offset=np.empty((0, 3)),
    parameters=np.empty((0, 4)),
    first=np.empty(0),
    last=np.empty(0),
)
"""No candidate at all."""


class Faces:
    """The two rough faces of a joined lattice, the wheel's nodes first."""

    def __init__(self, lattice: Lattice, wheel_nodes: int) -> None:
        split = slice(None, wheel_nodes), slice(wheel_nodes, None)
        self.wheel, self.axle = (np.ascontiguousarray(lattice.centres[part]) for part in split)
        self.wheel_radii, self.axle_radii = (lattice.radii[part] for part in split)
        self._bottoms, self._tops = self.wheel[:, 2] - self.wheel_radii, self.axle[:, 2] + self.axle_radii

    def first_touch(self, slide: float = 0.0) -> float:
        """Height at which the wheel's plate first touches the axle's at this slide [mm].

        That of the outermost spheres, as many as a face has, tells which others may touch any higher.
        """
        lowest, highest = (np.argsort(z)[: round(FACE * len(z) ** (2 / 3))] for z in (self._bottoms, -self._tops))
        height = self._touch(lowest, highest, slide)
        return self._touch(*self._facing(height, 0.0), slide)

    def _touch(self, wheel: IntArray, axle: IntArray, slide: float) -> float:
        """Height of the first touch of these spheres [mm]; -inf where they miss each other."""
        return float(first_touch(*self._spheres(wheel, axle), slide))

    def _facing(self, low: float, margin: float) -> tuple[IntArray, IntArray]:
        """Numbers of the wheel's and axle's spheres that may come within `margin` [mm] at heights from `low` [mm].

        The interior of the plates is left out, so that what follows grows with the faces, not with the plates.
        """
        reach = margin + ROUNDING - low
        wheel = np.flatnonzero(self._bottoms <= self._tops.max() + reach)
        return wheel, np.flatnonzero(self._tops >= self._bottoms.min() - reach)

    def _spheres(
        self, wheel: IntArray, axle: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
        """Centres and radii of these spheres, and the order of the axle's by y."""
        order = np.argsort(self.axle[axle, 1], kind="stable")
        return self.wheel[wheel], self.wheel_radii[wheel], self.axle[axle], self.axle_radii[axle], order

    def candidates(
        self,
        heights: tuple[float, float],
        travel: float,
        margin: float,
        material: Material,
        normal_stiffness: float,
        tangential_ratio: float,
        sway: FloatArray = STILL,
    ) -> ContactCandidates:
        """Every pair whose gap may fall below `margin` [mm] on the way from 0 to `travel`, within these heights [mm].

        k_n = normal_stiffness E_M (r_i + r_j)/2 and k_t = tangential_ratio k_n [N/mm]. `sway` (3,) [mm] is how far the
        wheel's face has moved against the axle's beside that way: the margin is for what differs from it.
        """
        low, high = heights[0] + sway[2], heights[1] + sway[2]
        wheel, axle = self._facing(low, margin)
        if not len(wheel):
            return NOBODY
        centres, *others = self._spheres(wheel, axle)
        centres = centres + np.array([sway[0], sway[1], 0.0])
        pair, span = find_candidates(centres, *others, low, high, travel, margin)
        pair = np.stack([wheel[pair[:, 0]], axle[pair[:, 1]]], axis=1)
        order = np.lexsort((pair[:, 1], pair[:, 0], span[:, 0]))
        (i, j), span = pair[order].T, span[order]
        wheel_radius, axle_radius = self.wheel_radii[i], self.axle_radii[j]
        stiffness = normal_stiffness * material.youngs_modulus * 0.5 * (wheel_radius + axle_radius)
        parameters = np.column_stack([wheel_radius, axle_radius, stiffness, tangential_ratio * stiffness])
        return ContactCandidates(
            pair=np.stack([i, j + len(self.wheel)], axis=1),
            offset=self.axle[j] - self.wheel[i],
            parameters=parameters,
            first=np.ascontiguousarray(span[:, 0]),
            last=np.ascontiguousarray(span[:, 1]),
        )
