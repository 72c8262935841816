"""Partial slip of a narrow seat against the plane closed forms of Cattaneo and Mindlin, with and without bulk stress.

Two half planes of one steel under p = p0 sqrt(1 - (x/a)^2) carry a shear force Q per length. They slip at both edges
and stick on |x - e| < c, where

    c/a = sqrt(1 - Q / (mu P)),   q = mu p0 [sqrt(1 - (x/a)^2) - c/a sqrt(1 - ((x - e)/c)^2)]

(Cattaneo 1938, Mindlin 1949). A bulk stress sigma in one of them, which comes up with Q, moves the zone by
e = E eps a / (4 (1 - nu^2) mu p0), eps the strain it makes (Nowell, Hills, Int. J. Mech. Sci. 29 (1987) 355-365,
doi 10.1016/0020-7403(87)90117-2; Hills, Nowell, *Mechanics of Fretting Fatigue*, 1994), as long as e + c < a: in the
zone the slip's derivative, 4 (1 - nu^2) / (pi E) times the Cauchy integral of q, has to be eps; sqrt(1 - (x/c)^2) has
the integral pi x / c, so that the first term gives x/a, and the second takes (x - e)/a away. Outside, the integral of
the second loses sign(x) sqrt((x/c)^2 - 1), and the slip is

    g = 4 (1 - nu^2) mu p0 / (E a) [u sqrt(u^2 - c^2) - c^2 arcosh(u/c)] / 2,   u = |x - e|.

A shear around the axle, and a bulk twist tau, are the antiplane problem: the same with G / 2 for E / (4 (1 - nu^2)).
With nu = 0 both are one, so that shear in any direction follows the same law. The seat's radius and the depth of the
bodies are 160 a: some 1/160 of the slip and zones is theirs, and the edges of zones lie within a facet of a / 20.
"""

from __future__ import annotations

import numpy as np
import pytest
from narrow_seat import HALF, MODULUS, RADIUS, NarrowSeat
from scipy.integrate import trapezoid

from macrofit.base.arrays import FloatArray

P0, MU = 100.0, 0.2
RISING = np.linspace(0.1, 1.0, 10)


def shear(z: FloatArray, c: float, e: float) -> FloatArray:
    """The closed form q [MPa]."""
    inner = np.sqrt(np.maximum(1.0 - ((z - e) / c) ** 2, 0.0))
    return np.asarray(MU * P0 * (np.sqrt(1.0 - (z / HALF) ** 2) - c / HALF * inner))


def slip(z: FloatArray, c: float, e: float, stiffness: float) -> FloatArray:
    """The closed form g without its sign [mm]; ``stiffness`` is E / (4 (1 - nu^2)) or G / 2 [MPa]."""
    u = np.maximum(np.abs(z - e), c)
    return np.asarray(MU * P0 / (stiffness * HALF) * 0.5 * (u * np.sqrt(u**2 - c**2) - c**2 * np.arccosh(u / c)))


def stuck(z: FloatArray, q: FloatArray, moved: FloatArray) -> tuple[float, float]:
    """Half the width c and middle e of the zone that does not move, by q [mm]: (mu p - q)^2 is a parabola there."""
    spare = (MU * P0 * np.sqrt(1.0 - (z / HALF) ** 2) - q) * HALF / (MU * P0)
    inside = moved == 0.0
    slope, constant = np.polyfit(z[inside], (spare**2 + z**2)[inside], 1)
    return float(np.sqrt(constant + 0.25 * slope**2)), 0.5 * float(slope)


def compare(z: FloatArray, q: FloatArray, moved: FloatArray, zone: tuple[float, float], stiffness: float) -> None:
    """Zone, shear and slip against the closed forms."""
    c, e = stuck(z, q, moved)
    assert c == pytest.approx(zone[0], rel=0.01)
    assert e == pytest.approx(zone[1], abs=0.02 * abs(zone[1]) + 0.001 * HALF)
    expected = slip(z, *zone, stiffness)
    assert np.abs(moved) == pytest.approx(expected, abs=0.02 * expected.max())
    far = np.abs(np.abs(z - zone[1]) - zone[0]) > 0.1 * HALF  # two facets from where q has a cusp
    assert q[far] == pytest.approx(shear(z, *zone)[far], abs=0.02 * MU * P0)


