"""Mesh files of users: strict where a number could come out wrong, generous in everything else.

A file becomes straight-sided triangles with named edges. Quadrilaterals are split, elements of second order keep the
curve of their contact line, what is given twice is taken once; parts that are not joined, elements upon each other
and boundaries that are not on the body are refused.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.arrays import FloatArray
from ..errors import MeshError
from .formats import read_contents
from .oddities import oddities, unused
from .raw import RawMesh
from .triangles import CORNERS, EdgeTable, IntArray, MeshData, check_sound, compact, doubled_area, place, tabulate_edges

REQUIRED = {"axle": ("seat", "held"), "wheel": ("bore", "pushed")}
WANTED = {"axle": ("seat", "held", "axis"), "wheel": ("bore", "pushed", "axis")}
CONTACT = {"axle": "seat", "wheel": "bore"}

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
"""Units of length that files may be in [mm]."""

FARTHEST_MIDDLE = 0.25
"""How far a middle node may lie from the middle of its edge, in lengths of the edge: beyond, elements overlap."""

FARTHEST_POINT = 1e7
"""Largest coordinate of a body [mm]."""

SMALLEST_RADIUS = 1.0
"""Below that [mm] a body of a file in no stated unit is taken for one in metres."""


def read_mesh(path: str, body: str, unit: str | None = None) -> MeshData:
    """Read a body's mesh: .msh, .inp (Abaqus, CalculiX), and .med, .vtk... through meshio.

    Wanted are triangles or quadrilaterals of first or second order in the plane x = r, y = z, and the boundaries
    ``seat`` and ``held`` (axle) or ``bore`` and ``pushed`` (wheel), and ``axis`` where the body touches r = 0: line
    elements in physical groups, families or sets; or sets of nodes; or surfaces of element faces. Capitals or not.

    Args:
        path: of the file.
        body: "axle" or "wheel".
        unit: of the file's lengths; left out: mm, and a body too small for it is refused.

    Raises:
        MeshError: the file cannot be read, or is no sound mesh of one body; what, where, and what to do.
    """
    where = f"mesh.{body}: '{path}'"
    raw = read_contents(Path(path), body, where)
    points = _plane(where, np.asarray(raw.points, dtype=np.float64)) * UNITS[unit or "mm"]
    triangles, middles = _triangles(where, raw, points)
    table = tabulate_edges(triangles)
    check_sound(where, points, triangles, table)
    edges = {name: found for name in WANTED[body] if len(found := _edges(where, name, raw, points, table))}
    data = compact(points, triangles, edges)
    _check_file(where, body, data, [*raw.lines, *raw.nodes, *raw.others], unit)
    contact = CONTACT[body]
    _check_outside(where, contact, points, edges[contact], table)
    curve = _curve(where, points, table, table.find(edges[contact]), (triangles, middles))
    odd = (*oddities(data), *_odd_points(raw, points, (triangles, middles), edges))
    return replace(data, middles={} if curve is None else {contact: curve}, oddities=odd)


def _plane(where: str, points: FloatArray) -> FloatArray:
    """The points in the plane x = r, y = z."""
    if not len(points):
        raise MeshError(f"{where} holds no points; is its name's ending that of its format?")
    if points.shape[1] > 2 and np.isfinite(points).all() and np.ptp(points[:, 2]) > 1e-6 * np.ptp(points, axis=0).max():
        raise MeshError(
            f"{where} is not plane: its third coordinate goes from {points[:, 2].min():.6g} to "
            f"{points[:, 2].max():.6g}; draw in the plane x = r, y = z"
        )
    return np.ascontiguousarray(points[:, :2])


def _triangles(where: str, raw: RawMesh, points: FloatArray) -> tuple[IntArray, IntArray]:
    """All cells as triangles (m, 3), each once, and (m, 3) points in the middle of their edges; -1: none."""
    corners, middles = [np.zeros((0, 3), dtype=np.int64)], [np.zeros((0, 3), dtype=np.int64)]
    for block in raw.triangles:
        _check_points(where, block, points)
        corners.append(block[:, :3])
        middles.append(block[:, 3:6] if block.shape[1] >= 6 else np.full((len(block), 3), -1))
    for block in raw.quads:
        _check_points(where, block, points)
        for half, mid in _split(where, block, points):
            corners.append(half)
            middles.append(mid)
    triangles, mids = np.concatenate(corners).astype(np.int64), np.concatenate(middles).astype(np.int64)
    if not len(triangles):
        raise MeshError(f"{where} holds no triangles or quadrilaterals")
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    first = np.sort(first)
    return triangles[first], mids[first]


def _check_points(where: str, block: IntArray, points: FloatArray) -> None:
    """Every point of the cells is there, and a number."""
    if block.size and (block.min() < 0 or block.max() >= len(points)):
        raise MeshError(f"{where}: elements name points that are not there; the file is damaged")
    corners = points[block]
    if not np.isfinite(corners).all():
        raise MeshError(f"{where}: a coordinate of an element is not a number; the file is damaged")
    if (np.abs(corners) > FARTHEST_POINT).any():
        raise MeshError(f"{where}: a point of an element is farther away than {FARTHEST_POINT:g} mm")


def _split(where: str, quads: IntArray, points: FloatArray) -> list[tuple[IntArray, IntArray]]:
    """Two triangles of each quadrilateral, along the diagonal that leaves the larger smallest angle."""
    ways = (((0, 1, 2), (0, 2, 3)), ((0, 1, 3), (1, 2, 3)))
    turned = np.sign(doubled_area(points, quads[:, ways[0][0]]) + doubled_area(points, quads[:, ways[0][1]]))
    quality = np.stack([np.min([turned * _shape(points, quads[:, half]) for half in way], axis=0) for way in ways])
    bad = np.flatnonzero(quality.max(axis=0) <= 0.0)
    if len(bad):
        middle = points[quads[bad[0], :4]].mean(axis=0)
        raise MeshError(f"{where}: a quadrilateral is twisted or flat at {place(middle)}")
    second = quality[1] > quality[0] * (1.0 + 1e-9)
    halves = []
    sides = {(0, 1): 4, (1, 2): 5, (2, 3): 6, (0, 3): 7}
    for k in range(2):
        half = np.where(second[:, None], quads[:, ways[1][k]], quads[:, ways[0][k]])
        mid = np.full(half.shape, -1)
        for chosen, way in ((~second, ways[0][k]), (second, ways[1][k])):
            for edge, (a, b) in enumerate(((0, 1), (1, 2), (2, 0))):
                side = sides.get((min(way[a], way[b]), max(way[a], way[b])))
                if side is not None and quads.shape[1] >= 8:
                    mid[chosen, edge] = quads[chosen, side]
        halves.append((half, mid))
    return halves


def _shape(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Quality of triangles: 1 for an equilateral one, 0 for a flat one, < 0 clockwise."""
    corners = points[triangles]
    squares = ((corners - np.roll(corners, -1, axis=1)) ** 2).sum(axis=(1, 2))
    return np.asarray(2.0 * np.sqrt(3.0) * doubled_area(points, triangles) / np.maximum(squares, 1e-300))


