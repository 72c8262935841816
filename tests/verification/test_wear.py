"""Wear of the seat: closed forms of Archard's law, and what a worn wheelset keeps."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from macrofit.base.arrays import FloatArray
from macrofit.friction import TilePairs
from macrofit.friction.evolving import Evolving, FlatteningPairs
from macrofit.scene import load_scene
from macrofit.scene.deviation import read_profile
from macrofit.service.journal import Kept
from macrofit.service.residual import pressed_and_released
from macrofit.service.rotation import Moment, Revolution, Rotation
from macrofit.service.run import Course
from macrofit.service.wear import Smoothing, Worn, depth_of, jump, mean_pressure, wear_away, write_worn_profile

K = 1e-8
"""Coefficient of wear of steel on steel in fretting [1/MPa]."""
SMALL = (
    "mesh.seat_facet=6", "mesh.coarse=40", "motion.start=90", "motion.travel=180", "motion.increment=30",
    "wheel.bore_radius=94.85", "friction.options.coefficient=0.2", "service.steps=14", "service.revolutions=1",
)  # fmt: skip


def to_and_fro(pressure: FloatArray, slip: float) -> Revolution:
    """A revolution in which a place under a pressure (m,) slips there and back, at three angles alike."""
    moments = []
    for time, moved in enumerate((0.0, slip, 0.0)):
        traction, where = np.zeros((2, 3, 3, len(pressure)))
        traction[:, 0], where[:, 1] = -pressure, moved
        moments.append(Moment(time=0.5 * time, traction=traction, slip=where))
    return Revolution(moments=moments, friction_work=0.0, load_work=0.0, iterations=0)


def pressed_by_force(places: FloatArray, width: float, modulus: float) -> FloatArray:
    """S (m, m) of a flat punch on a half plane that a given force presses: its own approach takes the mean away."""
    away = places[:, None] - places
    half = 0.5 * (places[1] - places[0])
    integral = [(away + end) * (np.log(np.abs(away + end) / width) - 1.0) for end in (-half, half)]
    compliance = -2.0 / (np.pi * modulus) * (integral[1] - integral[0])
    S, one = np.linalg.inv(compliance), np.ones(len(places))
    return np.asarray(S - np.outer(S @ one, one @ S) / (one @ S @ one))


def test_uniform_pressure_wears_k_p_s() -> None:
    pressure, slip, count = np.full(20, 80.0), 0.01, 1e5
    found = to_and_fro(pressure, slip)
    assert mean_pressure(found) == pytest.approx(pressure)
    assert depth_of(found, K) == pytest.approx(2.0 * K * 80.0 * slip)
    places = np.linspace(-9.5, 9.5, 20)
    worn = jump(found, pressed_by_force(places, 20.0, 2e5), K, count)
    assert worn == pytest.approx(2.0 * K * 80.0 * slip * count, rel=1e-9)


@pytest.mark.parametrize("count", [1e4, 1e5, 1e7])
def test_flat_punch_tends_to_its_mean_pressure(count: float) -> None:
    # P / (pi sqrt(a^2 - x^2)) at first; then all wear alike, k P / A s, however long the jumps are
    places = np.linspace(-9.9, 9.9, 100)
    S = pressed_by_force(places, 20.0, 2e5)
    pressure = 80.0 * 2.0 / np.pi / np.sqrt(1.0 - (places / 10.0) ** 2)
    pressure *= 80.0 / pressure.mean()
    for _ in range(200):
        more = jump(to_and_fro(pressure, 0.01), S, K, count)
        pressure = pressure - S @ more
        assert pressure.mean() == pytest.approx(80.0, rel=1e-6)
        assert pressure.min() > 0.0
    if count * 200 > 1e7:
        assert pressure == pytest.approx(80.0, rel=0.01)
        assert more == pytest.approx(2.0 * K * 80.0 * 0.01 * count, rel=0.01)


def test_first_short_jumps_follow_the_rate_equation() -> None:
    # dp/dN = -S k s p, by the exponential of its matrix; the backward Euler rule is of order one
    places = np.linspace(-9.5, 9.5, 20)
    S, start = pressed_by_force(places, 20.0, 2e5), np.linspace(60.0, 100.0, 20)
    values, vectors = np.linalg.eig(S * 2.0 * K * 0.01)
    exact = (vectors @ (np.exp(-values * 1e5) * np.linalg.solve(vectors, start))).real
    errors = []
    for parts in (10, 20, 40):
        pressure = start
        for _ in range(parts):
            pressure = pressure - S @ jump(to_and_fro(pressure, 0.01), S, K, 1e5 / parts)
        errors.append(float(np.abs(pressure - exact).max()))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([1.0, 1.0], abs=0.1)


def test_roughness_wears_with_the_work_done_on_it() -> None:
    # uniform pressure: W = 2 N p s, as the provider `evolving` has it
    pressure, slip, count = np.full(20, 80.0), 0.01, 1e5
    S = pressed_by_force(np.linspace(-9.5, 9.5, 20), 20.0, 2e5)
    done = jump(to_and_fro(pressure, slip), S, K, count) / K
    work, first = 2.0 * count * 80.0 * slip, np.linspace(0.2, 0.4, 20)
    fallen = Smoothing(flat_coefficient=0.07, work=2.0 * work).friction(first, done)
    assert fallen == pytest.approx(0.07 + (first - 0.07) * np.exp(-0.5), rel=1e-9)
    evolving = Evolving(base="uniform", options={"coefficient": 0.3}, flat_coefficient=0.07, work=2.0 * work)
    provider = FlatteningPairs(Constant(), "constant", evolving.flat_coefficient, evolving.full_work)
    asked = TilePairs(np.arange(20), np.arange(20), pressure, np.full(20, 2.0 * count * slip))
    assert Smoothing(flat_coefficient=0.07, work=2.0 * work).friction(np.full(20, 0.3), done) == pytest.approx(
        provider.coefficients(asked), rel=1e-9
    )


class Constant:
    """A rough face whose coefficient is 0.3 everywhere."""

    depends_on = frozenset({"tiles"})

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """0.3 for each pair."""
        return np.full(len(pairs.seat), 0.3)


def work_of(revolution: Revolution) -> FloatArray:
    """Friction work per area of each place (m,) [N/mm]."""
    slips = np.diff(np.stack([moment.slip for moment in revolution.moments]), axis=0)[:, :, 1:]
    shears = np.stack([moment.traction for moment in revolution.moments])[:, :, 1:]
    return np.asarray(-(0.5 * (shears[1:] + shears[:-1]) * slips).sum(axis=(0, 2)).mean(axis=0))


@cache
def worn_away(work: float | None) -> tuple[Rotation, Revolution, list[Worn]]:
    """The fit of a small wheelset as it wears by micrometres, its roughness with it or not."""
    course = Course(load_scene("wheelset", SMALL), lambda _: None, Kept())
    found = course.carry_out()
    assert course.rotation is not None
    assert found.turned is not None
    rough = None if work is None else Smoothing(flat_coefficient=0.1, work=work)
    new = found.turned.revolutions[-1]
    return (
        course.rotation,
        new,
        list(wear_away(course.rotation, found.moments[-1], [1e4, 3e4, 6e4, 1.0], K, rough)),
    )


def test_friction_work_leaves_what_is_worn_for_what_is_not() -> None:
    rotation, _, worn = worn_away(None)
    fit, depth = rotation.kernel.fit, worn[-1].depth
    first, last = worn[0].last, worn[-1].last
    before, after = work_of(first), work_of(last)
    assert before @ fit.weight == pytest.approx(first.friction_work, rel=1e-9)
    top = int(np.argmax(depth))
    assert top == int(np.argmax(before))
    assert after[top] < 0.8 * before[top]
    beside = (np.abs(fit.z - fit.z[top]) < 10.0) & (depth < 0.5 * depth[top])
    assert beside.any()
    assert after[beside] @ fit.weight[beside] > 1.5 * (before[beside] @ fit.weight[beside])
    slips = before > 1e-3 * before.max()
    assert after[slips].max() / after[slips].mean() < 0.8 * before[slips].max() / before[slips].mean()
    assert mean_pressure(last)[top] < mean_pressure(first)[top]


def test_roughness_that_wears_too_lets_more_slip() -> None:
    rotation, _, rough = worn_away(2e5)
    _, _, even = worn_away(None)
    assert even[-1].friction == pytest.approx(0.2)
    done = rough[-1].depth / K
    assert rough[-1].friction == pytest.approx(0.1 + 0.1 * np.exp(-done / 2e5))
    assert rough[-1].friction.min() < 0.15
    counted = [(work_of(each[-1].last) > 1e-3 * work_of(each[-1].last).max()).sum() for each in (rough, even)]
    assert counted[0] > counted[1]
    assert rotation.friction is rough[-1].friction


def test_a_worn_seat_is_a_profile_that_the_next_press_takes(tmp_path: Path) -> None:
    rotation, _, worn = worn_away(None)
    fit, depth = rotation.kernel.fit, worn[-1].depth
    write_worn_profile(tmp_path / "worn.csv", fit, depth, share=1.0)
    profile = read_profile(tmp_path / "worn.csv", "axle.profile")
    assert profile.at(fit.z) == pytest.approx(-depth, rel=1e-12, abs=1e-15)
    assert profile.value[[0, -1]] == pytest.approx(0.0)
    assert profile.unit == "um"
    new, _ = pressed_and_released(load_scene("wheelset", SMALL))
    again, _ = pressed_and_released(load_scene("wheelset", [*SMALL, f"axle.profile={tmp_path / 'worn.csv'}"]))
    gone = (depth > 0.3 * depth.max()) & (new.traction[0, fit.chosen] < -1.0)
    lost = again.traction[0, fit.chosen] - new.traction[0, fit.chosen]
    assert gone.any()
    assert lost[gone].min() > 0.0
    # pressed anew or worn in place, the seat has lost the same: dp = S h, but for the friction of the press
    by_wear = (rotation.kernel.normal_stiffness @ depth)[gone]
    assert np.corrcoef(lost[gone], by_wear)[0, 1] > 0.9


def test_worn_wheelset_presses_less_where_it_slips_and_carries_its_loads() -> None:
    course = Course(load_scene("wheelset", SMALL), lambda _: None, Kept())
    found = course.carry_out()
    rotation = course.rotation
    assert rotation is not None
    assert found.turned is not None
    worn: list[Worn] = list(wear_away(rotation, found.moments[-1], [1e3, 1e4, 1e4], 1e-9))
    first, last = found.turned.revolutions[-1], worn[-1].last
    fit, wear = rotation.kernel.fit, found.turned.fretting
    assert worn[-1].revolutions == 21e3
    assert depth_of(last, 1.0) @ fit.weight == pytest.approx(last.friction_work / 0.2, rel=0.1)
    stuck = wear.always & (np.hypot(wear.axial_range, wear.around_range) == 0.0)
    assert np.abs(worn[-1].depth[stuck]).max() == 0.0
    gone = wear.always & (worn[-1].depth > 0.2 * worn[-1].depth.max())
    assert gone.any()
    assert (mean_pressure(last)[gone] < mean_pressure(first)[gone]).all()
    angle = 2.0 * np.pi * np.arange(found.turned.angles) / found.turned.angles
    moment, normals = last.moments[-1], fit.normals.T
    radial = normals[0] * moment.traction[:, 0] - normals[1] * moment.traction[:, 1]
    down = (np.cos(angle) @ radial - np.sin(angle) @ moment.traction[:, 2]) @ fit.weight / found.turned.angles
    assert down == pytest.approx(-110e3, rel=1e-6)
