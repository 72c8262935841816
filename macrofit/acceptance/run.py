"""The verdict of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..base.arrays import FloatArray
from ..scene import Scene
from .fit import fit_of_scene
from .standard import Standard
from .verdict import Verdict, judge

if TYPE_CHECKING:
    from ..solution import Solution


def verdict(solution: Solution, standard: Standard | None = None) -> tuple[Verdict | None, str]:
    """The verdict of a solved scene, by EN 13260 where no standard is given, or None and the reason why not."""
    largest = {body: at.value for body, at in solution.max_von_mises.items()}
    return judge_scene(solution.scene, solution.displacement, solution.force, largest, standard)


def judge_scene(
    scene: Scene,
    displacement: FloatArray,
    force: FloatArray,
    von_mises: Mapping[str, float],
    standard: Standard | None = None,
    wheel: str | None = None,
) -> tuple[Verdict | None, str]:
    """The verdict of a scene's curve [mm, N] and largest stresses [MPa], see `fit_of_scene` and `judge`.

    Returns:
        The verdict, or None; and why no curve, or nothing at all, could be judged.

    Raises:
        StandardError: the standard does not know this type of wheel.
    """
    fit, reason = fit_of_scene(scene, displacement, force, von_mises)
    if fit is None:
        return None, reason
    return judge(fit, standard, wheel), fit.reason
