"""The fit in harmonics: what tractions on the seat and slips between the lines have to do with each other.

With J and N the moments of the seat's and the bore's displacement (see `contact.moments`) in the components (normal,
along the seat, around it), W their weights, C_a and C_w the compliances, R the rigid motions q of the wheel, f the
loads,

    (1 / gamma + A W) lambda = w - d + N R q,   A = J C_a J' + N C_w N'     (the law: lambda = -gamma (jump - w))
    (N R)' W lambda = R' f_w                                                 (the wheel is in balance)

where w is what the lines have slipped or opened and d the jump that the loads alone make. So for each harmonic
lambda = S (w - d) + lambda_h with one real S.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray
from ..bodies.body import ContactLine
from ..contact.interface import MortarCoupling
from ..contact.moments import CoveredFacets, entries, quadrature, scalar_rows, shape
from .elements import ComplexArray
from .harmonics import HarmonicBody


@dataclass(frozen=True, kw_only=True)
class Response:
    """What the fit answers in one harmonic to a slip w and loads."""

    matrix: FloatArray  # S (3 m, 3 m) [MPa/mm]
    motion: FloatArray  # N R (3 m, k), jumps of the rigid motions
    to_motion: FloatArray  # (k, 3 m): q = to_motion (w - d) + by_balance h
    by_balance: FloatArray  # (k, k)
    held: FloatArray  # (3 m, k): lambda_h = held h

    def traction(self, slip: ComplexArray, balance: ComplexArray) -> ComplexArray:
        """lambda (3 m,) [MPa] for w - d (3 m,) [mm] and R' f_w (k,)."""
        return np.asarray(self.matrix @ slip + self.held @ balance)

    def rigid(self, slip: ComplexArray, balance: ComplexArray) -> ComplexArray:
        """The rigid motions q (k,) of the wheel."""
        return np.asarray(self.to_motion @ slip + self.by_balance @ balance)


