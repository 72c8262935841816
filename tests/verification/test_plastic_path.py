"""The path of the strain within a step: shifted points, a field that travels, one that grows where it is."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from small import small_press

from macrofit.assembly import discretise_bodies
from macrofit.base.arrays import FloatArray
from macrofit.bodies.body import Body
from macrofit.plasticity.path import Path, StrainAlong

WAY = 0.8
"""Way of the other body [mm]."""


@pytest.fixture(scope="module")
def body() -> Body:
    return discretise_bodies(small_press(), MPI.COMM_SELF)["wheel"]


def field(body: Body, moved: float) -> FloatArray:
    """Displacement (dofs,) of a quadratic field that has travelled along the axis [mm]; P2 holds it exactly."""
    r, z = body.space.nodes.T / 100.0
    z = z - moved / 100.0
    return np.stack([0.3 * r * z + 0.2 * z**2, 0.1 * z**2 - 0.4 * r**2 + r * z], axis=1).ravel()


def strains(places: FloatArray, moved: float) -> FloatArray:
    """Its strains (n, 4), by hand."""
    r, z = places.T / 100.0
    z = z - moved / 100.0
    ur, ur_z, ur_r = 0.3 * r * z + 0.2 * z**2, 0.3 * r + 0.4 * z, 0.3 * z
    uz_z, uz_r = 0.2 * z + r, -0.8 * r + z
    return np.stack([ur_r, uz_z, ur / r, ur_z + uz_r], axis=1) / 100.0


@pytest.mark.parametrize("shift", [0.0, 0.37, -1.4])
def test_strains_at_shifted_points(body: Body, shift: float) -> None:
    operators, inside = StrainAlong(body.space, body.gauss.places).at(shift, np.arange(len(body.gauss.places)))
    found = operators.of(field(body, 0.0))
    exact = strains(body.gauss.places + np.array([0.0, shift]), 0.0)
    assert np.mean(inside) > 0.9
    assert np.abs(found - exact)[inside].max() < 1e-10


def test_what_is_asked_for_first_changes_no_bit(body: Body) -> None:
    """A run that goes on from a journal asks for other points first than the one that was killed."""
    points = np.array([3, 200, 201, 460])
    alone, _ = StrainAlong(body.space, body.gauss.places).at(0.37, points)
    along = StrainAlong(body.space, body.gauss.places)
    along.at(0.37, points[1:2])
    together, _ = along.at(0.37, np.arange(len(body.gauss.places)))
    np.testing.assert_array_equal(together.operators[points], alone.operators[points])
    np.testing.assert_array_equal(together.unknowns[points], alone.unknowns[points])


def test_points_that_leave_the_body_are_known(body: Body) -> None:
    """Nothing is extrapolated beyond the end of the hub, by more than a fifth of a cell."""
    shift, places = 25.0, body.gauss.places
    _, inside = StrainAlong(body.space, places).at(shift, np.arange(len(places)))
    beyond = places[:, 1] + shift > body.space.nodes[:, 1].max() + 10.0
    assert beyond.any()
    assert not inside[beyond].any()


def steps(body: Body, after: FloatArray, points: FloatArray) -> FloatArray:
    """Strains (3, m, 4) within a step of four parts, from the field where it starts to another displacement."""
    path = Path(StrainAlong(body.space, body.gauss.places), points, field(body, 0.0), WAY, 4)
    end = StrainAlong(body.space, body.gauss.places).at(0.0, points)[0].of(after)
    path.choose(end)
    return path.strains(after, end)


def test_a_field_that_travels_is_followed(body: Body) -> None:
    """Exactly; on a straight line the strains of the quadratic parts would be off by a sixth of their change."""
    points = np.arange(0, len(body.gauss.places), 7)
    _, inside = StrainAlong(body.space, body.gauss.places).at(-WAY, points)
    points = points[inside]
    found = steps(body, field(body, WAY), points)
    exact = np.stack([strains(body.gauss.places[points], share * WAY) for share in (0.25, 0.5, 0.75)])
    here, there = (strains(body.gauss.places[points], moved) for moved in (0.0, WAY))
    straight = np.stack([(1 - share) * here + share * there for share in (0.25, 0.5, 0.75)])
    error, of_line = (np.abs(each - exact).max(axis=(0, 2)) for each in (found, straight))
    assert np.median(error) < 1e-10
    assert np.median(of_line) > 1e-9


def test_a_field_that_grows_where_it_is_goes_straight(body: Body) -> None:
    points = np.arange(0, len(body.gauss.places), 7)
    before = strains(body.gauss.places[points], 0.0)
    found = steps(body, 1.001 * field(body, 0.0), points)
    assert found == pytest.approx(np.stack([(1 + 0.001 * share) * before for share in (0.25, 0.5, 0.75)]), abs=1e-12)
