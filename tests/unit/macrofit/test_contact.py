"""The law's status, and the way a slip turns around."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from macrofit.base.arrays import FloatArray
from macrofit.contact.law import LinearSolution, Status, classify
from macrofit.contact.newton import SHARE, _left, newton
from macrofit.contact.status import OPEN, SLIP, STICK


def test_status_of_a_trial() -> None:
    trial = np.array([[1.0, -10.0, -10.0, -10.0, -10.0], [5.0, 0.5, 2.0, -2.0, 3.0]])
    friction = np.array([0.1, 0.1, 0.1, 0.1, 0.0])
    status = classify(trial, friction)
    assert status.kind.tolist() == [OPEN, STICK, SLIP, SLIP, SLIP]
    assert status.sign.tolist() == [0, 0, 1, -1, 0]


def test_a_slip_turns_around_through_stick() -> None:
    before = Status(np.array([SLIP, SLIP], dtype=np.int8), np.array([1, 1], dtype=np.int8))
    after = classify(np.array([[-10.0, -10.0], [-5.0, 5.0]]), np.array([0.1, 0.1]), before)
    assert after.kind.tolist() == [STICK, SLIP]
    assert after.sign.tolist() == [0, 1]


class Planted:
    """Answers every status with the same slip, whose trial is ``off`` the traction; kappa turns by a factor a step."""

    def __init__(self, off: float, factor: float) -> None:
        self.off, self.factor, self.turned = off, factor, 1e-3
        self.contact: Any = self

    def total(self, traction: FloatArray, kappa: FloatArray) -> FloatArray:
        """The load where the pressure's axial share is tangential."""
        return np.asarray(traction - traction[0] * kappa * np.array([[0.0], [1.0]]))

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> LinearSolution:
        traction = np.array([[-10.0], [1.0]])
        trial = traction + np.array([[-self.off], [5.0]])
        self.turned *= self.factor
        return LinearSolution(traction, trial, traction, kappa + self.turned)


def slipping(problem: Planted) -> tuple[bool, float]:
    """How Newton's method ends with a planted problem, and the last turn of kappa."""
    status = Status(np.array([SLIP], dtype=np.int8), np.array([1], dtype=np.int8))
    return newton(problem, np.array([0.1]), status, np.zeros(1), 40).converged, problem.turned


@pytest.mark.parametrize(("off", "converged"), [(0.0, True), (1e-8, True), (1e-5, False), (1e4, False)])
def test_status_that_stays_is_no_answer_while_the_law_is_broken(off: float, *, converged: bool) -> None:
    """A solve too ill-conditioned for its own trial keeps traction and status all the same."""
    assert slipping(Planted(off, 0.1))[0] == converged


def test_the_load_of_an_answer_is_that_of_its_own_kappa() -> None:
    """The last solve loaded the bodies one kappa late; the force, a sum of the load, must not be late as well."""
    problem = Planted(0.0, 0.1)
    status = Status(np.array([SLIP], dtype=np.int8), np.array([1], dtype=np.int8))
    answer = newton(problem, np.array([0.1]), status, np.zeros(1), 40).answer
    assert problem.turned > 0.0
    assert answer.total.tolist() == problem.total(answer.traction, answer.kappa).tolist()


def test_what_is_left_of_an_error_is_not_less_than_said() -> None:
    """Changes that fall by 1e-3: at one status the factor is believed, doubled; after a change of status it is not."""
    assert _left(1e-8, 1e-5, same=True) == pytest.approx(2e-11)
    assert _left(1e-8, 1e-5, same=False) == pytest.approx(1e-10)
    assert _left(1e-8, 1e-1, same=True) == pytest.approx(2e-11)  # no smaller factor is believed
    assert _left(1e-8, 1.5e-8, same=True) == 1e-8
    assert _left(1e-8, np.inf, same=True) == 1e-8


class Turning:
    """A slip that first sticks: ``steps`` are the changes of the traction, kappa turns all the time or never."""

    def __init__(self, *steps: float, turned: float) -> None:
        self.steps, self.turned, self.contact, self.solves = iter(steps), turned, self, 0

    def total(self, traction: FloatArray, kappa: FloatArray) -> FloatArray:
        """The traction alone."""
        return traction

    def solve(self, status: Status, kappa: FloatArray, friction: FloatArray) -> LinearSolution:
        self.solves += 1
        traction = np.array([[-1.0], [0.1]]) * (1.0 + next(self.steps))
        return LinearSolution(traction, traction + np.array([[0.0], [1.0]]), traction, kappa + self.turned)


def solves(problem: Any) -> int:
    """Solves until Newton's method ends, from stick."""
    status = Status(np.array([STICK], dtype=np.int8), np.array([0], dtype=np.int8))
    assert newton(problem, np.array([0.1]), status, np.zeros(1), 10).converged
    return int(problem.solves)


def test_a_factor_over_a_change_of_status_is_not_believed() -> None:
    """2e-8 after a large change leaves 4e-11 where all three solves had one status, 2e-10 where the first had not."""
    assert solves(Turning(1.0, 0.0, 2e-8, 2e-8, turned=1e-12)) == 4
    assert solves(Turning(1.0, 0.5, 0.0, 2e-8, 2e-8, turned=1e-12)) == 4


def test_a_status_that_stays_is_exact_where_kappa_does() -> None:
    """Its first solve has the factors of its own kappa: no second one to see that nothing changes."""
    assert solves(Turning(1.0, 0.0, turned=0.0)) == 2


def test_loads_follow_kappa_before_it_is_an_answer() -> None:
    """The traction has stopped where kappa, which turns the pressure's load, has not."""
    converged, turned = slipping(Planted(0.0, 0.1))
    assert converged
    assert turned <= SHARE
    assert not slipping(Planted(0.0, 1.0))[0]
