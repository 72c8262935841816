"""Both bodies beyond their yield stress: plastic strains and contact, solved for each other.

The elastic factors stay as they are (see `body`). In every step, with plastic strains x at the Gauss points,

    1. u_p = K^-1 f_p(x) changes what the contact sees, and the contact is solved for it;
    2. its loads give u = K^-1 P' f_c + u_p, and the law the plastic strains g(x) at u;
    3. x = g(x) is what is looked for; Anderson's method takes the next x from those before.

A rank has the points of its own bodies. What the others need goes round once per iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI

from ..base.arrays import FloatArray
from ..contact.eigen import Eigen
from ..errors import ConvergenceError
from ..parallel import owner
from ..scene.checks import SOFTEST
from .anderson import Anderson
from .body import BodyFlow, BodyStep, Changes, Ended, PlasticBody, changed

TOLERANCE = 1e-3
"""Change of the step's plastic strain that is left, relative to it, in the root of the sum of squares over volume.

With 5e-3 the force of `wheelset` is as good, but stresses of `press-and-pull` lie 7 % beyond the yield stress.
"""

ROUNDING = 1e-12
"""Change that is none, relative to the plastic strain of the points so far: where nothing flows, rounding is left."""

LIMIT = 200
"""Iterations before a step is given up. Ideal plasticity under much friction takes up to 180, and the halves of a step
as many each: with 60 such runs took twice the time."""

Flow = dict[str, BodyFlow]
"""The state of the points of this rank's bodies."""

Loads = tuple[FloatArray, FloatArray]
"""Nodal loads of the contact on the seat and on the bore [N]."""

Contact = Callable[[dict[str, Eigen]], Loads]
"""Solves the contact for what the plastic strains do to it: its loads."""


@dataclass(frozen=True, kw_only=True)
class Settled:
    """What a step leaves where the steel yields."""

    flow: Flow
    eigen: dict[str, Eigen]
    energy: float
    """What is added to 1/2 sum of f_c . u to give the elastic energy [N mm]."""
    work: float
    """Plastic work of the step [N mm]."""
    largest: float
    """Largest accumulated plastic strain [-]."""
    iterations: int
    converged: bool


