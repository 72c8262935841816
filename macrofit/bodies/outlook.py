"""What the drawn, undeformed bodies of a scene tell before anything is computed."""

from __future__ import annotations

import numpy as np

from ..base.arrays import FloatArray
from ..errors import MacrofitError
from ..scene import MeshFile, Scene
from .geometry import Sizes, draw_body
from .mesh import read_mesh


def first_touch(scene: Scene) -> float | None:
    """The first planned displacement [mm] at which the drawn, undeformed bodies overlap.

    None where they never do, or where a body comes from a file.
    """
    if isinstance(scene.axle, MeshFile) or isinstance(scene.wheel, MeshFile):
        return None
    seat = draw_body(scene.axle, "seat", Sizes.of(scene.mesh, "seat")).generatrix
    bore = draw_body(scene.wheel, "bore", Sizes.of(scene.mesh, "bore")).generatrix
    ends = (seat.breaks[[0, -1]], bore.breaks[[0, -1]])
    radial = scene.direction == "radial"
    for displacement in scene.displacements:
        shift, advance = (displacement, 0.0) if radial else (0.0, displacement)
        first, last = max(ends[0][0], ends[1][0] + shift), min(ends[0][1], ends[1][1] + shift)
        if first > last:
            continue
        s = np.linspace(first, last, max(2, round((last - first) / 0.1) + 1))
        gap = bore.height(s - shift) - seat.height(s) if radial else seat.height(s) - bore.height(s) - advance
        if gap.min() < 0.0:
            return displacement
    return None


def seat_ends(scene: Scene) -> FloatArray | None:
    """Facet ends of the seat [mm] from the scene alone, for a run that ended before its solution."""
    if not isinstance(scene.axle, MeshFile):
        return draw_body(scene.axle, "seat", (sizes := Sizes.of(scene.mesh, "seat"))).generatrix.nodes(sizes)
    if scene.mesh.axle is None:
        return None
    try:
        mesh = read_mesh(scene.mesh.axle, "axle", scene.mesh.unit)
    except MacrofitError:
        return None
    column = 1 if scene.direction == "radial" else 0
    coordinates: FloatArray = np.unique(mesh.points[mesh.edges["seat"], column])
    return coordinates
