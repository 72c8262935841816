"""What the drawn, undeformed bodies of a scene tell before anything is computed."""

from __future__ import annotations

import math

import numpy as np

from ..base.arrays import FloatArray
from ..errors import MacrofitError
from ..scene import MeshFile, Scene
from .approach import check_approach, first_overlap, sides_of
from .geometry import Generatrix, Sizes, draw_body
from .mesh import read_mesh


def first_touch(scene: Scene) -> float | None:
    """The first planned displacement [mm] at which the undeformed bodies overlap; None where they never do.

    Raises:
        MeshError: a file cannot be read.
        SceneError: the bodies cannot be pressed together, see `check_approach`.
    """
    seat, bore = sides_of(scene)
    check_approach(scene, seat, bore)
    return first_overlap(seat, bore, scene.displacements, radial=scene.direction == "radial")


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
        mesh = read_mesh(scene.mesh.axle, "axle", scene.mesh.unit)
    except MacrofitError:
        return None
    column = 1 if scene.direction == "radial" else 0
    coordinates: FloatArray = np.unique(mesh.points[mesh.edges["seat"], column])
    return coordinates
