"""Semismooth Newton on the status of the moments; returns a report, prints nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..base.arrays import FloatArray
from .law import ContactProblem, LinearSolution, Status, StatusArray, classify, return_mapping
from .status import SLIP, STICK

TOLERANCE = 1e-10
"""Largest error of the traction that is left, relative to the largest traction."""

RESIDUAL = 1e-7
"""Largest violation of the traction law that is accepted, relative to the largest traction."""

SHARE = 1e-9
"""Largest change of the pressure's axial share, which loads the bodies one kappa late, relative to the traction."""

CONTRACTION, SAME_STATUS = 1e-2, 2e-3
"""Least factor between two changes that is believed; the second where the status was one and the same for both."""

NO_SLIP = 1e-6
"""Slip below this share of the motion is none: the facet sticks, wherever in the cone its traction is.

A traction that is kept at the cone's edge slips by 1e-8 of the motion (`push-out`, by the sleeve's own flexibility),
the first facet that slip reaches by 1e-3.
"""


class Linear(Protocol):
    """What is linear once status and kappa are given: the problem of one run, or of several in lockstep."""

    contact: ContactProblem

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> LinearSolution:
        """Traction, trial traction and kappa after one linear solve."""
        ...


class LinearProblem(Linear, Protocol):
    """The problem of one run: condensed or monolithic."""

    def displacements(self, answer: LinearSolution) -> tuple[FloatArray, FloatArray]:
        """Displacements of the axle's loaded nodes and of the bore's nodes [mm] at the last answer."""
        ...


@dataclass(frozen=True, kw_only=True)
class Report:
    """How Newton's method ended."""

    answer: LinearSolution
    status: Status
    iterations: int
    residual: float  # largest |lambda - return_mapping(trial)| relative to the largest traction
    converged: bool


def newton(problem: Linear, friction: FloatArray, status: Status, kappa: FloatArray, limit: int = 0) -> Report:
    """Iterate status -> linear solve -> status until neither status nor traction changes.

    The law is piecewise linear, so that the step that keeps its status is exact; kappa, which depends weakly on the
    displacement, is taken from the step before. The changes of the traction then fall geometrically, and the last two
    say what is left: change * (change / change before); of a body so soft that kappa follows the traction more than
    the traction kappa, the change of kappa's load says more. The answer's load is that of its last kappa. A status that
    comes back is a cycle: from then on repeated ones change one moment at a time.
    """
    limit = limit or 100 + friction.size  # a front of slip or contact may move by a moment or two a step
    before, last, same = None, np.inf, 0
    seen: set[bytes] = set()
    for iteration in range(1, limit + 1):
        answer = problem.solve(status, kappa, friction)
        asked = classify(answer.trial, friction, status)
        scale = float(np.abs(answer.traction).max(initial=0.0))
        change = np.inf if before is None else float(np.abs(answer.traction - before).max(initial=0.0))
        left = _left(change, last, same=same > 1)
        error = float(np.abs(answer.traction - return_mapping(answer.trial, friction)).max(initial=0.0))
        turned = np.abs(answer.kappa - kappa)
        same = same + 1 if asked.same(status) else 0
        own = same == 1 or change <= SHARE * scale  # a solve after it may be by the factors of another kappa
        settled = (
            same > 0
            and (left <= TOLERANCE * scale or (own and bool((turned <= 1e-13).all())))
            and float((turned * np.abs(answer.traction[0])).max(initial=0.0)) <= SHARE * scale
            and error <= RESIDUAL * scale
        )
        if settled or iteration == limit:
            break
        key = asked.kind.tobytes() + asked.sign.tobytes()
        if key in seen:
            asked = _one_change(status, asked, answer.trial, friction)
        seen.add(key)
        before, last, status, kappa = answer.traction, change, asked, answer.kappa
    return Report(
        answer=replace(answer, total=problem.contact.total(answer.traction, answer.kappa)),
        status=status,
        iterations=iteration,
        residual=error / scale if scale else error,
        converged=settled,
    )


def _left(change: float, last: float, *, same: bool) -> float:
    """What is left of an error after a change and the ``last`` one before; ``same``: at one and the same status.

    At one status the factor between two changes converges, mostly from below: twice the last one is on the safe side.
    """
    if not 0.0 < last < np.inf:
        return change
    factor = max(2.0 * change / last, SAME_STATUS) if same else max(change / last, CONTRACTION)
    return change * min(factor, 1.0)


def _one_change(status: Status, asked: Status, trial: FloatArray, friction: FloatArray) -> Status:
    """Take over the one change from ``status`` to ``asked`` that is farthest from the law.

    Where stick and slip of neighbours chase each other around a cycle, changing all of them at once does not end.
    """
    changed = (asked.kind != status.kind) | (asked.sign != status.sign)
    if not changed.any():
        return asked
    excess = np.where(changed, np.abs(trial - return_mapping(trial, friction)).max(axis=0), -1.0)
    kind, sign = status.kind.copy(), status.sign.copy()
    one = np.unravel_index(int(np.argmax(excess)), excess.shape)
    kind[one], sign[one] = asked.kind[one], asked.sign[one]
    return Status(kind, sign)


def settled_status(
    report: Report, contact: ContactProblem, friction: FloatArray, slip: FloatArray, moved: float
) -> StatusArray:
    """Status of each moment by its slip [mm]: one that friction holds without slip in this motion [mm] sticks."""
    asked = report.status.kind
    largest = np.abs(report.answer.traction).max(axis=(0, -1), initial=0.0, keepdims=True)[0]
    unseen = RESIDUAL * largest / contact.covered.gamma
    slips = (np.abs(slip) > np.maximum(NO_SLIP * abs(moved), unseen)) | (friction == 0.0)
    return np.where((asked == SLIP) & ~slips, STICK, asked).astype(np.int8)
