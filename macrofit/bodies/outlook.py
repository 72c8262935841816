"""What the drawn, undeformed bodies of a scene tell before anything is computed."""

from __future__ import annotations

import math

import numpy as np

from ..base.arrays import FloatArray
from ..errors import MacrofitError
from ..scene import MeshFile, Scene
from .geometry import Generatrix, Sizes, draw_body
from .mesh import read_mesh


def first_touch(scene: Scene) -> float | None:
    """The first planned displacement [mm] at which the drawn, undeformed bodies overlap.

    None where they never do, or where a body comes from a file.
    """
    if isinstance(scene.axle, MeshFile) or isinstance(scene.wheel, MeshFile):
        return None
    seat = draw_body(scene.axle, "seat", Sizes.of(scene.mesh, "seat")).generatrix
    bore = draw_body(scene.wheel, "bore", Sizes.of(scene.mesh, "bore")).generatrix
    radial = scene.direction == "radial"
    for displacement in scene.displacements:
        if overlap(seat, bore, displacement, 0.1, radial=radial) > 0.0:
            return displacement
    return None


def overlap(seat: Generatrix, bore: Generatrix, displacement: float, every: float, *, radial: bool) -> float:
    """How deep the undeformed bodies overlap [mm], looked for ``every`` mm; negative for a gap, -inf side by side."""
    shift, advance = (displacement, 0.0) if radial else (0.0, displacement)
    first = max(float(seat.breaks[0]), float(bore.breaks[0]) + shift)
    last = min(float(seat.breaks[-1]), float(bore.breaks[-1]) + shift)
    if first > last:
        return -math.inf
    s = np.linspace(first, last, max(2, round((last - first) / every) + 1))
    gap = bore.height(s - shift) - seat.height(s) if radial else seat.height(s) - bore.height(s) - advance
    return float(-gap.min())


def seat_ends(scene: Scene) -> FloatArray | None:
    """Facet ends of the seat [mm] from the scene alone, for a run that ended before its solution."""
    if not isinstance(scene.axle, MeshFile):
        return draw_body(scene.axle, "seat", (sizes := Sizes.of(scene.mesh, "seat"))).generatrix.nodes(sizes)
    if scene.mesh.axle is None:
        return None
    try:
        mesh = read_mesh(scene.mesh.axle, "axle")
    except MacrofitError:
        return None
    column = 1 if scene.direction == "radial" else 0
    coordinates: FloatArray = np.unique(mesh.points[mesh.edges["seat"], column])
    return coordinates
