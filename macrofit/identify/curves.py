"""Computed curves for values of a parameter, and what they say of its derivative."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from ..assembly import Assembly, assemble
from ..base.arrays import FloatArray
from ..base.ranks import made_by_first
from ..errors import MacrofitError
from ..friction import GivenFriction
from ..lockstep.solve import Run, common_to, solve_together
from ..monitor import Silent
from ..results.doubts import outside_doubts
from ..scene import Scene, load_scene
from ..solution import Solution

BESIDE = 1e-2
"""Distance of the run in lockstep with the first one, relative to the value or to the width of its bounds."""
WITHOUT = ("output.stress=false", "output.fields=[]", "output.frames=0", "motion.release=false")
"""What no curve needs."""


class IdentificationError(MacrofitError):
    """A parameter that the curve does not determine, or not within its bounds."""


@dataclass(frozen=True)
class Derivative:
    """dF/dp at a value, and half of d2F/dp2."""

    slope: FloatArray
    bend: FloatArray | None  # None where two curves are all that is known


def derivative(known: dict[float, FloatArray], at: float, least: float) -> Derivative:
    """The derivatives at one of the values whose curves are known: those of the parabola through the next two.

    Values nearer than ``least`` are passed over where there are others.

    Raises:
        IdentificationError: the curve does not depend on the parameter.
    """
    others = sorted((value for value in known if value != at), key=lambda value: abs(value - at))
    far = [value for value in others if abs(value - at) >= least] or others
    secant: FloatArray = (known[far[0]] - known[at]) / (far[0] - at)
    if not secant.any():
        raise IdentificationError("the curve does not depend on the parameter; name another with --key")
    if len(far) == 1:
        return Derivative(secant, None)
    next_one: FloatArray = (known[far[1]] - known[far[0]]) / (far[1] - far[0])
    bend: FloatArray = (next_one - secant) / (far[1] - at)
    return Derivative(secant - (far[0] - at) * bend, bend)


class ForwardModel:
    """Fitting curves for values of a key; bodies are factored again only where the key is one of theirs.

    The first value comes with one beside it, in lockstep, so that the derivative costs a part of a run.
    """

    def __init__(
        self,
        source: str | Path,
        overrides: Iterable[str],
        key: str,
        comm: MPI.Comm,
        friction: GivenFriction | None = None,
        *,
        bounds: tuple[float, float],
    ) -> None:
        self.source, self.overrides, self.key, self.comm, self.friction = source, overrides, key, comm, friction
        self.bounds = bounds
        self.factorisations = 0
        self.known: dict[float, FloatArray] = {}
        self.doubts: dict[float, list[str]] = {}  # about the friction of each
        self._assembly: Assembly | None = None

    def force(self, value: float) -> FloatArray:
        """Pushing force [N] at the scene's displacements; computed once for a value.

        Raises:
            ConvergenceError: an increment did not converge.
        """
        if value not in self.known:
            self._compute(value, beside=not self.known)
        return self.known[value]

    def nearest(self, value: float) -> float | None:
        """The value next to this one whose curve is known."""
        return min((each for each in self.known if each != value), key=lambda each: abs(each - value), default=None)

    def _compute(self, value: float, *, beside: bool) -> None:
        scenes = {value: self._scene(value)}
        if beside:
            scenes |= self._beside(value, scenes[value])
        if self._assembly is None or not self._assembly.serves(scenes[value]):
            self._assembly = assemble(scenes[value], self.comm)
            self.factorisations += self._assembly.work()["factorisations"]
        runs = [Run(scene=scene, monitor=Silent(), friction=self.friction) for scene in scenes.values()]
        for own, found in zip(scenes, solve_together(runs, self.comm, self._assembly), strict=True):
            if isinstance(found, Solution):
                self.known[own] = found.force
                self.doubts[own] = list(outside_doubts(found.outside, found.displacement.tolist()))
            elif own == value:
                raise found

    def _scene(self, value: float) -> Scene:
        changed = [*self.overrides, *WITHOUT, f"{self.key}={value!r}"]
        return made_by_first(self.comm, lambda: load_scene(self.source, changed))

    def _beside(self, value: float, scene: Scene) -> dict[float, Scene]:
        """A value beside the first one, where that is a scene to be solved in lockstep with it."""
        low, high = self.bounds
        step = BESIDE * (min(abs(value), high - low) or high - low)
        other = value + step if value + step <= high else value - step
        try:
            there = self._scene(other)
        except MacrofitError:
            return {}
        common = common_to(scene)
        return {other: there} if common is not None and common == common_to(there) else {}
