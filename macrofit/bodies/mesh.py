"""Meshes: a drawing or a file becomes points, triangles and named boundary edges."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..base.arrays import FloatArray
from ..base.files import check_regular
from ..errors import MeshError, OutputError
from .geometry import Drawing

IntArray = npt.NDArray[np.int64]

MOST_BYTES = 1_000_000_000
"""Size of a mesh file; one of a million nodes has 0.1 GB."""
REQUIRED = {"axle": ("seat", "held"), "wheel": ("bore", "pushed")}


@dataclass(frozen=True)
class MeshData:
    """Straight-sided triangles. points (n, 2) [mm] as (r, z); triangles (m, 3); edges: name -> (k, 2) of points."""

    points: FloatArray
    triangles: IntArray
    edges: dict[str, IntArray]


def mesh_drawing(drawing: Drawing, coarse: float, growth: float) -> MeshData:
    """Triangulate a drawing with gmsh: the contact line's facets as drawn, growing to ``coarse`` [mm] away from it."""
    interrupt = signal.getsignal(signal.SIGINT)  # importing gmsh takes Ctrl-C for itself
    import gmsh

    gmsh.initialize()
    signal.signal(signal.SIGINT, interrupt)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add(drawing.contact)
        _grade(gmsh, drawing, *_add_outline(gmsh, drawing), coarse, growth)
        gmsh.model.mesh.generate(2)
        return _extract(gmsh)
    except Exception as error:
        raise MeshError(f"gmsh could not mesh the body of the {drawing.contact}: {error}") from error
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGINT, interrupt)


def _add_outline(gmsh, drawing: Drawing) -> tuple[list[int], list[int]]:  # type: ignore[no-untyped-def]
    """Lines of the contact line's facets, and those of them that lie in its corners."""
    geo = gmsh.model.geo
    tags: dict[tuple[float, float], int] = {}
    for edge in drawing.edges:
        for point in (edge.start, edge.end):
            key = (round(point[0], 9), round(point[1], 9))
            if key not in tags:
                tags[key] = geo.addPoint(point[0], point[1], 0.0)
    lines: dict[str, list[int]] = {}
    loop, corner = [], []
    for edge in drawing.edges:
        ends = (tags[round(p[0], 9), round(p[1], 9)] for p in (edge.start, edge.end))
        line = geo.addLine(*ends)
        loop.append(line)
        lines.setdefault(edge.name, []).append(line)
        if edge.name == drawing.contact:
            geo.mesh.setTransfiniteCurve(line, 2)
        if edge.corner:
            corner.append(line)
    surface = geo.addPlaneSurface([geo.addCurveLoop(loop)])
    geo.synchronize()
    gmsh.model.addPhysicalGroup(2, [surface])
    for name, members in lines.items():
        if name:
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, members), name)
    return lines[drawing.contact], corner


def _grade(gmsh, drawing: Drawing, contact: list[int], corner: list[int], coarse: float, growth: float) -> None:  # type: ignore[no-untyped-def]
    """Element size = facet + growth * distance to the contact line, also from its corners' facets, at most coarse."""
    field, sizes = gmsh.model.mesh.field, drawing.sizes
    fields = [field.add("MathEval")]
    field.setString(fields[0], "F", repr(max(coarse, sizes.facet)))
    for lines, facet in ((contact, sizes.facet), (corner if sizes.corner < sizes.facet else [], sizes.corner)):
        if lines:
            distance = field.add("Distance")
            nodes = sorted({tag for line in lines for _, tag in gmsh.model.getBoundary([(1, line)])})
            field.setNumbers(distance, "NodesList", nodes)
            fields.append(field.add("MathEval"))
            field.setString(fields[-1], "F", f"{facet!r} + {growth!r} * F{distance}")
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", fields)
    field.setAsBackgroundMesh(least)
    for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)


def _extract(gmsh) -> MeshData:  # type: ignore[no-untyped-def]
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    index = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    index[tags.astype(np.int64)] = np.arange(len(tags))
    points = coordinates.reshape(-1, 3)[:, :2].copy()
    _, triangle_nodes = gmsh.model.mesh.getElementsByType(2)
    triangles = index[triangle_nodes.astype(np.int64)].reshape(-1, 3)
    edges = {}
    for _, group in gmsh.model.getPhysicalGroups(1):
        members = [
            gmsh.model.mesh.getElementsByType(1, entity)[1]
            for entity in gmsh.model.getEntitiesForPhysicalGroup(1, group)
        ]
        edges[gmsh.model.getPhysicalName(1, group)] = index[np.concatenate(members).astype(np.int64)].reshape(-1, 2)
    return _compact(points, triangles, edges)


