"""Epochs of a training: down the loss of one part of the pairs, stopped by the loss of the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import torch

from .checkpoint import Model
from .resume import TrainingState, pack_state, restore_state

Watch: TypeAlias = Callable[[int, float, float], None]
"""Told epoch, training loss and validation loss after each epoch."""


@dataclass
class Curves:
    """Loss by epoch; the first entry is before training."""

    training: list[float] = field(default_factory=list)
    validation: list[float] = field(default_factory=list)
    best: int = 0
    """Epoch whose state was kept."""


@dataclass(frozen=True)
class Descent:
    """What an architecture brings to `descend`."""

    optimiser: torch.optim.Optimizer
    steps: Callable[[], Iterator[float]]
    """One epoch; yields the loss of each step."""
    validate: Callable[[], float]
    """The loss on the validation pairs."""


def descend(
    model: Model, descent: Descent, epochs: int, patience: int, saved: TrainingState, watch: Watch | None
) -> Curves:
    """Run epochs until the validation loss has not fallen for `patience` of them; the best state is put back."""
    state = saved.read()
    if state is None:
        kept = {name: value.clone() for name, value in model.state_dict().items()}
        curves = Curves([float("nan")], [descent.validate()])
    else:
        kept = restore_state(state, model, descent.optimiser)
        curves = Curves(state["training"].tolist(), state["validation"].tolist(), int(state["best"]))
    for epoch in range(len(curves.training), epochs + 1):
        if epoch - 1 - curves.best >= patience:
            break
        curves.training.append(float(np.mean(list(descent.steps()))))
        curves.validation.append(descent.validate())
        if curves.validation[-1] < curves.validation[curves.best]:
            curves.best = epoch
            kept = {name: value.clone() for name, value in model.state_dict().items()}
        if saved.due():
            losses = {"training": curves.training, "validation": curves.validation}
            numbers = {name: torch.tensor(values, dtype=torch.float64) for name, values in losses.items()}
            saved.write(pack_state(model, descent.optimiser, kept) | numbers | {"best": torch.tensor(curves.best)})
        if watch is not None:
            watch(epoch, curves.training[-1], curves.validation[-1])
    model.load_state_dict(kept)
    return curves
