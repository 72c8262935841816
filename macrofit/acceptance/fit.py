"""What is judged: a seat and its pressing curve, from a scene or from a record, with all that is known of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..base.arrays import FloatArray
from ..scene import Hub, Scene, Shaft
from ..scene.material import yield_stress
from .curve import Curve

FEWEST = 5
"""Points that a measured curve needs."""
COVERED = 0.8
"""Share of the fit that a computed wheel must be pushed on by, for its end to be that of a fit [-]."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A press fit with what is known of it; what is not known is not judged."""

    diameter: float  # mm, of the seat
    length: float  # mm, that seat and bore have in common when the wheel is on
    curve: Curve | None
    reason: str = ""  # why there is no curve to judge
    interference: float | None = None  # mm, on the diameter
    shrunk: bool = False  # the wheel is shrunk on, not pressed
    holds: float | None = None  # N, axial force from which on the wheel slides
    von_mises: Mapping[str, float] = field(default_factory=dict)  # MPa, largest of "axle" and "wheel"
    yield_stress: Mapping[str, float] = field(default_factory=dict)  # MPa, of "axle" and "wheel"


def fit_of_scene(
    scene: Scene,
    displacement: FloatArray,
    force: FloatArray,
    von_mises: Mapping[str, float],
    holds: float | None = None,
) -> tuple[Fit | None, str]:
    """The press fit that a scene computes; where the motion reverses, only what comes before is one.

    Args:
        scene: what was computed.
        displacement: of the wheel at the increments, (n,) [mm].
        force: pushing force at the increments, (n,) [N].
        von_mises: largest stress of each body [MPa].
        holds: axial force from which on the wheel slides [N].

    Returns:
        The fit, or None and the reason why no standard says anything about this scene. A fit without a curve that
        can be judged has the reason within it.
    """
    axle, wheel = scene.axle, scene.wheel
    if not (isinstance(axle, Shaft) and isinstance(wheel, Hub)):
        return None, "the seat and the bore are not drawn with two radii"
    if scene.direction != "radial":
        return None, "the gap is not measured along the radius"
    length = min(axle.seat_length, wheel.hub_length)
    pressed = _pressed(displacement)
    reason = _not_a_press_fit(displacement[pressed], force[pressed], length)
    radial = scene.interference
    return Fit(
        diameter=2.0 * axle.seat_radius,
        length=length,
        curve=None if reason else Curve(displacement[pressed], force[pressed]),
        reason=reason,
        interference=None if radial is None else round(2.0 * radial, 12),
        shrunk=is_shrunk(displacement),
        holds=holds if len(displacement) and float(displacement.max()) >= COVERED * length else None,
        von_mises=von_mises,
        yield_stress=yield_stresses(scene),
    ), ""


def is_shrunk(displacement: FloatArray) -> bool:
    """Whether the motion starts with the wheel on its seat."""
    return len(displacement) > 0 and float(displacement[0]) > 0.0


def where_fitted(scene: Scene, displacement: FloatArray) -> int:
    """The increment at which the wheel is on, before it is pulled off: cooled, pressed on, or let go by the press."""
    if is_shrunk(displacement):
        return min(scene.motion.cooling, len(displacement) - 1)
    return len(displacement) - 1 if scene.motion.release else _pressed(displacement).stop - 1


def yield_stresses(scene: Scene) -> dict[str, float]:
    """Yield stress of each body [MPa] whose material states one; the safety of the others is not judged."""
    stated = {name: yield_stress(body.material) for name, body in (("axle", scene.axle), ("wheel", scene.wheel))}
    return {name: value for name, value in stated.items() if value is not None}


def measured_fit(
    diameter: float, length: float, displacement: FloatArray, force: FloatArray, interference: float | None = None
) -> Fit:
    """The press fit of a record.

    Args:
        diameter: of the seat [mm].
        length: that seat and bore have in common at the end [mm].
        displacement: ascending, (n,) [mm].
        force: pushing on is positive, (n,) [N].
        interference: measured before, on the diameter [mm].
    """  # fmt: skip
    reason = ""
    if len(force) < FEWEST:
        reason = f"the curve has {len(force)} points, {FEWEST} are needed"
    elif force.max() <= 0.0:
        reason = "no force is needed to push the wheel on; pushing on is positive"
    curve = None if reason else Curve(displacement, force)
    return Fit(diameter=diameter, length=length, curve=curve, reason=reason, interference=interference)


def _pressed(displacement: FloatArray) -> slice:
    """The increments before the motion first turns back."""
    back = np.flatnonzero(np.diff(displacement) < 0.0)
    return slice(0, int(back[0]) + 1 if len(back) else len(displacement))


def _not_a_press_fit(displacement: FloatArray, force: FloatArray, length: float) -> str:
    """Why the curve of a run is not one of a press fit; empty where it is."""
    if len(force) < 2 or displacement[0] > 0.0:
        return "the wheel is not pushed on from the entrance of the seat"
    if force.max() <= 0.0:
        return "no force is needed to push the wheel on"
    if min(float(displacement[-1]), length) < COVERED * length:
        return f"the wheel is pushed on by {displacement[-1]:g} mm only"
    return ""
