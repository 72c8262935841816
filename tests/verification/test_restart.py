"""A resumed run is the uninterrupted one to the bit; a failed and cut back increment leaves no trace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small import condensed_press, small_press

from macrofit import press as press_module
from macrofit.contact.newton import Report, newton
from macrofit.errors import ConvergenceError
from macrofit.solution import Increment, Solution
from macrofit.solve import solve
from macrofit.state import State


class Memory:
    """A journal in memory that can be cut short."""

    def __init__(self, kept: list[tuple[Increment, dict[str, np.ndarray]]]) -> None:
        self.kept = kept

    def records(self) -> list[tuple[Increment, dict[str, np.ndarray]]]:
        return list(self.kept)

    def append(self, record: Increment, state: dict[str, np.ndarray]) -> None:
        self.kept.append((record, {name: array.copy() for name, array in state.items()}))


@pytest.fixture(scope="module", params=[0, -1])
def journalled(request: pytest.FixtureRequest) -> tuple[Solution, Memory]:
    """A run that nobody interrupts and its journal, for a theta."""
    whole = Memory([])
    return solve(small_press(f"contact.theta={request.param}", fields=True), journal=whole), whole


@pytest.mark.parametrize("kept", [1, 4, 9])
def test_resumed_is_uninterrupted(kept: int, journalled: tuple[Solution, Memory]) -> None:
    uninterrupted, whole = journalled
    resumed = solve(uninterrupted.scene, journal=Memory(whole.kept[:kept]))
    assert (resumed.force == uninterrupted.force).all()
    assert resumed.max_von_mises == uninterrupted.max_von_mises
    assert len(resumed.increments) == len(uninterrupted.increments)
    assert (resumed.increments[-1].facets.pressure == uninterrupted.increments[-1].facets.pressure).all()


def test_state_as_arrays_and_back() -> None:
    press, _ = condensed_press(small_press())
    _, state = list(press.increments(press.rest()))[3]
    back = State.restored(state.arrays())
    for name, array in state.arrays().items():
        assert np.array_equal(getattr(back, name), array)


def test_a_failed_trial_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    """A trial that is thrown away changes nothing of what follows, to the bit."""
    press, _ = condensed_press(small_press())
    plain = [record.force for record, _ in press.increments(press.rest())]
    disturbed: list[float] = []
    state = press.rest()
    for displacement in press.scene.displacements:
        press.trial(state, displacement + 17.3)
        steps, _ = press.advance_to(state, displacement)
        state = steps[-1].state
        disturbed.append(steps[-1].force)
    assert disturbed == plain


def failing(monkeypatch: pytest.MonkeyPatch, longest: float) -> None:
    """Make Newton's method fail on increments longer than ``longest`` mm."""

    def stubborn(problem, friction, status, kappa, limit=0) -> Report:  # type: ignore[no-untyped-def]
        report = newton(problem, friction, status, kappa, limit)
        slip = problem.contact.approach[1]
        return replace(report, converged=report.converged and float(np.abs(slip).max()) < longest + 0.2)

    monkeypatch.setattr(press_module, "newton", stubborn)


def test_cutback_is_a_finer_increment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Increments of 5 mm that fail are halved twice: the forces of 1.25 mm increments, to the bit."""
    fine = small_press("motion.increment=1.25")
    press, _ = condensed_press(fine)
    wanted = {record.displacement: record.force for record, _ in press.increments(press.rest())}
    press, _ = condensed_press(small_press())
    failing(monkeypatch, 1.25)
    records = [record for record, _ in press.increments(press.rest())]
    assert [record.cutbacks for record in records[1:]] == [2] * 9
    assert all(record.force == wanted[record.displacement] for record in records)
    assert all(record.converged for record in records)


def test_cutbacks_end_in_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    press, _ = condensed_press(small_press("motion.max_cutbacks=3"))
    failing(monkeypatch, -1.0)
    increments = press.increments(press.rest())
    with pytest.raises(ConvergenceError, match=r"no convergence between displacements .* try a smaller"):
        list(increments)
    with pytest.raises(ConvergenceError, match=r"between displacements 15 and 15\.625 mm after 3 cutbacks"):
        press.advance_to(press.rest(), 20.0)
