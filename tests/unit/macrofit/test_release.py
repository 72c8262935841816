"""The secants that free a fit from the force of its support, on curves that are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from macrofit.contact.law import LinearSolution, Status
from macrofit.contact.newton import Report
from macrofit.contact.release import FREE, release

BOUND = 100.0  # N


@dataclass(frozen=True)
class Point:
    """A fit of a given curve."""

    given: float
    force: float
    report: Report
    friction_bound: float = BOUND
    normal_force: float = 10.0 * BOUND


def curve(
    force: Callable[[float], float], fails_beyond: float = np.inf
) -> tuple[list[Point], Callable[[float], Point]]:
    tried: list[Point] = []
    none = np.zeros((2, 0))
    answer = LinearSolution(none, none, none, np.zeros(0))
    status = Status(np.zeros(0, dtype=np.int8), np.zeros(0, dtype=np.int8))

    def fit_at(given: float) -> Point:
        converged = abs(given) <= fails_beyond
        report = Report(answer=answer, status=status, iterations=1, residual=0.0, converged=converged)
        tried.append(Point(given, force(given), report))
        return tried[-1]

    return tried, fit_at


@pytest.mark.parametrize("flexibility", [1e-6, 1e-3, 3e-2])
def test_a_straight_curve_takes_two_steps(flexibility: float) -> None:
    tried, fit_at = curve(lambda given: 30.0 + 1e3 * given)
    assert release(fit_at, flexibility).given == pytest.approx(-0.03, rel=1e-9)
    assert len(tried) <= 4  # the last is against rounding


@pytest.mark.parametrize("force", [30.0, -99.0])
def test_a_curve_that_bends_where_facets_slip(force: float) -> None:
    tried, fit_at = curve(lambda given: force + BOUND * np.tanh(10.0 * given))
    assert abs(release(fit_at, 1e-4).force) <= FREE * BOUND
    assert len(tried) < 15


@pytest.mark.parametrize("force", [101.0, -150.0])
def test_what_friction_cannot_carry_stays_on_the_support(force: float) -> None:
    tried, fit_at = curve(lambda given: force + BOUND * np.tanh(10.0 * given))
    assert release(fit_at, 1e-4).force == force
    assert len(tried) == 1


def test_a_curve_that_ends_before_it_is_free_stays_on_the_support() -> None:
    _, fit_at = curve(lambda given: 99.0 + 98.0 * max(given, -1.0))
    assert release(fit_at, 1e-2).force == 99.0


def test_a_fit_that_does_not_converge_is_handed_on() -> None:
    """The increment is then refused as any that fails."""
    _, fit_at = curve(lambda given: 30.0 + 1e3 * given, fails_beyond=0.01)
    assert not release(fit_at, 1e-3).report.converged
