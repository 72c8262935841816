"""The verdict of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..base.arrays import FloatArray
from ..scene import Scene
from .fit import fit_of_scene, where_fitted
from .standard import Standard
from .verdict import Verdict, judge

if TYPE_CHECKING:
    from ..solution import Solution


def verdict(solution: Solution, standard: Standard | None = None) -> tuple[Verdict | None, str]:
    """The verdict of a solved scene, by EN 13260 where no standard is given, or None and the reason why not."""
    largest = {body: at.value for body, at in solution.max_von_mises.items()}
    return judge_scene(solution.scene, solution.displacement, solution.force, largest, standard, holds=holds(solution))


def holds(solution: Solution) -> float | None:
    """The axial force [N] from which on the wheel slides, either way; None without friction."""
    numbers = holding(solution)
    return None if numbers is None else min(numbers["push_off_N"], numbers["pull_off_N"])


def holding(solution: Solution) -> dict[str, float] | None:
    """What the fit carries by friction before it slides: axial forces [N] and the torque; None without friction.

    Of the state in which the wheel is on. The torque is the integral of 2 pi r^2 mu p along the seat, F d / 2 where
    the seat is a cylinder.
    """
    if not solution.increments:
        return None
    record = solution.increments[where_fitted(solution.scene, solution.displacement)]
    if record.mean_friction == 0.0 or solution.scene.direction != "radial":
        return None
    return {
        "displacement_mm": record.displacement,
        "push_off_N": record.push_off,
        "pull_off_N": record.pull_off,
        "torque_N_mm": record.torque,
    }


def judge_scene(
    scene: Scene,
    displacement: FloatArray,
    force: FloatArray,
    von_mises: Mapping[str, float],
    standard: Standard | None = None,
    wheel: str | None = None,
    holds: float | None = None,
) -> tuple[Verdict | None, str]:
    """The verdict of a scene's curve [mm, N], largest stresses [MPa] and force that it ``holds`` [N], see `judge`.

    Returns:
        The verdict, or None; and why no curve, or nothing at all, could be judged.

    Raises:
        StandardError: the standard does not know this type of wheel.
    """
    fit, reason = fit_of_scene(scene, displacement, force, von_mises, holds)
    if fit is None:
        return None, reason
    return judge(fit, standard, wheel), fit.reason
