"""Meshes that are kept: the same bits as made anew, never another drawing's, and sound whatever happens to the file."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from macrofit.base import kept as arrays
from macrofit.bodies import kept, mesh
from macrofit.bodies.geometry import Drawing, Sizes, draw_body
from macrofit.bodies.mesh import MeshData, mesh_drawing
from macrofit.scene import load_scene
from macrofit.scene.keys import MeshFile

COARSE, GROWTH = 30.0, 0.6


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MACROFIT_CACHE", str(tmp_path))
    return tmp_path / "meshes"


def drawing(*overrides: str) -> Drawing:
    scene = load_scene("wheelset", ["mesh.seat_facet=10", *overrides])
    return draw_body(scene.axle, "seat", Sizes.of(scene.mesh, "seat"))


def same(a: MeshData, b: MeshData) -> bool:
    arrays = [(a.points, b.points), (a.triangles, b.triangles), *((a.edges[name], b.edges[name]) for name in a.edges)]
    return [*a.edges] == [*b.edges] and all(x.dtype == y.dtype and np.array_equal(x, y) for x, y in arrays)


def counted(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    made: list[Any] = []
    meshed = mesh._meshed
    monkeypatch.setattr(mesh, "_meshed", lambda *given: made.append(given) or meshed(*given))
    return made


def test_a_drawing_is_meshed_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = counted(monkeypatch)
    first, second = (mesh_drawing(drawing(), COARSE, GROWTH) for _ in range(2))
    assert len(made) == len(list(cache.iterdir())) == 1
    assert same(first, second)
    assert same(first, mesh._meshed(drawing(), COARSE, GROWTH))


def test_all_that_decides_a_mesh_is_in_its_name(cache: Path) -> None:
    base = drawing()
    sizes = base.sizes
    names = {
        kept.mesh_file(*each)
        for each in (
            (base, COARSE, GROWTH), (base, 29.0, GROWTH), (base, COARSE, 0.5),
            (drawing("axle.seat_length=181"), COARSE, GROWTH), (replace(base, contact="bore"), COARSE, GROWTH),
            *((replace(base, sizes=replace(sizes, **{size: 0.9})), COARSE, GROWTH) for size in vars(sizes)),
            (replace(base, edges=tuple(replace(edge, corner=True) for edge in base.edges)), COARSE, GROWTH),
            (replace(base, edges=(replace(base.edges[0], name="held"), *base.edges[1:])), COARSE, GROWTH),
        )
    }  # fmt: skip
    assert len(names) == 10
    assert None not in names


def test_the_mesher_is_in_the_name_too(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The interface of gmsh, the user's settings of it, and the code that asks it: each gives another name."""
    files = ["gmsh.py", ".gmshrc", ".gmsh-options", "mesh.py", "triangles.py", "kept.py"]
    names = set()
    for changed in (None, *files):
        monkeypatch.setattr(
            Path, "read_bytes", lambda file, changed=changed: file.name[: file.name == changed].encode()
        )
        kept._mesher.cache_clear()
        names.add(kept.mesh_file(drawing(), COARSE, GROWTH))
    kept._mesher.cache_clear()
    assert len(names) == 1 + len(files)


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "another", "another drawing's", "renamed"])
def test_a_damaged_mesh_is_made_again(cache: Path, monkeypatch: pytest.MonkeyPatch, damage: str) -> None:
    first = mesh_drawing(drawing(), COARSE, GROWTH)
    (file,) = cache.iterdir()
    data = file.read_bytes()
    if damage == "flipped":
        middle = len(data) // 2
        file.write_bytes(data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :])
    elif damage == "another drawing's":
        mesh_drawing(drawing("axle.seat_length=181"), COARSE, GROWTH)
        next(each for each in cache.iterdir() if each != file).replace(file)
    elif damage == "renamed":
        file.write_bytes(data.replace(b"edges of seat", b"edges of seau"))
    elif damage == "another":
        with file.open("wb") as target:
            np.savez(target, points=np.zeros((3, 3)), triangles=np.zeros((1, 3), dtype=np.int64))
    else:
        file.write_bytes(data[: len(data) // 2 if damage == "cut" else 0])
    made = counted(monkeypatch)
    with pytest.warns(UserWarning, match="is damaged and is made again"):
        assert same(mesh_drawing(drawing(), COARSE, GROWTH), first)
    assert len(made) == 1
    assert same(mesh_drawing(drawing(), COARSE, GROWTH), first)  # it is sound again
    assert len(made) == 1


@pytest.mark.parametrize("folder", [os.devnull, f"/{300 * 'a'}"])
def test_a_folder_that_cannot_be_written_is_done_without(folder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MACROFIT_CACHE", folder)
    assert not kept.all_kept(load_scene("wheelset"))
    assert len(mesh_drawing(drawing(), COARSE, GROWTH).points)


def test_the_oldest_go_first(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh_drawing(drawing(), COARSE, GROWTH)
    (oldest,) = cache.iterdir()
    os.utime(oldest, ns=(0, 0))
    monkeypatch.setattr(arrays, "MOST_BYTES", int(1.5 * oldest.stat().st_size))
    mesh_drawing(drawing(), 29.0, GROWTH)
    (left,) = cache.iterdir()
    assert left != oldest


def test_a_scene_says_whether_it_needs_a_mesher(cache: Path) -> None:
    scene = load_scene("wheelset", ["mesh.seat_facet=10"])
    assert not kept.all_kept(scene)
    for spec, contact in ((scene.axle, "seat"), (scene.wheel, "bore")):
        assert not kept.all_kept(scene)
        mesh_drawing(draw_body(spec, contact, Sizes.of(scene.mesh, contact)), scene.mesh.coarse, scene.mesh.growth)
    assert kept.all_kept(scene)
    assert not kept.all_kept(load_scene("wheelset", ["mesh.seat_facet=9"]))
    assert kept.all_kept(msgspec.structs.replace(scene, axle=MeshFile()))


def test_two_processes_at_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both make the mesh, each writes a whole file in place of the other's."""
    code = (
        "from unit.macrofit.test_kept_meshes import *\n"
        "data = mesh_drawing(drawing(), COARSE, GROWTH)\n"
        "print(data.points.tobytes().hex()[:64], len(data.triangles))"
    )
    tests = Path(__file__).parents[2]
    environment = os.environ | {"PYTHONPATH": f"{tests}:{tests.parent}"}
    runs = [subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE) for _ in range(2)]
    said = {run.communicate()[0] for run in runs}
    assert len(said) == 1
    assert len(list(cache.iterdir())) == 1
    assert len(mesh_drawing(drawing(), COARSE, GROWTH).points)
