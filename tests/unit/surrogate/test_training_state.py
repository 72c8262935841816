"""The state of a training: what was saved comes back, and nothing that was damaged does."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

from surrogate.network.resume import TrainingState

KEY = "the training of these tests"
FLIPS = 280
TENSORS = {
    "generator": torch.arange(64, dtype=torch.uint8),
    "model.weight": torch.linspace(-1.0, 1.0, 35, dtype=torch.float64).reshape(5, 7),
    "moments.0.step": torch.tensor(3.0),
}


@pytest.fixture
def state(tmp_path: Path) -> Path:
    TrainingState(tmp_path / "state", KEY).write(TENSORS)
    return tmp_path / "state"


def test_comes_back_to_the_bit(state: Path) -> None:
    read = TrainingState(state, KEY).read()
    assert read is not None
    assert read.keys() == TENSORS.keys()
    assert all(torch.equal(read[name], tensor) for name, tensor in TENSORS.items())


def test_another_training_gets_nothing_and_hears_nothing(state: Path, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert TrainingState(state, "another").read() is None
        assert TrainingState(tmp_path / "none", KEY).read() is None


def test_no_flipped_bit_is_accepted(state: Path) -> None:
    """Of 280 damaged states 216 were accepted; what still reads must be what was written."""
    whole, rng = state.read_bytes(), np.random.default_rng(5)
    for place in rng.integers(0, len(whole), FLIPS):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        state.write_bytes(damaged)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            read = TrainingState(state, KEY).read()
        if read is None:
            assert len(said) == 1
            assert "is damaged" in str(said[0].message)
        else:
            assert all(torch.equal(read[name], tensor) for name, tensor in TENSORS.items())


@pytest.mark.parametrize("length", [0, 1, 7, 100, -1])
def test_cut_short(state: Path, length: int) -> None:
    state.write_bytes(state.read_bytes()[:length])
    with pytest.warns(UserWarning, match="is damaged"):
        assert TrainingState(state, KEY).read() is None
