"""The dense engine: the interface problem condensed on the moments, without bulk unknowns.

With W the weights, J and T the moments of jump and bulk traction on the seat, N those of the bore's displacement in
the seat's frame, C_a and C_w the compliances of the two bodies,

    u_a = C_a (J - theta/gamma T)' W tau,   u_w = -C_w N' W tau
    trial = gamma (g - A W tau) - Q,        A = (J - T/gamma) C_a (J - theta/gamma T)' + N C_w N'

The wheel's stiffness does not change when it travels, so that an increment only changes N, g and the rows of the one
or two seat facets that the wheel covers in part.
"""

from __future__ import annotations

from itertools import product
from typing import TypeAlias

import numpy as np
import scipy.linalg as sla

from ..base.arrays import FloatArray, IntArray
from ..bodies.body import CondensedBody
from .law import ContactProblem, LinearSolution, Status
from .seat import Seat, SeatRows
from .status import OPEN, SLIP, STICK

Block: TypeAlias = tuple[int, int, slice, slice, FloatArray]
"""Component of the approach and of the force, where on the seat the force is, where the approach, and the influence."""


class Condensed:
    """The axle's compliance between all moments of the seat, and the wheel's between its bore nodes."""

    def __init__(self, seat: Seat, axle: CondensedBody, wheel: CondensedBody, *, reuse: bool = True) -> None:
        """``reuse`` the factors of the interface matrix where only kappa changed, not the status."""
        self.seat, self.axle, self.wheel, self.reuse = seat, axle, wheel, reuse
        self.factorisations = 0
        size, room = seat.size, seat.size + 2 * seat.moments
        # [j, i][column, row]: component i of the approach of a row under component j of a unit force on a column;
        # the last rows and columns are for partly covered facets
        self._influence = np.zeros((2, 2, room, room))
        # (2, loaded nodes, 2, loaded nodes), a view: these matrices are large
        by_component = axle.compliance.reshape(2, seat.line.trace_nodes, 2, seat.loaded)
        self.own_compliance = by_component[:, : seat.loaded]
        for i in range(2):
            reach = np.ascontiguousarray((seat.full.trial[i * size : (i + 1) * size] @ axle.compliance).T)
            for j in range(2):
                self._influence[j, i, :size, :size] = seat.full.load[j * size : (j + 1) * size] @ reach

    @property
    def between_bore_nodes(self) -> FloatArray:
        """The wheel's compliance by components (2, nodes, 2, nodes)."""
        nodes = len(self.wheel.line.nodes)
        return self.wheel.compliance.reshape(2, nodes, 2, nodes)

    def problem(self, contact: ContactProblem) -> CondensedProblem:
        """The linear problems of one increment; recomputes the influence of partly covered facets."""
        if contact.covered.partial is not None:
            self._insert(contact.covered.partial)
        return CondensedProblem(self, contact)

    def blocks(self, contact: ContactProblem) -> list[Block]:
        """Where forces on whole and on partly covered facets act on either."""
        index = contact.covered.index
        whole, spare = index[index < self.seat.size], index[index >= self.seat.size]
        covered = [slice(part.min(), part.max() + 1) for part in (whole, spare) if len(part)]
        return [
            (i, j, rows, columns, self._influence[j, i, rows, columns])
            for rows, columns, i, j in product(covered, covered, (0, 1), (0, 1))
        ]

    def influence(self, contact: ContactProblem, rows: int) -> list[FloatArray]:
        """A' for component ``rows`` of all approaches, (n, n) for either component of the forces [mm/N]."""
        index, band = contact.covered.index, contact.coupling.bore
        compliance = self.between_bore_nodes[:, band.span, :, band.span]
        n_r, n_z = contact.covered.normals.T
        frame = ((n_r, n_z), (-n_z, n_r))  # r and z components of the normal and the tangential direction
        spread = np.zeros((2, contact.moments, band.matrix.shape[1]))
        for here, scale in enumerate(frame[rows]):
            for there in (0, 1):
                band.add_product(spread[there], scale, compliance[here, :, there])
        both = [_chosen(self._influence[j, rows], index, self.seat.size) for j in range(2)]
        for out, direction in zip(both, frame, strict=True):
            for component, scale in enumerate(direction):
                band.add_product(out, scale, spread[component].T)
        return both

    def _insert(self, partial: SeatRows) -> None:
        """Write the influence of partly covered portions into the spare rows and columns."""
        full, compliance = self.seat.full, self.axle.compliance
        k, size = len(partial.weight), self.seat.size
        spare = slice(size, size + k)
        reach = (partial.trial @ compliance).T
        rows = full.load @ reach
        nodes = np.unique(partial.load.indices)
        columns = (full.trial @ (partial.load[:, nodes] @ compliance[:, nodes].T).T).T
        corner = partial.load @ reach
        for j in range(2):
            for i in range(2):
                block = self._influence[j, i]
                block[:size, spare] = rows[j * size : (j + 1) * size, i * k : (i + 1) * k]
                block[spare, :size] = columns[j * k : (j + 1) * k, i * size : (i + 1) * size]
                block[spare, spare] = corner[j * k : (j + 1) * k, i * k : (i + 1) * k]