class Fit:
    """The two bodies and the moments of the lines where they face each other; rows are component-major."""

    def __init__(
        self,
        axle: HarmonicBody,
        wheel: HarmonicBody,
        lines: tuple[ContactLine, ContactLine],
        coupling: MortarCoupling,
        gamma: FloatArray,
        chosen: IntArray,
    ) -> None:
        """The moments ``chosen`` of a coupling may touch; gamma [MPa/mm] is that of each facet of the seat."""
        self.axle, self.wheel, self.lines, self.coupling = axle, wheel, lines, coupling
        self.chosen, portions = chosen, coupling.portions
        self.weight, self.z = portions.weight.ravel()[chosen], portions.points.ravel()[chosen]  # mm2, mm
        self.facet = np.repeat(portions.facet, portions.points.shape[1])[chosen]
        self._gamma = gamma
        self.gamma, self.normals = gamma[self.facet], coupling.normals[chosen]
        self._responses: dict[int, Response] = {}

    @property
    def moments(self) -> int:
        """Number of moments m."""
        return len(self.chosen)

    def of_moments(self, chosen: IntArray) -> Fit:
        """The same fit where other moments may touch."""
        return Fit(self.axle, self.wheel, self.lines, self.coupling, self._gamma, chosen)

    @cached_property
    def seat_rows(self) -> sp.csr_matrix:
        """J (3 m, 3 seat nodes)."""
        return in_components(seat_moments(self.lines[0], self.coupling.portions)[self.chosen], self.normals)

    @cached_property
    def bore_rows(self) -> sp.csr_matrix:
        """N (3 m, 3 bore nodes)."""
        scalar = np.zeros((self.moments, self.coupling.nodes))
        scalar[:, self.coupling.bore.span] = sp.csr_matrix(self.coupling.bore.matrix)[self.chosen].toarray()
        return in_components(sp.csr_matrix(scalar), self.normals)

    def response(self, n: int) -> Response:
        """What it answers in harmonic n; made once."""
        if n not in self._responses:
            self._responses[n] = self._made(n)
        return self._responses[n]

    def _made(self, n: int) -> Response:
        J, N = self.seat_rows, self.bore_rows
        A = J @ (J @ self.axle.compliance(n)).T + N @ (N @ self.wheel.compliance(n)).T
        W = np.tile(self.weight, 3)
        matrix = A * W
        matrix[np.diag_indices(len(matrix))] += np.tile(1.0 / self.gamma, 3)
        G = sla.inv(matrix, overwrite_a=True, check_finite=False)
        motion = N @ self.wheel.on_trace(self.wheel.rigid_motions(n))
        k = motion.shape[1]
        if not k:
            none = np.zeros((0, len(W)))
            return Response(matrix=G, motion=motion, to_motion=none, by_balance=np.zeros((0, 0)), held=none.T)
        reach, pull = G @ motion, (W[:, None] * motion).T @ G
        by_balance = np.linalg.inv((W[:, None] * motion).T @ reach)
        return Response(
            matrix=G - reach @ (by_balance @ pull),
            motion=motion,
            to_motion=-by_balance @ pull,
            by_balance=by_balance,
            held=reach @ by_balance,
        )

    def jump(self, n: int, axle_loads: ComplexArray, wheel_loads: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """d (3 m,) [mm] and R' f_w (k,) of nodal loads (nodes, 3) on the bodies."""
        seat = self.axle.on_trace(self.axle.solve(n, axle_loads.reshape(-1, 1)))
        bore = self.wheel.on_trace(self.wheel.solve(n, wheel_loads.reshape(-1, 1)))
        balance = self.wheel.rigid_motions(n).T @ wheel_loads.reshape(-1)
        return np.asarray(self.seat_rows @ seat - self.bore_rows @ bore).ravel(), np.asarray(balance)

    def approach(self, n: int, loads: tuple[ComplexArray, ComplexArray], place: Fit) -> FloatArray:
        """How far the lines of the bonded fit approach at the moments (m,) of another one under nodal loads [mm]."""
        jump, balance = self.jump(n, *loads)
        traction, motion = self.response(n).traction(-jump, balance), self.response(n).rigid(-jump, balance)
        there, _ = place.jump(n, *loads)
        forces = np.tile(self.weight, 3) * traction
        seat = place.seat_rows @ (self.axle.compliance(n) @ (self.seat_rows.T @ forces))
        bore = place.bore_rows @ (self.wheel.compliance(n) @ (self.bore_rows.T @ forces))
        rigid = place.bore_rows @ (self.wheel.on_trace(self.wheel.rigid_motions(n)) @ motion)
        return np.asarray(np.abs(there + seat + bore - rigid)[: place.moments], dtype=np.float64)

    def line_displacement(self, n: int, traction: ComplexArray) -> ComplexArray:
        """Amplitudes (line nodes, 3) of the seat [mm] under tractions (3 m,) [MPa]."""
        forces = np.ascontiguousarray(self.seat_rows.T @ (np.tile(self.weight, 3) * traction))
        parts = self.axle.compliance(n) @ forces.view(np.float64).reshape(-1, 2)  # the matrix stays real
        return np.ascontiguousarray(parts).view(np.complex128).reshape(-1, 3)


def seat_moments(line: ContactLine, portions: CoveredFacets) -> sp.csr_matrix:
    """Moments (m, line nodes) of one component of the seat's displacement."""
    count, moments = portions.weight.shape
    s, which, test = quadrature(line, portions, np.arange(count), portions.start, portions.end)
    facet, x = portions.facet[which], line.coordinate
    values, _ = shape(line.order, (s - x[facet]) / (x[facet + 1] - x[facet]))
    columns = line.order * facet[:, None] + np.arange(line.order + 1)
    return scalar_rows(entries(test, values, which, columns), (count * moments, len(line.nodes)))


def in_components(scalar: sp.csr_matrix, normals: FloatArray) -> sp.csr_matrix:
    """Rows (normal, along, around) on columns (a, b, c) of each node, of rows for one component."""
    m, nodes = scalar.shape
    n_r, n_z = (sp.diags(normals[:, k]) @ scalar for k in (0, 1))
    stacked = sp.bmat([[n_r, None, n_z], [-n_z, None, n_r], [None, scalar, None]], format="coo")
    component, node = np.divmod(stacked.col, nodes)
    return sp.csr_matrix((stacked.data, (stacked.row, 3 * node + component)), shape=(3 * m, 3 * nodes))
