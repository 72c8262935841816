"""The dense engine: the interface problem condensed on the moments, without bulk unknowns.

With W the weights, J and T the moments of jump and bulk traction on the seat, N those of the bore's displacement in
the seat's frame, C_a and C_w the compliances of the two bodies,

    u_a = C_a (J - theta/gamma T)' W tau,   u_w = -C_w N' W tau
    trial = gamma (g - A W tau) - Q,        A = (J - T/gamma) C_a (J - theta/gamma T)' + N C_w N'

The wheel's stiffness does not change when it travels, so that an increment only changes N, g and the rows of the one
or two seat facets that the wheel covers in part.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp

from .body import CondensedBody
from .contact import Answer, Facing, Status
from .geometry import FloatArray
from .interface import Seat, SeatRows
from .mesh import IntArray
from .solution import OPEN, SLIP, STICK


class Condensed:
    """The axle's compliance between all moments of the seat, and the wheel's between its bore nodes."""

    def __init__(self, seat: Seat, axle: CondensedBody, wheel: CondensedBody) -> None:
        self.seat, self.axle, self.wheel = seat, axle, wheel
        self.factorisations = 0
        size, room = seat.size, seat.size + 2 * seat.moments
        self._influence = np.zeros((2, 2, room, room))  # rows and columns of two partly covered facets at the end
        influence = seat.full.trial @ (seat.full.load @ axle.compliance.T).T
        for i in range(2):
            for j in range(2):
                block = influence[i * size : (i + 1) * size, j * size : (j + 1) * size]
                self._influence[i, j, :size, :size] = block

    def problem(self, facing: Facing) -> CondensedProblem:
        """The linear problems of one increment; recomputes the influence of partly covered facets."""
        if facing.covered.partial is not None:
            self._insert(facing.covered.partial)
        return CondensedProblem(self, facing)

    def influence(self, i: int, j: int, rows: IntArray, columns: IntArray) -> FloatArray:
        """Component i of the approach of ``rows`` under component j of unit forces on ``columns`` [mm/N]."""
        return np.asarray(self._influence[i, j][np.ix_(rows, columns)])

    def respond(self, index: IntArray, forces: FloatArray) -> FloatArray:
        """The axle's share of A W tau (2, n) for forces W tau (2, n) on the moments ``index``."""
        spread = np.zeros((2, self._influence.shape[2]))
        spread[:, index] = forces
        both = [self._influence[i, 0] @ spread[0] + self._influence[i, 1] @ spread[1] for i in range(2)]
        return np.stack(both)[:, index]

    def displace(self, seat_load: FloatArray, bore_load: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Displacements of the axle's trace nodes and of the bore's nodes under nodal forces [N]."""
        return self.axle.compliance @ seat_load, self.wheel.compliance @ bore_load

    def _insert(self, partial: SeatRows) -> None:
        """Write the influence of partly covered portions into the spare rows and columns."""
        full, compliance = self.seat.full, self.axle.compliance
        k, size = len(partial.weight), self.seat.size
        spare = slice(size, size + k)
        reach = partial.trial @ compliance
        across = full.load @ reach.T
        along = full.trial @ (partial.load @ compliance.T).T
        corner = (partial.load @ reach.T).T
        for i in range(2):
            for j in range(2):
                block = self._influence[i, j]
                block[spare, :size] = across[j * size : (j + 1) * size, i * k : (i + 1) * k].T
                block[:size, spare] = along[i * size : (i + 1) * size, j * k : (j + 1) * k]
                block[spare, spare] = corner[i * k : (i + 1) * k, j * k : (j + 1) * k]


class CondensedProblem:
    """The linear problems of one increment, at given status and kappa."""

    def __init__(self, engine: Condensed, facing: Facing) -> None:
        self.engine, self.facing = engine, facing
        self._status: Status | None = None
        self._traction = np.zeros((2, facing.moments))
        self._lu: tuple[FloatArray, FloatArray] | None = None

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> Answer:
        """Solve for the traction; where only kappa changed, correct the last answer with the factors at hand."""
        active = np.flatnonzero(status.kind != OPEN)
        sticking = np.flatnonzero(status.kind == STICK)
        slipping = np.flatnonzero(status.kind == SLIP)
        if self._status is None or not self._status.same(status):
            self._factor(status, kappa, friction, active, sticking)
        traction = self._traction
        residual = (self._trial(traction, kappa)[0] - traction) / self.facing.covered.gamma
        unknown = np.concatenate([residual[0, active], residual[1, sticking]])
        step = sla.lu_solve(self._lu, unknown, check_finite=False) if len(unknown) else unknown
        traction = traction.copy()
        traction[0, active] += step[: len(active)]
        traction[1, sticking] += step[len(active) :]
        traction[1, slipping] = -status.sign[slipping] * friction[slipping] * traction[0, slipping]
        self._traction = traction
        trial, total, bore = self._trial(traction, kappa)
        return Answer(traction, trial, total, self.facing.kappa(bore))

    def displacements(self, answer: Answer) -> tuple[FloatArray, FloatArray]:
        """Displacements of the axle's trace nodes and of the bore's nodes [mm]."""
        return self.engine.displace(*self.facing.loads(answer.total))

    def _trial(self, traction: FloatArray, kappa: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Trial traction and tau (2, n), and the bore's displacement, that a traction (2, n) leads to."""
        facing = self.facing
        total = facing.total(traction, kappa)
        forces = facing.covered.weight * total
        bore = -(self.engine.wheel.compliance @ (facing.bore_jump.T @ forces.ravel()))
        response = self.engine.respond(facing.covered.index, forces) - (facing.bore_jump @ bore).reshape(2, -1)
        trial = facing.covered.gamma * (facing.approach - response)
        return (trial - (total - traction) if facing.nitsche else trial), total, bore

    def _factor(self, status: Status, kappa: FloatArray, friction: FloatArray, active: IntArray,
                sticking: IntArray) -> None:
        self._status, self._traction = status, np.zeros((2, self.facing.moments))
        if len(active):
            matrix = self.matrix(status, kappa, friction, active, sticking)
            self._lu = sla.lu_factor(matrix, overwrite_a=True, check_finite=False)
            self.engine.factorisations += 1

    def matrix(self, status: Status, kappa: FloatArray, friction: FloatArray, active: IntArray,
               sticking: IntArray) -> FloatArray:
        """d ((lambda + Q) / gamma + A W tau) / d (lambda_n of active, lambda_t of sticking moments).

        A slipping moment has lambda_t = -sign mu lambda_n, and Q = -kappa lambda_n e_z.
        """
        engine, covered = self.engine, self.facing.covered
        index, weight = covered.index, covered.weight
        n_r, n_z = covered.normals.T
        normal = (weight * (1.0 - kappa * n_z))[active]
        drag = (weight * (-status.sign * friction - kappa * n_r))[active]
        a, k = len(active), len(sticking)
        matrix = np.asfortranarray(self._bore_part(active, sticking, normal, drag))
        for i, rows, part in ((0, active, slice(0, a)), (1, sticking, slice(a, a + k))):
            if len(rows):
                matrix[part, :a] += engine.influence(i, 0, index[rows], index[active]) * normal
                matrix[part, :a] += engine.influence(i, 1, index[rows], index[active]) * drag
            if k:
                matrix[part, a:] += engine.influence(i, 1, index[rows], index[sticking]) * weight[sticking]
        share = kappa if self.facing.nitsche else np.zeros_like(kappa)
        diagonal = np.arange(a + k)
        own = (1.0 - share * n_z) / covered.gamma
        matrix[diagonal, diagonal] += np.concatenate([own[active], 1.0 / covered.gamma[sticking]])
        matrix[a + np.arange(k), np.searchsorted(active, sticking)] -= (share * n_r / covered.gamma)[sticking]
        return matrix

    def _bore_part(self, active: IntArray, sticking: IntArray, normal: FloatArray, drag: FloatArray) -> FloatArray:
        """The wheel's share of the matrix, N C_w N' on the unknowns."""
        jump, n = self.facing.bore_jump, self.facing.moments
        rows = jump[np.concatenate([active, n + sticking])]
        columns = sp.diags(normal) @ jump[active] + sp.diags(drag) @ jump[n + active]
        if len(sticking):
            held = sp.diags(self.facing.covered.weight[sticking]) @ jump[n + sticking]
            columns = sp.vstack([columns, held], format="csr")
        return np.asarray(rows @ (columns @ self.engine.wheel.compliance).T)