class CondensedProblem:
    """The linear problems of one increment, at given status and kappa."""

    def __init__(self, engine: Condensed, contact: ContactProblem) -> None:
        self.engine, self.contact = engine, contact
        self._rows: dict[int, list[FloatArray]] = {}
        self._blocks = engine.blocks(contact)
        self._status: Status | None = None
        self._lu: tuple[FloatArray, IntArray] | None = None
        self._traction, self._total, self._response = np.zeros((3, 2, contact.moments))

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> LinearSolution:
        """Solve for the traction; where only kappa changed, correct the last answer with the factors at hand."""
        contact = self.contact
        if self._status is None or not self.engine.reuse or not self._status.same(status):
            self._status = status
            self._traction, self._response = np.zeros((2, 2, contact.moments))
            self._active, self._sticking = (status.kind != OPEN).nonzero()[0], (status.kind == STICK).nonzero()[0]
            self._slipping = (status.kind == SLIP).nonzero()[0]
            self._factor(status, kappa, friction, self._active, self._sticking)
            total = contact.total(self._traction, kappa)
        else:
            total = contact.total(self._traction, kappa)
            self._turn(total, stick=len(self._sticking) > 0)
        active, sticking, slipping = self._active, self._sticking, self._slipping
        residual = contact.residual(self._traction, total, self._response)
        unknown = np.concatenate([residual[0, active], residual[1, sticking]])
        step = unknown
        if self._lu is not None and len(unknown):
            step = sla.lapack.dgetrs(*self._lu, unknown)[0]
        traction = self._traction.copy()
        traction[0, active] += step[: len(active)]
        traction[1, sticking] += step[len(active) :]
        traction[1, slipping] = -status.sign[slipping] * friction[slipping] * traction[0, slipping]
        total = contact.total(traction, kappa)
        self._response, bore = self.respond(contact.covered.weight * total)
        self._traction, self._total = traction, total
        trial = traction + contact.covered.gamma * contact.residual(traction, total, self._response)
        return LinearSolution(traction, trial, total, contact.kappa(bore))

    def respond(self, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A W tau (2, n) [mm] and the bore's displacement, where it faces the seat, for forces W tau (2, n) [N].

        Forces (2, runs, n) give the responses (2, runs, n) and the displacements (2, runs, bore nodes).
        """
        index, coupling, seat = self.contact.covered.index, self.contact.coupling, self.engine.seat
        spread, response = np.zeros((2, *forces.shape[:-1], seat.size + 2 * seat.moments))
        spread[..., index] = forces
        for i, j, rows, columns, influence in self._blocks:
            response[i, ..., columns] += spread[j, ..., rows] @ influence
        bore = -_product_within(self.engine.wheel.compliance, coupling.bore.span, coupling.bore_loads(forces))
        return response[..., index] - coupling.bore_moments(bore), bore

    def displacements(self, answer: LinearSolution) -> tuple[FloatArray, FloatArray]:
        """Displacements of the axle's loaded nodes and of the bore's nodes [mm]."""
        seat_load, bore_load = self.contact.loads(answer.total)
        return _product(self.engine.own_compliance, seat_load), _product(self.engine.between_bore_nodes, bore_load)

    def _turn(self, total: FloatArray, *, stick: bool) -> None:
        """Follow a change of kappa, and so of tau to ``total`` [MPa], in the rows that the next residual needs."""
        forces = self.contact.covered.weight * (total - self._total)
        for i in (0, 1) if stick else (0,):
            rows = self.influence(i)
            self._response[i] += forces[0] @ rows[0] + forces[1] @ rows[1]

    def influence(self, component: int) -> list[FloatArray]:
        """The influence on one component of the approaches, computed when first needed in this increment."""
        if component not in self._rows:
            self._rows[component] = self.engine.influence(self.contact, component)
        return self._rows[component]

    def _factor(
        self, status: Status, kappa: FloatArray, friction: FloatArray, active: IntArray, sticking: IntArray
    ) -> None:
        if len(active):
            matrix = self.matrix(status, kappa, friction, active, sticking)
            # a pivot of zero gives numbers that are not finite, with which no step converges: it is cut back
            self._lu = sla.lapack.dgetrf(matrix, overwrite_a=True)[:2]
            self.engine.factorisations += 1

    def matrix(
        self, status: Status, kappa: FloatArray, friction: FloatArray, active: IntArray, sticking: IntArray
    ) -> FloatArray:
        """d ((lambda + Q) / gamma + A W tau) / d (lambda_n of active, lambda_t of sticking moments).

        A slipping moment has lambda_t = -sign mu lambda_n, and Q = -kappa lambda_n e_z.
        """
        covered = self.contact.covered
        n_r, n_z = covered.normals.T
        normal = (covered.weight * (1.0 - kappa * n_z))[active, None]
        drag = (covered.weight * (-status.sign * friction - kappa * n_r))[active, None]
        a, k = len(active), len(sticking)
        transposed = np.empty((a + k, a + k))
        columns, held = span(active), span(sticking)
        for i, count, rows, part in ((0, a, columns, slice(0, a)), (1, k, held, slice(a, a + k))):
            if count:
                across, along = self.influence(i)
                np.multiply(normal, across[columns][:, rows], out=transposed[:a, part])
                transposed[:a, part] += drag * along[columns][:, rows]
                if k:
                    transposed[a:, part] = covered.weight[sticking, None] * along[held][:, rows]
        share = kappa if self.contact.nitsche else np.zeros_like(kappa)
        own = (1.0 - share * n_z) / covered.gamma
        diagonal = np.arange(a + k)
        transposed[diagonal, diagonal] += np.concatenate([own[active], 1.0 / covered.gamma[sticking]])
        transposed[np.searchsorted(active, sticking), a + np.arange(k)] -= (share * n_r / covered.gamma)[sticking]
        return transposed.T


def _chosen(matrix: FloatArray, index: IntArray, size: int) -> FloatArray:
    """matrix[index][:, index], for an ``index`` that ascends without holes where it is below ``size``."""
    whole = index < size
    out = np.empty((len(index), len(index)))
    rows, spare = span(np.flatnonzero(whole)), np.flatnonzero(~whole)
    if whole.any():
        part = span(index[whole])
        out[rows, rows] = matrix[part, part]
    out[spare] = matrix[index[spare]][:, index]
    out[:, spare] = matrix[:, index[spare]][index]
    return out


def _product(matrix: FloatArray, load: FloatArray) -> FloatArray:
    """The matrix (2, n, 2, n) times a load (2 n,), without the columns before the first and after the last load."""
    loaded = np.flatnonzero(load.reshape(2, -1).any(axis=0))
    if not len(loaded):
        return np.zeros(len(load))
    within = slice(int(loaded[0]), int(loaded[-1]) + 1)
    r, z = load.reshape(2, -1)[:, within]
    return np.concatenate([rows[:, 0, within] @ r + rows[:, 1, within] @ z for rows in matrix])


def _product_within(matrix: FloatArray, span: slice, vector: FloatArray) -> FloatArray:
    """(matrix @ vector) of two components (2 n,), for a vector that is zero outside ``span``, and there alone.

    Vectors (2, runs, n) give products (2, runs, n).
    """
    nodes = len(matrix) // 2
    blocks, given = matrix.reshape(2, nodes, 2, nodes), vector.reshape(2, *vector.shape[1:-1], nodes)
    out = np.zeros_like(given)
    for i, j in product((0, 1), (0, 1)):
        out[i, ..., span] += given[j, ..., span] @ blocks[i, span, j, span].T
    return out.reshape(vector.shape)


def span(index: IntArray) -> IntArray | slice:
    """A slice where the ascending ``index`` has no holes, so that picking it copies nothing."""
    if len(index) and int(index[-1]) - int(index[0]) + 1 == len(index):
        return slice(int(index[0]), int(index[-1]) + 1)
    return index
