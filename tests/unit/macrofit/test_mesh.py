"""Meshes of drawings and of files."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import meshio
import numpy as np
import pytest
from small import small_press

from macrofit.base.arrays import FloatArray
from macrofit.bodies.body import Body
from macrofit.bodies.geometry import Drawing, Sizes, draw_body
from macrofit.bodies.mesh import MeshData, mesh_drawing, read_mesh
from macrofit.bodies.outlook import first_touch
from macrofit.errors import MeshError, SceneError
from macrofit.scene import Scene, build_scene, load_scene
from macrofit.solve import solve

MESHES = Path(__file__).parents[3] / "meshes"

RING = np.array([(r, z) for z in (-30.0, -20.0, -10.0, 0.0) for r in (50.0, 60.0, 70.0)])
QUADS = np.array([[3 * j + i, 3 * j + i + 1, 3 * j + i + 4, 3 * j + i + 3] for j in range(3) for i in range(2)])
HALVES = QUADS[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
OTHER = QUADS[:, [[0, 1, 3], [1, 2, 3]]].reshape(-1, 3)
SIDES = {"bore": [0, 3, 6, 9], "pushed": [0, 1, 2]}


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
    drawn = solve(scene).force  # the first one is a shrink fit's, nothing but rounding
    assert from_files(tmp_path, ".vtk") == pytest.approx(drawn, rel=1e-9, abs=1e-15 * drawn.max())


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


def test_an_axisymmetric_deck_gives_the_drawn_forces(tmp_path: Path) -> None:
    """CAX3, node sets in capitals: the forces of the same mesh through gmsh's format, 1e-9."""
    for body in ("axle", "wheel"):
        data = read_mesh(str(MESHES / f"{body}.msh"), body)
        lines = ["*NODE", *(f"{k}, {r!r}, {z!r}" for k, (r, z) in enumerate(data.points.tolist(), 1))]
        lines.append("*ELEMENT, TYPE=CAX3")
        lines += [f"{k}, {a}, {b}, {c}" for k, (a, b, c) in enumerate((data.triangles + 1).tolist(), 1)]
        for name, pairs in data.edges.items():
            lines += [f"*NSET, NSET={name.upper()}", *(str(k + 1) for k in np.unique(pairs))]
        (tmp_path / f"{body}.inp").write_text("\n".join(lines))
    assert from_files(tmp_path, ".inp") == pytest.approx(from_files(MESHES, ".msh"), rel=1e-9)


def test_a_mesh_of_second_order_keeps_its_curves(tmp_path: Path) -> None:
    """With middle nodes on the arcs the blended bodies give the drawn forces, where chords are off by some 1e-3.

    An arc through three points of an arc is that arc, to the 16 digits of the file: 1e-7.
    """
    scene = small_press()
    drawings = draw_body(scene.axle, "seat", even(5.0)), draw_body(scene.wheel, "bore", even(4.7))
    for body, drawing in zip(("axle", "wheel"), drawings, strict=True):
        data = mesh_drawing(drawing, scene.mesh.coarse, scene.mesh.growth)
        for suffix, curved in (("2", True), ("1", False)):
            write_second_order(tmp_path / f"{body}{suffix}.vtk", data, drawing, curved=curved)
    drawn = solve(scene).force
    assert from_files(tmp_path, "2.vtk") == pytest.approx(drawn, rel=1e-7, abs=1e-15 * drawn.max())
    assert np.abs(from_files(tmp_path, "1.vtk") - drawn).max() > 1e-5 * drawn.max()


