"""Write the mesh files of this folder anew: the two bodies of a coarse `wheelset`, as a user's own meshes.

    .venv/bin/python meshes/regenerate.py [FOLDER]

No dimension stands here: they come from the built-in scene.
"""

from __future__ import annotations

import sys
from pathlib import Path

import meshio
import numpy as np

from macrofit.bodies.geometry import draw
from macrofit.bodies.mesh import MeshData, mesh_drawing
from macrofit.scene import load_scene

SIZES = ("mesh.seat_facet=5.0", "mesh.bore_facet=4.7", "mesh.coarse=40")


def as_meshio(data: MeshData) -> meshio.Mesh:
    """A mesh with the named edges as gmsh physical groups and, for other formats, as cell sets."""
    names = sorted(data.edges)
    points = np.column_stack([data.points, np.zeros(len(data.points))])
    cells = [("triangle", data.triangles)] + [("line", data.edges[name]) for name in names]
    tags = [np.full(len(block), number) for number, (_, block) in enumerate(cells, start=1)]
    return meshio.Mesh(
        points,
        cells,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={
            "body": np.array([1, 2]),
            **{name: np.array([k, 1]) for k, name in enumerate(names, start=2)},
        },
    )


def main(folder: Path) -> None:
    """Write axle.msh and wheel.msh."""
    scene = load_scene("wheelset", SIZES)
    for name, body, contact, facet in (
        ("axle", scene.axle, "seat", scene.mesh.seat_facet),
        ("wheel", scene.wheel, "bore", scene.mesh.bore_facet),
    ):
        assert facet is not None
        data = mesh_drawing(draw(body, contact, facet), scene.mesh.coarse, scene.mesh.growth)
        meshio.write(folder / f"{name}.msh", as_meshio(data), file_format="gmsh22", binary=False)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
