"""Meshes of drawings and of files."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from small import small_press

from macrofit.base.arrays import FloatArray
from macrofit.bodies.body import Body
from macrofit.bodies.geometry import Sizes, draw_body
from macrofit.bodies.mesh import MeshData, mesh_drawing, read_mesh
from macrofit.errors import MeshError, SceneError
from macrofit.scene import build_scene, load_scene
from macrofit.solve import solve

MESHES = Path(__file__).parents[3] / "meshes"


def triangles(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Areas of triangles by their corners (n, 2) [mm2]."""
    return 0.5 * np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1)))


def area(data: MeshData) -> float:
    """Area of the triangles [mm2]."""
    a, b, c = (data.points[data.triangles[:, k]] for k in range(3))
    return float(triangles(a, b, c).sum())


def even(facet: float) -> Sizes:
    """Facets alike everywhere [mm]."""
    return Sizes(facet, facet, 0.35)


def test_facets_are_graded_towards_the_corners() -> None:
    """Every facet has the wanted length min(facet, corner + growth distance) within 8 %."""
    sizes = Sizes(4.0, 0.5, 0.3)
    for body, contact in ((load_scene("wheelset").axle, "seat"), (load_scene("wheelset").wheel, "bore")):
        line = draw_body(body, contact, sizes).generatrix
        s = line.nodes(sizes)
        length, middle = np.diff(s), 0.5 * (s[1:] + s[:-1])
        arc = line.bends(middle)
        bend = np.flatnonzero(line.bend)[0]
        low, high = line.breaks[bend], line.breaks[bend + 1]
        distance = np.maximum(np.maximum(low - middle, middle - high), 0.0)
        wanted = np.where(arc, 0.5, np.minimum(4.0, 0.5 + 0.3 * distance))
        assert length / wanted == pytest.approx(1.0, abs=0.08)
        assert set(line.breaks) <= set(s)
        assert max(length[1:] / length[:-1]) < 1.45


def test_corner_facets_of_both_lines() -> None:
    """The bore's are 0.97 of the seat's; a corner is never coarser than its line."""
    scene = load_scene("wheelset", ["mesh.seat_facet=4", "mesh.bore_facet=0.25", "mesh.corner_facet=0.5"])
    assert Sizes.of(scene.mesh, "seat") == Sizes(4.0, 0.5, 0.35)
    assert Sizes.of(scene.mesh, "bore") == Sizes(0.25, 0.25, 0.35)
    fine = load_scene("wheelset", ["mesh.corner_facet=0.5"])
    assert Sizes.of(fine.mesh, "bore") == Sizes(0.97, 0.97 * 0.5, 0.35)
    plain = load_scene("wheelset", ["mesh.seat_facet=4"])
    assert Sizes.of(plain.mesh, "bore") == Sizes(3.88, 3.88, 0.35)


def test_meshes_that_cannot_be_are_refused_before_they_are_made() -> None:
    """Without growth the corners' size would be that of the whole body; too many facets exceed the memory."""
    with pytest.raises(SceneError, match=r"mesh\.growth"):
        load_scene("wheelset", ["mesh.corner_facet=0.5", "mesh.growth=0"])
    with pytest.raises(MeshError, match=r"lengthen mesh\.seat_facet"):
        Body(load_scene("wheelset", ["mesh.seat_facet=0.002"]), "axle")


def test_elements_follow_the_graded_facets() -> None:
    """At the corner's facets triangles are as small as they, far along the line as the others; fewer than all fine."""
    scene = load_scene("wheelset")
    graded, fine = (
        mesh_drawing(draw_body(scene.axle, "seat", sizes), 20.0, 0.35) for sizes in (Sizes(4.0, 0.5, 0.35), even(0.5))
    )
    assert len(graded.triangles) < 0.4 * len(fine.triangles)
    centre = graded.points[graded.triangles].mean(axis=1)
    a, b, c = (graded.points[graded.triangles[:, k]] for k in range(3))
    size = np.sqrt(triangles(a, b, c) * 4.0 / np.sqrt(3.0))  # edge of the equal equilateral one
    corner = np.hypot(centre[:, 0] - 95.0, centre[:, 1]) < 3.0
    assert np.median(size[corner]) < 0.9
    far = (np.abs(centre[:, 1] - 120.0) < 20.0) & (centre[:, 0] > 91.0)
    assert np.median(size[far]) > 3.0


def test_drawn_mesh_fills_the_outline() -> None:
    """The shoelace area of the outline equals that of the triangles."""
    scene = load_scene("wheelset")
    drawing = draw_body(scene.wheel, "bore", even(2.0))
    points = np.array([edge.start for edge in drawing.edges])
    ends = np.array([edge.end for edge in drawing.edges])
    assert np.allclose(points[1:], ends[:-1])
    assert np.allclose(points[0], ends[-1])
    shoelace = 0.5 * abs(float(np.sum(points[:, 0] * ends[:, 1] - ends[:, 0] * points[:, 1])))
    assert area(mesh_drawing(drawing, 30.0, 0.35)) == pytest.approx(shoelace, rel=1e-12)


def test_blends_are_tangent() -> None:
    """Height and slope of the contact generatrix are continuous at the ends of its arcs; nodes lie on it."""
    for body, contact in ((load_scene("wheelset").axle, "seat"), (load_scene("wheelset").wheel, "bore")):
        line = draw_body(body, contact, even(1.0)).generatrix
        for s in line.breaks[1:-1]:
            sides = np.array([s - 1e-9, s + 1e-9])
            assert np.ptp(line.height(sides)) < 1e-9
            assert np.ptp(line.slope(sides)) < 1e-9
        s = np.linspace(line.breaks[0], line.breaks[-1], 1001)[1:-1]
        difference = (line.height(s + 1e-5) - line.height(s - 1e-5)) / 2e-5
        assert np.abs(difference - line.slope(s)).max() < 1e-6


