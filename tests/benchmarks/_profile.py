"""What the profiles share: functions watched from outside, costs beside their floor, the rates of this machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import blas

from ._measure import cpu, row

WORD = 8.0
"""Bytes of a number."""


class Watch:
    """Calls of one function while the block lasts, their CPU seconds, and a note of each.

    Args:
        owner: Module or class whose function is replaced by one that watches it.
        name: Of the function.
        note: From the arguments and the result of a call to what is kept of it.
    """

    def __init__(self, owner: Any, name: str, note: Callable[[Any, Any], Any] = lambda arguments, result: None) -> None:
        self.owner, self.name, self.note = owner, name, note
        self.notes: list[Any] = []
        self.cpu_s = 0.0

    @property
    def calls(self) -> int:
        """How often it was called."""
        return len(self.notes)

    def __enter__(self) -> Watch:
        self._watched = watched = getattr(self.owner, self.name)

        def timed(*arguments: Any, **options: Any) -> Any:
            started = time.process_time()
            try:
                result = watched(*arguments, **options)
            finally:
                self.cpu_s += time.process_time() - started
            self.notes.append(self.note(arguments, result))
            return result

        setattr(self.owner, self.name, timed)
        return self

    def __exit__(self, *error: object) -> None:
        setattr(self.owner, self.name, self._watched)


class Cost(NamedTuple):
    """One stage: CPU time [s], operations, bytes; without operations and bytes it has no floor."""

    stage: str
    seconds: float
    flops: float = 0.0
    bytes: float = 0.0


class Rates(NamedTuple):
    """Of this machine, on one thread [1/s]."""

    flops: float
    bytes: float

    def __str__(self) -> str:
        """A sentence for the head of a table."""
        return f"dgemm {self.flops / 1e9:.1f} Gflop/s, daxpy {self.bytes / 1e9:.1f} GB/s"


def rates(size: int, length: int) -> Rates:
    """Operations of dgemm, and bytes of daxpy over arrays far larger than a cache."""
    a = np.asfortranarray(np.random.default_rng(0).normal(size=(size, size)))
    x, y = np.ones(length), np.ones(length)
    product, _ = cpu(lambda: blas.dgemm(1.0, a, a), repeats=5)
    update, _ = cpu(lambda: blas.daxpy(x, y, a=1.1), repeats=5)
    return Rates(2.0 * size**3 / product.median, 3.0 * WORD * length / update.median)


def medians(repeats: int, once: Callable[[], list[Cost]]) -> list[Cost]:
    """The stages of some runs, each with its median time; the first run is not counted."""
    runs = [once() for _ in range(repeats + 1)][1:]
    return [costs[0]._replace(seconds=median(cost.seconds for cost in costs)) for costs in zip(*runs, strict=True)]


def line(cost: Cost, machine: Rates, whole: float | None = None) -> str:
    """A row of the table, with the share of the whole where one is given."""
    floor = max(cost.flops / machine.flops, cost.bytes / machine.bytes)
    counted = [f"{value / 1e6:.3g}" if value else "" for value in (cost.flops, cost.bytes)]
    known = [f"{1e3 * floor:.2g}", f"{cost.seconds / floor:.1f}"] if floor else ["", ""]
    share = [] if whole is None else [f"{cost.seconds / whole:.0%}"]
    return row(cost.stage, f"{1e3 * cost.seconds:.3g}", *share, *counted, *known)
