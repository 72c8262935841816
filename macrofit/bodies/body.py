"""A body: its elements, its supports, and its compliance condensed on the contact line.

Vectors on trace nodes are component-major: the r components of all nodes, then the z components. The trace nodes
are those of the contact line, in ascending coordinate, followed (on the seat, for Nitsche) by the other nodes of the
adjacent cells, which the traction of the bulk stress depends on.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray
from ..base.cholmod import Factor, FactorError, NotDefiniteError, factor
from ..errors import MeshError
from ..scene.keys import MeshFile, Scene
from ..scene.material import Material
from .approach import Side, beside_line
from .discretisation import Discretisation
from .gauss import GaussPoints
from .geometry import Generatrix, Sizes, draw_body, polyline, with_profile
from .mesh import mesh_drawing, read_mesh
from .pieces import condensed, divided
from .stiffness import elastic_space
from .triangles import ordered_line

SUPPORTS = (("axis", 0), ("held", 1), ("pushed", 1))  # boundary, component that is zero there


@dataclass(frozen=True, kw_only=True)
class ContactLine:
    """A contact line of f facets and what its interface operators need of the bulk behind it."""

    order: int
    radial: bool  # True: the gap is radial, the coordinate is z; False: axial, r
    generatrix: Generatrix
    nodes: FloatArray  # (f order + 1, 2) points (r, z) [mm]
    normals: FloatArray  # (f, 2) outward unit normal (n_r, n_z)
    corners: FloatArray  # (f, 3, 2) vertices of the adjacent cell [mm]
    ends: IntArray  # (f, 2) local vertices of that cell where the facet starts and ends
    cells: IntArray  # (f, b) trace nodes of the adjacent cell
    trace_nodes: int
    material: Material
    beside: FloatArray  # (k, 2, 2) edges of a file's body where no contact is looked for, see `approach.Side` [mm]

    @property
    def facets(self) -> int:
        """Number of facets f."""
        return len(self.normals)

    @property
    def side(self) -> Side:
        """The line before it deforms, for `approach.check_approach`."""
        outward = np.sign(self.normals[:, 0 if self.radial else 1]).mean()
        return Side(line=self.generatrix, beside=self.beside, outward=float(outward))

    @property
    def coordinate(self) -> FloatArray:
        """(f + 1,) coordinates of the facet ends [mm]."""
        return self.nodes[:: self.order, 1 if self.radial else 0]

    @property
    def height(self) -> FloatArray:
        """(f + 1,) heights of the facet ends [mm]."""
        return self.nodes[:: self.order, 0 if self.radial else 1]

    @property
    def radius(self) -> FloatArray:
        """(f + 1,) distances of the facet ends from the axis [mm]."""
        return self.nodes[:: self.order, 0]

    @property
    def length(self) -> FloatArray:
        """(f,) lengths of the facets [mm]."""
        ends = self.nodes[:: self.order]
        return np.asarray(np.hypot(*(ends[1:] - ends[:-1]).T))


@dataclass(frozen=True)
class CondensedBody:
    """What the interface problem knows of a body: u = compliance @ load on its trace nodes."""

    line: ContactLine
    compliance: FloatArray  # (2 trace nodes, 2 loaded nodes) [mm/N]
    dofs: int


class Body:
    """One elastic body on this rank."""

    def __init__(self, scene: Scene, which: str) -> None:
        """Mesh, assemble and support the ``which`` ("axle" or "wheel") of a scene.

        Raises:
            MeshError: a file has no usable contact line.
        """
        self.which = which
        contact = "seat" if which == "axle" else "bore"
        spec = scene.axle if which == "axle" else scene.wheel
        self.material = spec.material
        keys = scene.mesh
        if isinstance(spec, MeshFile):
            data, generatrix = read_mesh(str(getattr(keys, which)), which, keys.unit), None
        else:
            drawing = draw_body(spec, contact, Sizes.of(keys, contact))
            facets = sum(edge.name == contact for edge in drawing.edges)
            self._fits(facets, 2 * (keys.order * facets + 1))
            data, generatrix = mesh_drawing(drawing, keys.coarse, keys.growth), drawing.generatrix
        self.space = elastic_space(data, keys.order, self.material)
        self.line, self.trace, self.line_cells = _contact_line(
            self.space,
            contact,
            which,
            generatrix,
            self.material,
            middles=data.middles.get(contact),
            beside=beside_line(data, contact) if generatrix is None else np.zeros((0, 2, 2)),
            radial=scene.direction == "radial",
            with_cells=which == "axle" and scene.contact.formulation == "nitsche",
        )
        self.line = replace(self.line, generatrix=with_profile(self.line.generatrix, scene, which))
        self.supported = np.zeros((len(self.space.nodes), 2), dtype=bool)
        for name, component in SUPPORTS:
            if name in self.space.edges:
                self.supported[self.space.edge_nodes(name).ravel(), component] = True
        self.free = np.flatnonzero(~self.supported)
        self.stabilisation: sp.csr_matrix | None = None
        self.factorisations = 0
        self.back_substitutions = 0

    @cached_property
    def gauss(self) -> GaussPoints:
        """Its Gauss points, for stresses and for flow."""
        return GaussPoints(self.space)

    @cached_property
    def kept_factor(self) -> Factor:
        """The factor of K in the order with the least entries, made when it is first needed."""
        return self._factored()

    @property
    def dofs(self) -> int:
        """Unknowns of the body, supports included."""
        return 2 * len(self.space.nodes)

    @property
    def trace_dofs(self) -> IntArray:
        """Degrees of freedom of the trace nodes, component-major."""
        return np.concatenate([2 * self.trace, 2 * self.trace + 1])

    @property
    def stiffness(self) -> sp.csr_matrix:
        """K, with the stabilisation of the contact formulation where there is one."""
        if self.stabilisation is None:
            return self.space.stiffness
        dofs = self.trace_dofs
        entries = self.stabilisation.tocoo()
        shape = self.space.stiffness.shape
        extra = sp.csr_matrix((entries.data, (dofs[entries.row], dofs[entries.col])), shape=shape)
        return (self.space.stiffness + extra).tocsr()

    def condense(self, *, load_trace: bool) -> CondensedBody:
        """Eliminate the bulk: no right-hand side, and pieces of the body where the line is long, see `pieces`.

        With ``load_trace`` every trace node is loaded, otherwise those of the contact line only.

        Raises:
            MeshError: K is not definite, or larger than this machine's memory.
        """
        loaded = len(self.trace) if load_trace else len(self.line.nodes)
        self._fits(self.line.facets, 2 * len(self.trace))
        own, others = self.trace[:loaded], self.trace[loaded:]
        middles = self.space.nodes[self.space.cells[:, :3], 1 if self.line.radial else 0].mean(axis=1)
        piece = divided(self.line.coordinate, middles, 2 * loaded)
        with self._definite():
            compliance = condensed(self._supported_stiffness(), self.space.cells, piece, own, others)
        held = np.flatnonzero(self.supported[own].T)
        rows = held + (len(self.trace) - loaded) * (held >= loaded)
        compliance[rows, held] = 0.0  # 1 stands for a support, see `_supported_stiffness`
        return CondensedBody(self.line, compliance, self.dofs)

    def _factored(self) -> Factor:
        """The factor of K.

        Raises:
            MeshError: the body can move freely, theta / gamma0 took its coercivity, or the factor is too large.
        """
        with self._definite():
            return factor(self._supported_stiffness(), None, 2)

    def _supported_stiffness(self) -> sp.csr_matrix:
        """K where a supported unknown has 1 on its diagonal and nothing else."""
        free = sp.diags((~self.supported).ravel().astype(np.float64))
        held = sp.diags(self.supported.ravel().astype(np.float64))
        return (free @ self.stiffness @ free + held).tocsr()

    @contextmanager
    def _definite(self) -> Iterator[None]:
        """Count a factorisation; what prevents it is an error of the mesh."""
        self.factorisations += 1
        try:
            yield
        except NotDefiniteError:
            raise MeshError(
                f"the stiffness of the {self.which} is not positive definite: check its supports, "
                f"or raise contact.gamma0 (theta = 1 needs 15 to 30 with order 2, 5 to 10 with order 1)"
            ) from None
        except FactorError as error:
            raise MeshError(f"the {self.which}: {error}; take a coarser mesh (mesh.coarse, mesh.growth)") from None

    def _fits(self, facets: int, unknowns: int) -> None:
        """A MeshError where the dense matrices of the contact line, four of them at once, exceed the memory."""
        needed, there = 4 * 8 * unknowns**2, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        if needed > there:
            raise MeshError(
                f"the {facets} facets of the {self.which}'s contact line take {needed / 2**30:.0f} GiB, and "
                f"this machine has {there / 2**30:.0f}: lengthen mesh.seat_facet, mesh.bore_facet or mesh.corner_facet"
            )

    def back_substitute(self, loads: FloatArray) -> FloatArray:
        """Displacement of every node, (dofs, k), from loads on the trace nodes (2 loaded nodes, k) [N]."""
        loaded = loads.shape[0] // 2
        dofs = self.trace_dofs.reshape(2, -1)[:, :loaded].ravel()
        rhs = np.zeros((loads.shape[1], self.dofs)).T  # by columns, as the factor takes them
        rhs[dofs] = loads
        return self._solved(rhs)

    def solve(self, loads: FloatArray) -> FloatArray:
        """Displacement of every node, (dofs, k) [mm], from nodal loads (dofs, k) [N]; loads on supports do nothing."""
        return self._solved(np.array(loads, order="F"))

    def _solved(self, loads: FloatArray) -> FloatArray:
        """As `solve`, for loads that are overwritten."""
        loads[self.supported.ravel()] = 0.0
        self.back_substitutions += loads.shape[1]
        return np.ascontiguousarray(self.kept_factor.solve(loads))  # by rows, as products with sparse matrices take it

    def reaction(self, displacement: FloatArray, loads: FloatArray, inner: FloatArray | None = None) -> FloatArray:
        """Axial force [N] of the support ("held" or "pushed") on the body, (k,).

        displacement (dofs, k) under the loads (2 loaded nodes, k) on the trace and those of plastic strains, ``inner``
        (dofs, k); what is loaded on the support's own nodes (a corner shared with the contact line) goes straight
        into it.
        """
        nodes, rows = self._support
        axial = loads[len(loads) // 2 :]
        direct = axial[np.isin(self.trace[: len(axial)], nodes)].sum(axis=0)
        if inner is not None:
            direct = direct + inner[2 * nodes + 1].sum(axis=0)
        return np.asarray((rows @ displacement).sum(axis=0) - direct)

    @cached_property
    def _support(self) -> tuple[IntArray, sp.csr_matrix]:
        """The nodes of the axial support, and the rows of K that give its force."""
        nodes = np.unique(self.space.edge_nodes("held" if self.which == "axle" else "pushed"))
        return nodes, self.stiffness[2 * nodes + 1]


def _contact_line(
    space: Discretisation,
    contact: str,
    which: str,
    generatrix: Generatrix | None,
    material: Material,
    *,
    middles: FloatArray | None,
    beside: FloatArray,
    radial: bool,
    with_cells: bool,
) -> tuple[ContactLine, IntArray, IntArray]:
    """The line with its facets in order, the numbers of its trace nodes, and the cells behind its facets."""
    axis = 1 if radial else 0
    cell, a, b = space.edges[contact].T
    pairs = np.stack([space.cells[cell, a], space.cells[cell, b]], axis=1)
    turn, order = ordered_line(space.nodes, pairs, f"mesh.{which}", contact, radial=radial)
    a, b = np.where(turn, b, a)[order], np.where(turn, a, b)[order]
    cell = cell[order]
    first, last = space.cells[cell, a], space.cells[cell, b]
    chain = np.append(first, last[-1])
    if space.order == 2:
        chain = np.insert(chain, np.arange(1, len(chain)), space.cells[cell, 3 + (3 - a - b)])
    others = np.setdiff1d(space.cells[cell], chain) if with_cells else np.empty(0, dtype=np.int64)
    trace = np.concatenate([chain, others])
    number = np.full(len(space.nodes), -1, dtype=np.int64)
    number[trace] = np.arange(len(trace))
    corners = space.nodes[space.cells[cell, :3]]
    start, end = space.nodes[first], space.nodes[last]
    tangent = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    normals = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    inward = np.einsum("fi,fi->f", normals, corners.mean(axis=1) - start) > 0.0
    normals[inward] *= -1.0
    if generatrix is None:
        ends = np.append(start, end[-1:], axis=0)
        along = [axis, 1 - axis]
        generatrix = polyline(ends[:, along], None if middles is None else middles[order][:, along])
    line = ContactLine(
        order=space.order,
        radial=radial,
        generatrix=generatrix,
        nodes=space.nodes[chain],
        normals=normals,
        corners=corners,
        ends=np.stack([a, b], axis=1),
        cells=number[space.cells[cell]],
        trace_nodes=len(trace),
        material=material,
        beside=beside,
    )
    return line, trace, cell
