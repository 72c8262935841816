"""What is odd about a mesh that is sound: a point, an element or a set that a damaged file would show so.

Such a mesh can be meant, and is computed; what is odd becomes a doubt about the run. The boundary is walked with the
body on its left; a turn is the angle [rad] by which it changes its direction at a point, > 0 to the left.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray, planar_cross
from .triangles import CORNERS, IntArray, MeshData, doubled_area, place, tabulate_edges

LEAST_TURN = np.radians(0.3)
"""Below that a point lies on its line: a file of six digits turns it by less."""

SHARE = 0.15
"""The line is smooth without a point where it then turns by less than this share of its turn at the point.

On an arc that is 1.5, for a point misplaced on a straight line 0.
"""

INCLINED = np.radians(25.0)
"""Turns above that are corners; a facet inclined by less, alone before a corner, makes no chamfer."""

TIP = np.radians(165.0)
"""Where the boundary turns by more it runs to a point and back."""

BENT = 0.5
"""The same on both sides of a point, where the line is an arc."""


@dataclass(frozen=True)
class Outline:
    """The boundary as a walk: the points on it, and for each the numbers in ``points`` of the next and the last."""

    points: FloatArray
    on: IntArray
    ahead: IntArray
    back: IntArray

    def turn(self, a: IntArray, b: IntArray, c: IntArray, d: IntArray) -> FloatArray:
        """By how much the direction from c to d differs from that from a to b [rad]."""
        first, second = self.points[b] - self.points[a], self.points[d] - self.points[c]
        return np.asarray(np.arctan2(planar_cross(first, second), (first * second).sum(axis=1)))

    def turn_at(self, at: IntArray) -> FloatArray:
        """The turn at points of the boundary."""
        return self.turn(self.back[at], at, at, self.ahead[at])


def outline(points: FloatArray, triangles: IntArray) -> Outline:
    """The boundary of triangles, each of whose points has one edge that comes and one that goes."""
    turned = np.where((doubled_area(points, triangles) < 0.0)[:, None], triangles[:, ::-1], triangles)
    every = np.concatenate([turned[:, pair] for pair in CORNERS])
    table = tabulate_edges(triangles)
    edges = every[table.owner[table.find(every), 1] < 0]
    ahead, back = np.full(len(points), -1), np.full(len(points), -1)
    ahead[edges[:, 0]], back[edges[:, 1]] = edges[:, 1], edges[:, 0]
    return Outline(points, np.unique(edges), ahead, back)


def oddities(mesh: MeshData) -> tuple[str, ...]:
    """A sentence for each thing that is odd about a mesh."""
    line = outline(mesh.points, mesh.triangles)
    return tuple([*_holes(line), *_stray_points(line), *_notches(line), *_corners(line), *_ends(line, mesh)])


def unused(points: FloatArray, triangles: IntArray, known: IntArray) -> Iterator[str]:
    """A point of the file that no element has, as close to the body as another element of it would reach."""
    bare = np.setdiff1d(np.flatnonzero(np.isfinite(points).all(axis=1)), known)
    if not len(bare):
        return
    from scipy.spatial import cKDTree

    used = np.unique(triangles)
    longest = np.zeros(len(points))
    for a, b in CORNERS:
        length = np.linalg.norm(points[triangles[:, a]] - points[triangles[:, b]], axis=1)
        np.maximum.at(longest, triangles[:, a], length)
        np.maximum.at(longest, triangles[:, b], length)
    distance, nearest = cKDTree(points[used]).query(points[bare])
    beside = bare[(distance > 0.0) & (distance < 1.1 * longest[used[nearest]])]
    if len(beside):
        yield f"the point at {place(points[beside[0]])}, beside the body, belongs to no element; is one missing?"


def _holes(line: Outline) -> Iterator[str]:
    """A hole of the size of one element."""
    for edges in (3, 4):
        walked = line.on
        for _ in range(edges):
            walked = line.ahead[walked]
        closed = line.on[walked == line.on]
        if len(closed):
            yield f"there is a hole of {edges} edges at {place(line.points[closed[0]])}; is an element missing?"


def _stray_points(line: Outline) -> Iterator[str]:
    """A point that stands out of a line which is smooth without it: the line turns away and, next to it, back."""
    c = line.on
    b, d = line.back[c], line.ahead[c]
    at = line.turn_at(c)
    returns = np.stack([line.turn_at(b), line.turn_at(d)]) * at < 0.0
    without = np.abs([line.turn(line.back[b], b, b, d), line.turn(b, d, d, line.ahead[d])])
    without /= np.maximum(np.abs(at), 1e-12)
    alone = (returns & (without < SHARE)).any(axis=0) | (without < BENT).all(axis=0) & returns.all(axis=0)
    stray = c[(np.abs(at) > LEAST_TURN) & alone | (np.abs(at) > TIP)]
    if len(stray):
        yield f"a point stands alone out of the boundary's line, at {place(line.points[stray[0]])}; is it misplaced?"


def _notches(line: Outline) -> Iterator[str]:
    """A step out of a straight line and back, as wide as one element."""
    b = line.on
    c1 = line.ahead[b]
    c2 = line.ahead[c1]
    d = line.ahead[c2]
    out = np.abs(line.turn(b, d, b, c1))
    straight = [np.abs(line.turn(line.back[b], b, b, d)), np.abs(line.turn(b, d, d, line.ahead[d]))]
    found = b[(out > 0.3) & (np.maximum(*straight) < LEAST_TURN) & (line.ahead[d] != b)]
    if len(found):
        yield f"one element is missing or stands out at {place(line.points[line.ahead[found[0]]])} of a straight line"


def _corners(line: Outline) -> Iterator[str]:
    """A straight line whose last facet before a corner is inclined."""
    z = line.on
    corner = np.abs(line.turn_at(z)) > INCLINED
    for step in (line.ahead, line.back):
        y = step[z]
        x = step[y]
        bent = np.abs(line.turn_at(y))
        found = z[corner & (bent > LEAST_TURN) & (bent < INCLINED) & (np.abs(line.turn_at(x)) < LEAST_TURN)]
        if len(found):
            yield f"the last facet before the corner at {place(line.points[found[0]])} is inclined; is that misplaced?"


def _ends(line: Outline, mesh: MeshData) -> Iterator[str]:
    """A named boundary that ends where the body's outline goes on straight, or that is in pieces."""
    for name in set(mesh.edges) - {"seat", "axis"}:
        ends = np.flatnonzero(np.bincount(mesh.edges[name].ravel(), minlength=len(mesh.points)) == 1)
        ends = ends[line.ahead[ends] >= 0]
        straight = ends[np.abs(line.turn_at(ends)) < LEAST_TURN]
        if len(straight):
            at = place(mesh.points[straight[0]])
            yield f"'{name}' ends at {at}, where the boundary goes on straight; is its group cut off?"
