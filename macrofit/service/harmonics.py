"""A body under loads that vary around it: supported, factored and condensed on its contact line, harmonic by harmonic.

On the axis u is smooth, so that n = 0 has a = b = 0 there, n = 1 has c = 0 and b = -a, and all others are zero. The
held end of the axle is a plane of symmetry, c = 0, which holds torsion too (n = 0: b = 0). What is left free is a
rigid motion of the axle across (n = 1), and of the wheel along (n = 0), around (n = 0), across and in tilt (n = 1).
Single nodes pin these. The pin of the axle is the frame of all displacements; the wheel's motions come back as
unknowns of the fit (see `fit`), so that nothing rests on a pin where the loads balance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import scipy.sparse as sp

from ..base.arrays import BoolArray, FloatArray, IntArray
from ..base.cholmod import Factor, NotDefiniteError, factor
from ..bodies.discretisation import Discretisation
from ..errors import MeshError
from ..scene.material import Material
from .elements import ComplexArray, Stiffness, assemble_harmonic, assemble_harmonics

Amplitudes = TypeVar("Amplitudes", FloatArray, ComplexArray)

NEAR = 1e-9
"""Radius below which a node lies on the axis, in the largest radius of the body."""


@dataclass(frozen=True, kw_only=True)
class Condensed:
    """What a fit needs of a body in one harmonic, once it is factored."""

    compliance: FloatArray  # (3 line nodes, 3 line nodes) [mm/N]
    loads: ComplexArray  # (3 nodes, 1) N
    moved: ComplexArray  # (3 nodes, 1) mm, by these loads


class HarmonicBody:
    """One body in harmonics; displacements and loads are (3 nodes, k) amplitudes, see `elements`."""

    def __init__(self, space: Discretisation, material: Material, trace: IntArray, *, floats: bool, name: str) -> None:
        """A body whose contact line has the nodes ``trace``; one that ``floats`` is held by its fit alone."""
        self.space, self.material, self.trace, self.floats, self.name = space, material, trace, floats, name
        self._factors: dict[int, Factor] = {}
        self._compliances: dict[int, FloatArray] = {}
        self._taken: dict[int, Condensed] = {}
        self.single = False  # whether a single harmonic will be asked for

    @cached_property
    def stiffness(self) -> Stiffness:
        """K_0, K_1, K_2, assembled when first needed."""
        return assemble_harmonics(self.space, self.material)

    def _stiffness_at(self, n: int) -> sp.csr_matrix:
        return assemble_harmonic(self.space, self.material, n) if self.single else self.stiffness.at(n)

    @cached_property
    def on_axis(self) -> BoolArray:
        """Which nodes lie on the axis (nodes,)."""
        radius = self.space.nodes[:, 0]
        return np.asarray(radius < NEAR * radius.max())

    def held(self, n: int) -> BoolArray:
        """Which amplitudes of a harmonic are zero (nodes, 3); on the axis, for n = 1, b stands for a + b."""
        out = np.zeros((len(self.space.nodes), 3), dtype=bool)
        out[self.on_axis] = {0: (True, True, False), 1: (False, True, True)}.get(n, (True, True, True))
        if not self.floats:
            nodes = self.space.edge_nodes("held").ravel()
            out[nodes, 2] = True
            out[nodes, 1] |= n == 0
            if n == 1:
                out[self._outermost(nodes), 0] = True
        elif n < 2:
            pin = self._outermost(np.arange(len(self.space.nodes)))
            out[pin, [1, 2] if n == 0 else [0, 2]] = True
        return out

    def _outermost(self, nodes: IntArray) -> int:
        """The node of the largest radius, where a pin holds a tilt best."""
        return int(nodes[np.argmax(self.space.nodes[nodes, 0])])

    def rigid_motions(self, n: int) -> FloatArray:
        """The motions (3 nodes, k) of a floating body: along and around (n = 0), across and in tilt (n = 1)."""
        r, z = self.space.nodes.T
        zero, one = np.zeros_like(r), np.ones_like(r)
        motions = {
            0: [(zero, zero, one), (zero, r, zero)],
            1: [(one, -one, zero), (z, -z, -r)],
        }.get(n, []) if self.floats else []  # fmt: skip
        columns = [np.stack(motion, axis=1).ravel() for motion in motions]
        return np.stack(columns, axis=1) if columns else np.zeros((3 * len(r), 0))

    def factor_of(self, n: int) -> Factor:
        """The factor of K_n, the contact line last; made once.

        Raises:
            MeshError: K_n is not positive definite.
        """
        if n not in self._factors:
            held = self.held(n).ravel().astype(np.float64)
            turn = self._turn(n)
            free = sp.diags(1.0 - held)
            matrix = free @ turn.T @ self._stiffness_at(n) @ turn @ free + sp.diags(held)
            try:
                # whole blocks: without the zeros of n = 0, where torsion stands alone, supernodes fall to pieces
                self._factors[n] = factor(matrix.tobsr((3, 3)).tocsr(), self.trace, 3)
            except NotDefiniteError:
                raise MeshError(
                    f"the stiffness of the {self.name} in harmonic {n} is not positive definite: check its supports"
                ) from None
        return self._factors[n]

    def _turn(self, n: int) -> sp.csr_matrix:
        """The amplitudes of the unknowns: b = -a + (a + b) on the axis for n = 1."""
        size, axis = 3 * len(self.space.nodes), 3 * np.flatnonzero(self.on_axis if n == 1 else np.zeros(0))
        tied = sp.csr_matrix((-np.ones(len(axis)), (axis + 1, axis)), shape=(size, size))
        return (sp.identity(size, format="csr") + tied).tocsr()

    def solve(self, n: int, loads: ComplexArray) -> ComplexArray:
        """Displacements (3 nodes, k) [mm] under nodal loads (3 nodes, k) [N]."""
        if not loads.any():
            return np.zeros_like(loads)
        taken = self._taken.get(n)
        if taken is not None and np.array_equal(taken.loads, loads):
            return taken.moved
        return np.asarray(self._solve(n, loads.real) + (1j * self._solve(n, loads.imag) if loads.imag.any() else 0.0j))

    def _solve(self, n: int, loads: FloatArray) -> FloatArray:
        turn = self._turn(n)
        right = np.asarray(turn.T @ loads)
        right[self.held(n).ravel()] = 0.0
        return np.asarray(turn @ self.factor_of(n).solve(right))

    def compliance(self, n: int) -> FloatArray:
        """C_n (3 line nodes, 3 line nodes) [mm/N] between the nodes of the contact line, node by node."""
        if n not in self._compliances:
            matrix = self.factor_of(n).compliance()
            held = self.held(n)[self.trace].ravel()
            matrix[held] = 0.0
            matrix[:, held] = 0.0
            self._compliances[n] = matrix
        return self._compliances[n]

    def condensed(self, n: int, loads: ComplexArray) -> Condensed:
        """The harmonic for another rank, with what loads (nodes, 3) [N] move.

        Raises:
            MeshError: K_n is not positive definite.
        """
        column = loads.reshape(-1, 1)
        return Condensed(compliance=self.compliance(n), loads=column, moved=self.solve(n, column))

    def take(self, n: int, condensed: Condensed) -> None:
        """Take the harmonic from another rank instead of factoring it."""
        self._taken[n], self._compliances[n] = condensed, condensed.compliance

    def on_trace(self, displacement: Amplitudes) -> Amplitudes:
        """The amplitudes of the contact line (3 line nodes, k) of those of all nodes (3 nodes, k)."""
        k = displacement.shape[1]
        nodes = len(self.space.nodes)
        return np.asarray(displacement.reshape(nodes, 3, k)[self.trace].reshape(3 * len(self.trace), k))
