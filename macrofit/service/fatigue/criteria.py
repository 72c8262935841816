"""Criteria of fatigue for histories of stress over a revolution, as shares of what the steel bears for ever.

Two limits of the steel give all constants: f in reversed bending, t in reversed torsion [MPa].

- Crossland (1956): (sqrt(J2)_a + a p_max) / t, a = (3 t - sqrt(3) f) / f; sqrt(J2)_a is the radius of the smallest ball
  around the path of the deviator in the norm sqrt(s : s / 2), p the hydrostatic stress.
- Dang Van (1973): max (tau + a p) / t, a = (3 t - 1.5 f) / f; tau is Tresca's shear of the deviator counted from the
  centre of that ball.
- Findley (1959): max over planes of (tau_a + k s_max) / (t sqrt(1 + k^2)), k / sqrt(1 + k^2) = 2 t / f - 1; tau_a is
  half the longest chord of the path of the shear on the plane, s its normal stress.
- Smith, Watson, Topper (1970): max over planes of s_max eps_a [MPa], the critical plane's normal stress and amplitude
  of strain; s^2 / E in reversed bending.
- Ruiz, Chen (1986): s_max tau_max delta [MPa2 mm], the stress along the seat, the shear and the range of slip there.

The ball shrinks onto its support: its centre walks towards that of the support's own ball until a further point stops
it, which joins; a point that the centre lies beyond leaves. Fischer, Gaertner, Kutz, *Fast smallest-enclosing-ball
computation in high dimensions*, ESA 2003 (doi 10.1007/978-3-540-39658-1_57).

All but Ruiz' look at the stress alone; at a surface that frets they say where a crack may begin.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np

from ...base.arrays import FloatArray
from ...scene.material import Material

PLANES = 15
"""Degrees between the normals of the planes that are searched first."""

ROUNDING = 1e-12
STEPS = 1000
"""Walks of the centre of a ball, at most."""

Measure: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]
"""Values on planes (planes, 3) of a history (times, 3, 3)."""

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Places of (nn, mm, tt, nm, nt, mt) in the tensor."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the steel bears for ever, amplitudes [MPa]."""

    bending: float  # f
    torsion: float  # t

    @property
    def crossland(self) -> float:
        """Weight of the hydrostatic stress by Crossland [-]."""
        return (3.0 * self.torsion - math.sqrt(3.0) * self.bending) / self.bending

    @property
    def dang_van(self) -> float:
        """Weight of the hydrostatic stress by Dang Van [-]."""
        return (3.0 * self.torsion - 1.5 * self.bending) / self.bending

    @property
    def findley(self) -> float:
        """Weight k of the normal stress by Findley [-]."""
        sine = 2.0 * self.torsion / self.bending - 1.0
        return sine / math.sqrt(1.0 - sine * sine)


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """The criteria of histories, (histories,) each."""

    crossland: FloatArray  # share of the limit
    dang_van: FloatArray  # share of the limit
    findley: FloatArray  # share of the limit
    swt: FloatArray  # MPa


