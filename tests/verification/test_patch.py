"""Patch tests: what the discrete spaces hold exactly must come out exactly, through meshes that do not match.

Tolerances are multiples of rounding: 1e-12 for displacements and 1e-8 for pressures are the bars of the project; the
solver leaves 1e-14 and 1e-12.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.sparse.linalg as spla
from found import Found

from macrofit.base.arrays import FloatArray, IntArray
from macrofit.bodies.body import Body
from macrofit.contact.interface import couple_lines
from macrofit.contact.seat import Seat
from macrofit.scene import Disc, Scene, load_scene
from macrofit.scene.material import Material
from macrofit.solve import solve

VARIANTS = [("nitsche", -1), ("nitsche", 0), ("nitsche", 1), ("penalty", 0)]
NO_STRESS = ("output.stress=false", "output.fields_at=[]")


def boundary_nodes(body: Body) -> IntArray:
    """Nodes of the edges that belong to one cell only."""
    space = body.space
    sides = np.array([[1, 2, 3], [2, 0, 4], [0, 1, 5]])[:, : space.order + 1]
    edges = space.cells[:, sides].reshape(-1, space.order + 1)
    _, index, count = np.unique(np.sort(edges[:, :2], axis=1), axis=0, return_index=True, return_counts=True)
    return np.unique(edges[index[count == 1]])


def volume(body: Body) -> float:
    """Volume [mm3] of the body's triangles turned around the axis: 2 pi r_c A each (Pappus)."""
    corners = body.space.nodes[body.space.cells[:, :3]]
    (x1, y1), (x2, y2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return float((math.pi * corners[:, :, 0].mean(axis=1)) @ np.abs(x1 * y2 - x2 * y1))


def linear_field(body: Body, a: float, b: float) -> FloatArray:
    """Displacements u_r = a r, u_z = b z (dofs,) [mm]."""
    return np.asarray((body.space.nodes * (a, b)).ravel())


@pytest.mark.parametrize("which", ["axle", "wheel"])
@pytest.mark.parametrize("order", [1, 2])
def test_bulk_reproduces_a_homogeneous_strain(order: int, which: str, found: Found) -> None:
    """u_r = a r, u_z = b z on the whole boundary: the same inside, with the energy of that strain in the volume."""
    a, b = 2e-3, -3e-3
    overrides = (f"mesh.order={order}", "mesh.seat_facet=5", "wheel.chamfer_blend=0", "axle.taper_blend=0")
    body = Body(load_scene("wheelset", overrides), which)
    exact = linear_field(body, a, b)
    inside = np.setdiff1d(np.arange(len(body.space.nodes)), boundary_nodes(body))
    free = np.concatenate([2 * inside, 2 * inside + 1])
    u = np.where(np.isin(np.arange(body.dofs), free), 0.0, exact)
    stiffness = body.space.stiffness
    u[free] = spla.spsolve(stiffness[free][:, free].tocsc(), -(stiffness[free] @ u))
    assert found("patch test of the bulk: displacement", np.abs(u - exact).max() / np.abs(exact).max(), 1e-12)

    lam, mu = body.material.lame_lambda, body.material.shear_modulus
    density = 0.5 * lam * (2.0 * a + b) ** 2 + mu * (2.0 * a**2 + b**2)
    energy = 0.5 * u @ (stiffness @ u)
    assert found("patch test of the bulk: energy", abs(energy / (density * volume(body)) - 1.0), 1e-12)


def compressed_discs(overrides: tuple[str, ...]) -> tuple[Scene, float, float]:
    """The built-in discs, their pressure p = E U / (t_axle + t_wheel) [MPa], and the displacement U [mm]."""
    scene = load_scene("contact-patch", overrides)
    assert isinstance(scene.axle, Disc)
    assert isinstance(scene.wheel, Disc)
    travel = scene.displacements[-1]
    pressure = scene.axle.material.youngs_modulus * travel / (scene.axle.thickness + scene.wheel.thickness)
    return scene, pressure, travel


@pytest.mark.parametrize("facets", [(2.0, 1.37), (2.0, 0.2), (0.5, 5.0)], ids=["near", "1:10", "10:1"])
@pytest.mark.parametrize("friction", [0.0, 0.11])
@pytest.mark.parametrize("theta", [-1, 0, 1])
@pytest.mark.parametrize("order", [1, 2])
def test_discs_in_uniaxial_compression(
    order: int, theta: int, friction: float, facets: tuple[float, float], found: Found
) -> None:
    """sigma_z = -p and u_r = nu p r / E in both discs, whatever the meshes; friction has nothing to hold."""
    seat, bore = facets
    scene, pressure, travel = compressed_discs((
        f"mesh.order={order}", f"contact.theta={theta}", f"friction.options.coefficient={friction}",
        f"mesh.seat_facet={seat}", f"mesh.bore_facet={bore}", "contact.gamma0=30", "output.stress=false",
    ))  # fmt: skip
    solution = solve(scene)
    strain, nu = -pressure / scene.axle.material.youngs_modulus, scene.axle.material.poisson_ratio
    for body in solution.fields[travel].values():
        r, z = body.points.T
        held = z[np.argmax(np.abs(z))]  # the far face of either disc does not move in its own frame
        exact = np.stack([-nu * strain * r, strain * (z - held)], axis=1)
        error = np.abs(body.displacement - exact).max() / travel
        assert found("patch test of the contact: displacement", error, 1e-12)
    last = solution.increments[-1]
    error = np.abs(last.facets.pressure / pressure - 1.0).max()
    assert found("patch test of the contact: pressure of each facet", error, 1e-8)
    error = np.abs(last.facets.traction).max() / pressure
    assert found("patch test of the contact: shear, over the pressure", error, 1e-8)
    error = abs(last.force / (pressure * math.pi * scene.axle.radius**2) - 1.0)
    assert found("patch test of the contact: force", error, 1e-12)


def test_penalty_fails_the_patch() -> None:
    """The bodies pass through each other by p / k: the patch test is not one that anything passes.

    Series of springs: p = U / (t / E + 1 / k). Measured at the default k = 10 E per mm: 0.5 % too little.
    """
    scene, pressure, _ = compressed_discs(("contact.formulation=penalty", *NO_STRESS))
    reached = solve(scene).increments[-1].facets.pressure
    thickness = scene.axle.thickness + scene.wheel.thickness  # type: ignore[union-attr]
    np.testing.assert_allclose(reached, pressure / (1.0 + 0.1 / thickness), rtol=1e-8)


SEAT_CONE = ("axle.taper_length=40", "axle.taper_height=8", "axle.taper_blend=0", "axle.lead_length=0")
BORE_CONE = (
    "wheel.chamfer_length=40", "wheel.chamfer_height=8", "wheel.chamfer_blend=0",
    "wheel.bore_radius=87", "axle.seat_radius=87",
)  # fmt: skip


def cone_traction(material: Material, a: float, b: float) -> FloatArray:
    """Normal and tangential traction (2,) [MPa] on the cone in the strain (a, b, a) of (r, z, hoop)."""
    common = material.lame_lambda * (2.0 * a + b)
    sigma_r, sigma_z = common + 2.0 * material.shear_modulus * a, common + 2.0 * material.shear_modulus * b
    n_r, n_z = 40.0 / math.hypot(40.0, 8.0), -8.0 / math.hypot(40.0, 8.0)
    return np.array([sigma_r * n_r**2 + sigma_z * n_z**2, (sigma_z - sigma_r) * n_r * n_z])


@pytest.mark.parametrize("facets", [(2.0, 0.2), (2.0, 3.3)], ids=["1:10", "incommensurate"])
@pytest.mark.parametrize(("formulation", "theta"), VARIANTS)
@pytest.mark.parametrize("order", [1, 2])
def test_cone_in_a_homogeneous_stress(
    order: int, formulation: str, theta: int, facets: tuple[float, float], found: Found
) -> None:
    """A uniform traction on a sloping interface balances homogeneous bodies, node by node.

    Seat and bore are the same cone, of normal (cos t, -sin t) with tan t = 8/40. With u = (a r, b z) in both bodies
    the jump vanishes, the bulk traction is normal and tangential, the same in every moment, and K u equals the nodal
    loads of the moments at every node of the contact line that has no other boundary. Rounding of K u is measured by
    the loads.
    """
    (a, b), (seat_facet, bore_facet) = (-3e-4, 2e-4), facets
    numerics = (
        f"mesh.order={order}", f"mesh.seat_facet={seat_facet}", f"mesh.bore_facet={bore_facet}",
        f"contact.formulation={formulation}", f"contact.theta={theta}",
    )  # fmt: skip
    scene = load_scene("wheelset", (*SEAT_CONE, *numerics))
    axle, wheel = Body(scene, "axle"), Body(load_scene("wheelset", (*BORE_CONE, *numerics)), "wheel")
    seat = Seat(axle.line, scene.contact)
    axle.stabilisation = seat.stabilisation
    pairing = couple_lines(seat.line, wheel.line, 0.0)
    assert pairing is not None
    covered = seat.cover(pairing.portions)

    traction = cone_traction(axle.material, a, b)[:, None] * np.ones(len(covered.weight))
    u_axle, u_wheel = linear_field(axle, a, b), linear_field(wheel, a, b)
    u_seat, u_bore = u_axle[axle.trace_dofs], u_wheel[wheel.trace_dofs]
    loaded = u_seat.reshape(2, -1)[:, : seat.loaded].ravel()
    jump = covered.seat_moments(loaded) - pairing.bore_moments(u_bore)
    np.testing.assert_allclose(jump, 0.0, atol=1e-12 * np.abs(u_seat).max())
    np.testing.assert_allclose(pairing.gap, 0.0, atol=1e-12 * 95.0)
    if formulation == "nitsche":
        bulk = (seat.rows(pairing.portions).traction @ u_seat).reshape(2, -1)
        np.testing.assert_allclose(bulk, traction, atol=1e-10 * np.abs(traction).max())

    forces = covered.weight * traction
    loads = {"axle": covered.loads(forces), "wheel": -pairing.bore_loads(forces)}
    for body, displacement in ((axle, u_axle), (wheel, u_wheel)):
        line = body.line.nodes
        inner = np.flatnonzero((line[:, 1] > -39.9) & (line[:, 1] < -0.1))
        if theta:  # the stabilisation reaches into facets that are not covered: leave out those beside them
            inner = inner[line[inner, 1] < -2.0 * seat_facet]
        applied = loads[body.which].reshape(2, -1)[:, inner]
        resisted = (body.stiffness @ displacement)[body.trace_dofs].reshape(2, -1)[:, inner]
        error = np.abs(resisted - applied).max() / np.abs(applied).max()
        assert found("patch test on a cone: forces on the nodes", error, 1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_sliding_without_interference_costs_nothing(order: int, found: Found) -> None:
    """180 mm over a seat as wide as the bore: no force but the rounding of the gap (1e-14 mm against 0.3 mm)."""
    scene = load_scene("wheelset", (
        "wheel.bore_radius=95", "wheel.chamfer_length=0", "wheel.chamfer_height=0", "wheel.chamfer_blend=0",
        "axle.taper_blend=0", f"mesh.order={order}", "mesh.seat_facet=5", "motion.increment=12.5", *NO_STRESS,
    ))  # fmt: skip
    solution = solve(scene)
    force = np.abs(solution.force).max()
    assert found("slide without interference: force [N], of 2.7e6 with it", force, 1e-5)
    assert max(record.max_pressure for record in solution.increments) < 1e-9