def _compact(points: FloatArray, triangles: IntArray, edges: dict[str, IntArray]) -> MeshData:
    """Drop points that no triangle uses."""
    used, renumbered = np.unique(triangles, return_inverse=True)
    index = np.full(len(points), -1, dtype=np.int64)
    index[used] = np.arange(len(used))
    return MeshData(
        np.ascontiguousarray(points[used]),
        renumbered.reshape(-1, 3).astype(np.int64),
        {name: index[pairs] for name, pairs in edges.items()},
    )


def read_mesh(path: str, body: str) -> MeshData:
    """Read a body's mesh (.msh, and through meshio .inp, .med, .vtk...) with its named boundary edges.

    Wanted are triangles in the (r, z) plane (x = r, y = z) and line elements in the physical groups ``seat`` and
    ``held`` (axle) or ``bore`` and ``pushed`` (wheel), and ``axis`` where the body touches r = 0.
    """
    import meshio

    file = Path(path)
    try:
        check_regular(file, MOST_BYTES)
    except OutputError as error:
        raise MeshError(f"mesh.{body}: no file '{path}'" if not file.exists() else f"mesh.{body}: {error}") from None
    try:
        mesh = meshio.read(file)
    except (Exception, SystemExit) as error:
        raise MeshError(f"mesh.{body}: '{path}' cannot be read: {error or type(error).__name__}") from None
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < 2:
        raise MeshError(f"mesh.{body}: '{path}' holds no points; is its name's ending that of its format?")
    points = np.ascontiguousarray(points[:, :2])
    triangles = [
        np.asarray(block.data, dtype=np.int64)[:, :3] for block in mesh.cells if block.type in ("triangle", "triangle6")
    ]
    if not triangles:
        raise MeshError(f"mesh.{body}: '{path}' holds no triangles")
    edges = _named_edges(mesh)
    _check_file(path, body, points, edges)
    cells = np.concatenate(triangles)
    a, b, c = (points[cells[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    if (np.abs(area) <= 1e-14 * np.abs(area).max()).any():
        raise MeshError(f"mesh.{body}: '{path}' has flat triangles in the (r, z) plane (x = r, y = z)")
    return _compact(points, cells, edges)


def _named_edges(mesh) -> dict[str, IntArray]:  # type: ignore[no-untyped-def]
    """Line elements by name: gmsh physical groups, element sets, MED families, or an integer array of names."""
    wanted = ("seat", "bore", "axis", "held", "pushed")
    found: dict[str, list[IntArray]] = {name: [] for name in wanted}
    families = getattr(mesh, "cell_tags", {})
    for k, block in enumerate(mesh.cells):
        if block.type not in ("line", "line3"):
            continue
        data = np.asarray(block.data, dtype=np.int64)[:, :2]
        tags = {key: np.asarray(values[k]) for key, values in mesh.cell_data.items()}
        for name in wanted:
            chosen = np.zeros(len(data), dtype=bool)
            if name in mesh.field_data and "gmsh:physical" in tags:
                chosen |= tags["gmsh:physical"] == mesh.field_data[name][0]
            if name in mesh.cell_sets:
                members = mesh.cell_sets[name][k]
                members = np.asarray([] if members is None else members, dtype=np.int64)
                chosen[members[members < len(data)]] = True
            if "cell_tags" in tags:
                ids = [tag for tag, names in families.items() if name in names]
                chosen |= np.isin(tags["cell_tags"], ids)
            if name in tags:
                chosen |= tags[name] != 0
            found[name].append(data[chosen])
    return {name: np.concatenate(parts) for name, parts in found.items() if parts and sum(map(len, parts))}


def _check_file(path: str, body: str, points: FloatArray, edges: dict[str, IntArray]) -> None:
    present = ", ".join(sorted(edges)) or "none"
    missing = [name for name in REQUIRED[body] if name not in edges]
    if missing:
        raise MeshError(
            f"mesh.{body}: '{path}' has no physical group '{missing[0]}' of line elements (found: {present})"
        )
    if points[:, 0].min() < -1e-9:
        raise MeshError(f"mesh.{body}: '{path}' has points at r < 0; draw x = r, y = z")
    if points[:, 0].min() < 1e-9 and "axis" not in edges:
        raise MeshError(f"mesh.{body}: '{path}' touches r = 0 but has no physical group 'axis' (found: {present})")
