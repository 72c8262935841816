"""How ranks divide the work: who holds which body, and a provider's batch in parts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from .base.arrays import FloatArray
from .base.ranks import raise_together
from .friction import FrictionProvider, PairFriction, TilePairs, answered


def summed(comm: MPI.Comm, counters: dict[str, int]) -> dict[str, int]:
    """Counters added up over the ranks; a name that a rank has not counts as 0 there. Collective."""
    every: list[dict[str, int]] = comm.allgather(counters)
    names = dict.fromkeys(name for one in every for name in one)
    return {name: sum(one.get(name, 0) for one in every) for name in names}


class SharedAsk:
    """Divides a batch of tile pairs among the ranks; every rank returns the whole answer. Collective."""

    def __init__(self, comm: MPI.Comm, name: str) -> None:
        self.comm, self.name = comm, name

    def __call__(self, provider: FrictionProvider, pairs: TilePairs) -> PairFriction:
        """Coefficients of ``pairs`` and their uncertainty, each asked on one rank and checked there."""
        if self.comm.size == 1:
            with raise_together(self.comm):
                return answered(provider, pairs, self.name)
        mine = self.part(pairs)
        answer = PairFriction(np.zeros(0), np.zeros(0))
        with raise_together(self.comm):
            if len(mine.seat):
                answer = answered(provider, mine, self.name)
        return PairFriction(*np.concatenate(self.comm.allgather(np.stack(answer)), axis=1))

    def part(self, pairs: TilePairs) -> TilePairs:
        """Those of the pairs that are asked on this rank."""
        bounds = np.linspace(0, len(pairs.seat), self.comm.size + 1).astype(np.int64)
        return pairs.take(np.arange(bounds[self.comm.rank], bounds[self.comm.rank + 1]))


def joined(comm: MPI.Comm, mine: Mapping[str, FloatArray], count: int) -> dict[str, FloatArray]:
    """What all ranks say of their parts of a batch; 0 where one does not name what another does. Collective.

    Args:
        comm: the ranks.
        mine: arrays (count,) by name.
        count: pairs of this rank's part.
    """
    every: list[tuple[Mapping[str, FloatArray], int]] = comm.allgather((mine, count))
    named = dict.fromkeys(name for one, _ in every for name in one)
    return {name: np.concatenate([one.get(name, np.zeros(size)) for one, size in every]) for name in named}


def owner(comm: MPI.Comm, body: str) -> int:
    """The rank that holds a body: the axle on the first, the wheel on the second (one rank holds both)."""
    return 0 if body == "axle" else min(1, comm.size - 1)