@pytest.mark.parametrize(("ratio", "bulk"), [(0.3, 0.4), (0.5, 0.8), (0.75, 0.0)])
def test_a_push_with_bulk_tension_slips_as_nowell_and_hills_found(ratio: float, bulk: float) -> None:
    seat = NarrowSeat(P0, MU)
    push = ratio * MU * seat.normal_force
    seat.push(push, 0.0)
    seat.pull(bulk * MU * P0 + push / RADIUS)  # the held end takes 2 Q / R away: half of it is bulk stress here
    q = seat.follow(RISING)[0, 1]
    compare(seat.z, q, seat.slip[0, 1], (HALF * np.sqrt(1.0 - ratio), HALF * bulk / 4.0), MODULUS / 4.0)


def test_a_torque_with_a_bulk_twist_is_the_antiplane_problem() -> None:
    seat, ratio, bulk = NarrowSeat(P0, MU, poisson_ratio=0.3), 0.5, 0.5
    push = ratio * MU * seat.normal_force
    seat.push(0.0, push)
    seat.twist(bulk * MU * P0 + 2.0 * push / RADIUS)  # 2 pi R^2 Q is 4 Q / R at the surface
    q = seat.follow(RISING)[0, 2]
    zone = (HALF * np.sqrt(1.0 - ratio), HALF * bulk / 2.0)
    compare(seat.z, q, seat.slip[0, 2], zone, 0.5 * MODULUS / 2.6)


def test_an_oblique_push_slips_along_itself() -> None:
    seat, ratio, direction = NarrowSeat(P0, MU), 0.5, np.array([0.6, 0.8])
    push = ratio * MU * seat.normal_force * direction
    seat.push(*push)
    seat.pull(push[0] / RADIUS)
    seat.twist(2.0 * push[1] / RADIUS)
    traction = seat.follow(RISING)[0, 1:]
    across = np.array([-direction[1], direction[0]])
    assert np.abs(across @ seat.slip[0, 1:]).max() < 0.02 * np.abs(seat.slip).max()
    zone = (HALF * np.sqrt(1.0 - ratio), 0.0)
    compare(seat.z, direction @ traction, direction @ seat.slip[0, 1:], zone, MODULUS / 4.0)


def test_bending_is_bulk_tension_that_differs_from_angle_to_angle() -> None:
    seat, ratio, bulk = NarrowSeat(P0, MU, harmonics=3), 0.5, 0.8
    push = ratio * MU * seat.normal_force
    seat.push(push, 0.0)
    seat.pull(push / RADIUS)
    seat.bend(bulk * MU * P0)
    q = seat.follow(RISING)[:, 1]
    for k in range(7):
        e = 0.25 * HALF * bulk * np.cos(2.0 * np.pi * k / 7)
        compare(seat.z, q[k], seat.slip[k, 1], (HALF * np.sqrt(1.0 - ratio), e), MODULUS / 4.0)


def test_a_push_to_and_fro_works_as_mindlin_found() -> None:
    # back from Q to -Q it slips over the same zone, twice as far, everywhere against mu p
    seat, ratio = NarrowSeat(P0, MU), 0.5
    push = ratio * MU * seat.normal_force
    seat.push(push, 0.0)
    seat.pull(push / RADIUS)
    seat.follow(RISING)
    there, before = seat.slip, seat.work
    seat.follow(np.linspace(0.9, -1.0, 20))
    c = HALF * np.sqrt(1.0 - ratio)
    moved = there[0, 1] - seat.slip[0, 1]
    assert np.abs(moved) == pytest.approx(2.0 * slip(seat.z, c, 0.0, MODULUS / 4.0), abs=0.02 * np.abs(moved).max())
    x = np.linspace(c, HALF, 20001)
    work = 4.0 * trapezoid(MU * P0 * np.sqrt(1.0 - (x / HALF) ** 2) * slip(x, c, 0.0, MODULUS / 4.0), x)
    assert seat.work - before == pytest.approx(work, rel=0.03)
