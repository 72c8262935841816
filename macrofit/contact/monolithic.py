"""The plain sparse engine: both bodies and the contact in one system, factored at every Newton step.

It solves the same equations as the condensed engine, with the same status and kappa, and is its oracle. It is also
where a nonlinear bulk would enter: nothing here relies on a stiffness that stays the same.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray
from ..bodies.body import Body
from ..bodies.fenics import Factor
from .law import ContactProblem, LinearSolution, Status
from .seat import Seat, SeatRows
from .status import OPEN, SLIP, STICK


class Monolithic:
    """The stiffness of both bodies, on their free unknowns."""

    def __init__(self, seat: Seat, axle: Body, wheel: Body) -> None:
        self.seat, self.axle, self.wheel = seat, axle, wheel
        self.factorisations = 0
        self.stiffness = sp.block_diag(
            [body.stiffness[body.free][:, body.free] for body in (axle, wheel)], format="csr"
        )
        trace = self._to_free(axle, axle.trace_dofs)
        loaded = axle.trace_dofs.reshape(2, -1)[:, : seat.loaded].ravel()
        self.trace, self.loaded = trace, self._to_free(axle, loaded)
        self.bore = self._to_free(wheel, wheel.trace_dofs)

    def problem(self, contact: ContactProblem) -> MonolithicProblem:
        """The linear problems of one increment."""
        return MonolithicProblem(self, contact)

    @staticmethod
    def _to_free(body: Body, dofs: IntArray) -> sp.csr_matrix:
        """(dofs, free): picks degrees of freedom out of the free ones; a supported one gives zero."""
        every = sp.identity(body.dofs, format="csr")
        return every[dofs][:, body.free]


class MonolithicProblem:
    """The sparse systems of one increment.

    y = gamma (g - B u) with B = [J - T/gamma, -N]; at given status and kappa, tau = M y, and
    (K + L' W M gamma B) u = L' W M gamma g with L = [J - theta/gamma T, -N].
    """

    def __init__(self, engine: Monolithic, contact: ContactProblem) -> None:
        self.engine, self.contact = engine, contact
        jump = contact.coupling.bore_rows @ engine.bore
        self.gap = sp.hstack([_rows(contact, "trial") @ engine.trace, -jump], format="csr")
        self.test = sp.hstack([_rows(contact, "load") @ engine.loaded, -jump], format="csr")
        self.displacement = np.zeros(engine.stiffness.shape[0])

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> LinearSolution:
        """Assemble, factor, solve, and read the traction off the displacement."""
        contact = self.contact
        weight, gamma = np.tile(contact.covered.weight, 2), np.tile(contact.covered.gamma, 2)
        spread = self.test.T @ sp.diags(weight) @ self._response(status, kappa, friction) @ sp.diags(gamma)
        matrix = self.engine.stiffness + spread @ self.gap
        self.displacement = Factor(matrix.tocsr()).solve(spread @ contact.approach.ravel())
        self.engine.factorisations += 1
        relative = (gamma * (contact.approach.ravel() - self.gap @ self.displacement)).reshape(2, -1)
        traction = self._traction(status, kappa, friction, relative)
        total = contact.total(traction, kappa)
        trial = relative - (total - traction) if contact.nitsche else relative
        return LinearSolution(traction, trial, total, contact.kappa(self.displacements(None)[1]))

    def displacements(self, answer: LinearSolution | None) -> tuple[FloatArray, FloatArray]:
        """Displacements of the axle's loaded nodes and of the bore's nodes [mm] at the last solve."""
        count = self.engine.trace.shape[1]
        return self.engine.loaded @ self.displacement[:count], self.engine.bore @ self.displacement[count:]

    def _response(self, status: Status, kappa: FloatArray, friction: FloatArray) -> sp.csr_matrix:
        """M (2 n, 2 n) with tau = M y."""
        n = self.contact.moments
        n_r, n_z = self.contact.covered.normals.T
        share = kappa if self.contact.nitsche else np.zeros(n)
        sticks = (status.kind == STICK).astype(float)
        normal = (status.kind != OPEN) / (1.0 - share * n_z)
        across = -status.sign * friction * (status.kind == SLIP) - kappa * n_r + sticks * share * n_r
        return sp.bmat(
            [[sp.diags(normal * (1.0 - kappa * n_z)), None], [sp.diags(normal * across), sp.diags(sticks)]],
            format="csr",
        )

    def _traction(self, status: Status, kappa: FloatArray, friction: FloatArray, relative: FloatArray) -> FloatArray:
        n_r, n_z = self.contact.covered.normals.T
        share = kappa if self.contact.nitsche else np.zeros_like(kappa)
        normal = np.where(status.kind != OPEN, relative[0] / (1.0 - share * n_z), 0.0)
        held = relative[1] + share * n_r * normal
        slipping = np.where(status.kind == SLIP, -status.sign * friction * normal, 0.0)
        return np.stack([normal, np.where(status.kind == STICK, held, slipping)])


def _rows(contact: ContactProblem, operator: str) -> sp.csr_matrix:
    """(2 n, columns): the seat's rows of the covered moments."""
    covered = contact.covered

    def pick(rows: SeatRows, index: IntArray) -> sp.csr_matrix:
        size = len(rows.weight)
        return getattr(rows, operator)[np.concatenate([index, size + index])]

    size = len(covered.full.weight)
    whole = covered.index < size
    if covered.partial is None or whole.all():
        return pick(covered.full, covered.index)
    inner, outer = (
        pick(covered.full, covered.index[whole]),
        pick(covered.partial, covered.index[~whole] - size),
    )
    k, p = inner.shape[0] // 2, outer.shape[0] // 2
    stacked = sp.vstack([inner, outer], format="csr")
    place = np.empty(2 * (k + p), dtype=np.int64)
    for i in range(2):
        offset = i * (k + p)
        place[offset + np.flatnonzero(whole)] = i * k + np.arange(k)
        place[offset + np.flatnonzero(~whole)] = 2 * k + i * p + np.arange(p)
    return stacked[place]
