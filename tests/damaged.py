"""Meshes damaged by chance: bytes turned, files cut, pieces moved, numbers replaced by odd ones."""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np
from decks import READ

from macrofit.bodies.mesh import MeshData, read_mesh
from macrofit.bodies.triangles import doubled_area

ODD = [b"0", b"-1", b"nan", b"inf", b"1e308", b"1e-308", b"99999999999", b"4294967295", b"-9223372036854775808", b"",
       b"x", b"1e5", b"2", b'"', b"*", b"$End", b"\xff\xfe", b"\x00", b","]  # fmt: skip


def sound_files(folder: Path, meshes: Path) -> list[Path]:
    """The shipped wheel in six formats and the decks of a ring: what is damaged."""
    data = read_mesh(str(meshes / "wheel.msh"), "wheel")
    names = sorted(data.edges)
    lines = [("line", data.edges[name]) for name in names]
    tags = [np.full(len(data.triangles), 9), *(np.full(len(data.edges[name]), k) for k, name in enumerate(names, 1))]
    points = np.pad(data.points, ((0, 0), (0, 1)))
    field_data = {name: np.array([k, 1]) for k, name in enumerate(names, 1)}
    mesh = meshio.Mesh(
        points,
        [("triangle", data.triangles), *lines],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data=field_data,
    )
    found = []
    for kind, binary in (("gmsh22", False), ("gmsh22", True)):
        found.append(folder / f"wheel_{kind}_{binary}.msh")
        mesh.write(found[-1], file_format=kind, binary=binary)
    arrays = {name: [(tag == k).astype(int) for tag in tags] for k, name in enumerate(names, 1)}
    for suffix in (".vtk", ".vtu"):
        found.append(folder / f"wheel{suffix}")
        meshio.Mesh(points, [("triangle", data.triangles), *lines], cell_data=arrays).write(found[-1])
    (folder / "wheel_41.msh").write_bytes((meshes / "wheel.msh").read_bytes())
    found.append(folder / "wheel_41.msh")
    for k, dialect in enumerate(READ):
        found.append(folder / f"deck{k}.inp")
        found[-1].write_bytes(READ[dialect]().encode("latin-1"))
    return found


def damage(content: bytes, rng: np.random.Generator) -> bytes:
    """The content with one to four kinds of damage."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 4]))):
        content = _damage_once(content, rng)
    return content


def _damage_once(content: bytes, rng: np.random.Generator) -> bytes:
    size = max(1, len(content))
    at, other = sorted(int(k) for k in rng.integers(0, size, 2))
    match int(rng.integers(0, 7)):
        case 0:  # a bit
            turned = bytearray(content or b"\0")
            turned[min(at, len(turned) - 1)] ^= 1 << int(rng.integers(0, 8))
            return bytes(turned)
        case 1:  # cut off
            return content[:other]
        case 2:  # a piece lost
            return content[:at] + content[min(other, at + int(rng.integers(1, 400))) :]
        case 3:  # a piece twice
            return content[:at] + content[max(0, at - int(rng.integers(1, 400))) :]
        case 4 | 5:  # a number or word replaced
            words = list(re.finditer(rb"[^\s,]+", content[at : at + 4000]))
            if not words:
                return content
            word = words[int(rng.integers(0, len(words)))]
            new = ODD[int(rng.integers(0, len(ODD)))]
            return content[: at + word.start()] + new + content[at + word.end() :]
        case _:  # noise
            return content[:at] + rng.bytes(int(rng.integers(1, 50))) + content[at:]


def check_sound(data: MeshData) -> None:
    """What a file that was read must be, whatever was done to it."""
    assert np.isfinite(data.points).all()
    assert (data.points[:, 0] >= -1e-6).all()
    assert np.abs(doubled_area(data.points, data.triangles)).min() > 0.0
    assert {"bore", "pushed"} <= set(data.edges)
    for pairs in data.edges.values():
        assert len(pairs)
        assert pairs.min() >= 0
        assert pairs.max() < len(data.points)
