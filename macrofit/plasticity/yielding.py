"""Both bodies beyond their yield stress: plastic strains and contact, solved for each other.

The elastic factors stay as they are (see `body`). In every step, with plastic strains x at the Gauss points,

    1. u_p = K^-1 f_p(x) changes what the contact sees, and the contact is solved for it;
    2. its loads give u = K^-1 P' f_c + u_p, and the law the plastic strains g(x) at u;
    3. x = g(x) is what is looked for; Anderson's method takes the next x from those before.

A rank has the points of its own bodies. What the others need goes round once per iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from ..base.arrays import FloatArray
from ..contact.law import ContactProblem, EigenMoments
from ..contact.seat import Seat
from ..parallel import owner
from .anderson import Anderson
from .body import Eigen, PlasticBody
from .law import PointState

TOLERANCE = 1e-4
"""Change of the step's plastic strain that is left, relative to it, in the root of the sum of squares over volume."""

DEBUG = False
LIMIT = 60
"""Iterations before a step is given up."""

Flow = dict[str, PointState]
"""The state of the points of this rank's bodies."""

Loads = tuple[FloatArray, FloatArray]
"""Nodal loads of the contact on the seat and on the bore [N]."""


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
    """The bodies that may yield, wherever they are."""

    def __init__(self, comm: MPI.Comm, seat: Seat, bodies: dict[str, PlasticBody], names: tuple[str, ...]) -> None:
        self.comm, self.seat, self.bodies, self.names = comm, seat, bodies, names

    def rest(self) -> Flow:
        """Nothing flowed yet."""
        return {name: body.rest() for name, body in self.bodies.items()}

    def settle(
        self, before: Flow, contact: Callable[[dict[str, Eigen]], Loads]
    ) -> Settled:
        """Plastic strains and contact that fit each other, from the state before the step. Collective."""
        x = {name: before[name].strain for name in self.bodies}
        accelerated = Anderson(self._dot)
        for iteration in range(1, LIMIT + 1):
            pushes = {name: body.load(x[name]) for name, body in self.bodies.items()}
            own = {name: body.displace(pushes[name]) for name, body in self.bodies.items()}
            eigen = self._shared({name: body.eigen(own[name], x[name]) for name, body in self.bodies.items()})
            both = dict(zip(("axle", "wheel"), contact(eigen), strict=True))
            u = {name: own[name] + body.displace_trace(both[name]) for name, body in self.bodies.items()}
            after = {name: body.flowed(u[name], before[name]) for name, body in self.bodies.items()}
            left, gained = self._norms(x, before, after)
            if DEBUG: print(iteration, left, gained)
            if left <= TOLERANCE * gained:
                break
            reached = {name: state.strain for name, state in after.items()}
            x = self._split(accelerated.next(self._joined(x), self._joined(reached)))
        return self._settled(before, after, u, eigen, iteration, converged=left <= TOLERANCE * gained)

    def _settled(
        self,
        before: Flow,
        after: Flow,
        displacement: dict[str, FloatArray],
        eigen: dict[str, Eigen],
        iteration: int,
        *,
        converged: bool,
    ) -> Settled:
        """What is left at the end, and what it took in work and energy."""
        numbers = {}
        for name, body in self.bodies.items():
            after[name], numbers[name] = body.finished(before[name], after[name], displacement[name])
        shared = self._shared(numbers)
        energy, work, largest = (np.array([shared[name][k] for name in self.names]) for k in range(3))
        return Settled(
            flow=after,
            eigen=eigen,
            energy=float(energy.sum()),
            work=float(work.sum()),
            largest=float(largest.max()),
            iterations=iteration,
            converged=converged,
        )

    def _norms(self, x: dict[str, FloatArray], before: Flow, after: Flow) -> tuple[float, float]:
        """Norms of g(x) - x and of the step's plastic strain."""
        squares = {
            name: np.array([body.square(after[name].strain - there) for there in (x[name], before[name].strain)])
            for name, body in self.bodies.items()
        }
        left, gained = np.sqrt(sum(self._shared(squares)[name] for name in self.names))
        return float(left), float(gained)

    def _joined(self, strains: dict[str, FloatArray]) -> FloatArray:
        """The plastic strains of this rank's bodies as one vector, such that its square is that of `_norms`."""
        parts = [(body.scale * strains[name]).ravel() for name, body in self.bodies.items()]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _split(self, vector: FloatArray) -> dict[str, FloatArray]:
        """The inverse of `_joined`."""
        ends = np.cumsum([4 * body.count for body in self.bodies.values()])
        parts = np.split(vector, ends[:-1]) if self.bodies else []
        return {
            name: part.reshape(-1, 4) / body.scale
            for (name, body), part in zip(self.bodies.items(), parts, strict=True)
        }

    def _dot(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """left @ right.T over all bodies, summed in the same order on any number of ranks."""
        own, start = {}, 0
        for name, body in self.bodies.items():
            part = slice(start, start + 4 * body.count)
            own[name], start = left[:, part] @ right[:, part].T, part.stop
        shared = self._shared(own)
        return np.asarray(sum(shared[name] for name in self.names))

    def _shared(self, own: dict[str, Any]) -> dict[str, Any]:
        """What the ranks have for each body, on all ranks."""
        if self.comm.size == 1:
            return own
        return {name: self.comm.bcast(own.get(name), root=owner(self.comm, name)) for name in self.names}


def shifted(contact: ContactProblem, coordinate: FloatArray, eigen: dict[str, Eigen]) -> ContactProblem:
    """The contact problem of bodies that yielded."""
    approach, slope = np.zeros_like(contact.undeformed), np.zeros(contact.moments)
    coupling, covered = contact.coupling, contact.covered
    if "axle" in eigen:
        approach -= covered.trial_moments(eigen["axle"].displacement)
        if contact.nitsche:
            approach -= _traction_moments(contact, coordinate, eigen["axle"].traction) / covered.gamma
    if "wheel" in eigen:
        bore = eigen["wheel"].displacement
        approach += coupling.bore_moments(bore)
        slope += coupling.bore_slope(bore) if contact.radial else 0.0
    return replace(contact, eigen=EigenMoments(approach=approach, slope=slope))


def _traction_moments(contact: ContactProblem, s: FloatArray, ends: FloatArray) -> FloatArray:
    """Moments (2, n) of a traction (facets, 2 ends, 2) that is linear along each facet: its values at their points."""
    portions = contact.coupling.portions
    facet = portions.facet
    start, end = s[facet], s[facet + 1]
    along = ((portions.points - start[:, None]) / (end - start)[:, None])[:, :, None]
    values = (1.0 - along) * ends[facet, None, 0] + along * ends[facet, None, 1]
    return np.asarray(values.reshape(-1, 2).T)
