"""solve_together(runs) -> their solutions: the runs take turns, an increment each, and share what can be shared."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np
from mpi4py import MPI

from ..assembly import BODY_KEYS, Assembly
from ..errors import MacrofitError
from ..friction import GivenFriction
from ..monitor import Monitor
from ..parallel import owner, summed
from ..plasticity.material import hardening
from ..scene import Scene
from ..solution import Journal, Solution
from ..solve import steps
from .group import Group, Member


@dataclass(frozen=True, kw_only=True)
class Run:
    """What `solve` is given for one run."""

    scene: Scene
    monitor: Monitor
    journal: Journal | None = None
    friction: GivenFriction | None = None


def common_to(scene: Scene) -> bytes | None:
    """What runs in lockstep have in common: bodies, contact and motion; None where a scene is solved by itself.

    Steel that may yield has a history in the bodies, and the monolithic solver has no interface matrix to share.
    """
    if scene.solver != "condensed" or any(hardening(body.material) is not None for body in (scene.axle, scene.wheel)):
        return None
    return msgspec.json.encode([getattr(scene, key) for key in (*BODY_KEYS, "motion")], order="deterministic")


def solve_together(runs: Sequence[Run], comm: MPI.Comm, assembly: Assembly) -> list[Solution | MacrofitError]:
    """The solution of each run, or the error that ended it; the others go on. Collective.

    The scenes have the same `common_to`. Each solution is that of `solve` to 1e-9 of the forces, with the status of
    every moment decided for itself. What the runs share is counted with the first of them that asks for it.
    """
    group = Group()
    going = [Turns(run, group, comm, assembly) for run in runs]
    for each in going:
        each.take()
    while waiting := [each for each in going if each.outcome is None]:
        last = min(each.done for each in waiting)
        for each in waiting:
            if each.done == last:
                each.take()
    return [each.outcome for each in going if each.outcome is not None]


@dataclass
class Tally:
    """What the turns of one run took."""

    cpu_s: list[float] = field(default_factory=list)  # of each turn
    work: Any = field(default_factory=lambda: np.zeros(3, dtype=np.int64))  # see `_work`


class Turns:
    """A run that takes one turn after the other: its set-up, its increments, its stresses."""

    def __init__(self, run: Run, group: Group, comm: MPI.Comm, assembly: Assembly) -> None:
        self.group, self.comm, self.assembly = group, comm, assembly
        self.member: Member | None = None
        self.outcome: Solution | MacrofitError | None = None
        self.tally = Tally()
        self._steps = steps(run.scene, comm, run.monitor, run.journal, assembly, run.friction, pressed=self._pressed)

    @property
    def done(self) -> int:
        """Increments that are done."""
        return 0 if self.member is None else self.member.done

    def take(self) -> None:
        """Go on to the next pause, to the solution, or to the error that ends the run."""
        began, before = time.process_time(), _work(self.assembly)
        try:
            next(self._steps)
        except StopIteration as end:
            self.outcome = end.value
        except MacrofitError as error:
            self.outcome = error
        self.tally.cpu_s.append(time.process_time() - began)
        self.tally.work += _work(self.assembly) - before
        if isinstance(self.outcome, Solution):
            self.outcome = self._own(self.outcome)

    def _pressed(self, *parts: Any) -> Member:
        self.member = self.group.press(*parts)
        return self.member

    def _own(self, solution: Solution) -> Solution:
        """The solution with the times and counts of this run's own turns."""
        first, *increments, last = self.tally.cpu_s
        interface, factorisations, sides = self.tally.work.tolist()
        counted = summed(self.comm, {"factorisations": factorisations, "back_substitutions": sides})
        return replace(
            solution,
            setup_cpu_s=first,
            increments_cpu_s=sum(increments),
            stress_cpu_s=last,
            counters={
                **solution.counters, **counted,
                "right_hand_sides": counted["back_substitutions"], "interface_factorisations": interface,
            },
        )  # fmt: skip


def _work(assembly: Assembly) -> Any:
    """Factorisations of the interface, and of this rank's bodies, and their right-hand sides so far."""
    own = [body for name, body in assembly.bodies.items() if owner(assembly.comm, name) == assembly.comm.rank]
    sums = (sum(body.factorisations for body in own), sum(body.back_substitutions for body in own))
    return np.array([assembly.engine.factorisations, *sums], dtype=np.int64)
