"""Fourier elements against closed forms: beams, torsion, rings, rigid motions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI
from revolved import grid, places, revolved, stress_at
from small import small_press

from macrofit.assembly import discretise_bodies
from macrofit.bodies.discretisation import Discretisation
from macrofit.bodies.elasticity import weak_form
from macrofit.bodies.fenics import discretise
from macrofit.scene.material import Material
from macrofit.service.elements import assemble_harmonic, assemble_harmonics, quadrature_points
from macrofit.service.loads import Section, front_face
from macrofit.service.wheelset import wheelset

STEEL = Material(youngs_modulus=206e3, poisson_ratio=0.3)


def column(loads: np.ndarray) -> np.ndarray:
    return loads.astype(np.complex128).reshape(-1, 1)


@pytest.mark.parametrize(("inner", "stress"), [(0.0, 148.504394), (30.0, 149.996056)])
def test_bending_of_a_shaft_is_exact(inner: float, stress: float) -> None:
    # quadratic displacements are in the space of P2; 32 M d / (pi (d^4 - d'^4)), as in EN 13103-1
    body = revolved(grid(inner, 95.0, 200.0, 3, 4), STEEL)
    face = front_face(body.space)
    assert face.section.bending_stress(1e8) == pytest.approx(stress, rel=1e-7)
    found = body.solve(1, column(face.loads(body.space, 0.0, 1e8, 0.3)))
    points, _ = quadrature_points()
    axial = -2.0 * stress_at(body, 1, found, points)[..., 1]
    expected = 1e8 * places(body, points)[..., 0] / face.section.second_moment
    assert np.abs(axial - expected).max() < 1e-7 * stress


def test_cylinder_under_a_traction_that_turns_once() -> None:
    # SSLV109 of code_aster: E = 72, nu = 0.3, R = 1, l = 12, p = r cos t: u_r = -1 on the axis, u_z = 1/6 at the rim
    body = revolved(grid(0.0, 1.0, 12.0, 3, 6), Material(youngs_modulus=72.0, poisson_ratio=0.3))
    face = front_face(body.space)
    loads = 2.0 * face.loads(body.space, 0.0, face.section.second_moment, 0.3)
    found = body.solve(1, column(loads)).real.reshape(-1, 3)
    r, z = body.space.nodes.T
    axis, held, rim = (int(np.argmin(np.hypot(r - a, z - b))) for a, b in ((0, 0), (0, 12), (1, 0)))
    assert found[held, 0] - found[axis, 0] == pytest.approx(-1.0, abs=1e-10)
    assert found[rim, 2] == pytest.approx(1.0 / 6.0, abs=1e-10)


@pytest.mark.parametrize("inner", [0.0, 30.0])
def test_flexure_converges_with_order_two(inner: float) -> None:
    force, length, errors = 1e5, 200.0, []
    points, weights = quadrature_points()
    for cells in (4, 8, 16):
        body = revolved(grid(inner, 95.0, length, cells, 2 * cells), STEEL, floats=True)
        near, far = front_face(body.space), front_face(body.space, last=True)
        loads = near.loads(body.space, force, 0.0, 0.3) - far.loads(body.space, force, force * length, 0.3)
        assert np.abs(body.rigid_motions(1).T @ loads.ravel()).max() < 1e-9 * force * length
        found = 2.0 * stress_at(body, 1, body.solve(1, column(loads)), points)
        r, z = np.moveaxis(places(body, points), 2, 0)
        exact = np.zeros_like(found)
        exact[..., 1] = -force * z * r / near.section.second_moment
        exact[..., 3], exact[..., 5] = (-part for part in near.section.shear(force, 0.3, r))
        weight = (weights * r)[..., None]
        errors.append(math.sqrt((weight * (found - exact) ** 2).sum() / (weight * exact**2).sum()))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 6e-4
    assert rates == pytest.approx([2.0, 2.0], abs=0.12)


def test_shear_of_a_section_carries_its_force() -> None:
    # integral of (tau_rz cos^2 - tau_tz sin^2) r dr dt = V, and no traction on either surface
    section = Section(outer=95.0, inner=30.0)
    x, weight = np.polynomial.legendre.leggauss(8)
    r = 62.5 + 32.5 * x
    radial, around = section.shear(1e5, 0.3, r)
    assert math.pi * 32.5 * weight @ ((radial - around) * r) == pytest.approx(1e5, rel=1e-9)
    surface, _ = section.shear(1e5, 0.3, np.array([30.0, 95.0]))
    assert np.abs(surface).max() < 1e-12 * np.abs(radial).max()


def test_torsion_is_exact() -> None:
    body = revolved(grid(0.0, 95.0, 200.0, 3, 4), STEEL)
    face = front_face(body.space)
    loads = np.zeros((len(body.space.nodes), 3))
    loads[:, 1] = face.loads(body.space, 0.0, 1e8, 0.3)[:, 2]  # M r / (2 I) over the face is T r / I_p with T = M
    points, _ = quadrature_points()
    found = stress_at(body, 0, body.solve(0, column(loads)), points)
    expected = 0.5 * 1e8 * places(body, points)[..., 0] / face.section.second_moment
    assert np.abs(np.abs(found[..., 5]) - expected).max() < 1e-7 * expected.max()
    assert np.abs(found[..., :5]).max() < 1e-7 * expected.max()


@pytest.mark.parametrize("n", [0, 1])
def test_rigid_motions_strain_nothing(n: int) -> None:
    body = revolved(grid(30.0, 95.0, 200.0, 2, 3), STEEL, floats=True)
    motions, stiffness = body.rigid_motions(n), body.stiffness.at(n)
    assert motions.shape[1] == 2
    assert np.abs(stiffness @ motions).max() < 1e-11 * np.abs(stiffness).max() * np.abs(motions).max()


def test_ring_under_a_pressure_that_turns_twice() -> None:
    # Michell's stress function (A r^2 + B r^4 + C / r^2 + D) cos 2 t: sigma_r = -p cos 2 t outside, a free bore
    a, b, p = 60.0, 100.0, 50.0
    rows = [[-2, 0, -6 / s**4, -4 / s**2] for s in (a, b)] + [[2, 6 * s**2, -6 / s**4, -2 / s**2] for s in (a, b)]
    A, B, C, _ = np.linalg.solve(np.array(rows), [0.0, -p, 0.0, 0.0])
    body = revolved(grid(a, b, 20.0, 8, 4, both_held=True), STEEL)
    loads = np.zeros((len(body.space.nodes), 3))
    for start, middle, end in body.space.edge_nodes("seat"):
        share = -p * 2.0 * math.pi * b * abs(np.diff(body.space.nodes[[start, end], 1])[0]) / 6.0
        loads[[start, middle, end], 0] += share * np.array([1.0, 4.0, 1.0])
    points, _ = quadrature_points()
    found = stress_at(body, 2, body.solve(2, column(loads)), points)[..., 2]
    r = places(body, points)[..., 0]
    expected = 2.0 * A + 12.0 * B * r**2 + 6.0 * C / r**4
    assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()


def test_harmonic_zero_is_the_axisymmetric_body() -> None:
    space = grid(30.0, 95.0, 100.0, 3, 4)
    elastic = with_moduli(space)
    zero = assemble_harmonics(space, STEEL).at(0).toarray().reshape(len(space.nodes), 3, len(space.nodes), 3)
    plane = zero[:, ::2][:, :, :, ::2].reshape(2 * len(space.nodes), -1)
    assert np.abs(plane - elastic).max() < 1e-10 * np.abs(elastic).max()


def with_moduli(space: Discretisation) -> np.ndarray:
    """The stiffness that dolfinx assembles for the same cells, in the numbers of ``space``."""
    from macrofit.bodies.mesh import MeshData

    vertices = np.unique(space.cells[:, :3])
    number = np.searchsorted(vertices, space.cells[:, :3])
    data = MeshData(points=space.nodes[vertices], triangles=number.astype(np.int64), edges={})
    again = discretise(data, 2, weak_form, (STEEL.lame_lambda, STEEL.shear_modulus))
    near = ((again.nodes[None] - space.nodes[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    order = (2 * near[:, None] + np.arange(2)).ravel()
    return np.asarray(again.stiffness.toarray()[order][:, order])


def test_condensed_lines_are_those_of_the_press() -> None:
    scene = small_press()
    bodies = discretise_bodies(scene, MPI.COMM_SELF)
    fit = wheelset(scene, bodies).fit
    lines = len(bodies["axle"].line.nodes)
    kept = bodies["axle"].condense(load_trace=False).compliance.reshape(2, -1, 2, lines)[:, :lines]
    mine = fit.axle.compliance(0).reshape(lines, 3, lines, 3)[:, ::2][:, :, :, ::2].transpose(1, 0, 3, 2)
    assert np.abs(mine - kept).max() < 1e-9 * np.abs(kept).max()


def test_torsion_without_neighbours_leaves_the_factor_as_lean_as_others() -> None:
    # for n = 0 the amplitude around the axle stands alone; supernodes of whole nodes are ten times faster than without
    body = revolved(grid(0.0, 95.0, 200.0, 6, 8), STEEL)
    zero, one = (body.factor_of(n).supernodes[0] for n in (0, 1))
    assert not (zero % 3).any()
    assert len(zero) < 1.2 * len(one)


@pytest.mark.parametrize("n", [0, 1, 3])
def test_a_harmonic_alone_is_that_of_the_three_matrices(n: int) -> None:
    space = grid(0.0, 95.0, 200.0, 3, 4)
    alone, of_all = assemble_harmonic(space, STEEL, n), assemble_harmonics(space, STEEL).at(n)
    assert np.abs(alone - of_all).max() < 1e-13 * np.abs(of_all).max()
