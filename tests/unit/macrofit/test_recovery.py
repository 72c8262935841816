"""Recovered stress: polynomials to rounding, and the tractions of the contact line in the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from small import YIELDING, small_press, solved

from macrofit.assembly import Assembly, discretise_bodies
from macrofit.base.arrays import FloatArray
from macrofit.bodies.body import Body
from macrofit.bodies.elasticity import stiffness_moduli, von_mises
from macrofit.bodies.recovery import Patches
from macrofit.bodies.stress import StressEvaluator
from macrofit.bodies.surface import line_traction, surface_stress, to_line
from macrofit.plasticity.body import PlasticBody
from macrofit.plasticity.history import FlowHistory
from macrofit.plasticity.law import Hardening, PointState
from macrofit.plasticity.surface import NEAREST, POINTS, SurfaceFit
from macrofit.scene import Scene, load_scene
from macrofit.solution import Increment
from macrofit.solve import solve
from macrofit.state import State
from macrofit.stress import Stresses, evaluate_stresses


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


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["axle", "wheel"])
def test_uniform_strain_on_the_line(order: int, name: str) -> None:
    """The stress of a uniform strain: exact on straight lines, to 2e-3 in arcs of 5 mm facets."""
    made, _ = body(name, order)
    strain = np.array([3e-3, -1e-3, 3e-3, 4e-4])
    r, z = made.space.nodes.T
    displacement = np.stack([strain[0] * r, strain[1] * z + strain[3] * r], axis=1).ravel()
    exact = stiffness_moduli(made.material) @ strain
    n_r, n_z = made.line.normals.T
    traction = np.stack([exact[0] * n_r + exact[3] * n_z, exact[3] * n_r + exact[1] * n_z], axis=1)
    found = surface_stress(made, displacement, traction)
    off = np.abs(found - exact).max(axis=1) / np.abs(exact).max()
    assert off.max() < 2e-3
    bends = np.pad(np.abs(np.diff(made.line.normals[:, 1])) > 1e-9, 1)[:, None]  # at the ends of facets
    far = ~np.stack([np.roll(bends, k) for k in range(-2, 3)]).any(axis=0).ravel()
    assert far.sum() > 10
    assert off[:: made.line.order][far].max() < 1e-10


@pytest.mark.parametrize("steel", [(), YIELDING])
def test_the_surface_bears_the_traction(steel: tuple[str, ...]) -> None:
    """The middles of the facets have the pressure and shear of the run on the seat, those that are free none."""
    scene = small_press(*steel, fields=True)
    solution = solved(scene)
    facets, line = solution.increments[-1].facets, discretise_bodies(scene, MPI.COMM_SELF)["axle"].line
    field = solution.fields[solution.increments[-1].displacement]["axle"]
    middle = 0.5 * (line.nodes[:-1:2] + line.nodes[2::2])
    near = np.abs(field.points[:, None] - middle).sum(axis=2).argmin(axis=0)
    rr, zz, _, rz = field.stress[near].T
    n_r, n_z = line.normals.T
    pressure = -(rr * n_r**2 + zz * n_z**2 + 2.0 * rz * n_r * n_z)
    shear = (zz - rr) * n_r * n_z + rz * (n_r**2 - n_z**2)
    assert (facets.pressure > 0.0).sum() > 5
    assert pressure == pytest.approx(facets.pressure, rel=1e-9, abs=1e-9)
    assert np.abs(shear) == pytest.approx(np.abs(facets.traction), rel=1e-9, abs=1e-9)


def test_no_stress_of_a_line_that_flowed_is_beyond_yield() -> None:
    """Of neither body, though Hooke's stress of the strain would be 1000 MPa and a quadratic swings a third beyond."""
    scene = small_press(*YIELDING, "mesh.seat_facet=2", "mesh.bore_facet=1.94", "motion.travel=40", fields=True)
    fields = solved(scene).fields[40.0]
    assert fields["wheel"].plastic_strain is not None
    assert fields["wheel"].plastic_strain.max() > 5e-3
    for name, made in discretise_bodies(scene, MPI.COMM_SELF).items():
        line = made.trace[: len(made.line.nodes)]
        strain = fields[name].plastic_strain
        assert strain is not None
        assert fields[name].von_mises[line].max() < 1.001 * (350.0 + 5000.0 * strain[line].max())


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["axle", "wheel"])
def test_planes_through_the_points_beside_the_line(order: int, name: str) -> None:
    """A field of degree 1 to rounding at the nodes of the line."""
    made, evaluator = body(name, order)
    fit = SurfaceFit(PlasticBody(made, Hardening(yield_stress=300.0)))
    nodes = np.arange(len(made.line.nodes))
    exact = polynomial(made.line.nodes, 1).T
    assert np.abs(fit.at(nodes, polynomial(evaluator.places, 1).T) - exact).max() <= 1e-8 * np.abs(exact).max()


def test_the_nearest_points_of_a_plane_count_most() -> None:
    """The plane of least sum of (distance to it)^2 / (distance from the node), of any field."""
    made, evaluator = body("axle", 2)
    values, node = np.random.default_rng(2).standard_normal(len(evaluator.places)), 9
    offset = evaluator.places - made.line.nodes[node]
    near = np.argsort(np.hypot(*offset.T))[:POINTS]
    distance = np.hypot(*offset[near].T)
    terms, weight = np.column_stack([np.ones(POINTS), offset[near]]), 1.0 / (distance / distance[-1] + NEAREST)
    expected = np.linalg.solve(terms.T * weight @ terms, terms.T * weight @ values[near])[0]
    fit = SurfaceFit(PlasticBody(made, Hardening(yield_stress=300.0)))
    assert fit.at(np.array([node]), values) == pytest.approx(expected)


