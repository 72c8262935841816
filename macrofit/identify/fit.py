"""The parameter of a scene whose fitting curve matches a measured one: least squares in one unknown."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mpi4py import MPI

from ..base.arrays import FloatArray
from ..base.ranks import made_by_first
from ..base.toml import split_override
from ..errors import ProviderError, SceneError
from ..friction import GivenFriction, ScriptFriction, load_options
from ..scene import Scene, load_scene, with_script_friction
from .curves import Derivative, ForwardModel, IdentificationError, derivative
from .measured import Measured, check_scale, comparable
from .shift import Offset, Tangent, best_offset, offset_at, standard_errors

KEYS = {"uniform": "friction.options.coefficient"}
DEFAULT_KEY = "friction.options.micro_friction"
BOUNDS = {"friction.options.coefficient": (0.0, 1.0), "friction.options.micro_friction": (0.0, 0.5)}
MOST_RUNS = 12
FIRST_STEP = 0.02
"""Least distance of the second trial from the first, relative to it."""
TOLERANCE = 1e-4
"""Step at which the value is found, relative to it or to the width of its bounds, whichever is less."""
SHORT, EXACT = 0.05, 1e-5
"""A step no longer than the first that is wrong by no more than the second, both relative to the same, is taken without
a trial."""
HALVINGS = 4
"""How often a step that the provider or the scene refuses is halved."""

MOST_OFFSETS = 8
"""How often value and offset are found in turn."""
SETTLED = 1e-3
"""Change of the offset at which it is found [mm]."""
BETTER, WORTH = 0.5, 2e-3
"""An offset is proposed where it leaves less than this share of the residual, and the residual is above this share of
the largest force."""

Forward = Callable[[float], FloatArray]
"""Parameter -> forces [N] at the measured displacements."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """The least-squares value p of one parameter and what its error is."""

    value: float
    standard_error: float  # sqrt(sigma^2 / (J' J)): residuals independent and of one spread
    standard_error_correlated: float  # the same times sqrt((1 + rho) / (1 - rho)), rho > 0
    correlation: float  # rho of neighbouring residuals
    sigma: float  # sqrt(r' r / (n - 1)) [N]
    fitted: FloatArray  # (n,) forces at p [N]
    residual: FloatArray  # (n,) measured - fitted [N]
    sensitivity: FloatArray  # (n,) J = dF/dp [N]
    trials: tuple[tuple[float, float], ...]  # values tried, with r' r [N2]


def fit_parameter(
    forward: Forward,
    measured: FloatArray,
    start: float,
    bounds: tuple[float, float],
    beside: Callable[[float], float | None] = lambda value: None,
) -> Fit:
    """The p that makes r' r least, r = measured - forward(p), by Gauss-Newton steps J' r / (J' J).

    J is that of the parabola through the trial next to p and two others, of the secant where there are two. The last
    step is taken without a trial where the parabola says that it is small. The second trial is one beside the first
    whose forces are known, or where the curve would match if forces were proportional to p. The standard error is
    sigma (J' J)^-1/2, sigma^2 = r' r / (n - 1).

    Args:
        forward: forces [N] at the measured places for a value of p; a ProviderError or SceneError halves the step.
        measured: forces [N], shape (n,).
        start: first value.
        bounds: lowest and highest value.
        beside: for a value, another one whose forces cost nothing; None where there is none.

    Raises:
        IdentificationError: p is at a bound, the curve does not depend on it, or the steps do not settle.
    """
    low, high = bounds
    known: dict[float, FloatArray] = {}
    best = float(np.clip(start, low, high))
    known[best] = forward(best)
    trial = beside(best)
    if trial is None or not low <= trial <= high:
        trial = _second(best, known[best], measured, bounds)
    for _ in range(MOST_RUNS - 1):
        trial = _evaluate(forward, known, best, trial)
        best = min(known, key=lambda p: _squares(measured - known[p]))
        size = min(abs(best), high - low) or high - low
        found = derivative(known, best, 1e-3 * size)
        wanted = best + float(found.slope @ (measured - known[best])) / _squares(found.slope)
        trial = float(np.clip(wanted, low, high))
        if abs(wanted - best) <= TOLERANCE * size:
            return _report(known, best, found.slope, measured)
        if trial == wanted and abs(wanted - best) <= SHORT * size and _error(found, wanted - best) <= EXACT * size:
            return _report(known, best, found.slope, measured, wanted - best)
        if trial == best:
            side = "lower" if best == low else "upper"
            raise IdentificationError(
                f"the best value is at the {side} bound {best:g}, the curve asks for about {wanted:.3g}; "
                f"widen --bounds if that can be, or check the scene's interference"
            )
        if trial in known:  # the steps go round between the same values
            trial = 0.5 * (trial + best)
    raise IdentificationError(f"no value was found in {MOST_RUNS} runs, the last was {best:g}; give narrower --bounds")


def _error(found: Derivative, step: float) -> float:
    """What a step is wrong by for the curve's bend; not known from two trials."""
    if found.bend is None:
        return np.inf
    return step**2 * float(np.sqrt(_squares(found.bend) / _squares(found.slope)))


def _second(first: float, forces: FloatArray, measured: FloatArray, bounds: tuple[float, float]) -> float:
    low, high = bounds
    scale = float(forces @ measured) / float(forces @ forces) if forces.any() else 2.0
    guess = float(np.clip(first * np.clip(scale, 0.5, 2.0), low, high))
    least = min(FIRST_STEP * abs(first), 0.1 * (high - low)) or 0.1 * (high - low)
    if abs(guess - first) >= least:
        return guess
    return first + least if first + least <= high else first - least


def _evaluate(forward: Forward, known: dict[float, FloatArray], best: float, trial: float) -> float:
    """Forces of a trial, or of one nearer to the best value where the provider or the scene refuses it."""
    asked = trial
    for halving in range(HALVINGS + 1):
        try:
            known[trial] = forward(trial)
            return trial
        except (ProviderError, SceneError) as error:
            if halving == HALVINGS:
                raise IdentificationError(
                    f"the curve asks for about {asked:.3g}, and from {trial:.4g} on: {error}"
                ) from error
            trial = 0.5 * (trial + best)
    raise AssertionError


def _report(
    known: dict[float, FloatArray], best: float, slope: FloatArray, measured: FloatArray, step: float = 0.0
) -> Fit:
    """The fit a step beyond the best trial."""
    fitted = known[best] + step * slope
    residual = measured - fitted
    sigma = float(np.sqrt(_squares(residual) / (len(measured) - 1)))
    error = sigma / float(np.sqrt(slope @ slope))
    rho = neighbour_correlation(residual)
    bounded = min(max(rho, 0.0), 0.99)
    trials = tuple((p, _squares(measured - forces)) for p, forces in known.items())
    correlated = error * float(np.sqrt((1.0 + bounded) / (1.0 - bounded)))
    return Fit(
        value=best + step,
        standard_error=error,
        standard_error_correlated=correlated,
        correlation=rho,
        sigma=sigma,
        fitted=fitted,
        residual=residual,
        sensitivity=slope,
        trials=trials,
    )


def _squares(residual: FloatArray) -> float:
    return float(residual @ residual)


def neighbour_correlation(residual: FloatArray) -> float:
    """rho = sum r_i r_(i+1) / sum r_i^2; 0 where there are no residuals."""
    squares = _squares(residual)
    return float(residual[:-1] @ residual[1:]) / squares if squares > 0.0 else 0.0


@dataclass(frozen=True, kw_only=True)
class Identification:
    """A fit with where it comes from."""

    key: str
    bounds: tuple[float, float]
    scene: Scene  # with the value found
    fit: Fit
    displacement: FloatArray  # (n,) [mm] of the points used
    measured: FloatArray  # (n,) [N]
    left_out: int  # measured points outside the scene's displacements
    factorisations: int  # of bodies, in all trials
    runs: int  # computed curves
    taken: str  # what of the file was taken for what
    assumed: tuple[str, ...]  # units that the file does not state
    shift: float  # offset found [mm], already added to displacement; 0 where it was not sought
    shift_error: float | None  # its standard error [mm]
    proposal: Offset | None  # an offset that the residual asks for; its step is relative to the value
    doubts: list[str]  # about the friction of the curve that was computed next to the value


def identify(
    source: str | Path,
    measured: Measured,
    overrides: Iterable[str] = (),
    key: str | None = None,
    bounds: tuple[float, float] | None = None,
    comm: MPI.Comm | None = None,
    say: Callable[[str], None] = lambda line: None,
    *,
    friction: GivenFriction | None = None,
    free_shift: bool = False,
) -> Identification:
    """Find the value of a key for which the scene's fitting curve is nearest to the measured one. Collective.

    Args:
        source: a built-in scene or a TOML file.
        measured: the curve; points outside the scene's displacements are left out, the computed one is linear between.
        overrides: "key=value" each.
        key: any number of the scene, dotted; by default friction.options.coefficient for a uniform coefficient,
            friction.options.micro_friction otherwise.
        bounds: lowest and highest value the key may have.
        comm: the ranks that share the work; all by default.
        say: told of every trial, on all ranks.
        friction: an object in place of the scene's [friction], see `macrofit.solve.solve`. The key may be one of its
            options (friction.options.KEY) where it is a callable that makes a provider, such as a class.
        free_shift: whether an offset of the measured displacements is sought too.

    Raises:
        MacrofitError: one line, on all ranks together.
    """
    comm = MPI.COMM_WORLD if comm is None else comm
    script = None if friction is None else ScriptFriction(friction)
    common = [*([] if script is None else [f"friction.provider={script.name}"]), *overrides]
    scene = made_by_first(comm, lambda: load_scene(source, common))
    key = KEYS.get(scene.friction.provider, DEFAULT_KEY) if key is None else key
    start, (low, high) = made_by_first(comm, lambda: _start(scene, key, bounds, script))
    places = _ascending(scene)
    model = ForwardModel(source, common, key, comm, friction, bounds=(low, high))
    search = _Search(measured, places, model, (low, high), say)
    found, shift = search.with_offset(start) if free_shift else (search.at(0.0, start), 0.0)
    at, wanted = search.points(shift)
    final = made_by_first(comm, lambda: load_scene(source, [*common, f"{key}={found.value!r}"]))
    fit, error = search.judged(found, at) if free_shift else (found, None)
    return Identification(
        key=key,
        bounds=(low, high),
        scene=final if script is None else with_script_friction(final, script),
        fit=fit,
        displacement=at,
        measured=wanted,
        left_out=len(measured.force) - len(wanted),
        factorisations=model.factorisations,
        runs=len(model.known),
        taken=measured.taken,
        assumed=measured.assumed,
        shift=shift,
        shift_error=error,
        proposal=None if free_shift else search.proposal(found),
        doubts=model.doubts[min(model.doubts, key=lambda value: abs(value - found.value))],
    )


class _Search:
    """The fit of one curve, at an offset of its displacements or with the offset as a second unknown."""

    def __init__(
        self,
        measured: Measured,
        places: FloatArray,
        model: ForwardModel,
        bounds: tuple[float, float],
        say: Callable[[str], None],
    ) -> None:
        self.measured, self.places, self.model, self.bounds, self.say = measured, places, model, bounds, say

    def points(self, shift: float) -> tuple[FloatArray, FloatArray]:
        """Displacements [mm] and forces [N] that lie within the computed ones at this offset."""
        moved = replace(self.measured, displacement=self.measured.displacement + shift)
        inside = comparable(moved, self.places)
        return moved.displacement[inside], moved.force[inside]

    def at(self, shift: float, start: float) -> Fit:
        """The fit at this offset."""
        at, wanted = self.points(shift)

        def forward(value: float) -> FloatArray:
            first, fresh = not self.model.known, value not in self.model.known
            forces = np.interp(at, self.places, self.model.force(value))
            if first:
                check_scale(wanted, forces, self.measured.assumed)
            misfit = np.sqrt(np.mean((wanted - forces) ** 2))
            if fresh:
                moved = f"  shift {shift:+.3f} mm" if shift else ""
                self.say(f"{self.model.key} = {value:.6g}{moved}  misfit {misfit / 1e3:.5g} kN")
            return forces

        return fit_parameter(forward, wanted, start, self.bounds, self.model.nearest)

    def with_offset(self, start: float) -> tuple[Fit, float]:
        """Value and offset in turn, until neither moves.

        Raises:
            IdentificationError: they go on moving.
        """
        low, high = self.bounds
        first = np.interp(self.measured.displacement, self.places, self.model.force(start))
        check_scale(self.measured.force, first, self.measured.assumed)
        if self.model.nearest(start) is None:
            self.model.force(_second(start, np.ones(1), np.ones(1), self.bounds))
        offset = best_offset(self.measured, self.tangent(start))
        value = float(np.clip(start + offset.step, low, high))
        for _ in range(MOST_OFFSETS):
            found = self.at(offset.shift, value)
            before, offset = offset, best_offset(self.measured, self.tangent(found.value))
            if abs(offset.shift - before.shift) <= SETTLED:
                return found, before.shift
            value = float(np.clip(found.value + offset.step, low, high))
        raise IdentificationError("value and offset do not settle; leave out --free-shift and give --shift")

    def tangent(self, value: float) -> Tangent:
        """The computed curve at a value that was tried, or a short step from one that was."""
        known, (low, high) = self.model.known, self.bounds
        size = min(abs(value), high - low) or high - low
        near = min(known, key=lambda each: abs(each - value))
        slope = derivative(known, near, 1e-3 * size).slope
        return Tangent(self.places, known[near] + (value - near) * slope, slope)

    def judged(self, found: Fit, at: FloatArray) -> tuple[Fit, float]:
        """The fit with the errors that its value has beside an unknown offset, and the offset's."""
        error, of_shift = standard_errors(at, self.tangent(found.value), found.residual)
        wider = found.standard_error_correlated / found.standard_error if found.standard_error else 1.0
        return replace(found, standard_error=error, standard_error_correlated=wider * error), of_shift

    def proposal(self, found: Fit) -> Offset | None:
        """An offset that would leave much less of the residual; None where it would not."""
        tangent = self.tangent(found.value)
        present = offset_at(self.measured, tangent).deviation
        if present <= WORTH * float(np.abs(found.fitted).max()):
            return None
        offset = best_offset(self.measured, tangent)
        return offset if offset.deviation < BETTER * present else None


def _ascending(scene: Scene) -> FloatArray:
    """The scene's displacements [mm], where a curve can be compared along them."""
    places = np.array(scene.displacements)
    if (np.diff(places) <= 0.0).any():
        raise SceneError("motion: the displacements must ascend for a curve to be compared with")
    return places


def _start(
    scene: Scene, key: str, bounds: tuple[float, float] | None, script: ScriptFriction | None
) -> tuple[float, tuple[float, float]]:
    """The scene's own value, moved between the bounds, and the bounds."""
    present = _value(scene, key, script)
    low, high = bounds or BOUNDS.get(key) or (0.5 * present, 2.0 * present)
    if not low < high:
        raise SceneError(f"--bounds {low:g},{high:g}: the lower bound must be below the upper one")
    inside = low < present < high
    return (present if inside else 0.5 * (low + high)), (low, high)


def _value(scene: Scene, key: str, script: ScriptFriction | None) -> float:
    """The number a key has in the scene, or the default of the provider's option."""
    *path, last = split_override(f"{key}=0")[0]
    if path == ["motion"]:
        raise SceneError(f"{key}: changes where forces are computed, so no curve can tell it; name another with --key")
    value: Any = msgspec.to_builtins(scene)
    if path == ["friction", "options"]:
        value = _options(scene, script)
        if last not in value:
            raise SceneError(
                f"{key}: no option of friction provider '{scene.friction.provider}' ({', '.join(value) or 'none'}); "
                f"name another with --key, or another provider with --set friction.provider=NAME"
            )
        value = value[last]
    else:
        for part in (*path, last):
            if not isinstance(value, dict) or part not in value:
                raise SceneError(f"{key}: no such key in the scene")
            value = value[part]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SceneError(f"{key}: is {value!r} in the scene, not a number to be identified")
    return float(value)


def _options(scene: Scene, script: ScriptFriction | None) -> dict[str, Any]:
    """Options of the scene's provider, those left out with their defaults."""
    given = scene.friction.options
    if script is not None and not script.makes:
        raise SceneError(
            f"{script.name}: is an object whose options cannot be identified; give what makes it, for example its "
            f"class, or name another key of the scene"
        )
    loaded = load_options(scene.friction.provider, given) if script is None else script.load(given)
    return {**given, **{name: getattr(loaded, name) for name in getattr(loaded, "__struct_fields__", ())}}
