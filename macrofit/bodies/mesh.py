"""Meshes: a drawing or a file becomes points, triangles and named boundary edges."""

from __future__ import annotations

import signal

import numpy as np

from ..errors import MeshError
from .geometry import Drawing
from .kept import keep_mesh, kept_mesh, mesh_file
from .magnitudes import check_drawing
from .reader import read_mesh
from .triangles import MeshData, compact

__all__ = ["MeshData", "mesh_drawing", "read_mesh"]


def mesh_drawing(drawing: Drawing, coarse: float, growth: float) -> MeshData:
    """Triangulate a drawing: the contact line's facets as drawn, growing to ``coarse`` [mm] away from it.

    By gmsh, or as it was kept from an earlier run, see `kept`.

    Raises:
        MeshError: the drawing cannot be meshed.
    """
    check_drawing(drawing, coarse, growth)
    file = mesh_file(drawing, coarse, growth)
    found = None if file is None else kept_mesh(file)
    if found is None:
        found = _meshed(drawing, coarse, growth)
        if file is not None:
            keep_mesh(file, found)
    return found


def _meshed(drawing: Drawing, coarse: float, growth: float) -> MeshData:
    """What gmsh makes of a drawing.

    Raises:
        MeshError: it cannot.
    """
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
    return compact(points, triangles, edges)
