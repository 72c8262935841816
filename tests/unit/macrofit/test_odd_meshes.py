"""What a damaged file would show is a doubt where the mesh could be meant, and refused where it could not."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
from decks import plain, second_order, sets

from macrofit.bodies.geometry import Sizes, draw_body
from macrofit.bodies.mesh import MeshData, mesh_drawing, read_mesh
from macrofit.bodies.oddities import oddities
from macrofit.errors import MeshError
from macrofit.results.foresight import foreseen
from macrofit.scene import build_scene, load_scene, scene_names

MESHES = Path(__file__).parents[3] / "meshes"


def moved(label: int, old: str, new: str) -> Callable[[], str]:
    """The ring with one node elsewhere."""
    return lambda: plain().replace(f"\n{label}, {old}\n", f"\n{label}, {new}\n")


def without(*labels: int) -> Callable[[], str]:
    """The ring without some elements."""
    drop = {f"{k}, " for k in labels}
    head, _, rest = plain().partition("ELSET=EALL\n")
    rows, star, tail = rest.partition("*NSET")
    kept = [row for row in rows.splitlines(keepends=True) if not any(row.startswith(k) for k in drop)]
    return lambda: head + "ELSET=EALL\n" + "".join(kept) + star + tail


ODD = {
    "a point of a straight line": (moved(26, "60.0, 0.0", "60.0, 0.4"), r"point stands alone .* \(60, 0\.4\)"),
    "a point of the bore": (moved(17, "50.0, -10.0", "52.0, -10.0"), r"point stands alone .* \(52, -10\)"),
    "a point far away": (moved(24, "80.0, -5.0", "1e5, -5.0"), r"point stands alone .* \(100000, -5\)"),
    "a corner": (moved(4, "80.0, -30.0", "80.0, -31.0"), r"facet before the corner at .* \(80, -31\) is inclined"),
    "a corner of second order": (
        lambda: second_order("CAX8").replace("\n28, 80.0, 0.0", "\n28, 80.0, 0.8") + "\n" + sets(),
        r"facet before the corner at .* is inclined",
    ),
    "an element inside": (without(8), r"hole of 4 edges"),
    "an element at the outside": (without(9), r"one element is missing or stands out"),
    "an element at a corner": (without(18), r"point at \(r, z\) = \(80, 0\), beside the body, belongs to no element"),
    "a bore cut off": (lambda: plain().replace("17, 21, 25", "17"), r"'bore' ends at \(r, z\) = \(50, -10\)"),
    "a point of the bore lost": (lambda: plain().replace("17, 21, 25", "21, 25"), r"ends at .* goes on straight"),
    "a label too many": (lambda: plain().replace("17, 21, 25", "17, 21, 25, 28"), r"'bore' has a point at .* \(80, 0"),
}  # fmt: skip

REFUSED = {
    "another point of the boundary": (
        lambda: plain().replace("12, 15, 16, 20, 19", "12, 2, 16, 20, 19"), "holds together by a single point",
    ),
    "another point inside": (
        lambda: plain().replace("\n5, 6, 7, 11, 10", "\n5, 6, 7, 18, 10"), "lie upon others around|folded|lies? upon",
    ),
    "a star among the elements": (
        lambda: plain().replace("\n17, 22", "\n*, 22"), r"line 49, \*: is no keyword; a comment begins with two stars"
    ),
    "a misspelt keyword": (lambda: plain().replace("*ELEMENT", "*ELEMNT"), r"\*ELEMNT: .* did you mean \*ELEMENT\?"),
}  # fmt: skip


def read(folder: Path, text: str, name: str = "ring.inp") -> MeshData:
    (folder / name).write_text(text)
    return read_mesh(str(folder / name), "wheel")


@pytest.mark.parametrize("case", ODD)
def test_what_could_be_meant_is_doubtful(case: str, tmp_path: Path) -> None:
    make, said = ODD[case]
    assert read(tmp_path, plain(), "sound.inp").oddities == ()
    found = " ".join(read(tmp_path, make()).oddities)
    assert re.search(said, found), found


@pytest.mark.parametrize("case", REFUSED)
def test_what_could_not_be_meant_is_refused(case: str, tmp_path: Path) -> None:
    make, said = REFUSED[case]
    with pytest.raises(MeshError, match=said):
        read(tmp_path, make())


@pytest.mark.parametrize("name", scene_names())
def test_drawn_bodies_are_not_odd(name: str) -> None:
    """Arcs, tapers, chamfers, webs and grooves of every built-in scene."""
    scene = load_scene(name)
    for body, contact in (("axle", "seat"), ("wheel", "bore")):
        drawing = draw_body(getattr(scene, body), contact, Sizes.of(scene.mesh, contact))
        assert oddities(mesh_drawing(drawing, scene.mesh.coarse, scene.mesh.growth)) == ()


def test_an_odd_mesh_is_a_doubt_about_the_run(tmp_path: Path) -> None:
    (tmp_path / "wheel.msh").write_text(
        (MESHES / "wheel.msh").read_text().replace("9.4700000000000003e+01 -8.27", "9.5700000000000003e+01 -8.27", 1)
    )
    mesh = {"axle": str(MESHES / "axle.msh"), "wheel": str(tmp_path / "wheel.msh")}
    scene = build_scene({"mesh": mesh, "motion": {"start": 15.0, "travel": 60.0, "increment": 5.0}})
    assert [each for each in foreseen(scene) if each.startswith("odd mesh: mesh.wheel: a point stands alone")]
    sound = build_scene({"mesh": mesh | {"wheel": str(MESHES / "wheel.msh")}, "motion": {"travel": 60.0}})
    assert not [each for each in foreseen(sound) if each.startswith("odd mesh")]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("$EndNodes", "$EndNode", "section Nodes does not end"),
        ("$EndElements\n", "", "section Elements does not end"),
        ("\n108 2 2 1 1 161 ", "\n108 2 2 1 1 0 ", "names node 0, which is not there"),
        ("$Elements\n", "$Elements\n9", "not as many as it announces"),
    ],
)
def test_texts_of_gmsh_are_counted(old: str, new: str, said: str, tmp_path: Path) -> None:
    data = read_mesh(str(MESHES / "wheel.msh"), "wheel")
    tags = [np.full(len(data.triangles), 1)]
    mesh = meshio.Mesh(np.pad(data.points, ((0, 0), (0, 1))), [("triangle", data.triangles)])
    mesh.cell_data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    mesh.write(tmp_path / "old.msh", file_format="gmsh22", binary=False)
    text = (tmp_path / "old.msh").read_text()
    row = next(line for line in text.splitlines() if line.startswith("108 2 "))
    text = text.replace(row, "108 2 2 1 1 161 " + " ".join(row.split()[6:]))
    with pytest.raises(MeshError, match=said):
        read(tmp_path, text.replace(old, new), "new.msh")


def nastran(folder: Path, head: str = "", *, lines: bool = True) -> str:
    """The shipped wheel as a deck of Nastran: bore and pushed face are CBAR elements of properties 1 and 2."""
    data = read_mesh(str(MESHES / "wheel.msh"), "wheel")
    ends = [data.edges["bore"], data.edges["pushed"]]
    cells = [("triangle", data.triangles), *([("line", np.concatenate(ends))] if lines else [])]
    numbers = [np.full(len(data.triangles), 9), np.repeat([1, 2], [len(each) for each in ends])]
    points = np.pad(data.points, ((0, 0), (0, 1))).round(6)
    meshio.Mesh(points, cells, cell_data={"nastran:ref": numbers[: len(cells)]}).write(folder / "raw.bdf")
    return head + (folder / "raw.bdf").read_text()


@pytest.mark.parametrize(
    "head",
    [
        "$ bore = 1\n$ pushed = 2\n",
        '$HMNAME COMP                   1"Bore"\n$HMNAME PROP                   2"pushed" 4\n',
        "$ Femap Property 1 : bore\n$ Femap with NX Nastran Property 2 : PUSHED\n",
        "$ANSA_NAME_COMMENT;1;PBAR;bore;;NO;\n$ANSA_NAME_COMMENT;2;PBAR;pushed;;NO;\n",
    ],
)
def test_boundaries_of_nastran_are_named_by_comments(head: str, tmp_path: Path) -> None:
    wanted = read_mesh(str(MESHES / "wheel.msh"), "wheel")
    found = read(tmp_path, nastran(tmp_path, head), "wheel.bdf")
    assert found.oddities == ()
    for name in ("bore", "pushed"):
        ends = [np.sort(data.points[data.edges[name]], axis=0).sum(axis=1) for data in (wanted, found)]
        assert np.sort(ends[1], axis=0) == pytest.approx(np.sort(ends[0], axis=0), abs=1e-5)


def test_a_deck_of_nastran_without_names_says_what_to_write(tmp_path: Path) -> None:
    for text, said in (
        (nastran(tmp_path), r"names no boundary; name the properties of its line elements \(1, 2\).*'\$ bore = 1'"),
        (nastran(tmp_path, lines=False), r"has no line elements; lay CBAR elements along"),
        (nastran(tmp_path).replace("ENDDATA", ""), r"has no ENDDATA; is it cut off\?"),
        (nastran(tmp_path, "$ bore = 1\n"), r"no physical group 'pushed' of line elements"),
    ):
        with pytest.raises(MeshError, match=said) as caught:
            read(tmp_path, text, "wheel.nas")
        assert "\n" not in str(caught.value)


def med(path: Path, names: dict[int, list[str]]) -> None:
    """The shipped wheel with groups of nodes: 1 on the bore, 2 on the pushed face, 3 on both."""
    data = read_mesh(str(MESHES / "wheel.msh"), "wheel")
    tags = np.zeros(len(data.points), dtype=int)
    for number, name in ((1, "bore"), (2, "pushed")):
        tags[np.unique(data.edges[name])] += number
    mesh = meshio.Mesh(data.points, [("triangle", data.triangles)], point_data={"point_tags": tags})
    mesh.point_tags = names
    mesh.write(path)


def test_groups_of_nodes_of_med_are_boundaries(tmp_path: Path) -> None:
    """A node in two groups is of a family of its own."""
    wanted = read_mesh(str(MESHES / "wheel.msh"), "wheel")
    med(tmp_path / "wheel.med", {1: ["Bore"], 2: ["PUSHED"], 3: ["Bore", "PUSHED"]})
    found = read_mesh(str(tmp_path / "wheel.med"), "wheel")
    for name in ("bore", "pushed"):
        assert np.array_equal(
            np.sort(found.edges[name], axis=1), np.unique(np.sort(wanted.edges[name], axis=1), axis=0)
        )
    med(tmp_path / "wheel.med", {1: ["boar"], 2: ["pushed"], 3: ["boar", "pushed"]})
    with pytest.raises(MeshError, match=r"no physical group 'bore'.*nor a set of nodes.*did you mean 'boar'"):
        read_mesh(str(tmp_path / "wheel.med"), "wheel")