@pytest.mark.parametrize("grown", [0.5, 1.0, 3.0])
def test_a_line_that_flowed_has_its_traction_and_its_yield_stress(grown: float) -> None:
    """Uniform stress, back-stress and hardening: s - X is drawn back to R where it is beyond, and only there."""
    made, evaluator = body("axle", 2)
    law = Hardening(yield_stress=300.0, isotropic=2000.0)
    fit, count = SurfaceFit(PlasticBody(made, law)), len(evaluator.places)
    back, sigma = np.array([40.0, -60.0, 20.0, 10.0]), np.array([-50.0, 120.0, 60.0, 30.0])
    radius = 300.0 + 2000.0 * 0.01
    sigma = back + sigma * grown * radius / von_mises(sigma)
    n_r, n_z = made.line.normals.T
    traction = np.stack([sigma[0] * n_r + sigma[3] * n_z, sigma[3] * n_r + sigma[1] * n_z], axis=1)
    backs = np.tile(np.stack([0.3 * back, 0.7 * back]), (count, 1, 1))
    plastic = replace(PointState.virgin(count, 2), accumulated=np.full(count, 0.01), back=backs)
    nodes = np.arange(1, len(made.line.nodes), 2)  # middles, whose traction is their facet's
    found = fit.stress(nodes, np.tile(sigma[:, None], count), plastic, traction)
    n_r, n_z, normal, shear = line_traction(made, traction)[:, nodes]
    kept = to_line(n_r, n_z, found)
    assert kept[0] == pytest.approx(normal)
    assert kept[3] == pytest.approx(shear)
    shears = to_line(n_r, n_z, np.tile(sigma - back, (len(nodes), 1)))[3]
    bound = np.maximum(np.sqrt(3.0) * np.abs(shears), min(grown, 1.0) * radius)
    assert von_mises((found - back).T) == pytest.approx(bound)


def test_where_a_line_flowed() -> None:
    """Beside points that flowed, but not where the strain ends below the line; and where Hooke says too much."""
    made, evaluator = body("axle", 2)
    fit = SurfaceFit(PlasticBody(made, Hardening(yield_stress=300.0)))
    elastic = np.zeros((len(made.line.nodes), 4))
    elastic[7, 2] = 301.0
    accumulated = np.zeros(len(evaluator.places))
    assert np.flatnonzero(fit.flowed(accumulated, elastic)).tolist() == [7]
    depth = 95.0 - evaluator.places[:, 0]  # of the seat, beyond its taper
    seat = np.abs(made.line.nodes[:, 0] - 95.0) < 1e-9
    accumulated = np.maximum(0.0, 1e-3 * (4.0 - depth))
    assert fit.flowed(accumulated, elastic)[seat].all()
    accumulated = np.maximum(0.0, 1e-3 * depth)
    assert not fit.flowed(accumulated - accumulated.min(), elastic)[seat][3:-3].any()
    third = np.argsort(np.hypot(*(evaluator.places - made.line.nodes[9]).T))[2]
    alone = np.where(np.arange(len(accumulated)) == third, 1.0, 0.0)
    assert fit.at(np.array([9]), alone)[0] > 0.0
    assert not fit.flowed(alone, 0.0 * elastic)[9]


def test_a_history_has_what_the_points_remember_after_each_increment() -> None:
    """Of increments asked for in batches: what one changed stays until another changes it."""
    plastic = PlasticBody(body("axle", 1)[0], Hardening(yield_stress=300.0, moduli=(1e4,), recalls=(9.0,)))
    rng = np.random.default_rng(5)

    def change(points: list[int]) -> dict[str, FloatArray]:
        new = PointState.virgin(len(points), 1)
        return {"points": np.array(points)} | {name: rng.random(part.shape) for name, part in vars(new).items()}

    changes = [None, change([3, 5]), None, change([5, 8])]
    history = FlowHistory(plastic, changes)
    assert history.any == [False, True, True, True]
    (rest,), (first, second), (last,) = history.at([0]), history.at([1, 2]), history.at([3])
    assert first.strain is second.strain
    for name in vars(rest):
        assert not getattr(rest, name).any()
        assert np.array_equal(getattr(first, name)[[3, 5]], changes[1][name])  # type: ignore[index]
        assert np.array_equal(getattr(last, name)[[5, 8]], changes[3][name])  # type: ignore[index]
        assert np.array_equal(getattr(last, name)[3], getattr(first, name)[3])
        assert not getattr(first, name)[8].any()


def test_once_released_is_the_last_increment_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The largest stress left is that of a run that knows of no other increment, and less than under the press."""
    scene, alone = small_press("motion.release=true", "output.stress=true"), []

    def twice(scene: Scene, assembly: Assembly, states: list[State], increments: list[Increment]) -> Stresses:
        alone.append(evaluate_stresses(scene, assembly, states[-1:], increments[-1:]))
        return evaluate_stresses(scene, assembly, states, increments)

    monkeypatch.setattr("macrofit.solve.evaluate_stresses", twice)
    solution = solve(scene, MPI.COMM_SELF)
    assert set(solution.residual) == {"axle", "wheel"}
    for name, left in solution.residual.items():
        other = alone[0].extremes[name]
        assert (left.r_mm, left.z_mm, left.displacement_mm) == (other.r_mm, other.z_mm, other.displacement_mm)
        assert left.value == pytest.approx(other.value, rel=1e-12)
        assert left.value < solution.max_von_mises[name].value