class Yielding:
    """The bodies that may yield, wherever they are.

    Args:
        comm: the ranks.
        bodies: those of this rank.
        names: of all that may yield.
        unseen: of those that yield at less than `scene.checks.SOFTEST` of their Young's modulus, nearly rigid tools:
            right while nothing in them flows; then the contact would not see what they bear.
    """

    def __init__(
        self, comm: MPI.Comm, bodies: dict[str, PlasticBody], names: tuple[str, ...], unseen: tuple[str, ...] = ()
    ) -> None:
        self.comm, self.bodies, self.names, self.unseen = comm, bodies, names, unseen

    def rest(self) -> Flow:
        """Nothing flowed yet."""
        return {name: body.rest() for name, body in self.bodies.items()}

    def increment(self, before: Flow, after: Flow, moved: float, place: float) -> tuple[Flow, dict[str, Changes]]:
        """The flow of a whole increment, which may be of several steps, and what changed in it, on all ranks.

        Args:
            before: the flow before it.
            after: that after it.
            moved: travel of the wheel in it [mm].
            place: the displacement it ends at [mm].

        Raises:
            ConvergenceError: a body flows whose yield stress is too far below its Young's modulus for that.
        """
        flow = {}
        for name in self.bodies:
            end = after[name]
            flow[name] = BodyFlow.between(before[name].state, end.state, moved, end.ended)
        changes = self._shared({name: body.changes() for name, body in flow.items()})
        for name in self.unseen:
            if len(changes[name]["points"]):
                raise ConvergenceError(
                    f"{name}.material: flows at {place:.6g} mm, and its yield stress is less than {SOFTEST:g} of its "
                    f"youngs_modulus; no solid yields so soon, and the contact would not see what it bears; both are "
                    f"in MPa, or take {name}.material.elastic = true for a rigid tool"
                )
        return flow, changes

    def restored(self, changes: list[dict[str, Changes]], moved: float) -> Flow:
        """The flow after all these increments, the last of which moved the wheel by so much [mm]."""
        out = {}
        for name, body in self.bodies.items():
            before = state = body.rest().state
            for each in changes:
                before, state = state, changed(state, each[name])
            out[name] = BodyFlow.between(before, state, moved)
        return out

    def settle(self, before: Flow, moved: float, loads: Loads, contact: Contact) -> Settled:
        """Plastic strains and contact that fit each other. Collective.

        Args:
            before: the flow before the step.
            moved: travel of the wheel in the step [mm].
            loads: of the contact before the step.
            contact: solves the contact.
        """
        old = dict(zip(("axle", "wheel"), loads, strict=True))
        steps = {name: BodyStep(body, before[name], moved, old[name]) for name, body in self.bodies.items()}
        accelerated = Anderson(partial(self._dot, steps))
        for iteration in range(1, LIMIT + 1):
            own = {name: step.displace() for name, step in steps.items()}
            eigen = self._shared({name: step.eigen(own[name]) for name, step in steps.items()})
            both = dict(zip(("axle", "wheel"), contact(eigen), strict=True))
            for name, step in steps.items():
                step.press(both[name])
            if iteration == 1:
                self._widened(steps)
            reached = {name: step.flowed() for name, step in steps.items()}
            left, gained, whole = self._norms(steps, reached)
            if left <= max(TOLERANCE * gained, ROUNDING * whole):
                ended = {name: step.ended(both[name]) for name, step in steps.items()}
                if not self._widened(steps, ended):
                    return self._settled(steps, ended, eigen, iteration)
                accelerated = Anderson(partial(self._dot, steps))
                continue
            x = {name: step.x for name, step in steps.items()}
            _divide(steps, accelerated.next(_joined(steps, x), _joined(steps, reached)))
        return Settled(flow=before, eigen=eigen, energy=0.0, work=0.0, largest=0.0, iterations=LIMIT, converged=False)

    def _widened(self, steps: dict[str, BodyStep], ended: dict[str, Ended] | None = None) -> bool:
        """Whether any body has to watch more points."""
        ends = {} if ended is None else ended
        missed = self._shared({name: step.widened(ends.get(name)) for name, step in steps.items()})
        return any(missed[name] for name in self.names)

    def _settled(
        self, steps: dict[str, BodyStep], ended: dict[str, Ended], eigen: dict[str, Eigen], iteration: int
    ) -> Settled:
        """What is left at the end, and what it took in work and energy."""
        after, numbers = {}, {}
        for name, step in steps.items():
            after[name], numbers[name] = step.finished(ended[name])
        shared = self._shared(numbers)
        energy, work, largest = (np.array([shared[name][k] for name in self.names]) for k in range(3))
        return Settled(
            flow=after,
            eigen=eigen,
            energy=float(energy.sum()),
            work=float(work.sum()),
            largest=float(largest.max()),
            iterations=iteration,
            converged=True,
        )

    def _norms(self, steps: dict[str, BodyStep], reached: dict[str, FloatArray]) -> tuple[float, float, float]:
        """Norms of g(x) - x, of what the law gave in the step, and of g(x)."""
        squares = {
            name: np.array(
                [
                    _square(step.scale * (reached[name] - step.x)),
                    step.gained_square(),
                    _square(step.scale * reached[name]),
                ]
            )
            for name, step in steps.items()
        }
        shared = self._shared(squares)
        left, gained, whole = np.sqrt(sum(shared[name] for name in self.names))
        return float(left), float(gained), float(whole)

    def _dot(self, steps: dict[str, BodyStep], left: FloatArray, right: FloatArray) -> FloatArray:
        """left @ right.T over all bodies, summed in the same order on any number of ranks."""
        own, start = {}, 0
        for name, step in steps.items():
            part = slice(start, start + 4 * len(step.points))
            own[name], start = left[:, part] @ right[:, part].T, part.stop
        shared = self._shared(own)
        return np.asarray(sum(shared[name] for name in self.names))

    def _shared(self, own: dict[str, Any]) -> dict[str, Any]:
        """What the ranks have for each body, on all ranks."""
        if self.comm.size == 1:
            return own
        return {name: self.comm.bcast(own.get(name), root=owner(self.comm, name)) for name in self.names}


def _square(vector: FloatArray) -> float:
    return float(np.square(vector).sum())


def _joined(steps: dict[str, BodyStep], strains: dict[str, FloatArray]) -> FloatArray:
    """Plastic strains of this rank's bodies as one vector, scaled so that its square is their norm's."""
    return np.concatenate([np.zeros(0), *((step.scale * strains[name]).ravel() for name, step in steps.items())])


def _divide(steps: dict[str, BodyStep], vector: FloatArray) -> None:
    """Give a joined vector to the steps, as their plastic strains."""
    start = 0
    for step in steps.values():
        end = start + 4 * len(step.points)
        step.x, start = vector[start:end].reshape(-1, 4) / step.scale, end
