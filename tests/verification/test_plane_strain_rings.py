"""Rings in plane strain that yield on elastic shafts: held on both faces, by the groups of their mesh files.

Both are 2 mm high, and nothing moves along the axis: the groups `held` and `pushed` are of both faces.
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI
from verification.plane_stress_ring import PlaneStrainRing, shrink_fit
from verification.test_plastic_rings import HEIGHT, NU, A, E

from macrofit.scene import load_scene
from macrofit.solve import solve

COMPLIANCE = A / E * (1.0 + NU) * (1.0 - 2.0 * NU)
TABLE = {0.15: 108.91, 0.20: 142.68, 0.25: 165.09, 0.30: 179.08}
"""Pressure [MPa] of a ring of 152 mm by radial interference [mm], both radii at 95 mm, 355 MPa: by others."""


def write(path: Path, inner: float, outer: float, low: float, line: tuple[str, float], faces: str, size: float) -> Path:
    """A rectangle of triangles: contact line at a radius [mm], both faces in one group, the axis where there is one."""
    across, rows = round((outer - inner) / size), round(HEIGHT / size)
    r, z = np.meshgrid(np.linspace(inner, outer, across + 1), low + np.linspace(0.0, HEIGHT, rows + 1), indexing="ij")
    points = np.stack([r.ravel(), z.ravel(), np.zeros(r.size)], axis=1)
    number = np.arange(r.size).reshape(r.shape)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    edges = np.concatenate([np.stack(p, axis=1) for p in (
        (number[:-1, 0], number[1:, 0]), (number[:-1, -1], number[1:, -1]),
        (number[0, :-1], number[0, 1:]), (number[-1, :-1], number[-1, 1:]),
    )])  # fmt: skip
    middle = points[edges].mean(axis=1)
    flat = (middle[:, 1] == low) | (middle[:, 1] == low + HEIGHT)
    groups = {faces: flat, line[0]: middle[:, 0] == line[1], "axis": middle[:, 0] == 0.0}
    blocks = [("triangle", triangles), *(("line", edges[there]) for there in groups.values() if there.any())]
    names = ["body", *(name for name, there in groups.items() if there.any())]
    tags = [np.full(len(cells), k) for k, (_, cells) in enumerate(blocks, 1)]
    mesh = meshio.Mesh(
        points, blocks, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array([k, 2 if k == 1 else 1]) for k, name in enumerate(names, 1)},
    )  # fmt: skip
    mesh.write(path, file_format="gmsh22", binary=False)
    return path


def pressure(folder: Path, outer: float, interference: float, size: float = 1.0, *more: str) -> float:
    """Mean pressure on the seat [MPa]."""
    shaft = write(folder / "axle.msh", 0.0, A, 0.0, ("seat", A), "held", size)
    bore = A - interference
    ring = write(folder / "wheel.msh", bore, outer, -HEIGHT, ("bore", bore), "pushed", size)
    scene = folder / "ring.toml"
    scene.write_text(
        f'[axle]\nshape = "mesh"\n[wheel]\nshape = "mesh"\nmaterial = {{ yield_stress = 355.0 }}\n'
        f"[motion]\nstart = {HEIGHT}\ntravel = {HEIGHT}\n[friction.options]\ncoefficient = 0.0\n"
        f'[mesh]\naxle = "{shaft.name}"\nwheel = "{ring.name}"\n[output]\nstress = false\nfields_at = []\n'
    )
    solution = solve(load_scene(scene, list(more)), MPI.COMM_SELF)
    return solution.increments[-1].normal_force / (2.0 * np.pi * A * HEIGHT)


def reference(outer: float, interference: float, bore: float | None = None) -> float:
    ring = PlaneStrainRing(A - interference if bore is None else bore, outer, E, NU, 355.0, elements=400)
    return shrink_fit(ring, A, COMPLIANCE, interference)


@pytest.mark.parametrize("interference", TABLE)
def test_the_reference_gives_the_known_table(interference: float) -> None:
    assert reference(152.0, interference, bore=A) == pytest.approx(TABLE[interference], rel=3e-4)


@pytest.mark.parametrize("interference", TABLE)
@pytest.mark.parametrize("outer", [152.0, 140.0])
def test_pressure_of_a_ring_held_on_both_faces(outer: float, interference: float, tmp_path: Path) -> None:
    """The whole interference comes in one step, whose path the law follows to 2e-4; the mesh leaves 1e-6."""
    assert pressure(tmp_path, outer, interference) == pytest.approx(reference(outer, interference), rel=4e-4)


def test_facets_hardly_matter(tmp_path: Path) -> None:
    """... and shorter ones come nearer to what still shorter ones give."""
    coarse, middle, fine = (pressure(tmp_path, 152.0, 0.3, size) for size in (2.0, 1.0, 0.5))
    print(f"2, 1, 0.5 mm: {coarse:.6f} {middle:.6f} {fine:.6f} MPa")
    assert abs(middle - fine) < abs(coarse - fine)
    assert middle == pytest.approx(fine, rel=2e-6)
