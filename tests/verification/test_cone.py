"""Conical seats and bores: the closed form of a wedge, F / N = sin a + mu cos a."""

from __future__ import annotations

import math

import numpy as np
import pytest

from macrofit.bodies.geometry import Sizes, draw_body
from macrofit.errors import SceneError
from macrofit.scene import Scene, build_scene
from macrofit.scene.keys import Hub
from macrofit.solve import solve


def cone(taper: float, friction: float, depth: float = 0.025, start: float = 0.0, **wheel: float) -> Scene:
    """A conical bore of 40 mm that touches its seat all along at 60 mm, pressed until it is ``depth`` mm too narrow.

    ``start`` is the share of the way that it is shrunk on at.
    """
    half = 0.5 * taper
    return build_scene(
        {
            "axle": {"seat_radius": 50.0, "seat_length": 90.0, "taper": taper, "tail_length": 20.0},
            "wheel": {
                "bore_radius": 50.0 + half * 60.0,
                "hub_length": 40.0,
                "hub_outer_radius": 90.0 + half * 60.0,
                "bore_taper": taper,
                **wheel,
            },
            "mesh": {"seat_facet": 2.0, "coarse": 10.0},
            "motion": {"displacements": [60.0 + depth / half * k / 5 for k in range(6) if k / 5 >= start]},
            "friction": {"options": {"coefficient": friction}},
            "output": {"stress": False, "fields_at": []},
        }
    )


@pytest.mark.parametrize(("taper", "friction"), [(0.02, 0.12), (0.1, 0.0), (0.1, 0.12), (0.4, 0.2)])
def test_the_force_of_a_cone(taper: float, friction: float) -> None:
    """Everything slides: F / N within the slopes that the interference itself makes, 0.025 mm over 40 mm: 5e-4."""
    last = solve(cone(taper, friction)).increments[-1]
    angle = math.atan(0.5 * taper)
    wanted = math.sin(angle) + friction * math.cos(angle)
    assert last.force / last.normal_force == pytest.approx(wanted, abs=5e-4)
    assert last.force > 0.0


def test_the_interference_of_equal_cones_is_that_of_the_end() -> None:
    assert cone(0.1, 0.1).interference == pytest.approx(0.025)


def test_a_high_cone_is_judged_by_its_gap() -> None:
    """Radii of 50 and 54.5 mm along one cone are no interference of 4.5 mm; 1.5 mm of real one is refused."""
    scene = cone(0.15, 0.1)
    assert scene.axle.seat_radius + 0.075 * 90.0 - 54.5 > 2.0  # type: ignore[union-attr]
    with pytest.raises(SceneError, match=r"interference of 1\.5 mm, beyond small strain"):
        cone(0.15, 0.1, depth=1.5)


def test_a_conical_bore_closes_before_its_rear() -> None:
    with pytest.raises(SceneError, match=r"^wheel\.bore_taper: .*closes the bore"):
        cone(0.1, 0.1, bore_taper=1.0, bore_radius=19.0)


def test_the_rear_edge_of_a_cone_is_tangent() -> None:
    """Height and slope are continuous at the ends of the arcs, and the outline closes."""
    wheel = cone(0.2, 0.1, rear_edge_blend=3.0, chamfer_length=5.0, chamfer_height=1.0, chamfer_blend=20.0).wheel
    assert isinstance(wheel, Hub)
    drawing = draw_body(wheel, "bore", Sizes(1.0, 1.0, 0.35))
    line = drawing.generatrix
    for s in line.breaks[1:-1]:
        sides = np.array([s - 1e-9, s + 1e-9])
        assert np.ptp(line.height(sides)) < 1e-8
        assert np.ptp(line.slope(sides)) < 1e-8
    starts, ends = (np.array([getattr(edge, name) for edge in drawing.edges]) for name in ("start", "end"))
    assert np.allclose(starts[1:], ends[:-1])
    assert np.allclose(starts[0], ends[-1])
