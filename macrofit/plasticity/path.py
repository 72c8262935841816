"""The path of the strain within a step: straight, or carried along the axis with the edges that pass.

An edge of the other body passes a point within one or two millimetres of travel, and its stress rises and falls
meanwhile. A straight path from the strain before a step to that after it knows nothing of the peak between them. The
field of a moving edge hardly changes in the edge's own frame, so that at a share a of the step

    eps(P, a) = (1 - a) eps_before(P - a c) + a eps_after(P + (1 - a) c)

is nearly exact, with c the way of the other body in this body's frame. A point takes the path that describes its change
better: the straight one where |eps_after(P) - eps_before(P)| < |eps_after(P) - eps_before(P - c)|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..base.arrays import BoolArray, FloatArray, IntArray
from ..bodies.discretisation import Discretisation
from ..bodies.elasticity import strain_operator

CANDIDATES = 12
"""Cells whose centres are nearest to a point, among which the one that holds it is looked for."""

KEPT = 32
"""Shifts whose operators are kept."""

OUTSIDE = 0.2
"""How far, in barycentric coordinates, a point may lie beyond the nearest cell and be evaluated there."""

CHUNK = 96
"""Points that are located together: always the same ones, for the last bits of an operator depend on its neighbours."""


@dataclass(frozen=True, kw_only=True)
class Strains:
    """Strain operators at m of n points: B (n, 4, b) on the unknowns (n, b) of the cell that each lies in."""

    operators: FloatArray
    unknowns: IntArray
    points: IntArray
    """Numbers of the m points."""

    def of(self, displacement: FloatArray) -> FloatArray:
        """Strains (m, 4) of a displacement (dofs,) [mm]."""
        from .kernels import strains_at

        return np.asarray(strains_at(self.points, self.operators, self.unknowns, displacement))

    def load(self, stress: FloatArray, dofs: int) -> FloatArray:
        """Sum of B' s (dofs,) [N] of stresses s (m, 4) times the volume of each point [MPa mm3]."""
        from .kernels import loads_of

        return np.asarray(loads_of(self.points, self.operators, self.unknowns, stress, dofs))

    @property
    def reach(self) -> IntArray:
        """The unknowns of all m points, many of them more than once."""
        return self.unknowns[self.points].ravel()

    def at(self, points: IntArray) -> Strains:
        """Those of other points."""
        return Strains(operators=self.operators, unknowns=self.unknowns, points=points)


class _Shifted:
    """Operators at the points moved by one shift, made when they are first asked for."""

    def __init__(self, count: int, width: int) -> None:
        self.known = np.zeros(-(-count // CHUNK), dtype=bool)
        self.operators, self.unknowns = np.zeros((count, 4, width)), np.zeros((count, width), dtype=np.int64)
        self.inside = np.zeros(count, dtype=bool)


class StrainAlong:
    """Strain operators at the Gauss points of a body, shifted along the axis."""

    def __init__(self, space: Discretisation, places: FloatArray) -> None:
        self.space, self.places = space, places
        self._corners = space.nodes[space.cells[:, :3]]
        sides = [self._corners[:, k] - self._corners[:, 0] for k in (1, 2)]
        self._inverse = np.linalg.inv(np.stack(sides, axis=2))
        self._tree = cKDTree(self._corners.mean(axis=1))
        self._known: dict[float, _Shifted] = {}

    def at(self, shift: float, points: IntArray) -> tuple[Strains, BoolArray]:
        """The operators at some of the points moved along the axis [mm], and which of these lie in the body."""
        if shift not in self._known:
            if len(self._known) == KEPT:
                self._known.clear()
            self._known[shift] = _Shifted(len(self.places), 2 * self.space.cells.shape[1])
        shifted = self._known[shift]
        chunks = np.unique(points // CHUNK)
        for chunk in chunks[~shifted.known[chunks]]:
            self._locate(shifted, shift, slice(chunk * CHUNK, (chunk + 1) * CHUNK))
            shifted.known[chunk] = True
        found = Strains(operators=shifted.operators, unknowns=shifted.unknowns, points=points)
        return found, shifted.inside[points]

    def _locate(self, shifted: _Shifted, shift: float, part: slice) -> None:
        cells, points, shifted.inside[part] = self._located(self.places[part] + np.array([0.0, shift]))
        shifted.operators[part], _ = strain_operator(self.space.order, self._corners[cells], points)
        shifted.unknowns[part] = self.space.unknowns(cells)

    def _located(self, places: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
        """For each place its cell, the point on the reference triangle, and whether it is in the cell or near it."""
        _, near = self._tree.query(places, k=min(CANDIDATES, len(self._corners)))
        reference = np.einsum("pcij,pcj->pci", self._inverse[near], places[:, None] - self._corners[near, 0])
        least = np.minimum(reference.min(axis=2), 1.0 - reference.sum(axis=2))
        best = least.argmax(axis=1)
        row = np.arange(len(places))
        return near[row, best], reference[row, best], least[row, best] > -OUTSIDE


class Path:
    """The strains of some points along one step, from the displacement before it.

    Args:
        along: the operators.
        points: numbers of the points (m,).
        before: displacement of the body before the step (dofs,) [mm].
        carried: the way c of the other body in this body's frame [mm].
        parts: sub-steps of the step.
    """

    def __init__(self, along: StrainAlong, points: IntArray, before: FloatArray, carried: float, parts: int) -> None:
        self.shares = (np.arange(1, parts) / parts)[:, None, None]
        self._inside = np.ones(len(points), dtype=bool)

        def shifted(shift: float) -> Strains:
            """The operators at the points so far along."""
            operators, there = along.at(round(shift, 9), points)
            self._inside &= there
            return operators

        self._here, self._whole = shifted(0.0).of(before), shifted(-carried).of(before)
        shares = self.shares.ravel()
        self._before = np.stack([shifted(-share * carried).of(before) for share in shares])
        self.after = [shifted((1.0 - share) * carried) for share in shares]
        self._stays = ~self._inside

    def choose(self, after: FloatArray) -> None:
        """Decide between the paths for the strains (m, 4) after the step."""
        straight = np.abs(after - self._here).sum(axis=1)
        self._stays |= straight <= np.abs(after - self._whole).sum(axis=1)

    def strains(self, displacement: FloatArray, after: FloatArray) -> FloatArray:
        """The strains (parts - 1, m, 4) at the end of each sub-step but the last."""
        straight = (1.0 - self.shares) * self._here + self.shares * after
        there = np.stack([each.of(displacement) for each in self.after])
        carried = (1.0 - self.shares) * self._before + self.shares * there
        return np.where(self._stays[:, None], straight, carried)
