"""A wheel bonded to its axle in bending: harmonics against hexahedra of a three-dimensional mesh."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from mpi4py import MPI
from solid import Loads, Solid, amplitudes, solve_half

from macrofit.assembly import discretise_bodies
from macrofit.base.arrays import FloatArray
from macrofit.scene import build_scene
from macrofit.service.bonded import Harmonic, one_harmonic
from macrofit.service.loads import Section
from macrofit.service.seat_stress import MM
from macrofit.service.wheelset import Wheelset, wheelset

FORCE, MOMENT, EDGES = 1e4, 1e7, (110.0, 190.0)
NEAR = 10.0
"""Distance from an edge below which stresses are those of an edge, and of either mesh [mm]."""
SOLID = Solid(
    radii=np.array([20.0, 33.0, 43.0, 47.5, 50.0, 53.0, 60.0, 75.0, 100.0]),
    seat=50.0,
    places=np.array(
        [
            0, 25, 50, 70, 84, 94, 102, 107, 110, 113, 118, 126, 137, 150, 163, 174, 182, 187, 190, 193, 198, 206, 216,
            230, 250, 275, 300, 350, 400,
        ],
        dtype=np.float64,
    ),
    hub=EDGES,
    sectors=10,
)  # fmt: skip


@cache
def by_harmonics() -> tuple[Wheelset, list[Harmonic]]:
    tables = {
        "axle": {"seat_radius": 50.0, "seat_length": 300.0, "tail_length": 100.0, "inner_radius": 20.0},
        "wheel": {"bore_radius": 49.99, "hub_length": 80.0, "hub_outer_radius": 100.0},
        "mesh": {"seat_facet": 2.0, "coarse": 10.0},
        "motion": {"start": 190.0, "travel": 190.0},
        "service": {"journal_force": FORCE, "journal_moment": MOMENT},
    }
    scene = build_scene(tables)
    whole = wheelset(scene, discretise_bodies(scene, MPI.COMM_SELF))
    return whole, [one_harmonic(whole, n) for n in range(4)]


@cache
def by_hexahedra() -> tuple[FloatArray, FloatArray]:
    section = Section(outer=50.0, inner=20.0)

    def front(points: FloatArray) -> FloatArray:
        r = np.hypot(points[:, 0], points[:, 1])
        cosine, sine = points[:, 0] / r, points[:, 1] / r
        radial, around = section.shear(FORCE, 0.3, r)
        across = [radial * cosine**2 - around * sine**2, (radial + around) * sine * cosine]
        return np.column_stack([*across, MOMENT * r / section.second_moment * cosine])

    return solve_half(SOLID, Loads(front=front, rim=(100.0, 150.0, FORCE)), by_harmonics()[0].fit.axle.material)


def compared(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places z (k,) of the seat, amplitudes (k, 3) there by harmonics and by hexahedra; n = 1 from the same frame."""
    whole, found = by_harmonics()
    line, each = whole.fit.lines[0], found[n]
    moved = (whole.fit.line_displacement(n, each.traction) + each.moved).real * (1.0 if n == 0 else 2.0)
    z, solid = amplitudes(SOLID, *by_hexahedra(), n)
    here = z <= line.coordinate[-1]
    mine = np.stack([np.interp(z[here], line.nodes[:, 1], part) for part in moved.T], axis=1)
    solid = solid[here]
    if n == 1:
        solid -= (solid - mine)[-1, 0] * np.array([1.0, -1.0, 0.0])
    return z[here], mine, solid


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_seat_moves_as_that_of_hexahedra(n: int) -> None:
    # n = 1 is the bending of the whole, the others what one point of the rim does to the ring
    _, mine, solid = compared(n)
    assert mine == pytest.approx(solid, abs=(0.005 if n == 1 else 0.03) * np.abs(solid).max())


def test_bending_stress_away_from_the_edges_is_that_of_hexahedra() -> None:
    (whole, found), (z, _, solid) = by_harmonics(), compared(1)
    steel, r = whole.fit.axle.material, SOLID.seat
    modulus = steel.youngs_modulus / (1.0 - steel.poisson_ratio**2)
    along, around = np.gradient(solid[:, 2], z), (solid[:, 0] + solid[:, 1]) / r
    expected = modulus * (along + steel.poisson_ratio * around)[1:-1:2]  # in the middles of hexahedra, of order 2
    middle = z[1:-1:2]
    free = (middle < EDGES[0] - NEAR) | (middle > EDGES[1] + NEAR)
    ends = whole.fit.lines[0].coordinate
    stress = np.interp(middle, 0.5 * (ends[1:] + ends[:-1]), 2.0 * found[1].stress[:, MM].real)
    assert stress[free] == pytest.approx(expected[free], rel=0.01)
