"""What the last revolution says along the seat: slip, friction work, stress histories, criteria."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import BoolArray, FloatArray
from .bonded import Harmonic, seat_stress
from .fatigue.criteria import Criteria, judge_histories
from .fatigue.limits import limits_of
from .kernel import Kernel
from .residual import Residual
from .rotation import Revolution
from .seat_stress import MM, MT, NM, NT, by_facet
from .wheelset import Wheelset

SLIPPED = 1e-5
"""Range of slip above which a place slips [mm]."""
TOUCHES = 1e-6
"""Pressure above which a place is in contact, in the largest one."""


@dataclass(frozen=True, kw_only=True)
class Fretting:
    """The seat over a revolution, (m,) moments; largest over the angles where nothing else is said."""

    touches: BoolArray  # at some time
    always: BoolArray  # in contact at all times
    axial_range: FloatArray  # mm, of the slip along the seat while in contact
    around_range: FloatArray  # mm, of the slip around it
    work: FloatArray  # N/mm, friction work of a revolution per area, mean over the angles
    largest_pressure: FloatArray  # MPa
    least_pressure: FloatArray  # MPa
    largest_shear: FloatArray  # MPa
    opening: FloatArray  # mm, largest gap
    front_zone: float  # mm, length from the front end of the contact over which it slips
    inner_zone: float  # mm, from its inner end
    left: tuple[float, float]  # change of the slip along and around over the revolution, in its largest range
    wave_errors: tuple[float, float]  # see `wave_error`: of pressure and shear along the seat, of shear around it


def fretting(whole: Wheelset, last: Revolution) -> Fretting:
    """What the last revolution did to the seat."""
    traction = np.stack([moment.traction for moment in last.moments])
    slip = np.stack([moment.slip for moment in last.moments])
    closed = in_contact(traction)
    ranges = [_range(slip[:, :, i], closed).max(axis=0) for i in (1, 2)]
    change = np.diff(slip[:, :, 1:], axis=0)
    mean = 0.5 * (traction[1:, :, 1:] + traction[:-1, :, 1:])
    touches = closed.any(axis=(0, 1))
    slips = touches & (np.hypot(*ranges) > SLIPPED)
    always = closed.all(axis=(0, 1))
    shears = [wave_error(traction[:, :, part][..., always]) for part in (slice(0, 2), slice(2, 3))]
    size = max(float(np.abs(traction[:, :, 1:]).max(initial=0.0)), 1e-300)
    wave = [error / size for error in shears]
    front, inner = _zones(whole.fit.z, touches, slips)
    return Fretting(
        touches=touches,
        always=always,
        axial_range=ranges[0],
        around_range=ranges[1],
        work=-(mean * change).sum(axis=(0, 2)).mean(axis=0),
        largest_pressure=-traction[:, :, 0].min(axis=(0, 1)),
        least_pressure=-traction[:, :, 0].max(axis=(0, 1)),
        largest_shear=np.hypot(traction[:, :, 1], traction[:, :, 2]).max(axis=(0, 1)),
        opening=-slip[:, :, 0].min(axis=(0, 1)),
        front_zone=front,
        inner_zone=inner,
        left=_left(slip, always, ranges[0]),
        wave_errors=(wave[0], wave[1]),
    )


def slip_left(revolution: Revolution) -> tuple[float, float] | None:
    """`Fretting.left` of a revolution by itself; None where no place stays in contact all around."""
    traction = np.stack([moment.traction for moment in revolution.moments])
    slip = np.stack([moment.slip for moment in revolution.moments])
    closed = in_contact(traction)
    always = closed.all(axis=(0, 1))
    return _left(slip, always, _range(slip[:, :, 1], closed)) if always.any() else None


def _left(slip: FloatArray, always: BoolArray, axial_range: FloatArray) -> tuple[float, float]:
    """What slip (times, K, 3, m) has changed along and around where it is always in contact, in the largest range."""
    left = np.abs(slip[-1] - slip[0])[:, 1:, always].max(axis=(0, 2), initial=0.0)
    along, around = (left / max(float(axial_range.max(initial=0.0)), 1e-300)).tolist()
    return along, around


def in_contact(traction: FloatArray) -> BoolArray:
    """Where tractions (times, K, 3, m) press (times, K, m), rounding left out."""
    normal = traction[:, :, 0]
    return np.asarray(normal < TOUCHES * normal.min())


def _range(values: FloatArray, closed: BoolArray) -> FloatArray:
    """Largest less smallest value over the times (times, ...) that are closed; 0 where none is."""
    high = np.where(closed, values, -np.inf).max(axis=0)
    low = np.where(closed, values, np.inf).min(axis=0)
    return np.where(closed.any(axis=0), high - np.where(np.isfinite(low), low, 0.0), 0.0)


def _zones(z: FloatArray, touches: BoolArray, slips: BoolArray) -> tuple[float, float]:
    """Lengths from both ends of the contact to the first place that sticks [mm]."""
    place, slipping = z[touches], slips[touches]
    if not len(place):
        return 0.0, 0.0
    stuck = place[~slipping]
    whole = float(place[-1] - place[0])
    return (whole, whole) if not len(stuck) else (float(stuck[0] - place[0]), float(place[-1] - stuck[-1]))


def wave_error(traction: FloatArray) -> float:
    """How far tractions (times + 1, K, ...) are from a wave that turns with the loads [MPa]: between times alike."""
    steps, angles = len(traction) - 1, traction.shape[1]
    turned = [np.roll(traction[:-1, k], -k * (steps // angles), axis=0) for k in range(angles)]
    return max(float(np.abs(each - turned[0]).max(initial=0.0)) for each in turned)


def stress_histories(
    whole: Wheelset, kernel: Kernel, harmonics: list[Harmonic], residual: Residual, last: Revolution
) -> FloatArray:
    """Stress (facets, times, 6) of the seat at the angle 0 over a revolution, the residual stress included [MPa]."""
    start = residual.traction[:, whole.fit.chosen].reshape(-1)
    sines = np.ones(6, dtype=np.complex128)
    sines[[NT, MT]] = -1j
    times = []
    for moment in last.moments[1:]:
        added = kernel.amplitudes(moment.traction.reshape(kernel.angles, -1) - start) / kernel.turn
        total = residual.stress.copy()
        for n, each in enumerate(harmonics):
            moved = each.moved * np.exp(-2j * np.pi * n * moment.time)
            stress = sines * seat_stress(whole, n, added[n], moved)
            total += (1.0 if n == 0 else 2.0) * stress.real
        times.append(total)
    return np.stack(times, axis=1)


@dataclass(frozen=True, kw_only=True)
class Endurance:
    """Criteria along the seat, (facets,)."""

    z: FloatArray  # middles of the facets [mm]
    stress: FloatArray  # (facets, times, 6) MPa
    criteria: Criteria
    ruiz: FloatArray  # MPa2 mm


def endurance(whole: Wheelset, stress: FloatArray, wear: Fretting) -> Endurance:
    """The criteria of the seat's stress histories.

    Raises:
        SceneError: see `fatigue.limits.limits_of`.
    """
    line = whole.fit.lines[0]
    limits = limits_of(whole.loads.keys, whole.scene.axle.material)
    middles = 0.5 * (line.coordinate[1:] + line.coordinate[:-1])
    along = by_facet(line.facets, whole.fit.facet, wear.axial_range.astype(np.complex128)[:, None]).real[:, 0]
    shear = np.abs(stress[:, :, NM]).max(axis=1)
    return Endurance(
        z=middles,
        stress=stress,
        criteria=judge_histories(stress, limits, line.material),
        ruiz=np.maximum(stress[:, :, MM].max(axis=1), 0.0) * shear * along,
    )
