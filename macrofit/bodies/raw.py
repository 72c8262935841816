"""What a mesh file says, before it is judged: points, cells and whatever could name a boundary."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..base.arrays import FloatArray
from .triangles import IntArray


@dataclass(kw_only=True)
class RawMesh:
    """Contents of a mesh file; points are counted from 0, as in ``points``."""

    points: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    triangles: list[IntArray] = field(default_factory=list)  # (m, 3) or, with middles, (m, 6)
    quads: list[IntArray] = field(default_factory=list)  # (m, 4), or with middles (m, 8) or (m, 9)
    lines: dict[str, list[IntArray]] = field(default_factory=dict)  # name -> (k, 2) ends of edges
    nodes: dict[str, list[IntArray]] = field(default_factory=dict)  # name -> points
    others: dict[str, str] = field(default_factory=dict)  # name -> what it holds instead, "elements"
