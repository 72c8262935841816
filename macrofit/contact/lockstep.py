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

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg as sla

from ..base.arrays import FloatArray, IntArray
from .condensed import Condensed, span
from .law import ContactProblem, LinearSolution, Status, StatusArray
from .status import OPEN, STICK

EXACT, LEAST = 1e-5, 1e-10
"""Error of a solve, relative to its first correction, but no less relative to the largest traction than the second.

The next iteration of Newton's method goes on from there: its first correction, for the status and kappa that changed,
is no smaller, so that 1e-8 took a quarter more corrections for the same forces.
"""
BLOCK = 8
"""Runs that a product of matrices takes at once: five to seven take up to a third longer than eight."""
MOST = 8
"""Corrections in one solve."""

FIRST_CONTRACTION = 1e-2
"""Factor that the first correction is taken to leave of an error."""


Chosen: TypeAlias = IntArray | slice
"""Numbers of moments or runs."""


@dataclass(frozen=True)
class Factors:
    """LU factors of the interface matrix of one set of open, sticking and slipping moments."""

    active: Chosen  # moments that are not open
    sticking: Chosen
    lu: tuple[FloatArray, FloatArray] | None  # None where all are open

    def correct(self, traction: FloatArray, residual: FloatArray, runs: Chosen) -> None:
        """Add the corrections for residuals (2, runs, n) [mm] to the tractions (2, runs, n) of some ``runs``."""
        if self.lu is None:
            return
        normal, tangential = _places(runs, self.active), _places(runs, self.sticking)
        unknown = np.concatenate([residual[0][normal], residual[1][tangential]], axis=1)
        step = sla.lapack.dgetrs(*self.lu, unknown.T, overwrite_b=True)[0].T
        count = traction[0][normal].shape[1]
        traction[0][normal] += step[:, :count]
        traction[1][tangential] += step[:, count:]


Sets: TypeAlias = list[tuple[Chosen, Factors]]
"""Runs, and the factors they share."""


class Lockstep:
    """The linear problem of several runs, at one displacement.

    Args:
        engine: whose compliances all runs share.
        contact: the problem of all runs.
    """

    def __init__(self, engine: Condensed, contact: ContactProblem) -> None:
        self.engine, self.contact = engine, contact
        self._shared = engine.problem(contact)
        self._factors: dict[bytes, Factors] = {}
        self._traction, self._total, self._response = np.zeros((3, *contact.undeformed.shape))
        self._contraction = FIRST_CONTRACTION

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> LinearSolution:
        """Correct the traction of every run with the factors of its status."""
        contact, sets = self.contact, self._by_set(status, kappa, friction)
        traction, before, first = _within(self._traction, status, friction), 0.0, 0.0
        for _ in range(MOST):
            self._move_to(traction, status, kappa)
            corrected = _within(self._corrected(traction, sets), status, friction)
            change = float(np.abs(corrected - traction).max(initial=0.0))
            traction = corrected
            first = first or change
            if before > 0.0 and change > 0.0:
                self._contraction = min(change / before, 1.0)
            if change * self._contraction <= max(EXACT * first, LEAST * float(np.abs(traction).max(initial=0.0))):
                break
            before = change
        self._traction, self._total = traction, contact.total(traction, kappa)
        response, bore = self._shared.respond(_filled(contact.covered.weight * self._total))
        self._response, bore = response[:, : friction.shape[0]], bore[:, : friction.shape[0]]
        trial = traction + contact.covered.gamma * contact.residual(traction, self._total, self._response)
        return LinearSolution(traction, trial, self._total, contact.kappa(bore))

    def displacements(self, answer: LinearSolution) -> tuple[FloatArray, FloatArray]:
        """Displacements of the axle's loaded nodes and of the bore's nodes [mm]."""
        seat_load, bore_load = self.contact.loads(answer.total)
        return _product(self.engine.own_compliance, seat_load), _product(self.engine.between_bore_nodes, bore_load)

    def _move_to(self, traction: FloatArray, status: Status, kappa: FloatArray) -> None:
        """Follow the traction in the rows of the response that the next correction needs."""
        total = self.contact.total(traction, kappa)
        forces, runs = _filled(self.contact.covered.weight * (total - self._total)), total.shape[1]
        for i in (0, 1) if (status.kind == STICK).any() else (0,):
            across, along = self._shared.influence(i)
            self._response[i] += (forces[0] @ across + forces[1] @ along)[:runs]
        self._total = total

    def _by_set(self, status: Status, kappa: FloatArray, friction: FloatArray) -> Sets:
        """The runs of each set of open, sticking and slipping moments, and the factors they share."""
        drag, keys = status.sign * friction, [kind.tobytes() for kind in status.kind]
        found: Sets = []
        different = dict.fromkeys(keys)
        for key in different:
            runs = np.array([k for k, own in enumerate(keys) if own == key])
            if key not in self._factors:
                mean = drag[runs].mean(axis=0), kappa[runs].mean(axis=0)
                self._factors[key] = self._factored(status.kind[runs[0]], *mean)
            found.append((runs if len(different) > 1 else slice(None), self._factors[key]))
        return found

    def _corrected(self, traction: FloatArray, sets: Sets) -> FloatArray:
        """The traction with a correction of the runs of each set of moments at once."""
        left, after = self.contact.residual(traction, self._total, self._response), traction.copy()
        for runs, factors in sets:
            factors.correct(after, left, runs)
        return after

    def _factored(self, kind: StatusArray, drag: FloatArray, kappa: FloatArray) -> Factors:
        """The factors at a mean of sign times friction, and of kappa."""
        active, sticking = np.flatnonzero(kind != OPEN), np.flatnonzero(kind == STICK)
        if not len(active):
            return Factors(slice(0), slice(0), None)
        status = Status(kind, np.sign(drag).astype(np.int8))
        matrix = self._shared.matrix(status, kappa, np.abs(drag), active, sticking)
        self.engine.factorisations += 1
        return Factors(span(active), span(sticking), sla.lapack.dgetrf(matrix, overwrite_a=True)[:2])


def _places(runs: Chosen, moments: Chosen) -> Any:
    """Index of some moments of some runs."""
    both = isinstance(runs, slice) or isinstance(moments, slice)
    return (runs, moments) if both else np.ix_(runs, moments)  # type: ignore[arg-type]


def _within(traction: FloatArray, status: Status, friction: FloatArray) -> FloatArray:
    """The traction that its status allows: none where open, friction's where it slips."""
    normal = np.where(status.kind == OPEN, 0.0, traction[0])
    slipping = -status.sign * friction * normal
    return np.stack([normal, np.where(status.kind == STICK, traction[1], slipping)])


def _product(matrix: FloatArray, loads: FloatArray) -> FloatArray:
    """The matrix (2, n, 2, n) times loads (2, runs, n), without columns before the first and after the last load."""
    loaded = np.flatnonzero(loads.any(axis=(0, 1)))
    within = slice(int(loaded[0]), int(loaded[-1]) + 1) if len(loaded) else slice(0)
    blocks = matrix[..., within]
    r, z = _filled(loads[..., within])
    return np.stack([(r @ blocks[i, :, 0].T + z @ blocks[i, :, 1].T)[: loads.shape[1]] for i in (0, 1)])


def _filled(values: FloatArray) -> FloatArray:
    """Values (2, runs, n) with runs of zeros beside them where products take those for less, see `BLOCK`."""
    spare = -values.shape[1] % BLOCK
    if not 0 < spare < BLOCK // 2:
        return values
    filled = np.zeros((2, values.shape[1] + spare, values.shape[2]))
    filled[:, : values.shape[1]] = values
    return filled
