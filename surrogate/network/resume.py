"""The state of a training on disk, so that a killed one goes on: tensors in safetensors, nothing is ever unpickled."""

from __future__ import annotations

import hashlib
import time
import warnings
from contextlib import suppress
from pathlib import Path

import safetensors.torch
import torch
from torch import Tensor, nn

from macrofit.base.files import replacing

ENTRY = "macrofit-surrogate-state"
CHECK_SUM = "sha256"
SAVE_PERIOD_S = 20.0
"""Time between two states [s]."""
Tensors = dict[str, Tensor]
"""Tensors by name."""


class TrainingState:
    """A file with the state of a training and its check sum; one of another training is as good as none.

    Args:
        path: the file; None keeps nothing.
        key: text that names all that the training's bits depend on.
    """

    def __init__(self, path: Path | None, key: str) -> None:
        self.path, self.key = path, key
        self._last = time.monotonic()

    def read(self) -> Tensors | None:
        """Read what the same training saved; None if there is nothing, or, with a warning, if it is damaged."""
        if self.path is None or not self.path.is_file():
            return None
        try:
            with safetensors.safe_open(self.path, framework="pt") as file:
                names, told = sorted(file.keys()), file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in names}
            sound = told.get(CHECK_SUM) == check_sum(tensors, told.get(ENTRY, ""))
        except (OSError, safetensors.SafetensorError, ValueError, RuntimeError, TypeError, KeyError):
            sound = False
        if not sound:
            warnings.warn(
                f"{self.path}: is damaged, or of an older version; the training starts from the beginning",
                stacklevel=2,
            )
            return None
        return tensors if told[ENTRY] == self.key else None

    def due(self) -> bool:
        """Whether the last state is old enough for the next."""
        return self.path is not None and time.monotonic() - self._last >= SAVE_PERIOD_S

    def write(self, tensors: Tensors) -> None:
        """Put a state in the place of the one before, in one step.

        Raises:
            OutputError: it cannot be written.
        """
        if self.path is None:
            return
        with replacing(self.path) as draft:
            told = {ENTRY: self.key, CHECK_SUM: check_sum(tensors, self.key)}
            draft.write_bytes(safetensors.torch.save(tensors, told))
        self._last = time.monotonic()

    def remove(self) -> None:
        """Remove the file: the training is over."""
        if self.path is not None:
            with suppress(OSError):
                self.path.unlink(missing_ok=True)


def check_sum(tensors: Tensors, key: str) -> str:
    """SHA-256 of a training's key and of names, kinds, shapes and bytes of its tensors."""
    whole = hashlib.sha256(key.encode())
    for name, tensor in sorted(tensors.items()):
        whole.update(f"\n{name} {tensor.dtype} {tuple(tensor.shape)}\n".encode())
        whole.update(tensor.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
    return whole.hexdigest()


def pack_state(model: nn.Module, optimiser: torch.optim.Optimizer, kept: Tensors) -> Tensors:
    """Parameters, the kept ones, the optimiser's moments and the generator, as copies by name."""
    moments = optimiser.state_dict()["state"]
    state = {f"model.{name}": value for name, value in model.state_dict().items()}
    state |= {f"kept.{name}": value for name, value in kept.items()}
    state |= {f"moments.{at}.{name}": value for at, some in moments.items() for name, value in some.items()}
    state["generator"] = torch.get_rng_state()
    return {name: value.detach().cpu().clone().contiguous() for name, value in state.items()}


def restore_state(state: Tensors, model: nn.Module, optimiser: torch.optim.Optimizer) -> Tensors:
    """Put a state back into model, optimiser and generator; gives the kept parameters."""
    model.load_state_dict(_under("model.", state))
    moments: dict[int, Tensors] = {}
    for name, value in _under("moments.", state).items():
        at, moment = name.split(".")
        moments.setdefault(int(at), {})[moment] = value
    optimiser.load_state_dict(optimiser.state_dict() | {"state": moments})
    torch.set_rng_state(state["generator"])
    return _under("kept.", state)


def _under(prefix: str, state: Tensors) -> Tensors:
    """The tensors whose names begin with a prefix, without it."""
    return {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
