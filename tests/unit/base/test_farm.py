"""The processes of a farm: every task once, whatever a task, a process or the one who orders does."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from macrofit.base.farm import FarmError, ProcessFarm


def squared(number: int) -> int:
    return number * number


def failing(number: int) -> int:
    if number == 2:
        raise ValueError("two")
    return number


def failing_in_secret(number: int) -> int:
    error = OSError("two")
    error.seen = lambda: number  # type: ignore[attr-defined]  # what pickle cannot take
    raise error


def killed(number: int) -> int:
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def large(number: int) -> bytes:
    return bytes(40_000_000)


@pytest.mark.parametrize(("jobs", "tasks"), [(2, 7), (3, 1), (2, 0)])
def test_every_task_is_done_once(jobs: int, tasks: int) -> None:
    found: list[int] = []
    ProcessFarm(jobs).run(range(tasks), squared, found.append)
    assert sorted(found) == [number * number for number in range(tasks)]


def test_an_exception_says_where_it_was_raised() -> None:
    with pytest.raises(ValueError, match="two") as caught:
        ProcessFarm(2).run(range(6), failing, lambda result: None)
    assert "in failing" in "".join(caught.value.__notes__)
    with pytest.raises(FarmError, match="in failing_in_secret"):
        ProcessFarm(2).run(range(6), failing_in_secret, lambda result: None)


def test_an_error_of_the_one_who_accepts_is_its_own() -> None:
    def refuse(result: int) -> None:
        raise ConnectionResetError(result)

    with pytest.raises(ConnectionResetError):
        ProcessFarm(2).run(range(6), squared, refuse)


def test_a_process_that_is_killed_is_one_line() -> None:
    with pytest.raises(FarmError, match="killed"):
        ProcessFarm(2).run(range(6), killed, lambda result: None)


def test_it_ends_while_a_process_writes_a_large_result() -> None:
    """A process that is ended in the middle of its result must leave nobody waiting for the rest."""
    code = (
        "from tests.unit.base.test_farm import ProcessFarm, large\n"
        "def refuse(result): raise SystemExit(3)\n"
        "ProcessFarm(2).run(range(8), large, refuse)"
    )
    done = subprocess.run([sys.executable, "-c", code], timeout=60.0, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (3, "")