def from_files(folder: Path, suffix: str) -> np.ndarray:
    """Forces of the small press with both bodies from files."""
    scene = build_scene(
        {
            "mesh": {"axle": f"axle{suffix}", "wheel": f"wheel{suffix}"},
            "motion": {"start": 15.0, "travel": 60.0, "increment": 5.0},
            "friction": {"options": {"coefficient": 0.11}},
            "output": {"stress": False, "fields_at": []},
        },
        folder,
    )
    return solve(scene).force


def test_own_meshes_give_the_drawn_forces(tmp_path: Path) -> None:
    """With sharp corners a file holds the whole shape, so that the same triangles give the same forces: 1e-9.

    (With blends it holds chords, and only a drawing has the arcs.)
    """
    scene = small_press("axle.taper_blend=0", "wheel.chamfer_blend=0")
    drawings = draw_body(scene.axle, "seat", even(5.0)), draw_body(scene.wheel, "bore", even(4.7))
    for body, drawing in zip(("axle", "wheel"), drawings, strict=True):
        write(tmp_path / f"{body}.vtk", mesh_drawing(drawing, scene.mesh.coarse, scene.mesh.growth), ".vtk")
    assert from_files(tmp_path, ".vtk") == pytest.approx(solve(scene).force, rel=1e-9)


@pytest.mark.parametrize("suffix", [".inp", ".vtk", ".med"])
def test_other_formats(suffix: str, tmp_path: Path) -> None:
    """The same mesh through another format gives the same forces to the last digits of its numbers."""
    for body in ("axle", "wheel"):
        data = read_mesh(str(MESHES / f"{body}.msh"), body)
        write(tmp_path / f"{body}{suffix}", data, suffix)
    assert from_files(tmp_path, suffix) == pytest.approx(from_files(MESHES, ".msh"), rel=1e-9)


def write(path: Path, data: MeshData, suffix: str) -> None:
    """The mesh with its named edges as users of that format would have them."""
    names = sorted(data.edges)
    points = np.column_stack([data.points, np.zeros(len(data.points))])
    if suffix == ".inp":
        write_inp(path, points, data)
        return
    lines = np.concatenate([data.edges[name] for name in names])
    number = np.repeat(np.arange(len(names)), [len(data.edges[name]) for name in names])
    mesh = meshio.Mesh(points, [("triangle", data.triangles), ("line", lines)])
    if suffix == ".vtk":
        nothing = np.zeros(len(data.triangles), dtype=int)
        mesh.cell_data = {name: [nothing, (number == k).astype(int)] for k, name in enumerate(names)}
    else:
        mesh.points = points[:, :2]
        mesh.cell_data = {"cell_tags": [np.full(len(data.triangles), -9), -1 - number]}
        mesh.cell_tags = {-9: ["body"]} | {-1 - k: [name] for k, name in enumerate(names)}
    mesh.write(path)


def write_inp(path: Path, points: np.ndarray, data: MeshData) -> None:
    """An Abaqus input file with an element set on every block, one of them under a second name."""
    lines = ["*NODE"] + [f"{k}, {x!r}, {y!r}, 0.0" for k, (x, y, _) in enumerate(points.tolist(), start=1)]
    number, sets = 1, []
    lines.append("*ELEMENT, TYPE=CPS3, ELSET=Surface1")
    for triangle in (data.triangles + 1).tolist():
        lines.append(f"{number}, " + ", ".join(map(str, triangle)))
        number += 1
    for name, pairs in sorted(data.edges.items()):
        first, block = number, "Line1" if name in ("held", "pushed") else name
        lines.append(f"*ELEMENT, TYPE=T2D2, ELSET={block}")
        for pair in (pairs + 1).tolist():
            lines.append(f"{number}, {pair[0]}, {pair[1]}")
            number += 1
        if block != name:
            sets += [f"*ELSET, ELSET={name}", ", ".join(str(k) for k in range(first, number))]
    path.write_text("\n".join(lines + sets) + "\n")


def test_missing_group(tmp_path: Path) -> None:
    text = (MESHES / "axle.msh").read_text().replace('"held"', '"hold"')
    (tmp_path / "axle.msh").write_text(text)
    with pytest.raises(MeshError, match=r"mesh\.axle: .*no physical group 'held'.*found: axis, seat"):
        read_mesh(str(tmp_path / "axle.msh"), "axle")


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "no file"), ("nonsense", "cannot be read"), ("", "cannot be read")],
)
def test_unreadable_file(content: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "axle.msh"
    if content is not None:
        path.write_text(content)
    with pytest.raises(MeshError, match=f"mesh.axle: .*{message}"):
        read_mesh(str(path), "axle")


def test_wrong_ending(tmp_path: Path) -> None:
    (tmp_path / "axle.inp").write_text((MESHES / "axle.msh").read_text())
    with pytest.raises(MeshError, match="holds no points"):
        read_mesh(str(tmp_path / "axle.inp"), "axle")


def test_turned_contact_line(tmp_path: Path) -> None:
    """A contact line that is not a graph is refused: here the held end face is called the seat."""
    text = (
        (MESHES / "axle.msh").read_text().replace('"held"', '"x"').replace('"seat"', '"held"').replace('"x"', '"seat"')
    )
    (tmp_path / "axle.msh").write_text(text)
    with pytest.raises(MeshError, match="must be a graph over z"):
        solve(
            build_scene(
                {
                    "mesh": {"axle": "axle.msh", "wheel": str(MESHES / "wheel.msh")},
                    "motion": {"travel": 1.0},
                },
                tmp_path,
            )
        )