def write_second_order(path: Path, data: MeshData, drawing: Drawing, *, curved: bool) -> None:
    """The mesh with a node in the middle of every edge, on the generatrix where the edge is of the contact line."""
    pairs = np.concatenate([data.triangles[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
    ends, number = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    middle = data.points[ends].mean(axis=1)
    contact = {tuple(sorted(pair)) for pair in data.edges[drawing.contact].tolist()}
    line = np.array([tuple(pair) in contact for pair in ends.tolist()])
    if curved:
        middle[line, 0] = drawing.generatrix.height(middle[line, 1])
    cells = np.column_stack([data.triangles, number.reshape(3, -1).T + len(data.points)])
    names = sorted(data.edges)
    lines = np.concatenate([data.edges[name] for name in names])
    tags = np.repeat(np.arange(len(names)), [len(data.edges[name]) for name in names])
    points = np.pad(np.concatenate([data.points, middle]), ((0, 0), (0, 1)))
    nothing = np.zeros(len(cells), dtype=int)
    cell_data = {name: [nothing, (tags == k).astype(int)] for k, name in enumerate(names)}
    meshio.Mesh(points, [("triangle6", cells), ("line", lines)], cell_data=cell_data).write(path)


def ring(cells: list[tuple[str, np.ndarray]], lines: dict[str, list[int]], points: np.ndarray = RING) -> meshio.Mesh:
    """A mesh of the ring's points with chains of lines as physical groups."""
    pairs = {name: np.array(list(pairwise(chain))) for name, chain in lines.items()}
    tags = [np.full(len(block), 9) for _, block in cells] + [
        np.full(len(p), k) for k, p in enumerate(pairs.values(), 1)
    ]
    return meshio.Mesh(
        np.pad(points, ((0, 0), (0, 1))),
        [*cells, *(("line", p) for p in pairs.values())],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array([k, 1]) for k, name in enumerate(pairs, 1)},
    )


def saved(folder: Path, mesh: meshio.Mesh, kind: str = "gmsh22") -> str:
    """The path of the mesh as a file of gmsh."""
    path = folder / "ring.msh"
    mesh.write(path, file_format=kind, binary=False)
    return str(path)


def test_quadrilaterals_are_split_along_their_better_diagonal(tmp_path: Path) -> None:
    """All of the area is there, beside triangles, and no angle is smaller than it must be."""
    data = read_mesh(saved(tmp_path, ring([("quad", QUADS[:4]), ("triangle", HALVES[8:])], SIDES)), "wheel")
    assert area(data) == pytest.approx(600.0)
    slanted = RING + np.array([0.0, 1.0]) * 0.8 * (RING[:, :1] - 50.0)
    data = read_mesh(saved(tmp_path, ring([("quad", QUADS)], SIDES, slanted)), "wheel")
    corners = data.points[data.triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert sides.max() < 12.9  # the shorter diagonal of every one


def test_elements_given_twice_are_taken_once(tmp_path: Path) -> None:
    """As gmsh 2.2 has them where a surface is in two groups; lines too."""
    mesh = ring([("triangle", np.concatenate([HALVES, HALVES[:, [1, 2, 0]]])), ("quad", QUADS[:1])], SIDES)
    with pytest.raises(MeshError, match="more than two elements share the edge"):
        read_mesh(saved(tmp_path, ring([("triangle", HALVES), ("triangle", OTHER)], SIDES)), "wheel")
    assert len(read_mesh(saved(tmp_path, mesh), "wheel").triangles) == len(HALVES)


def test_parts_that_hang_in_the_air_are_named(tmp_path: Path) -> None:
    """The outer half with nodes of its own is not joined, though they lie upon the inner one's."""
    twice = np.concatenate([RING, RING])
    outer = RING[QUADS].mean(axis=1)[:, 0] > 60.0
    cells = np.where(outer[:, None], QUADS + len(RING), QUADS)
    with pytest.raises(
        MeshError, match=r"2 parts are not joined: .*r = 60 to 70.*lie upon each other at \(r, z\) = \(60"
    ):
        read_mesh(saved(tmp_path, ring([("quad", cells)], SIDES | {"pushed": [0, 1]}, twice)), "wheel")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ({"Bore": [0, 3, 6, 9], "PUSHED": [0, 1, 2]}, None),
        ({"boer": [0, 3, 6, 9], "pushed": [0, 1, 2]}, r"no physical group 'bore'.*did you mean 'boer'\?"),
        ({"BORE": [0, 3, 6, 9], "Bore": [0, 3], "pushed": [0, 1, 2]}, r"groups 'BORE' and 'Bore'; which is 'bore'"),
        ({"bore": [0, 3, 6, 9], "pushed": [0, 2]}, r"1 edges of 'pushed' are no edges .* at \(r, z\) = \(60, -30\)"),
        ({"bore": [1, 4, 7, 10], "pushed": [0, 1, 2]}, r"'bore' runs inside the body at"),
    ],
)
def test_groups_are_found_or_named(lines: dict[str, list[int]], message: str | None, tmp_path: Path) -> None:
    path = saved(tmp_path, ring([("triangle", HALVES)], lines))
    if message is None:
        assert sorted(read_mesh(path, "wheel").edges) == ["bore", "pushed"]
        return
    with pytest.raises(MeshError, match=message):
        read_mesh(path, "wheel")


def test_folded_and_foreign_elements_are_refused(tmp_path: Path) -> None:
    folded = RING.copy()
    folded[4] = (76.0, -16.0)
    with pytest.raises(MeshError, match=r"the mesh is folded there|lie upon others"):
        read_mesh(saved(tmp_path, ring([("triangle", HALVES)], SIDES, folded)), "wheel")
    solid = meshio.Mesh(np.eye(4)[:, :3], [("tetra", np.array([[0, 1, 2, 3]]))])
    solid.write(tmp_path / "solid.vtk")
    with pytest.raises(MeshError, match="holds elements 'tetra', which are not read"):
        read_mesh(str(tmp_path / "solid.vtk"), "wheel")


def test_only_files_of_a_stated_size_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.msh")
    (tmp_path / "loop.msh").symlink_to(tmp_path / "loop.msh")
    with (tmp_path / "sparse.msh").open("wb") as file:
        file.truncate(10 * 2**30)
    for name, message in (("pipe", "is a pipe, not a file"), ("loop", "mesh.axle"), ("sparse", "sparse.msh: ")):
        with pytest.raises(MeshError, match=message):
            read_mesh(str(tmp_path / f"{name}.msh"), "axle")


def pressed(
    folder: Path, *, lenient: bool = False, axle: MeshData | None = None, wheel: MeshData | None = None, **motion: float
) -> Scene:
    """A scene of the shipped meshes, one of them replaced."""
    paths = {}
    for body, data in (("axle", axle), ("wheel", wheel)):
        paths[body] = str(MESHES / f"{body}.msh")
        if data is not None:
            write(folder / f"{body}.vtk", data, ".vtk")
            paths[body] = str(folder / f"{body}.vtk")
    return build_scene(
        {
            "mesh": paths,
            "motion": {"start": 15.0, "travel": 60.0, "increment": 15.0} | motion,
            "contact": {"allow_no_contact": lenient},
            "output": {"stress": False, "fields_at": []},
        },
        folder,
    )


def moved(body: str, r: float = 0.0, z: float = 0.0) -> MeshData:
    """A shipped mesh, moved [mm]; an axle moves off its axis."""
    data = read_mesh(str(MESHES / f"{body}.msh"), body)
    return replace(data, points=data.points + np.array([r, z]))


def test_mesh_scenes_are_judged_by_their_gap(tmp_path: Path) -> None:
    """What the keys of a drawing tell is told of files, too."""
    assert first_touch(pressed(tmp_path)) == 15.0
    loose = pressed(tmp_path, wheel=moved("wheel", r=1.0))
    with pytest.raises(SceneError, match=r"never meet at displacements from 15 to 60 mm: the gap is 0\.7"):
        solve(loose)
    meant = pressed(tmp_path, lenient=True, wheel=moved("wheel", r=1.0))
    assert not solve(meant).force.any()
    with pytest.raises(SceneError, match="never face each other"):
        first_touch(pressed(tmp_path, wheel=moved("wheel", z=-900.0)))
    with pytest.raises(
        SceneError, match=r"overlap by 2\.\d+ mm, an interference beyond small strain \(at most 1\.9 mm\)"
    ):
        solve(pressed(tmp_path, wheel=moved("wheel", r=-2.0)))
    with pytest.raises(SceneError, match=r"beside 'seat', where no contact is looked for; shorten motion\.travel"):
        solve(pressed(tmp_path, travel=250.0))


def test_a_bore_narrower_than_the_axle_s_end_is_refused(tmp_path: Path) -> None:
    """The wheel starts before the seat and its mouth, 0.7 mm wider than the bore, is made to meet the taper."""
    narrow = pressed(tmp_path, wheel=moved("wheel", r=-1.8), start=-30.0)
    with pytest.raises(SceneError, match=r"the bore's mouth, .* is narrower than the axle where it enters"):
        first_touch(narrow)


@pytest.mark.parametrize("size", ["seat_facet", "bore_facet", "coarse", "corner_facet", "growth"])
def test_absurd_sizes_of_elements_are_counted_without_a_word(size: str) -> None:
    """Facets of 1e300 mm: each piece of the outline is one, and numpy warned of an overflow."""
    scene = load_scene("lame-rings", [f"mesh.{size}=1e300"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert first_touch(scene) == 40.0
