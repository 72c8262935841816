"""The wheelset in bending where nothing slips or opens: the linear solution, harmonic by harmonic.

It says what the fit has to carry, how it concentrates the bending stress beside the hub, and with which power the shear
grows towards the edges: for a sharp bonded edge of a right angle on a half plane of the same steel, distance^-0.4555
(Williams; Bogy 1968), which friction cannot hold however high it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray
from .elements import ComplexArray
from .seat_stress import MM, by_facet, surface_stress
from .wheelset import Wheelset

EDGE = (2.0, 8.0)
"""Distances from an edge between which the power of the shear is fitted [mm]."""
FEWEST = 4
"""Fewest points that it is fitted to."""
NO_BENDING = "nothing bends the axle there"
OUTSIDE = 4.0
"""Distance beside the hub where the stress concentration is taken [mm]."""


@dataclass(frozen=True, kw_only=True)
class Harmonic:
    """What one harmonic adds, at the angle 0 of the load."""

    jump: ComplexArray  # d (3 m,) [mm]
    balance: ComplexArray  # R' f_w (k,)
    moved: ComplexArray  # displacement of the seat's line by the loads alone (line nodes, 3) [mm]
    traction: ComplexArray  # lambda of the bonded fit (3 m,) [MPa]
    stress: ComplexArray  # (facets, 6) see `seat_stress`


@dataclass(frozen=True, kw_only=True)
class Edge:
    """One end of the fit."""

    name: str  # "front" or "inner"
    z: float  # mm, where contact ends
    nominal_stress: float  # MPa, there
    concentration: float | None  # stress over the nominal one, OUTSIDE mm beside the hub
    without: str | None  # why there is none
    shear_power: float | None  # exponent of the shear within EDGE
    without_power: str | None  # why there is none


@dataclass(frozen=True, kw_only=True)
class Bonded:
    """The bonded solution under the loads at the angle 0."""

    harmonics: Mapping[int, Harmonic]  # those that were asked for, n = 1 among them
    z: FloatArray  # (facets,) middles of the seat's facets [mm]
    nominal: FloatArray  # (facets,) MPa
    bending: FloatArray  # (facets,) axial stress of n = 1, positive as the nominal one [MPa]
    edges: tuple[Edge, Edge]


def one_harmonic(whole: Wheelset, n: int) -> Harmonic:
    """The loads of one harmonic, and the tractions and stresses of the bonded fit."""
    fit, loads = whole.fit, whole.loads
    jump, balance = fit.jump(n, loads.of_axle(n), loads.of_wheel(n))
    traction = fit.response(n).traction(-jump, balance)
    moved = fit.axle.solve(n, loads.of_axle(n).reshape(-1, 1)).reshape(-1, 3)[fit.axle.trace]
    return Harmonic(
        jump=jump, balance=balance, moved=moved, traction=traction, stress=seat_stress(whole, n, traction, moved)
    )


def seat_stress(whole: Wheelset, n: int, traction: ComplexArray, moved: ComplexArray) -> ComplexArray:
    """Stress amplitudes (facets, 6) of the seat under tractions (3 m,) and what loads move it (line nodes, 3)."""
    fit, line = whole.fit, whole.fit.lines[0]
    means = by_facet(line.facets, fit.facet, traction.reshape(3, -1).T)
    return surface_stress(line, n, fit.line_displacement(n, traction) + moved, means)


def bonded_solution(whole: Wheelset) -> Bonded:
    """The bonded solution in the harmonic that bends the axle; what pushes or twists it alone, n = 0, bends nothing."""
    for body in (whole.fit.axle, whole.fit.wheel):
        body.single = True
    return in_bending(whole, {1: one_harmonic(whole, 1)})


def in_bending(whole: Wheelset, found: Mapping[int, Harmonic]) -> Bonded:
    """What the harmonics of the bonded solution say of the bending of the axle."""
    coordinate = whole.fit.lines[0].coordinate
    z = 0.5 * (coordinate[1:] + coordinate[:-1])
    bending = -2.0 * found[1].stress[:, MM].real
    nominal = whole.nominal_stress(z)
    shear = 2.0 * np.abs(found[1].traction.reshape(3, -1)[1])
    ratio = np.divide(bending, nominal, out=np.full_like(bending, np.nan), where=nominal != 0.0)
    edges = tuple(_edge(whole, name, z, ratio, shear) for name in ("front", "inner"))
    return Bonded(harmonics=found, z=z, nominal=nominal, bending=bending, edges=(edges[0], edges[1]))


def _edge(whole: Wheelset, name: str, z: FloatArray, ratio: FloatArray, shear: FloatArray) -> Edge:
    portions, place = whole.fit.coupling.portions, whole.fit.z
    used = whole.fit.chosen // portions.points.shape[1]
    at, out = (portions.start[used[0]], -1.0) if name == "front" else (portions.end[used[-1]], 1.0)
    concentration = float(np.interp(at + out * OUTSIDE, z, ratio, left=np.nan, right=np.nan))
    distance = out * (at - place)
    inside = (distance > EDGE[0]) & (distance < EDGE[1]) & (shear > 0.0)
    power = np.nan
    if inside.sum() >= FEWEST:
        power = float(np.polyfit(np.log(distance[inside]), np.log(shear[inside]), 1)[0])
    nominal = float(whole.nominal_stress(np.array([at]))[0])
    no_power = _without_power(nominal, power)
    return Edge(
        name=name,
        z=float(at),
        nominal_stress=nominal,
        concentration=concentration if np.isfinite(concentration) else None,
        without=None if np.isfinite(concentration) else _without(nominal, out * (z[0 if out < 0.0 else -1] - at)),
        shear_power=power if no_power is None else None,
        without_power=no_power,
    )


def _without(nominal: float, left: float) -> str:
    """Why there is no concentration beside an edge; the last facet's middle stands ``left`` mm beside it."""
    if nominal == 0.0:
        return NO_BENDING
    ends = f"the last facet is {left:.2g} mm beside the hub" if left > 0.0 else "the hub reaches the end of the seat"
    return f"{ends}, and it is taken {OUTSIDE:g} mm beside"


def _without_power(nominal: float, power: float) -> str | None:
    """Why the power of the shear says nothing; NaN where there were too few points. An edge has one of 0 to -1."""
    if nominal == 0.0:
        return NO_BENDING
    if np.isnan(power):
        return f"fewer than {FEWEST} points are {EDGE[0]:g} to {EDGE[1]:g} mm from the edge"
    if power >= 0.0:
        return "the shear does not grow towards the edge"
    if power <= -1.0:
        return f"the shear grows as the distance to the power {power:.2f}, which no edge does; lower mesh.seat_facet"
    return None
