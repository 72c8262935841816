"""Bodies of revolution on plain grids, for tests of harmonics."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from macrofit.bodies.elasticity import weak_form
from macrofit.bodies.fenics import Discretisation, discretise
from macrofit.bodies.mesh import MeshData
from macrofit.scene.material import Material
from macrofit.service.harmonics import HarmonicBody

FloatArray = npt.NDArray[np.float64]


def grid(inner: float, outer: float, length: float, across: int, along: int, order: int = 2) -> Discretisation:
    """A ring or a solid shaft (inner = 0), z from 0 to its held end, in 2 across along triangles."""
    r, z = np.linspace(inner, outer, across + 1), np.linspace(0.0, length, along + 1)
    points = np.stack(np.meshgrid(r, z, indexing="ij"), axis=2).reshape(-1, 2)
    number = np.arange(len(points)).reshape(across + 1, along + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack(cell, axis=2).reshape(-1, 3) for cell in ((a, b, c), (a, c, d))])
    lines = {"seat": number[-1], "held": number[:, -1], "bore": number[0]}
    edges = {name: np.array(list(pairwise(line.tolist()))) for name, line in lines.items()}
    data = MeshData(points=points, triangles=triangles.astype(np.int64), edges=edges)
    return discretise(data, order, weak_form, (1.0, 1.0))


def revolved(space: Discretisation, material: Material, *, floats: bool = False) -> HarmonicBody:
    """A body with its outer surface as contact line."""
    trace = np.unique(space.edge_nodes("seat"))
    return HarmonicBody(space, material, trace, floats=floats, name="axle")
