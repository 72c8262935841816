"""Whether a drawing can be meshed: gmsh ends the process, or the memory, where lengths differ beyond measure."""

from __future__ import annotations

import numpy as np

from ..errors import MeshError
from .geometry import Drawing

SHORTEST_EDGE = 1e-5
"""Shortest edge of an outline off the contact line, in its size: gmsh tells points apart by 1e-8 of it or so."""

SHORTEST_FACET = 1e-7
"""Shortest facet of a contact line, in the size of the outline."""

MOST_ELEMENTS = 4e6
"""Their stiffness and its factors take tens of GiB."""


def check_drawing(drawing: Drawing, coarse: float, growth: float) -> None:
    """Whether an outline's edges are of comparable lengths, and its elements countable.

    Args:
        drawing: of a body.
        coarse: largest element [mm].
        growth: of the element size with the distance from the contact line [mm/mm].

    Raises:
        MeshError: which edge is too short, or that there would be too many elements.
    """
    starts, ends = (np.array([getattr(edge, name) for edge in drawing.edges]) for name in ("start", "end"))
    contact = np.array([edge.name == drawing.contact for edge in drawing.edges])
    body = "axle" if drawing.contact == "seat" else "wheel"
    size = float(np.hypot(*np.ptp(starts, axis=0)))
    extent = np.abs(ends - starts)
    along = extent[:, 1] if np.ptp(starts[contact, 1]) >= np.ptp(starts[contact, 0]) else extent[:, 0]
    length = np.where(contact, along, np.hypot(*extent.T))
    short = length < np.where(contact, SHORTEST_FACET, SHORTEST_EDGE) * size
    if short.any():
        k = int(np.argmax(short))
        r, z = 0.5 * (starts[k] + ends[k])
        raise MeshError(
            f"{body}: its outline of {size:.4g} mm has an edge of {length[k]:.3g} mm at (r, z) = ({r:.6g}, {z:.6g}), "
            f"too short to be meshed; look for the length in [{body}] that is so small or so large, or leave it out (0)"
        )
    area = 0.5 * abs(float(np.sum(starts[:, 0] * ends[:, 1] - ends[:, 0] * starts[:, 1])))
    elements = _elements(
        area, float(along[contact].sum()), drawing.sizes.facet, max(coarse, drawing.sizes.facet), growth
    )
    if not elements <= MOST_ELEMENTS:
        raise MeshError(
            f"{body}: its outline of {size:.4g} mm would take some {elements:.2g} elements, more than "
            f"{MOST_ELEMENTS:.0e}: check its lengths, or raise mesh.coarse, mesh.growth or the facets"
        )


def _elements(area: float, line: float, facet: float, coarse: float, growth: float) -> float:
    """About how many triangles of side h = min(coarse, facet + growth d) fill an area around a contact line.

    At the distance d from the line lies a strip of length line + pi d / 2, up to where all the area is counted.
    """
    quarter = 0.25 * np.pi
    farthest = 2.0 * area / (line + np.sqrt(line**2 + 4.0 * quarter * area))
    d = np.append(0.0, np.geomspace(1e-9, 1.0, 400)) * farthest
    density = (line + 2.0 * quarter * d) * (1.0 / np.minimum(coarse, facet + growth * d)) ** 2  # a side of 1e300 counts
    return float((0.5 * (density[1:] + density[:-1]) * np.diff(d)).sum()) / 0.43  # area of an equilateral triangle
