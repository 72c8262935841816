"""The law's status, and the way a slip turns around."""

from __future__ import annotations

import numpy as np

from macrofit.contact import Status, classify
from macrofit.solution import OPEN, SLIP, STICK


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
