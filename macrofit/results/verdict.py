"""A press fit held against the acceptance rules for wheelsets: force at the end, shape of the curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from ..base.arrays import FloatArray
from ..scene import Hub, Shaft

if TYPE_CHECKING:
    from ..solution import Solution

EN_13260 = (0.85 * 4e3, 1.45 * 4e3)
"""Pressing force at the end over the seat's diameter [N/mm]: 0.85 to 1.45 times 4e-3 MN per mm."""
GOST_11018 = (3.92e3, 5.88e3)
"""The same [N/mm]: 392 to 588 kN per 100 mm."""
OSCILLATION_LIMIT = 0.03
"""Largest drop of a smooth pressing curve below what it had reached, over its peak."""


class Window(msgspec.Struct, frozen=True, rename={"low": "low_N", "high": "high_N"}):
    """The forces [N] a standard accepts at the end of the press fit, and whether the run's is one of them."""

    low: float
    high: float
    inside: bool


class Verdict(msgspec.Struct, frozen=True, kw_only=True, rename={"final_force": "final_force_N"}):
    """A press fit held against the acceptance rules for wheelsets.

    Where the motion reverses, only what comes before is the press fit.
    """

    seat_diameter_mm: float
    final_force: float
    en_13260: Window
    gost_11018: Window
    oscillation: float  # largest drop of the force below its running maximum, over the peak
    smooth: bool  # oscillation at most OSCILLATION_LIMIT
    bulge: float  # mean height of the curve above the chord from first force to end, over the peak
    convex: bool  # bulge not negative: the curve bulges upwards
    sentence: str


def verdict(solution: Solution) -> tuple[Verdict | None, str]:
    """The verdict, or None and the reason why the standards say nothing about this run."""
    scene = solution.scene
    axle = scene.axle
    if not (isinstance(axle, Shaft) and isinstance(scene.wheel, Hub)):
        return None, "the seat and the bore are not drawn with two radii"
    if scene.direction != "radial":
        return None, "the gap is not measured along the radius"
    pressed = _pressed(solution.displacement)
    displacement, force = solution.displacement[pressed], solution.force[pressed]
    if len(force) < 2 or displacement[0] > 0.0:
        return None, "the wheel is not pushed on from the entrance of the seat"
    if force.max() <= 0.0:
        return None, "no force is needed to push the wheel on"
    wheel = scene.wheel
    covered = min(float(displacement[-1]), axle.seat_length, wheel.hub_length)
    if covered < 0.8 * min(axle.seat_length, wheel.hub_length):
        return None, f"the wheel is pushed on by {displacement[-1]:g} mm only"
    return _judge(2.0 * axle.seat_radius, displacement, force), ""


def _pressed(displacement: FloatArray) -> slice:
    """The increments before the motion first turns back."""
    back = np.flatnonzero(np.diff(displacement) < 0.0)
    return slice(0, int(back[0]) + 1 if len(back) else len(displacement))


def _judge(diameter: float, displacement: FloatArray, force: FloatArray) -> Verdict:
    final, peak = float(force[-1]), float(force.max())
    european, russian = (
        Window(low * diameter, high * diameter, low * diameter <= final <= high * diameter)
        for low, high in (EN_13260, GOST_11018)
    )
    oscillation = float((np.maximum.accumulate(force) - force).max()) / peak
    bulge = _bulge(displacement, force) / peak
    smooth, convex = oscillation <= OSCILLATION_LIMIT, bulge >= 0.0
    sentence = (
        f"The wheel is pressed on with {final / 1e3:.0f} kN at the end, "
        f"{_placed(european, 'EN 13260')} and {_placed(russian, 'GOST 11018')} "
        f"for a seat of {diameter:g} mm in diameter; "
        f"the curve {'rises smoothly' if smooth else 'is not smooth'} "
        f"(it drops by {oscillation:.1%} of its peak, {OSCILLATION_LIMIT:.0%} allowed) "
        f"and {'bulges upwards' if convex else 'sags'}."
    )
    return Verdict(
        seat_diameter_mm=diameter,
        final_force=final,
        en_13260=european,
        gost_11018=russian,
        oscillation=oscillation,
        smooth=smooth,
        bulge=bulge,
        convex=convex,
        sentence=sentence,
    )


def _bulge(displacement: FloatArray, force: FloatArray) -> float:
    """Mean height of the curve above its chord [N], from where the force begins."""
    first = max(int(np.argmax(force > 1e-3 * force.max())) - 1, 0)
    s, f = displacement[first:], force[first:]
    chord = f[0] + (f[-1] - f[0]) * (s - s[0]) / (s[-1] - s[0])
    above = f - chord
    return float((0.5 * (above[1:] + above[:-1])) @ np.diff(s)) / float(s[-1] - s[0])


def _placed(window: Window, standard: str) -> str:
    where = "inside" if window.inside else "outside"
    return f"{where} the {window.low / 1e3:.0f} to {window.high / 1e3:.0f} kN of {standard}"
