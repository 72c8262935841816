"""Runs in lockstep: problems at one displacement that differ in friction and history alone, on shared factors.

Runs of one set of open, sticking and slipping moments share the LU factors of M_0, the interface matrix at the mean of
their coefficients of friction and kappa. Every solve corrects the traction that a run already has,

    lambda <- lambda + M_0^-1 r,    r = g - A W tau - (lambda [+ Q]) / gamma

so that the error falls by |1 - M_0^-1 M| each time: by about 1e-3 where the coefficients scatter by 5 %, by 1e-2 for
0.07 on the factors of 0.11. Newton's iterations, which follow status and kappa, are these corrections at the same
time. The pairing of the lines and the influence of the moments are the same for all runs, and their responses are
products of matrices with matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import scipy.linalg as sla

from ..base.arrays import FloatArray, IntArray
from .condensed import Condensed
from .law import ContactProblem, LinearSolution, Status, StatusArray
from .newton import Report
from .status import OPEN, SLIP, STICK

EXACT = 1e-8
"""Correction of a traction, relative to the largest, from which on it is left to the next iteration."""
MOST = 8
"""Corrections in one solve."""

Number = TypeVar("Number", bound=np.generic)


@dataclass(frozen=True)
class Factors:
    """LU factors of the interface matrix of one set of open, sticking and slipping moments."""

    active: IntArray  # moments that are not open
    sticking: IntArray
    lu: tuple[FloatArray, FloatArray] | None  # None where all are open

    def step(self, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normal (runs, active) and tangential (runs, sticking) corrections for residuals (2, runs, n) [mm]."""
        unknown = np.concatenate([residual[0][:, self.active], residual[1][:, self.sticking]], axis=1)
        if self.lu is not None:
            unknown = sla.lu_solve(self.lu, unknown.T, check_finite=False).T
        return unknown[:, : len(self.active)], unknown[:, len(self.active) :]


