"""The ripple of the force on a rough field under short steps comes from the field, not from the mesh."""

from __future__ import annotations

import numpy as np
import pytest
from found import Found
from rippled import ENTRY

from macrofit.friction import registry
from macrofit.scene import build_scene
from macrofit.solution import Solution
from macrofit.solve import solve

START, STEPS, HUB = 42.0, 30, 30.0
BORE_FACETS = (1.3, 0.65, 0.4)


def pressed(provider: str, bore_facet: float = BORE_FACETS[0]) -> Solution:
    """A ring on a cylinder: steps of 0.1 mm after a long way."""
    tables = {
        "axle": {"seat_radius": 50.0, "seat_length": 60.0},
        "wheel": {"bore_radius": 49.99, "hub_length": HUB, "hub_outer_radius": 80.0},
        "mesh": {"seat_facet": 1.0, "bore_facet": bore_facet},
        "motion": {"displacements": (35.0, 38.0, START, *(START + 0.1 * k for k in range(1, STEPS + 1)))},
        "friction": {"provider": provider},
        "output": {"stress": False, "fields_at": []},
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(registry.BUILT_IN, "rippled", ENTRY)
        return solve(build_scene(tables))


@pytest.fixture(scope="module")
def rough() -> Solution:
    return pressed("rippled")


def force(solution: Solution) -> np.ndarray:
    """Friction force under the steps of 0.1 mm [N]."""
    return np.array([record.friction_force for record in solution.increments[-STEPS:]])


def test_a_finer_bore_changes_nothing(rough: Solution) -> None:
    coarse = force(rough)
    line = np.polyval(np.polyfit(np.arange(STEPS), coarse, 1), np.arange(STEPS))
    amplitude = np.abs(coarse / line - 1.0).max()
    change = max(np.abs(force(pressed("rippled", facet)) / coarse - 1.0).max() for facet in BORE_FACETS[1:])
    print(f"ripple {amplitude:.2%} of the force; a finer bore changes it by {change:.1e}")
    assert amplitude > 5e-3  # there is one
    assert change < 1e-3


def test_the_field_explains_it(rough: Solution, found: Found) -> None:
    """The rough field under the pressure of a run with a uniform coefficient: integral of mu p over what is covered."""
    even = pressed("uniform")
    told = []
    for smooth, record in zip(even.increments[-STEPS:], rough.increments[-STEPS:], strict=True):
        nose = record.displacement
        covered = np.clip(np.minimum(even.seat[1:], nose) - np.maximum(even.seat[:-1], nose - HUB), 0.0, None)
        load = covered * smooth.facets.pressure
        told.append(smooth.friction_force * (load @ record.facets.friction) / (load @ smooth.facets.friction))
    off = np.abs(np.array(told) / force(rough) - 1.0).max()
    print(f"the field alone tells the force within {off:.1e}")
    assert found("rough field: force against the field alone", off, 1e-3)