def tensors(stress: FloatArray) -> FloatArray:
    """Stresses (..., 6) as tensors (..., 3, 3)."""
    out = np.empty((*stress.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(PAIRS):
        out[..., i, j] = out[..., j, i] = stress[..., k]
    return out


def judge_histories(stress: FloatArray, limits: Limits, material: Material) -> Criteria:
    """The criteria of histories of stress (histories, times, 6) [MPa]."""
    tensor = tensors(stress)
    pressure = np.trace(tensor, axis1=2, axis2=3) / 3.0
    deviator = tensor - pressure[..., None, None] * np.eye(3)
    flat = deviator.reshape(*deviator.shape[:2], 9) / math.sqrt(2.0)
    balls = [smallest_ball(path) for path in flat]
    radius = np.array([ball[1] for ball in balls])
    centre = math.sqrt(2.0) * np.array([ball[0] for ball in balls]).reshape(-1, 1, 3, 3)
    principal = np.linalg.eigvalsh(deviator - centre)
    shear = 0.5 * (principal[..., 2] - principal[..., 0])
    findley, swt = _on_planes(tensor, limits.findley, material)
    return Criteria(
        crossland=(radius + limits.crossland * pressure.max(axis=1)) / limits.torsion,
        dang_van=(shear + limits.dang_van * pressure).max(axis=1) / limits.torsion,
        findley=findley / (limits.torsion * math.sqrt(1.0 + limits.findley**2)),
        swt=swt,
    )


def _on_planes(tensor: FloatArray, weight: float, material: Material) -> tuple[FloatArray, FloatArray]:
    """Findley's and Smith, Watson and Topper's values on the worst plane of each history."""
    coarse = plane_normals(math.radians(PLANES))
    findley: Measure = partial(_findley, weight=weight)
    swt: Measure = partial(_swt, material=material)
    worst = [[_worst(measure, history, coarse) for history in tensor] for measure in (findley, swt)]
    return np.array(worst[0]), np.array(worst[1])


def _worst(measure: Measure, history: FloatArray, normals: FloatArray) -> float:
    """The largest value of a history over the planes, sought ever finer around the worst."""
    best = 0.0
    for finer in (1.0, 5.0, 25.0, 125.0, 625.0):
        found = measure(normals, history)
        k = int(np.argmax(found))
        best = max(best, float(found[k]))
        normals = _around(normals[k], math.radians(PLANES) / finer)
    return best


def plane_normals(step: float) -> FloatArray:
    """Unit normals (planes, 3) over half a sphere, about ``step`` [rad] apart."""
    out = []
    for polar in np.linspace(0.0, 0.5 * math.pi, math.ceil(0.5 * math.pi / step) + 1):
        count = max(1, math.ceil(2.0 * math.pi * math.sin(polar) / step))
        angles = np.arange(count) * 2.0 * math.pi / count
        sine = math.sin(polar)
        out.append(np.stack([sine * np.cos(angles), sine * np.sin(angles), np.full(count, math.cos(polar))], axis=1))
    return np.concatenate(out)


def _around(normal: FloatArray, reach: float) -> FloatArray:
    """Normals within ``reach`` [rad] of one, itself among them."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    steps = np.linspace(-reach, reach, 9)
    x, y = (part.ravel()[:, None] for part in np.meshgrid(steps, steps))
    turned = normal + x * first + y * np.cross(normal, first)
    return np.asarray(turned / np.linalg.norm(turned, axis=1)[:, None])


def _findley(normals: FloatArray, history: FloatArray, weight: float) -> FloatArray:
    """tau_a + k s_max on planes (planes,) of a history (times, 3, 3)."""
    traction = np.einsum("tij,pj->pti", history, normals)
    normal = np.einsum("pti,pi->pt", traction, normals)
    shear = traction - normal[..., None] * normals[:, None]
    square = (shear * shear).sum(axis=2)
    chords = square[:, :, None] + square[:, None] - 2.0 * (shear @ np.swapaxes(shear, 1, 2))
    amplitude = 0.5 * np.sqrt(np.maximum(chords.max(axis=(1, 2)), 0.0))
    return np.asarray(amplitude + weight * normal.max(axis=1))


def _swt(normals: FloatArray, history: FloatArray, material: Material) -> FloatArray:
    """s_max eps_a on planes (planes,), 0 where the plane is never pulled."""
    nu, E = material.poisson_ratio, material.youngs_modulus
    normal = np.einsum("pi,tij,pj->pt", normals, history, normals)
    strain = ((1.0 + nu) * normal - nu * np.trace(history, axis1=1, axis2=2)) / E
    return np.asarray(np.maximum(normal.max(axis=1), 0.0) * 0.5 * np.ptp(strain, axis=1))


def smallest_ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Centre (d,) and radius of the smallest ball around points (n, d)."""
    spread = float(np.ptp(points, axis=0).max(initial=0.0))
    if spread <= 0.0:
        return points[0].copy(), 0.0
    centre = points.mean(axis=0)
    support = [int(np.argmax(_squares(points - centre)))]
    for _ in range(STEPS):
        target, shares = _circle(points[support], centre)
        way = target - centre
        if np.abs(way).max() <= ROUNDING * spread:
            if shares.min() >= -ROUNDING or len(support) == 1:
                break
            support.pop(int(np.argmin(shares)))
            continue
        along, stop = _stopped(points, support, centre, way)
        centre = centre + along * way
        if stop is not None:
            support.append(stop)
    return centre, float(np.sqrt(_squares(points - centre).max()))


def _squares(vectors: FloatArray) -> FloatArray:
    return np.asarray((vectors * vectors).sum(axis=-1))


def _circle(support: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The point of the support's affine hull that is nearest to the centre, and its shares in the points."""
    edges = support[1:] - support[0]
    if not len(edges):
        return support[0], np.ones(1)
    parts = np.linalg.lstsq(edges.T, centre - support[0], rcond=None)[0]
    return support[0] + parts @ edges, np.append(1.0 - parts.sum(), parts)


def _stopped(points: FloatArray, support: list[int], centre: FloatArray, way: FloatArray) -> tuple[float, int | None]:
    """How far the centre can go along its way until a point outside the support stops it, and which."""
    reach = points[support[0]]
    apart = points - reach
    slope = 2.0 * (apart @ -way)
    room = float(_squares(reach - centre)) - _squares(points - centre)
    closing = slope > ROUNDING * float(_squares(way))
    closing[support] = False
    if not closing.any():
        return 1.0, None
    where = np.flatnonzero(closing)
    limits = np.maximum(room[where], 0.0) / slope[where]
    first = int(np.argmin(limits))
    return (1.0, None) if limits[first] >= 1.0 else (float(limits[first]), int(where[first]))
