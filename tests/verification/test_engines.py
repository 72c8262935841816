"""The condensed engine against the monolithic one, and both against invariances."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from found import Found
from small import condensed_press, small_press, solved

from macrofit.bodies.geometry import Drawing
from macrofit.bodies.mesh import MeshData, mesh_drawing
from macrofit.contact import newton
from macrofit.scene import build_scene
from macrofit.solution import Solution
from macrofit.solve import solve

CASES = {
    "theta0": (),
    "theta1": ("contact.theta=1",),
    "theta-1": ("contact.theta=-1",),
    "penalty": ("contact.formulation=penalty",),
    "p1": ("mesh.order=1",),
    "frictionless": ("friction.options.coefficient=0.0",),
    "sticky": ("friction.options.coefficient=0.6",),
    "reversal": (
        "motion.start=0",
        "motion.travel=0",
        "motion.increment=1",
        "motion.displacements=[40, 45, 44.99, 44.9, 44, 46]",
    ),
    "partly covered": ("motion.start=41.3", "motion.travel=47.9", "motion.increment=0.7"),
    "partly covered under pressure": (
        "motion.travel=40",
        "motion.increment=3.3",
        "wheel.chamfer_length=0",
        "wheel.chamfer_height=0",
        "wheel.chamfer_blend=0",
    ),
}


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES.keys())
def overrides(request: pytest.FixtureRequest) -> tuple[str, ...]:
    return request.param


@pytest.fixture(scope="module")
def exact(overrides: tuple[str, ...]) -> Solution:
    """Newton's method goes on to rounding."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(newton, "TOLERANCE", 1e-15)
        return solve(small_press(*overrides))


def test_condensed_equals_monolithic(
    overrides: tuple[str, ...], exact: Solution, found: Found, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Same segments, same equations, solved to rounding: forces to 1e-12 of the normal force, same Newton counts.

    The tolerance is the rounding of gamma * displacement (1e-14 of the pressure) times the number of moments. The
    counts are those of the same Newton steps; reusing the interface's factors while only kappa changes, as the
    condensed engine does by default, takes a few cheap corrections more.
    """
    monkeypatch.setattr(newton, "TOLERANCE", 1e-15)
    condensed = exact
    monolithic = solve(small_press('solver="monolithic"', *overrides))
    scale = max(record.normal_force for record in condensed.increments)
    assert scale > 0.0
    difference = np.abs(condensed.force - monolithic.force).max() / scale
    assert found("condensed against monolithic: force", difference, 1e-12)
    press, _ = condensed_press(small_press(*overrides), reuse=False)
    counts = [record.newton_iterations for record, _ in press.increments(press.rest())]
    assert counts == [record.newton_iterations for record in monolithic.increments]
    for a, b in zip(condensed.increments, monolithic.increments, strict=True):
        assert (a.facets.status == b.facets.status).all()
        assert np.abs(a.facets.pressure - b.facets.pressure).max() <= 1e-10 * a.max_pressure


def test_newton_ends_within_its_tolerance(overrides: tuple[str, ...], exact: Solution, found: Found) -> None:
    """What Newton's method says is left of the error is not less than what is: forces and pressures to 1e-10."""
    ended = solved(small_press(*overrides))
    assert ended.counters["newton_iterations"] < exact.counters["newton_iterations"]
    scale = max(record.normal_force for record in exact.increments)
    assert found("Newton's last error: force", np.abs(ended.force - exact.force).max() / scale, 1e-10)
    for a, b in zip(ended.increments, exact.increments, strict=True):
        assert np.abs(a.facets.pressure - b.facets.pressure).max() <= 1e-10 * b.max_pressure


def test_units(monkeypatch: pytest.MonkeyPatch) -> None:
    """mm-N-MPa and m-N-Pa give the same forces: no length or modulus hides in the code.

    Both use the triangulation drawn in mm (gmsh's own depends on the scale); what is left is rounding, 1e-11.
    """
    drawn: dict[str, MeshData] = {}

    def in_millimetres(drawing: Drawing, coarse: float, growth: float) -> MeshData:
        drawn[drawing.contact] = mesh_drawing(drawing, coarse, growth)
        return drawn[drawing.contact]

    def in_metres(drawing: Drawing, coarse: float, growth: float) -> MeshData:
        return replace(drawn[drawing.contact], points=1e-3 * drawn[drawing.contact].points)

    scene = small_press()
    tables = msgspec.to_builtins(scene)
    for body in ("axle", "wheel"):
        for key, value in tables[body].items():
            if isinstance(value, float):
                tables[body][key] = value * 1e-3
        tables[body]["material"]["youngs_modulus"] *= 1e6
    for key in ("seat_facet", "bore_facet", "coarse"):
        tables["mesh"][key] *= 1e-3
    for key in ("start", "travel", "increment"):
        tables["motion"][key] *= 1e-3
    monkeypatch.setattr("macrofit.bodies.body.mesh_drawing", in_millimetres)
    millimetres = solve(scene)
    monkeypatch.setattr("macrofit.bodies.body.mesh_drawing", in_metres)
    metres = solve(build_scene(tables))
    rounding = 1e-15 * float(millimetres.force.max())  # in place no force is left
    assert metres.force == pytest.approx(millimetres.force, rel=1e-11, abs=rounding)


def test_balances(found: Found) -> None:
    """The supports' reactions, from the full displacement field, carry the pushing force."""
    solution = solve(small_press(fields=True))
    assert solution.force_balance is not None
    assert found("supports' reactions against the pushing force", solution.force_balance, 1e-12)


@pytest.mark.parametrize("theta", [0, 1, -1])
def test_strain_energy(theta: int) -> None:
    """The energy from the interface loads is 1/2 u' K u of the bodies' full displacement."""
    press, bodies = condensed_press(small_press(f"contact.theta={theta}"))
    record, state = list(press.increments(press.rest()))[-1]
    energy = 0.0
    for name, load in (("axle", state.seat_load), ("wheel", state.bore_load)):
        u = bodies[name].back_substitute(load[:, None])[:, 0]
        energy += 0.5 * float(u @ (bodies[name].space.stiffness @ u))
    assert record.strain_energy == pytest.approx(energy, rel=1e-11)