def _edges(where: str, wanted: str, raw: RawMesh, points: FloatArray, table: EdgeTable) -> IntArray:
    """Ends (k, 2) of the edges of a boundary, each once: of lines or faces where there are any, else by its nodes."""
    lines = _named(where, wanted, raw.lines)
    if lines:
        pairs = np.unique(np.sort(np.concatenate(lines), axis=1), axis=0)
        lost = pairs[table.find(pairs) < 0]
        if len(lost):
            ends = lost[0][lost[0] < len(points)]
            at = f" at {place(points[ends].mean(axis=0))}" if len(ends) else ""
            raise MeshError(
                f"{where}: {len(lost)} edges of '{wanted}' are no edges of the body's elements, the first{at}; "
                f"write the elements beside them too, and share their nodes"
            )
        return np.asarray(pairs)
    boundary = table.boundary
    nodes = _named(where, wanted, raw.nodes)
    if not nodes:
        return np.zeros((0, 2), dtype=np.int64)
    found = boundary[np.isin(boundary, np.concatenate(nodes)).all(axis=1)]
    if not len(found):
        raise MeshError(f"{where}: the set of nodes '{wanted}' has no two neighbours on the body's boundary")
    return np.asarray(found)


def _odd_points(
    raw: RawMesh, points: FloatArray, cells: tuple[IntArray, IntArray], edges: dict[str, IntArray]
) -> Iterator[str]:
    """What is odd about points on no element, or in a set of nodes and on none of its edges."""
    triangles, middles = cells
    yield from unused(points, triangles, np.union1d(triangles, middles[middles >= 0]))
    for name, found in edges.items():
        if _named("", name, raw.lines):
            continue
        members = np.concatenate(_named("", name, raw.nodes))
        lone = np.setdiff1d(members, [*found.ravel(), *middles.ravel()])
        if len(lone):
            at = place(points[lone[0]])
            yield f"'{name}' has a point at {at} that is on none of its edges; is one beside it missing?"


