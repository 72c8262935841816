"""Criteria of fatigue: their identities, and the smallest ball against all balls through few points."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from macrofit.scene.keys import ServiceKeys
from macrofit.scene.material import Material
from macrofit.service.fatigue.criteria import Limits, judge_histories, smallest_ball
from macrofit.service.fatigue.limits import limits_of

LIMITS = Limits(bending=240.0, torsion=150.0)
STEEL = Material(youngs_modulus=206e3, poisson_ratio=0.3)
TIMES = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


def history(**components: np.ndarray) -> np.ndarray:
    out = np.zeros((1, len(TIMES), 6))
    for name, values in components.items():
        out[0, :, ["nn", "mm", "tt", "nm", "nt", "mt"].index(name)] = values
    return out


def brute_force(points: np.ndarray) -> float:
    """The least radius of the balls around all points that have two or more of them on their surface."""
    best = np.inf
    for size in range(2, points.shape[1] + 2):
        for chosen in combinations(points, size):
            corners = np.array(chosen)
            edges = corners[1:] - corners[0]
            shares = np.linalg.lstsq(2.0 * edges @ edges.T, (edges**2).sum(axis=1), rcond=None)[0]
            centre = corners[0] + shares @ edges
            radius = np.linalg.norm(corners[0] - centre)
            if np.linalg.norm(points - centre, axis=1).max() <= radius * (1.0 + 1e-9):
                best = min(best, radius)
    return float(best)


@pytest.mark.parametrize("seed", range(12))
def test_smallest_ball_is_that_of_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(9, 2 + seed % 4)) * rng.uniform(0.1, 10.0, size=2 + seed % 4)
    centre, radius = smallest_ball(points)
    assert radius == pytest.approx(brute_force(points), rel=1e-6)
    assert np.linalg.norm(points - centre, axis=1).max() <= radius * (1.0 + 1e-12)


@pytest.mark.parametrize("points", [[[1.0, 2.0]], [[1.0, 2.0]] * 4, [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]]])
def test_smallest_ball_of_points_that_fall_together_or_lie_in_line(points: list[list[float]]) -> None:
    _, radius = smallest_ball(np.array(points))
    assert radius == pytest.approx(1.0 if len(points) == 3 else 0.0)


def test_reversed_bending_and_torsion_at_their_limits_are_one() -> None:
    for stress in (history(mm=240.0 * np.cos(TIMES)), history(nm=150.0 * np.cos(TIMES))):
        found = judge_histories(stress, LIMITS, STEEL)
        for share in (found.crossland, found.dang_van, found.findley):
            assert share[0] == pytest.approx(1.0, rel=1e-6)


def test_steady_shear_does_not_count_by_findley() -> None:
    # half the longest chord of the shear's path, wherever the path lies
    found = judge_histories(history(nm=400.0 + 150.0 * np.cos(TIMES)), LIMITS, STEEL)
    k = LIMITS.findley
    assert 1.0 <= found.findley[0] <= (150.0 * np.sqrt(1.0 + k * k) + k * 400.0) / (150.0 * np.sqrt(1.0 + k * k))
    sheared = judge_histories(history(nm=np.full_like(TIMES, 60.0)), LIMITS, STEEL)
    assert sheared.findley[0] == pytest.approx(k * 60.0 / (150.0 * np.sqrt(1.0 + k * k)), rel=1e-6)


def test_the_limit_in_torsion_is_a_part_of_that_in_bending_where_none_is_given() -> None:
    assert limits_of(ServiceKeys(bending_limit=250.0), Material()) == Limits(bending=250.0, torsion=150.0)


def test_limits_of_a_grade_stand_where_none_are_given() -> None:
    assert limits_of(ServiceKeys(), Material(grade="EA4T")) == Limits(bending=240.0, torsion=144.0)
    assert limits_of(ServiceKeys(bending_limit=220.0), Material(grade="EA4T")).bending == 220.0
    for material in (Material(), Material(grade="ER7")):  # a wheel's steel has no such limits
        assert limits_of(ServiceKeys(), material).bending == 200.0


def test_smith_watson_topper_of_reversed_bending() -> None:
    found = judge_histories(history(mm=240.0 * np.cos(TIMES)), LIMITS, STEEL)
    assert found.swt[0] == pytest.approx(240.0**2 / 206e3, rel=1e-9)
    pressed = judge_histories(history(mm=240.0 * np.cos(TIMES) - 300.0), LIMITS, STEEL)
    assert pressed.swt[0] < 1e-6


def test_shear_that_turns_in_its_plane_counts_as_its_radius() -> None:
    # tau_nm = t cos, tau_nt = t sin: the path of the deviator is a circle of radius t in sqrt(s : s / 2)
    found = judge_histories(history(nm=150.0 * np.cos(TIMES), nt=150.0 * np.sin(TIMES)), LIMITS, STEEL)
    assert found.crossland[0] == pytest.approx(1.0, rel=1e-9)
    assert found.dang_van[0] == pytest.approx(1.0, rel=1e-9)


def test_steady_stress_counts_by_its_hydrostatic_part_alone() -> None:
    still = np.full_like(TIMES, 60.0)
    found = judge_histories(history(nn=still, mm=still, tt=still), LIMITS, STEEL)
    assert found.crossland[0] == pytest.approx(LIMITS.crossland * 60.0 / 150.0)
    assert found.dang_van[0] == pytest.approx(LIMITS.dang_van * 60.0 / 150.0)
    sheared = judge_histories(history(nm=still), LIMITS, STEEL)
    assert sheared.crossland[0] == pytest.approx(0.0, abs=1e-12)
    assert sheared.dang_van[0] == pytest.approx(0.0, abs=1e-12)


def test_criteria_do_not_depend_on_the_frame() -> None:
    rng = np.random.default_rng(3)
    stress = rng.normal(scale=100.0, size=(1, 12, 6))
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    tensor = np.zeros((12, 3, 3))
    for k, (i, j) in enumerate(pairs):
        tensor[:, i, j] = tensor[:, j, i] = stress[0, :, k]
    other = turned @ tensor @ turned.T
    again = np.stack([other[:, i, j] for i, j in pairs], axis=1)[None]
    one, two = (judge_histories(each, LIMITS, STEEL) for each in (stress, again))
    assert one.crossland == pytest.approx(two.crossland, rel=1e-9)
    assert one.dang_van == pytest.approx(two.dang_van, rel=1e-9)
    assert one.findley == pytest.approx(two.findley, rel=1e-4)  # the planes that are searched differ
    assert one.swt == pytest.approx(two.swt, rel=1e-4)
