"""Runs that were never computed: records made of numbers, for what reads them (files, figures, reports)."""

from __future__ import annotations

import numpy as np

from macrofit.scene import Scene, build_scene
from macrofit.solution import BodyField, Extreme, FacetState, Increment, Solution

SEAT_RADIUS = 95.0
BODIES = {
    "axle": {"seat_radius": SEAT_RADIUS, "seat_length": 20.0, "taper_length": 5.0, "taper_height": 0.5},
    "wheel": {"bore_radius": 94.85, "hub_length": 20.0, "hub_outer_radius": 140.0},
}


def fake_scene(**motion: object) -> Scene:
    """A short press fit, 0 to 18 mm in steps of 2 mm."""
    return build_scene(BODIES | {"title": "A short fit", "motion": motion or {"travel": 18.0, "increment": 2.0}})


def fake_increment(index: int, displacement: float, force: float, facets: int = 25) -> Increment:
    """An increment whose numbers have no short decimal form, so that a lost bit shows."""
    rng = np.random.default_rng(index)
    names = ("pressure", "traction", "gap", "slip", "accumulated_slip")
    columns = {name: rng.random(facets) / 3.0 for name in names}
    status = rng.integers(0, 3, facets)
    state = FacetState(**columns, status=status, friction=np.full(facets, 0.11))
    return Increment(
        index=index, displacement=displacement, force=force, normal_force=force / 0.11,
        friction_force=force * 0.99, mean_friction=0.11,
        max_pressure=float(columns["pressure"].max()), active_facets=int((status > 0).sum()), sticking_facets=2,
        newton_iterations=3, cutbacks=0, residual=1e-13, converged=True, strain_energy=1.0 / 3.0,
        dissipation=2.0 / 7.0, wall_s=0.004, facets=state,
    )  # fmt: skip


def fake_field(shift: float = 0.0, quadratic: bool = True) -> BodyField:
    """Two triangles of a square with the node opposite to each vertex after the vertices."""
    points = [[90.0, 0.0], [94.0, 0.0], [94.0, 4.0], [90.0, 4.0]]
    points += [[94.0, 2.0], [92.0, 2.0], [92.0, 0.0], [92.0, 4.0], [90.0, 2.0]]
    cells = [[0, 1, 2, 4, 5, 6], [0, 2, 3, 7, 8, 5]]
    nodes, columns = (9, 6) if quadratic else (4, 3)
    place = np.array(points)[:nodes]
    place[:, 1] += shift
    stress = np.arange(4.0 * nodes).reshape(nodes, 4)
    return BodyField(
        points=place,
        cells=np.array(cells)[:, :columns],
        displacement=np.full((nodes, 2), 0.01),
        stress=stress,
        von_mises=stress[:, 0] * 10.0,
    )


def fake_solution(scene: Scene | None = None, force: np.ndarray | None = None, facets: int = 25) -> Solution:
    """A run of ``scene`` with these forces [N], by default rising to 760 kN."""
    scene = fake_scene() if scene is None else scene
    places = scene.displacements
    if force is None:
        force = 7.6e5 * np.sqrt(np.linspace(0.0, 1.0, len(places)))
    records = [fake_increment(k, s, float(f), facets) for k, (s, f) in enumerate(zip(places, force, strict=True))]
    extremes = {
        "axle": Extreme(512.9, 93.5, 1.0, places[-1]),
        "wheel": Extreme(430.0, 95.0, 2.0, places[len(places) // 2]),
    }
    return Solution(
        scene=scene, seat=np.linspace(-5.0, 20.0, facets + 1), increments=tuple(records),
        max_von_mises=extremes,
        fields={places[-1]: {"axle": fake_field(), "wheel": fake_field(4.0)}}, force_balance=1e-14,
        energy_balance=2e-4, dofs=1234, setup_cpu_s=0.5, increments_cpu_s=1.0, stress_cpu_s=0.25,
        counters={"factorisations": 2},
    )  # fmt: skip
