"""Recovered stress: polynomials to rounding, and the tractions of the contact line in the fit."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from small import small_press, solved

from macrofit.assembly import discretise_bodies
from macrofit.base.arrays import FloatArray
from macrofit.bodies.body import Body
from macrofit.bodies.recovery import Patches
from macrofit.bodies.stress import StressEvaluator
from macrofit.scene import load_scene


def body(name: str, order: int) -> tuple[Body, StressEvaluator]:
    made = discretise_bodies(small_press(f"mesh.order={order}"), MPI.COMM_SELF)[name]
    return made, StressEvaluator(made)


def polynomial(points: FloatArray, order: int) -> FloatArray:
    """Four components of a field of degree 1 or 2 at points (n, 2): (4, n)."""
    rng = np.random.default_rng(4)
    r, z = (points - 100.0).T / 50.0
    terms = [np.ones_like(r), r, z] if order == 1 else [np.ones_like(r), r, z, r * r, r * z, z * z]
    return np.asarray(rng.standard_normal((4, len(terms))) @ np.stack(terms))


def tractions(made: Body, order: int) -> FloatArray:
    """sigma n of that field in the middle of each facet of the contact line."""
    line = made.line
    middle = 0.5 * (line.nodes[: -line.order : line.order] + line.nodes[line.order :: line.order])
    rr, zz, _, rz = polynomial(middle, order)
    n_r, n_z = line.normals.T
    return np.stack([rr * n_r + rz * n_z, rz * n_r + zz * n_z], axis=1)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["axle", "wheel"])
@pytest.mark.parametrize("with_traction", [False, True])
def test_polynomials_are_recovered_to_rounding(order: int, name: str, with_traction: bool) -> None:
    made, evaluator = body(name, order)
    exact = polynomial(made.space.nodes, order).T
    given = tractions(made, order) if with_traction else None
    found = Patches(made, evaluator.places).recover(polynomial(evaluator.places, order), given)
    assert np.abs(found - exact).max() <= 1e-8 * np.abs(exact).max()


def test_tractions_pull_the_surface_towards_them() -> None:
    """The known traction halves, at least, what noise at the points leaves of it at the vertices of the line."""
    made, evaluator = body("axle", 2)
    noise = np.random.default_rng(1).standard_normal((4, len(evaluator.places)))
    patches = Patches(made, evaluator.places)
    free, held = (patches.recover(noise, given) for given in (None, np.zeros((made.line.facets, 2))))
    vertices = made.trace[: len(made.line.nodes) : 2]
    n_r, n_z = np.array([1.0, 0.0])  # the seat, mostly

    def left(stress: FloatArray) -> float:
        rr, _, _, rz = stress[vertices].T
        return float(np.sqrt(np.mean((rr * n_r + rz * n_z) ** 2)))

    assert left(held) < 0.5 * left(free)
    inside = np.setdiff1d(np.arange(len(free)), made.trace)
    assert np.abs(held[inside] - free[inside]).max() > 0.0  # middles beside the line follow


def test_both_sides_of_the_contact_have_its_pressure() -> None:
    """Flush rings: sigma_rr at the seat's and the bore's vertices is the pressure of Lame, whatever the side."""
    scene = load_scene("lame-rings", ["mesh.seat_facet=4", "mesh.coarse=8"])
    solution = solved(scene)
    pressure = solution.increments[-1].normal_force / (2.0 * np.pi * 95.0 * 40.0)
    fields = solution.fields[solution.increments[-1].displacement]
    for name, radius in (("axle", 95.0), ("wheel", 94.7)):
        line = np.flatnonzero(np.abs(fields[name].points[:, 0] - radius) < 1e-9)
        assert len(line) > 10
        assert fields[name].stress[line, 0] == pytest.approx(-pressure, rel=0.01)
