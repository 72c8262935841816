"""Wear of the seat: closed forms of Archard's law, and what a worn wheelset keeps."""

from __future__ import annotations

import numpy as np
import pytest

from macrofit.base.arrays import FloatArray
from macrofit.scene import load_scene
from macrofit.service.journal import Kept
from macrofit.service.rotation import Moment, Revolution
from macrofit.service.run import Course
from macrofit.service.wear import Worn, depth_of, jump, mean_pressure, wear_away

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


def test_worn_wheelset_presses_less_where_it_slips_and_carries_its_loads() -> None:
    course = Course(load_scene("wheelset", SMALL), lambda _: None, Kept())
    found = course.carry_out()
    rotation = course._rotation
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