class Lockstep:
    """The linear problems of several runs at one displacement: n moments of the first, then those of the second, ...

    Args:
        engine: whose compliances all runs share.
        contacts: of each run, on one and the same coupling.
    """

    def __init__(self, engine: Condensed, contacts: Sequence[ContactProblem]) -> None:
        self.engine, self.runs, self.one = engine, len(contacts), contacts[0]
        covered = self.one.covered
        self.contact = replace(
            self.one,
            covered=replace(
                covered,
                weight=np.tile(covered.weight, self.runs),
                gamma=np.tile(covered.gamma, self.runs),
                normals=np.tile(covered.normals, (self.runs, 1)),
            ),
            undeformed=np.concatenate([each.undeformed for each in contacts], axis=1),
        )
        self._shared = engine.problem(self.one)
        self._factors: dict[bytes, Factors] = {}
        self._traction, self._total, self._response = np.zeros((3, 2, self.contact.moments))

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> LinearSolution:
        """Correct the traction of every run with the factors of its status."""
        contact, weight = self.contact, self.contact.covered.weight
        runs = self._by_set(status, kappa, friction)
        traction = self._move_to(_within(self._traction, status, friction), status, kappa)
        for _ in range(MOST):
            corrected = _within(self._corrected(traction, kappa, runs), status, friction)
            change = float(np.abs(corrected - traction).max(initial=0.0))
            if change <= EXACT * float(np.abs(corrected).max(initial=0.0)):
                break
            traction = self._move_to(corrected, status, kappa)
        self._traction, self._total = corrected, contact.total(corrected, kappa)
        response, bore = self.engine.respond(self.one, self._by_run(weight * self._total))
        self._response = response.reshape(corrected.shape)
        trial = corrected + contact.covered.gamma * contact.residual(corrected, self._response, kappa)
        return LinearSolution(corrected, trial, self._total, self._kappa(bore))

    def reports(self, report: Report) -> list[Report]:
        """The report of each run, of that of all."""
        found, status = report.answer, report.status
        traction, trial, total, kappa = map(self._by_run, (found.traction, found.trial, found.total, found.kappa))
        kind, sign = map(self._by_run, (status.kind, status.sign))
        return [
            replace(
                report,
                answer=LinearSolution(traction[:, k], trial[:, k], total[:, k], kappa[k]),
                status=Status(kind[k], sign[k]),
            )
            for k in range(self.runs)
        ]

    def displacements(self, reports: Sequence[Report]) -> list[tuple[FloatArray, FloatArray]]:
        """Displacements of the axle's loaded nodes and of the bore's nodes [mm] of each run."""
        loads = zip(*(self.one.loads(report.answer.total) for report in reports), strict=True)
        matrices = self.engine.own_compliance, self.engine.wheel.compliance
        seat, bore = (_products(matrix, np.stack(each)) for matrix, each in zip(matrices, loads, strict=True))
        return list(zip(seat, bore, strict=True))

    def _by_run(self, values: npt.NDArray[Number]) -> npt.NDArray[Number]:
        """(..., runs, n) of values (..., runs n)."""
        return values.reshape(*values.shape[:-1], self.runs, -1)

    def _move_to(self, traction: FloatArray, status: Status, kappa: FloatArray) -> FloatArray:
        """Follow the traction in the rows of the response that the next correction needs; gives the traction."""
        total = self.contact.total(traction, kappa)
        forces = self._by_run(self.contact.covered.weight * (total - self._total))
        response = self._by_run(self._response)
        for i in (0, 1) if (status.kind == STICK).any() else (0,):
            across, along = self._shared.influence(i)
            response[i] += forces[0] @ across + forces[1] @ along
        self._total = total
        return traction

    def _by_set(self, status: Status, kappa: FloatArray, friction: FloatArray) -> list[tuple[IntArray, Factors]]:
        """The runs of each set of open, sticking and slipping moments, and the factors they share."""
        kinds, drag, kappas = self._by_run(status.kind), self._by_run(status.sign * friction), self._by_run(kappa)
        keys = [kind.tobytes() for kind in kinds]
        found = []
        for key in dict.fromkeys(keys):
            runs = np.array([k for k, own in enumerate(keys) if own == key])
            if key not in self._factors:
                self._factors[key] = self._factored(kinds[runs[0]], drag[runs].mean(axis=0), kappas[runs].mean(axis=0))
            found.append((runs, self._factors[key]))
        return found

    def _corrected(self, traction: FloatArray, kappa: FloatArray, sets: list[tuple[IntArray, Factors]]) -> FloatArray:
        """The traction with a correction of the runs of each set of moments at once."""
        left = self._by_run(self.contact.residual(traction, self._response, kappa))
        after = self._by_run(traction.copy())
        for runs, factors in sets:
            normal, tangential = factors.step(left[:, runs])
            after[0][np.ix_(runs, factors.active)] += normal
            after[1][np.ix_(runs, factors.sticking)] += tangential
        return after.reshape(traction.shape)

    def _factored(self, kind: StatusArray, drag: FloatArray, kappa: FloatArray) -> Factors:
        """The factors at a mean of sign times friction, and of kappa."""
        active, sticking = np.flatnonzero(kind != OPEN), np.flatnonzero(kind == STICK)
        if not len(active):
            return Factors(active, sticking, None)
        status = Status(kind, np.sign(drag).astype(np.int8))
        matrix = self._shared.matrix(status, kappa, np.abs(drag), active, sticking)
        self.engine.factorisations += 1
        return Factors(active, sticking, sla.lapack.dgetrf(matrix, overwrite_a=True)[:2])

    def _kappa(self, bore: FloatArray) -> FloatArray:
        """kappa (runs n,) at displacements (2, runs, bore nodes) of the bore."""
        share = self.one.coupling.axial_share_undeformed
        if not self.one.radial:
            return np.tile(share, self.runs)
        return np.asarray(share + self.one.coupling.bore_slope(bore)).ravel()


def _within(traction: FloatArray, status: Status, friction: FloatArray) -> FloatArray:
    """The traction (2, n) that its status allows: none where open, friction's where it slips."""
    normal = np.where(status.kind == OPEN, 0.0, traction[0])
    held = np.where(status.kind == STICK, traction[1], 0.0)
    return np.stack([normal, np.where(status.kind == SLIP, -status.sign * friction * normal, held)])


def _products(matrix: FloatArray, loads: FloatArray) -> FloatArray:
    """loads (runs, 2 n) @ matrix', without the columns before the first and after the last load."""
    both = loads.reshape(len(loads), 2, -1)
    loaded = np.flatnonzero(both.any(axis=(0, 1)))
    within = slice(int(loaded[0]), int(loaded[-1]) + 1) if len(loaded) else slice(0)
    blocks = matrix.reshape(len(matrix), 2, -1)
    return np.asarray(both[:, 0, within] @ blocks[:, 0, within].T + both[:, 1, within] @ blocks[:, 1, within].T)
