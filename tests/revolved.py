"""Bodies of revolution on plain grids, for tests of harmonics."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from macrofit.bodies.discretisation import Discretisation
from macrofit.bodies.elasticity import weak_form
from macrofit.bodies.fenics import discretise
from macrofit.bodies.mesh import MeshData
from macrofit.scene.material import Material
from macrofit.service.elements import moduli, strain_operators
from macrofit.service.harmonics import HarmonicBody

FloatArray = npt.NDArray[np.float64]


def grid(
    inner: float, outer: float, length: float, across: int, along: int, *, both_held: bool = False
) -> Discretisation:
    """A ring or a solid shaft (inner = 0), z from 0 to its held end, in 2 across along triangles of order 2."""
    return mesh_of(np.linspace(inner, outer, across + 1), np.linspace(0.0, length, along + 1), both_held=both_held)


def mesh_of(r: FloatArray, z: FloatArray, *, both_held: bool = False, inside: bool = False) -> Discretisation:
    """The same between given radii and places; its contact line is the outer surface, or the one ``inside``."""
    points = np.stack(np.meshgrid(r, z, indexing="ij"), axis=2).reshape(-1, 2)
    number = np.arange(len(points)).reshape(len(r), len(z))
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack(cell, axis=2).reshape(-1, 3) for cell in ((a, b, c), (a, c, d))])
    held = [number[:, -1], *([number[:, 0]] if both_held else [])]
    lines = {"seat": [number[0 if inside else -1]], "held": held}
    edges = {
        name: np.array([pair for line in parts for pair in pairwise(line.tolist())]) for name, parts in lines.items()
    }
    data = MeshData(points=points, triangles=triangles.astype(np.int64), edges=edges)
    return discretise(data, 2, weak_form, (1.0, 1.0))


def revolved(space: Discretisation, material: Material, *, floats: bool = False) -> HarmonicBody:
    """A body with its outer surface as contact line."""
    trace = np.unique(space.edge_nodes("seat"))
    return HarmonicBody(space, material, trace, floats=floats, name="axle")


def stress_at(body: HarmonicBody, n: int, displacement: npt.NDArray[np.complex128], points: FloatArray) -> FloatArray:
    """Amplitudes of stress (cells, points, 6) at reference points (q, 2) of every cell."""
    space = body.space
    first, second, _ = strain_operators(space.order, space.nodes[space.cells[:, :3]], points)
    unknowns = displacement.real.reshape(-1, 3)[space.cells].reshape(len(space.cells), -1)
    return np.einsum("mqib,mb->mqi", first + n * second, unknowns) @ moduli(body.material)


def places(body: HarmonicBody, points: FloatArray) -> FloatArray:
    """(r, z) of reference points in every cell (cells, points, 2)."""
    corners = body.space.nodes[body.space.cells[:, :3]]
    shares = np.column_stack([1.0 - points.sum(axis=1), points])
    return np.einsum("qv,mvi->mqi", shares, corners)
