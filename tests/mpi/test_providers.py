"""A provider's failure on one rank ends the run on all of them, with the provider's name; good ones share the work."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI
from small import small_press

from macrofit.errors import ProviderError
from macrofit.friction import TilePairs
from macrofit.geometry import FloatArray
from macrofit.solution import Increment
from macrofit.solve import solve

WORLD = MPI.COMM_WORLD


class Tiles:
    """0.05 or 0.15 by the parity of the seat tile, until ``break_at`` pairs were answered on the last rank."""

    depends_on = frozenset({"tiles"})

    def __init__(self, bad: Callable[[FloatArray], FloatArray] | None = None, break_at: int = 0) -> None:
        self.bad, self.break_at, self.asked = bad, break_at, 0

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        self.asked += len(pairs.seat)
        answer = 0.05 + 0.1 * (pairs.seat % 2)
        if self.bad is not None and WORLD.rank == WORLD.size - 1 and self.asked > self.break_at:
            return self.bad(answer)
        return answer


def raises(answer: FloatArray) -> FloatArray:
    raise RuntimeError("the table is empty")


FAILURES: dict[str, tuple[Callable[[FloatArray], FloatArray], str]] = {
    "raises": (raises, "the table is empty"),
    "nan": (lambda answer: answer * np.nan, "nan"),
    "shape": (lambda answer: answer[:-1], "shape"),
    "negative": (lambda answer: -answer, "-0."),
    "large": (lambda answer: answer + 2.0, "2."),
}


class Kept:
    """A monitor and journal that remember what was accepted."""

    def __init__(self) -> None:
        self.records: list[Increment] = []

    def started(self, scene: object, total_increments: int, dofs: int) -> None: ...

    def increment(self, record: Increment) -> None:
        self.records.append(record)

    def finished(self) -> None: ...


@pytest.mark.mpi
@pytest.mark.parametrize(("bad", "message"), FAILURES.values(), ids=FAILURES.keys())
def test_failure_on_one_rank(
    bad: Callable[[FloatArray], FloatArray], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every rank gets the ProviderError; the increments accepted before it were told on every rank."""
    provider = Tiles(bad, break_at=60)
    monkeypatch.setattr("macrofit.assembly.build", lambda name, options, context: provider)
    kept = Kept()
    with pytest.raises(ProviderError, match="uniform") as caught:
        solve(small_press(), WORLD, kept)
    assert message in str(caught.value)
    assert 0 < len(kept.records) < 10
    assert WORLD.allgather(len(kept.records)) == [len(kept.records)] * WORLD.size


@pytest.mark.mpi
def test_the_batch_is_shared_and_each_pair_asked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    provider = Tiles()
    monkeypatch.setattr("macrofit.assembly.build", lambda name, options, context: provider)
    solution = solve(small_press(), WORLD)
    asked = WORLD.allgather(provider.asked)
    assert sum(asked) == solution.counters["pairs_asked"]
    assert max(asked) - min(asked) <= len(solution.increments)
    alone = Tiles()
    monkeypatch.setattr("macrofit.assembly.build", lambda name, options, context: alone)
    assert (solve(small_press(), MPI.COMM_SELF).force == solution.force).all()


@pytest.mark.mpi
def test_a_monitor_that_fails_on_one_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(Kept):
        def increment(self, record: Increment) -> None:
            super().increment(record)
            if WORLD.rank == 0 and record.index == 3:
                raise OSError("no space left on device")

    kept = Full()
    with pytest.raises(OSError, match="no space left"):
        solve(small_press(), WORLD, kept)
    assert len(kept.records) == 4


@pytest.mark.mpi
def test_uniform_of_any_kind_is_the_same_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    class Constant:
        depends_on = frozenset({"tiles", "pressure", "sliding"})

        def coefficients(self, pairs: TilePairs) -> FloatArray:
            return np.full(len(pairs.seat), 0.11)

    uniform = solve(small_press(), WORLD)
    assert uniform.counters["provider_calls"] == 1
    assert uniform.counters["pairs_asked"] == 1
    monkeypatch.setattr("macrofit.assembly.build", lambda name, options, context: Constant())
    assert (solve(small_press(), WORLD).force == uniform.force).all()
