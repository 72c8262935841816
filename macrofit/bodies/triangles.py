"""Triangles with named boundary edges: the record of a mesh, and whether it is one sound body."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..base.arrays import FloatArray, planar_cross
from ..errors import MeshError

IntArray = npt.NDArray[np.int64]

CORNERS = ((0, 1), (1, 2), (2, 0))
"""Corners at the ends of the edges of a triangle."""


@dataclass(frozen=True, kw_only=True)
class MeshData:
    """Straight-sided triangles. points (n, 2) [mm] as (r, z); triangles (m, 3); edges: name -> (k, 2) of points.

    middles: name -> (k, 2) points [mm] that a curved edge passes between its ends, for files of second order.
    oddities: what may mean that the file is damaged, a sentence each.
    """

    points: FloatArray
    triangles: IntArray
    edges: dict[str, IntArray]
    middles: dict[str, FloatArray] = field(default_factory=dict)
    oddities: tuple[str, ...] = ()


def compact(points: FloatArray, triangles: IntArray, edges: dict[str, IntArray]) -> MeshData:
    """The mesh without the points that no triangle uses."""
    used, renumbered = np.unique(triangles, return_inverse=True)
    index = np.full(len(points), -1, dtype=np.int64)
    index[used] = np.arange(len(used))
    return MeshData(
        points=np.ascontiguousarray(points[used]),
        triangles=renumbered.reshape(-1, 3).astype(np.int64),
        edges={name: index[pairs] for name, pairs in edges.items()},
    )


def doubled_area(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Twice the signed areas of the triangles [mm2], > 0 counterclockwise."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.asarray((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))


@dataclass(frozen=True, kw_only=True)
class EdgeTable:
    """Every edge of a triangulation once: its ends, its triangles, and the corner opposite to it in each.

    ends (e, 2) ascending; owner (e, 2): triangles, the second -1 on the boundary; opposite (e, 2): points.
    """

    ends: IntArray
    owner: IntArray
    opposite: IntArray
    crowded: IntArray  # numbers of the edges that more than two triangles share

    @property
    def boundary(self) -> IntArray:
        """Ends (b, 2) of the edges that one triangle has."""
        return np.asarray(self.ends[self.owner[:, 1] < 0])

    def find(self, pairs: IntArray) -> IntArray:
        """Number of the edge between each pair of points (k, 2); -1 where there is none."""
        base = np.int64(max(int(self.ends.max(initial=0)), int(pairs.max(initial=0))) + 1)
        keys, wanted = self.ends @ np.array([base, 1]), np.sort(pairs, axis=1) @ np.array([base, 1])
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        return np.where(keys[place] == wanted, place, -1)


def tabulate_edges(triangles: IntArray) -> EdgeTable:
    """The edges of triangles (m, 3), in ascending order of their ends."""
    every = np.sort(np.concatenate([triangles[:, pair] for pair in CORNERS]), axis=1)
    opposite = np.concatenate([triangles[:, 3 - a - b] for a, b in CORNERS])
    cells = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort((every[:, 1], every[:, 0]))
    every, opposite, cells = every[order], opposite[order], cells[order]
    first = np.flatnonzero(np.append(True, (np.diff(every, axis=0) != 0).any(axis=1)))
    count = np.diff(np.append(first, len(every)))
    second = np.where(count > 1, np.minimum(first + 1, len(every) - 1), first)
    alone = count == 1
    return EdgeTable(
        ends=every[first],
        owner=np.stack([cells[first], np.where(alone, -1, cells[second])], axis=1),
        opposite=np.stack([opposite[first], np.where(alone, -1, opposite[second])], axis=1),
        crowded=np.flatnonzero(count > 2),
    )


def place(point: FloatArray | tuple[float, float]) -> str:
    """A point (r, z) in words [mm]."""
    return f"(r, z) = ({point[0]:.6g}, {point[1]:.6g})"


def ordered_line(
    points: FloatArray, pairs: IntArray, where: str, name: str, *, radial: bool
) -> tuple[npt.NDArray[np.bool_], IntArray]:
    """Which edges (k, 2) of a contact line to turn, and their order, for its coordinate to ascend.

    Raises:
        MeshError: it is no graph over its coordinate, or not one line.
    """
    axis = 1 if radial else 0
    along = points[pairs[:, 1], axis] - points[pairs[:, 0], axis]
    steep = np.flatnonzero(np.abs(along) < 1e-12)
    if len(steep):
        raise MeshError(
            f"{where}: a facet of '{name}' is perpendicular to the contact line at "
            f"{place(points[pairs[steep[0]]].mean(axis=0))}; '{name}' must be a graph over {'z' if radial else 'r'}"
        )
    turn = along < 0.0
    first = np.where(turn, pairs[:, 1], pairs[:, 0])
    order = np.argsort(points[first, axis], kind="stable")
    first, last = first[order], np.where(turn, pairs[:, 0], pairs[:, 1])[order]
    apart = np.flatnonzero(first[1:] != last[:-1])
    if len(apart):
        raise MeshError(
            f"{where}: '{name}' is not one connected line without branches: it breaks or folds at "
            f"{place(points[last[apart[0]]])}"
        )
    return turn, order


def check_sound(where: str, points: FloatArray, triangles: IntArray, table: EdgeTable) -> None:
    """Whether the triangles tile one body: none flat or upon another, all joined by edges.

    Raises:
        MeshError: what is wrong, with its place; ``where`` begins the message.
    """
    area = np.abs(doubled_area(points, triangles))
    longest = np.max(
        [((points[triangles[:, a]] - points[triangles[:, b]]) ** 2).sum(axis=1) for a, b in CORNERS], axis=0
    )
    flat = np.flatnonzero(area <= np.maximum(1e-9 * longest, 1e-14 * area.max()))
    if len(flat):
        middle = points[triangles[flat[0]]].mean(axis=0)
        raise MeshError(f"{where} has flat triangles in the (r, z) plane (x = r, y = z), one at {place(middle)}")
    if len(table.crowded):
        middle = points[table.ends[table.crowded[0]]].mean(axis=0)
        raise MeshError(f"{where}: more than two elements share the edge at {place(middle)}; elements lie upon others")
    inner = table.owner[:, 1] >= 0
    a, b = points[table.ends[inner, 0]], points[table.ends[inner, 1]]
    sides = [planar_cross(b - a, points[table.opposite[inner, k]] - a) for k in range(2)]
    folded = np.flatnonzero(sides[0] * sides[1] > 0.0)
    if len(folded):
        middle = 0.5 * (a + b)[folded[0]]
        raise MeshError(f"{where}: elements lie upon others at {place(middle)}; the mesh is folded there")
    _check_joined(where, points, triangles, table)
    _check_around_points(where, points, triangles, table)


def _check_around_points(where: str, points: FloatArray, triangles: IntArray, table: EdgeTable) -> None:
    """The elements around a point fill one sector, of a full turn at most."""
    ends = np.bincount(table.boundary.ravel(), minlength=len(points))
    pinched = np.flatnonzero(ends > 2)
    if len(pinched):
        raise MeshError(
            f"{where}: the body holds together by a single point at {place(points[pinched[0]])}; an element is "
            f"missing there, or names a point from elsewhere"
        )
    angle = np.zeros(len(points))
    for a, b in CORNERS:
        ahead, back = (points[triangles[:, k]] - points[triangles[:, a]] for k in (b, 3 - a - b))
        np.add.at(angle, triangles[:, a], np.abs(np.arctan2(planar_cross(ahead, back), (ahead * back).sum(axis=1))))
    full = np.flatnonzero(angle > 2.0 * np.pi + 1e-6)
    if len(full):
        raise MeshError(f"{where}: elements lie upon others around {place(points[full[0]])}; the mesh is folded there")


def _check_joined(where: str, points: FloatArray, triangles: IntArray, table: EdgeTable) -> None:
    """Parts that share no edge with the largest one hang in the air."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    pairs = table.owner[table.owner[:, 1] >= 0]
    size = (len(triangles), len(triangles))
    count, part = connected_components(coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=size), False)
    if count == 1:
        return
    sizes = np.bincount(part)
    loose = np.flatnonzero(np.arange(count) != np.argmax(sizes))
    cells = triangles[part == loose[0]]
    used = np.unique(cells)
    low, high = points[used].min(axis=0), points[used].max(axis=0)
    twins = _twins(points, used, np.setdiff1d(triangles, used))
    raise MeshError(
        f"{where}: its {count} parts are not joined: {len(cells)} triangles within r = {low[0]:.6g} to {high[0]:.6g}, "
        f"z = {low[1]:.6g} to {high[1]:.6g} share no edge with the rest{twins}; merge the nodes of parts that touch "
        f"(Coherence in gmsh), and leave out what is another body"
    )


def _twins(points: FloatArray, used: IntArray, rest: IntArray) -> str:
    """Where a point of a loose part lies upon one of the rest, in words."""
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(points[rest]).query(points[used])
    nearest = int(np.argmin(distance))
    if distance[nearest] > 1e-6 * float(np.ptp(points[rest], axis=0).max()):
        return ""
    return f", though nodes lie upon each other at {place(points[used[nearest]])}"
