"""A wheel bonded to a hollow axle in three dimensions: half of it, of curved hexahedra of order 2, by dolfinx."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI

from macrofit.base.arrays import FloatArray, IntArray
from macrofit.base.cholmod import factor
from macrofit.scene.material import Material


@dataclass(frozen=True, kw_only=True)
class Solid:
    """Where the hexahedra stand: radii, with the seat's among them, places along the axle, and of the hub [mm]."""

    radii: FloatArray
    seat: float
    places: FloatArray
    hub: tuple[float, float]
    sectors: int  # of the half circle


@dataclass(frozen=True, kw_only=True)
class Loads:
    """On the front end V (to the angle 0) and M (compresses there), at one point of the rim a force."""

    front: Any  # tractions (n, 3) at points (n, 3) of the front end: to x, y, z [MPa]
    rim: tuple[float, float, float]  # place and force: r, z [mm], towards the axle [N]


def half_solid(solid: Solid) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and cells (m, 27) in the order of basix."""
    r, z, angle = (between(each) for each in (solid.radii, solid.places, np.linspace(0.0, np.pi, solid.sectors + 1)))
    size = (len(r), len(z), len(angle))
    number = np.arange(np.prod(size)).reshape(size)
    first = np.stack(np.meshgrid(*(np.arange(0, n - 1, 2) for n in size), indexing="ij"), axis=-1).reshape(-1, 3)
    middle_r, middle_z = r[first[:, 0] + 1], z[first[:, 1] + 1]
    first = first[(middle_r < solid.seat) | ((middle_z > solid.hub[0]) & (middle_z < solid.hub[1]))]
    cell = basix.create_element(basix.ElementFamily.P, basix.CellType.hexahedron, 2, basix.LagrangeVariant.gll_warped)
    inside = np.rint(2.0 * cell.points).astype(np.int64)
    cells = number[tuple(np.moveaxis(first[:, None] + inside, 2, 0))]
    used, renumbered = np.unique(cells, return_inverse=True)
    i, k, j = np.unravel_index(used, size)
    points = np.column_stack([r[i] * np.cos(angle[j]), r[i] * np.sin(angle[j]), z[k]])
    return points, renumbered.reshape(cells.shape)


def between(ends: FloatArray) -> FloatArray:
    """Ends and middles of intervals."""
    return np.interp(np.arange(2 * len(ends) - 1) / 2.0, np.arange(len(ends)), ends)


def vectors(points: FloatArray, cells: IntArray) -> tuple[Any, Any]:
    """The mesh and its displacements of order 2, in the words of either version of dolfinx."""
    if hasattr(fem, "functionspace"):
        element = basix.ufl.element("Lagrange", "hexahedron", 2, shape=(3,))
        grid = mesh.create_mesh(MPI.COMM_SELF, cells, points, ufl.Mesh(element))
        return grid, fem.functionspace(grid, ("Lagrange", 2, (3,)))
    grid = mesh.create_mesh(MPI.COMM_SELF, cells, points, ufl.Mesh(ufl.VectorElement("Lagrange", "hexahedron", 2)))
    return grid, fem.VectorFunctionSpace(grid, ("Lagrange", 2))


def solve_half(solid: Solid, loads: Loads, material: Material) -> tuple[FloatArray, FloatArray]:
    """Nodes (n, 3) and displacements (n, 3) of the half, held at its far end along z, and at one point across."""
    grid, space = vectors(*half_solid(solid))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    strain = ufl.sym(ufl.grad(u))
    stress = 2.0 * material.shear_modulus * strain + material.lame_lambda * ufl.tr(strain) * ufl.Identity(3)
    exact = {"quadrature_degree": 5}
    matrix = fem_petsc.assemble_matrix(fem.form(ufl.inner(stress, ufl.sym(ufl.grad(v))) * ufl.dx(metadata=exact)))
    matrix.assemble()
    indptr, indices, entries = matrix.getValuesCSR()
    nodes = space.tabulate_dof_coordinates()[:, :3]
    traction = fem.Function(space)
    traction.x.array[:] = loads.front(nodes).ravel()
    front = ufl.conditional(ufl.lt(ufl.SpatialCoordinate(grid)[2], 1e-6), 1.0, 0.0)
    vector = fem_petsc.assemble_vector(fem.form(front * ufl.inner(traction, v) * ufl.ds(metadata=exact)))
    right = np.array(vector.array)
    r, place, force = loads.rim
    right[3 * nearest(nodes, (r, 0.0, place))] -= 0.5 * force
    far, plane = np.abs(nodes[:, 2] - nodes[:, 2].max()) < 1e-6, np.abs(nodes[:, 1]) < 1e-6
    held = np.stack([np.zeros_like(far), plane, far], axis=1)
    held[nearest(nodes, (solid.seat, 0.0, nodes[:, 2].max())), 0] = True
    free = sp.diags(1.0 - held.ravel().astype(np.float64))
    stiffness = sp.csr_matrix((entries, indices, indptr), shape=(right.size,) * 2)
    right[held.ravel()] = 0.0
    kept = (free @ stiffness @ free + sp.diags(held.ravel().astype(np.float64))).tocsr()
    found = factor(kept, np.array([0]), 3).solve(right[:, None])
    return nodes, found.reshape(-1, 3)


def nearest(nodes: FloatArray, place: tuple[float, float, float]) -> int:
    """The node next to a place."""
    return int(np.argmin(np.linalg.norm(nodes - np.array(place), axis=1)))


def amplitudes(solid: Solid, nodes: FloatArray, moved: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Places z (k,) of the axle's surface and a, b, c (k, 3) of u_r = a cos n t and so on, one-sided."""
    on = np.abs(np.hypot(nodes[:, 0], nodes[:, 1]) - solid.seat) < 1e-6
    angle, z, u = np.arctan2(nodes[on, 1], nodes[on, 0]), nodes[on, 2], moved[on]
    cylinder = np.stack(
        [u[:, 0] * np.cos(angle) + u[:, 1] * np.sin(angle), u[:, 1] * np.cos(angle) - u[:, 0] * np.sin(angle), u[:, 2]]
    )
    order = np.lexsort([angle, np.rint(1e6 * z)])
    turns = 2 * solid.sectors
    field = cylinder[:, order].reshape(3, -1, turns + 1)
    weight = np.full(turns + 1, 2.0 / turns)
    weight[[0, -1]] *= 0.5
    if n == 0:
        weight *= 0.5
    t = np.pi * np.arange(turns + 1) / turns
    waves = np.stack([np.cos(n * t), np.sin(n * t), np.cos(n * t)])
    return z[order][:: turns + 1], np.einsum("ckt,ct,t->kc", field, waves, weight)