def _named(where: str, wanted: str, groups: dict[str, list[IntArray]]) -> list[IntArray]:
    """The group of a name, spelled so or else in other capitals, or behind the name of an instance."""
    if wanted in groups:
        return groups[wanted]
    alike = [name for name in groups if _plain(name) == wanted]
    if len(alike) > 1:
        raise MeshError(f"{where} has groups '{alike[0]}' and '{alike[1]}'; which is '{wanted}'? rename one")
    return groups[alike[0]] if alike else []


def _plain(name: str) -> str:
    return name.strip().strip("'\"").rpartition(".")[2].lower()


def _check_file(where: str, body: str, data: MeshData, groups: list[str], unit: str | None) -> None:
    """The boundaries are there, and the body is where and as large as it can be."""
    others = ", ".join(sorted({name for name in groups if ":" not in name and _plain(name) not in data.edges}))
    present = (", ".join(sorted(data.edges)) or "none") + (f"; other groups: {others}" if others else "")
    missing = [name for name in REQUIRED[body] if name not in data.edges]
    if missing:
        raise MeshError(
            f"{where} has no physical group '{missing[0]}' of line elements, nor a set of nodes or a surface of that "
            f"name (found: {present}){_meant(missing[0], groups)}"
        )
    low, high, far = float(data.points[:, 0].min()), float(data.points[:, 0].max()), float(np.abs(data.points).max())
    if low < -1e-9 * far:
        raise MeshError(f"{where} has points at r < 0; draw x = r, y = z")
    if low < 1e-9 * far and "axis" not in data.edges:
        raise MeshError(f"{where} touches r = 0 but has no physical group 'axis' (found: {present})")
    if unit is None and high < SMALLEST_RADIUS:
        raise MeshError(
            f"{where} has no point farther than {high:.4g} mm from the axis; is it in metres? "
            f"then mesh.unit = 'm', and 'mm' if it is as small as that"
        )


def _meant(missing: str, groups: list[str]) -> str:
    """What may have been meant by a name that no boundary has, as the end of a sentence."""
    alike = [name for name in groups if _plain(name) == missing]
    if alike:
        return f"; '{alike[0]}' holds no edges, or elements of the body"
    close = difflib.get_close_matches(missing, [_plain(name) for name in groups], 1, 0.6)
    meant = [name for name in groups if _plain(name) in close]
    return f"; did you mean '{meant[0]}'?" if meant else ""


def _check_outside(where: str, name: str, points: FloatArray, pairs: IntArray, table: EdgeTable) -> None:
    """The contact line lies on the boundary of the body."""
    inside = pairs[table.owner[table.find(pairs), 1] >= 0]
    if len(inside):
        middle = points[inside[0]].mean(axis=0)
        raise MeshError(f"{where}: '{name}' runs inside the body at {place(middle)}; it must lie on its boundary")


def _curve(
    where: str, points: FloatArray, table: EdgeTable, line: IntArray, cells: tuple[IntArray, IntArray]
) -> FloatArray | None:
    """Points (k, 2) between the ends of the edges ``line`` of elements of second order; None where all are of first."""
    triangles, middles = cells
    if (middles < 0).all():
        return None
    pairs = np.concatenate([triangles[:, pair] for pair in CORNERS])
    middle = middles.T.ravel()
    there = middle >= 0
    a, b = points[pairs[there, 0]], points[pairs[there, 1]]
    off = np.linalg.norm(points[middle[there]] - 0.5 * (a + b), axis=1) / np.linalg.norm(b - a, axis=1)
    if off.max() > FARTHEST_MIDDLE:
        at = place(points[middle[there][np.argmax(off)]])
        raise MeshError(f"{where}: a middle node lies far from the middle of its edge, at {at}; the mesh is damaged")
    of_edge = np.full(len(table.ends), -1)
    of_edge[table.find(pairs[there])] = middle[there]
    ends = points[table.ends[line]].mean(axis=1)
    return np.where(of_edge[line, None] >= 0, points[of_edge[line]], ends)
