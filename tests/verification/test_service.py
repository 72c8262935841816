"""A small wheelset in rotating bending: balances, the law of friction, and what does not depend on how it is asked."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from benchmarks.service_fuzz import out_of_balance
from small import small_press

from macrofit.base.arrays import FloatArray
from macrofit.bodies.elasticity import von_mises
from macrofit.errors import ConvergenceError, MacrofitError, SceneError
from macrofit.scene import Scene, build_scene, load_scene
from macrofit.service import rotation, slipping, wheelset
from macrofit.service.bonded import one_harmonic
from macrofit.service.history import slip_left
from macrofit.service.journal import Kept
from macrofit.service.output.numbers import service_doubts
from macrofit.service.residual import pressed_and_released
from macrofit.service.rotation import Rotation
from macrofit.service.run import Course, Service, bonded_only, serve
from macrofit.service.seat_stress import MM, MT, TT, facet_mean
from macrofit.service.wheelset import Loads
from macrofit.solve import solve

COARSE = (
    "mesh.seat_facet=6", "mesh.coarse=40", "motion.start=90", "motion.travel=180", "motion.increment=15",
    "wheel.bore_radius=94.85", "friction.options.coefficient=0.2", "service.steps=28",
    "service.harmonics=3",
)  # fmt: skip


def small(*overrides: str) -> Scene:
    return load_scene("wheelset", [*COARSE, *overrides])


@cache
def served(*overrides: str) -> Service:
    return serve(small(*overrides))


def test_loads_work_as_much_as_friction_takes() -> None:
    turned = served().turned
    assert turned is not None
    last = turned.revolutions[-1]
    assert last.friction_work > 1000.0
    assert last.load_work == pytest.approx(last.friction_work, rel=1e-4)
    whole = (turned.fretting.work * served().whole.fit.weight).sum()
    assert whole == pytest.approx(last.friction_work, rel=1e-9)


def test_third_revolution_repeats_the_second_and_is_a_wave() -> None:
    turned = served().turned
    assert turned is not None
    assert turned.fretting.left[0] < 1e-3
    assert turned.fretting.wave_errors[0] < 5e-3


def test_turns_until_it_is_periodic_and_no_longer() -> None:
    several, asked = served("service.revolutions=5").turned, served("service.revolutions=5", "service.periodicity=4e-3")
    assert several is not None
    assert asked.turned is not None
    left = [max(slip_left(each)) for each in several.revolutions]
    count = next(k for k, each in enumerate(left, 1) if each <= 4e-3)
    assert 1 < count < 5
    assert len(asked.turned.revolutions) == count
    assert [max(slip_left(each)) for each in asked.turned.revolutions] == left[:count]
    assert left[count - 1] == max(asked.turned.fretting.left)
    assert not service_doubts(asked.whole, asked.turned)


def test_what_is_not_periodic_by_its_last_revolution_is_doubted() -> None:
    found = served("service.revolutions=2", "service.periodicity=1e-6")
    assert found.turned is not None
    assert len(found.turned.revolutions) == 2
    said = [doubt for doubt in service_doubts(found.whole, found.turned) if doubt.startswith("not periodic yet")]
    assert len(said) == 1
    assert f"revolution 2 leaves {max(found.turned.fretting.left):.1e} of the slip" in said[0]


@pytest.mark.parametrize("load", ["service.torque=1e12", "service.torque=-1e12"])
def test_loads_that_friction_cannot_hold_in_the_first_step_end_at_once(
    monkeypatch: pytest.MonkeyPatch, load: str
) -> None:
    monkeypatch.setattr(rotation, "solve_step", None)  # no step is tried
    with pytest.raises(
        ConvergenceError, match=r"no equilibrium is possible beyond [0-9.e-]+ of the loads at [0-9.e-]+"
    ):
        serve(small(load, "motion.increment=30"))


def test_grip_is_that_of_the_fit_and_loads_within_it_are_tried() -> None:
    # the torque that slides the fit round as a whole is found by steps; the bound lies above, not below it
    given = ("motion.increment=30", "service.harmonics=1", "service.steps=9", "service.revolutions=1")
    nothing = ("service.journal_force=0", "service.journal_moment=0")
    residual, _ = pressed_and_released(small(*given))
    whole = served(*given).whole
    holds = 0.2 * -(residual.traction[0, whole.fit.chosen] @ whole.fit.weight) * 95.0  # N mm
    with pytest.raises(ConvergenceError, match="no equilibrium was found beyond") as found:
        serve(small(*given, *nothing, f"service.torque={2.0 * holds}"))
    assert 0.33 < float(str(found.value).split("beyond ")[1].split("%")[0]) / 100.0 < 0.56
    with pytest.raises(ConvergenceError, match=r"is possible beyond 0\.05"):
        serve(small(*given, *nothing, f"service.torque={20.0 * holds}"))


def grip_of(*more: str) -> tuple[Rotation, Loads, FloatArray]:
    """A fit that can turn, its loads, and the normal force of each place in all steps of a revolution [N]."""
    course = Course(small("motion.increment=30", "service.steps=9", "service.revolutions=1", *more), print, Kept())
    whole, turning = course.carry_out().whole, course.rotation
    assert turning is not None
    return turning, whole.loads, -turning.steps * turning.rest().traction[0, 0] * whole.fit.weight


def refused(turning: Rotation, loads: Loads, force: float) -> bool:
    """Whether a torque that asks for this shear force [N] is refused."""
    torque = force * float(turning.kernel.fit.lines[0].radius.max())
    try:
        rotation.check_grip(turning, replace(loads, keys=msgspec.structs.replace(loads.keys, torque=torque)))
    except ConvergenceError as error:
        return "no equilibrium is possible" in str(error)
    return False


def test_loads_that_press_the_fit_together_help_friction_to_hold() -> None:
    turning, loads, normal = grip_of()
    slope = np.abs(turning.kernel.fit.normals[:, 1])
    pressed = np.abs(turning.kernel.load_at(0.0)[:, : len(normal)]).mean(axis=0) @ turning.kernel.fit.weight
    held, more = float(normal @ (0.2 + slope)), rotation.PRESSED * float((0.2 + slope.max()) * pressed)
    assert 0.005 * held < more < 0.1 * held
    assert [refused(turning, loads, held + share * more) for share in (0.9, 1.1)] == [False, True]


def test_pressure_on_a_cone_helps_friction_to_hold() -> None:
    nothing = ("service.journal_force=0", "service.journal_moment=0")
    turning, loads, normal = grip_of("axle.taper=0.0033", "wheel.bore_taper=0.0033", *nothing)
    slope = float(np.median(np.abs(turning.kernel.fit.normals[:, 1])))
    assert 1e-3 < slope < 1e-2
    assert [refused(turning, loads, (0.2 + way * slope) * float(normal.sum())) for way in (0.9, 3.0)] == [False, True]


@pytest.mark.parametrize(("offset", "said"), [(62.0, ""), (-62.0, ""), (80.0, "beyond the rim"), (-80.0, "beyond")])
def test_a_rail_beside_the_rim_is_refused_on_either_side(offset: float, said: str) -> None:
    if not said:
        bonded_only(small(f"service.rim_offset={offset}"))
        return
    with pytest.raises(SceneError, match=said):
        bonded_only(small(f"service.rim_offset={offset}"))


def test_what_is_kept_between_iterations_is_taken_anew_where_others_slip() -> None:
    """Few more moments than slip are kept: a product with them takes as long."""
    taken: list[int] = []
    kernel: Any = SimpleNamespace(fit=SimpleNamespace(moments=100), between=lambda places: taken.append(len(places)))
    nearby = slipping.Nearby(kernel)
    for moments, kept in ((range(50), 50), (range(45), 50), (range(40, 52), 12), (range(41, 53), 13), (range(10), 10)):
        assert len(nearby.among(np.array(moments))[0]) == kept
    assert taken == [150, 36, 39, 30]


@pytest.mark.parametrize(
    ("load", "said"), [("journal_force=1e9", "1e+09 N on the journal"), ("lateral_force=-1e10", "-1e+10 N along")]
)
def test_loads_that_bend_the_axle_out_of_measure_are_refused_with_their_names(load: str, said: str) -> None:
    with pytest.raises(SceneError, match=re.escape(said) + r".* at every angle, .* service\.journal_force") as found:
        bonded_only(small(f"service.{load}"))
    assert "\n" not in str(found.value)


def test_slip_around_the_axle_creeps_as_a_mean_twist_that_dies_away() -> None:
    # where a place slips to and fro along the axle, friction lets a mean shear around it go a little each time: the
    # twist that the rising loads left dies away over revolutions. Neither steps nor harmonics change it
    turned = served("service.revolutions=5").turned
    assert turned is not None
    always, twists = turned.fretting.always, []
    size = turned.fretting.axial_range.max()
    for revolution in turned.revolutions[2:]:
        first, last = revolution.moments[0], revolution.moments[-1]
        left = (last.slip - first.slip)[:, 2, always] / size
        twists.append(float(np.abs(left.mean(axis=0)).max()))
        assert np.abs(left - left.mean(axis=0)).max() < 0.75 * twists[-1]
        assert np.abs(last.traction - first.traction)[..., always].max() < 5e-3 * np.abs(first.traction[:, 1:]).max()
    works = np.array([revolution.friction_work for revolution in turned.revolutions[2:]])
    assert works == pytest.approx(works[-1], rel=3e-4)
    assert 1e-3 < twists[0] < 5e-3
    assert twists[1] < 0.8 * twists[0]
    assert twists[2] < 0.8 * twists[1]


def test_every_point_obeys_the_law_of_friction() -> None:
    found = served()
    assert found.turned is not None
    rounding = 1e-6 * found.turned.fretting.largest_pressure.max()
    moments = found.turned.revolutions[-1].moments
    for before, after in zip(moments[::3], moments[1::3], strict=False):
        normal, shear = after.traction[:, 0], after.traction[:, 1:]
        size, bound = np.hypot(*np.moveaxis(shear, 1, 0)), -found.turned.friction * normal
        step = after.slip[:, 1:] - before.slip[:, 1:]
        way = np.hypot(*np.moveaxis(step, 1, 0))
        assert (normal <= rounding).all()
        assert (after.slip[:, 0] <= 1e-12).all()
        assert np.abs(normal * after.slip[:, 0]).max() < rounding * 1e-3  # in contact, or apart
        assert (size <= bound + rounding).all()
        slips = (way > 1e-9) & (bound > rounding)
        assert size[slips] == pytest.approx(bound[slips], abs=rounding)
        against = -(step * shear).sum(axis=1)
        assert against[slips] == pytest.approx((size * way)[slips], rel=1e-4, abs=rounding * 1e-6)


def test_wheel_is_in_balance_at_all_times() -> None:
    found = served()
    assert found.turned is not None
    fit, moment = found.whole.fit, found.turned.revolutions[-1].moments[3]
    angles = 2.0 * np.pi * np.arange(found.turned.angles) / found.turned.angles
    n_r, n_z = fit.normals.T
    radial = n_r * moment.traction[:, 0] - n_z * moment.traction[:, 1]
    cosine, sine, around = np.cos(angles), np.sin(angles), moment.traction[:, 2]
    across = np.array([cosine @ radial - sine @ around, sine @ radial + cosine @ around]) @ fit.weight
    turned = 2.0 * np.pi * moment.time
    load = found.whole.loads.keys.journal_force * np.array([np.cos(turned), np.sin(turned)])
    assert across / found.turned.angles == pytest.approx(-load, abs=1e-6 * np.abs(load).max())


@pytest.mark.parametrize("order", [1, 2])
def test_wheel_on_a_cone_under_all_loads_is_in_balance(monkeypatch: pytest.MonkeyPatch, order: int) -> None:
    rest, at_rest = [], rotation.Rotation.rest

    def noted(turning: rotation.Rotation) -> rotation.Moment:
        rest.append(at_rest(turning).traction)
        return at_rest(turning)

    monkeypatch.setattr(rotation.Rotation, "rest", noted)
    cone = small(
        "axle.taper=0.0033", "wheel.bore_taper=0.0033", "wheel.material.youngs_modulus=1.1e5", f"mesh.order={order}",
        "mesh.seat_facet=14", "mesh.coarse=60", "motion.increment=30", "service.lateral_force=2e4",
        "service.torque=1e6", "service.harmonics=1", "service.steps=3", "service.revolutions=1",
    )  # fmt: skip
    found = serve(cone)
    assert len(found.moments) == 4
    assert [out_of_balance(found, moment, rest[0]) for moment in found.moments] == [[]] * 4


def test_places_that_are_left_out_would_not_have_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for margin in (0.0, wheelset.MARGIN, 1e9):
        monkeypatch.setattr(wheelset, "MARGIN", margin)
        turned = serve(small("service.steps=14", "service.revolutions=1")).turned
        assert turned is not None
        found.append(turned.revolutions[-1].friction_work)
    assert found[1] == pytest.approx(found[2], rel=1e-6)
    assert found[0] != pytest.approx(found[2], rel=1e-2)  # those that are near do touch


def test_iteration_gives_what_elimination_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    short = ("service.steps=14", "service.revolutions=1", "motion.increment=30")
    found = []
    for most in (10**6, 0):
        monkeypatch.setattr(slipping, "DENSE", most)
        turned = serve(small(*short)).turned
        assert turned is not None
        found.append(turned.revolutions[-1])
    largest = np.abs(found[0].moments[-1].slip[:, 1:]).max()
    for one, two in zip(found[0].moments, found[1].moments, strict=True):
        assert two.slip == pytest.approx(one.slip, abs=1e-7 * largest)


def test_less_friction_slips_farther() -> None:
    low, high = served("friction.options.coefficient=0.12").turned, served().turned
    assert low is not None
    assert high is not None
    assert low.fretting.front_zone > 1.2 * high.fretting.front_zone
    assert low.revolutions[-1].friction_work > 1.5 * high.revolutions[-1].friction_work


def test_a_table_of_one_coefficient_is_the_uniform_one_to_the_bit() -> None:
    class Constant:
        depends_on = frozenset({"tiles"})

        def coefficients(self, pairs: object) -> np.ndarray:
            return np.full(len(pairs.seat), 0.2)  # type: ignore[attr-defined]

    one, two = served().turned, serve(small(), friction=Constant()).turned
    assert one is not None
    assert two is not None
    assert one.revolutions[-1].friction_work == two.revolutions[-1].friction_work
    assert (one.revolutions[-1].moments[-1].slip == two.revolutions[-1].moments[-1].slip).all()


def test_bending_stress_far_from_the_hub_is_the_nominal_one() -> None:
    found = bonded_only(long_seat(2.0)).bonded
    far = (found.z < 40.0) | (found.z > 260.0)
    assert found.bending[far] == pytest.approx(found.nominal[far], rel=2e-3)


def test_stress_of_the_surface_far_from_the_hub_is_that_of_a_beam() -> None:
    # before the hub the front end's shear alone, behind it a lateral force's moment and a torque too
    keys = {"lateral_force": 2e4, "torque": 3e6}
    found = bonded_only(long_seat(2.0, keys))
    bonded, section = found.bonded, found.whole.section(np.array([20.0]))[0]
    before, behind = bonded.z < 10.0, bonded.z > 270.0  # a disturbance of 10 MPa falls by e in 19 mm
    expected = [1e7 + 1e4 * 20.0, 1e7 + 1e4 * 150.0 + 2e4 * 100.0]  # the wheel stands at 150 mm, its rim is at 100
    assert found.whole.loads.moment(np.array([20.0, 280.0])) == pytest.approx(expected)
    assert bonded.bending[before | behind] == pytest.approx(bonded.nominal[before | behind], rel=3e-3)
    _, shear = section.shear(-1e4, 0.3, np.array([section.outer]))
    first = 2.0 * bonded.harmonics[1].stress[before].real
    assert first[:, MT] == pytest.approx(shear[0], rel=4e-2)
    assert np.abs(first[:, TT]).max() < 5e-3 * bonded.nominal[before].max()
    # a force around the bore, of radius 49.95, is handed over at that of the seat, 50
    zero = -1j * one_harmonic(found.whole, 0).stress[behind]
    assert zero[:, MT].real == pytest.approx(-3e6 * section.outer / (2.0 * section.second_moment) / 0.999, rel=1e-3)
    assert (1j * zero[:, MM]).real == pytest.approx(-2e4 / (np.pi * section.outer**2), rel=2e-2)


def test_shear_of_a_bonded_sharp_edge_grows_with_the_known_power() -> None:
    # a corner of 270 degrees in one steel: distance^-0.4555; 8 mm are not near enough to a hub of 50 for more
    powers = [bonded_only(long_seat(facet)).bonded.edges[1].shear_power for facet in (2.0, 1.0)]
    errors = [abs(power + 0.4555) for power in powers if power is not None]
    assert errors[1] < 0.5 * errors[0]
    assert errors[1] < 0.11


def long_seat(facet: float, loads: dict[str, float] | None = None) -> Scene:
    """A ring with sharp edges in the middle of a seat."""
    tables = {
        "axle": {"seat_radius": 50.0, "seat_length": 300.0, "tail_length": 100.0},
        "wheel": {"bore_radius": 49.95, "hub_length": 80.0, "hub_outer_radius": 100.0},
        "mesh": {"seat_facet": facet, "coarse": 20.0},
        "motion": {"start": 190.0, "travel": 190.0},
        "service": {"journal_force": 1e4, "journal_moment": 1e7, **(loads or {})},
    }
    return build_scene(tables)


def test_residual_stress_of_an_axle_that_flowed_is_what_its_steel_bears() -> None:
    # Hooke's law on the whole strain gives 400 MPa for the median facet, and 1800 MPa at the worst
    steel = 'axle.material={yield_stress=200.0, hardening={law="linear", isotropic=2000.0}}'
    residual, _ = pressed_and_released(small("wheel.bore_radius=94.7", steel))
    found = von_mises(residual.stress[:, :4].T)
    assert np.abs(residual.stress[:, 4:]).max() == 0.0
    assert np.median(found) == pytest.approx(200.0, rel=0.1)
    assert found.max() < 1.02 * (200.0 + 2000.0 * residual.plastic_strain)  # patches had 600 at the ends


def test_residual_stress_of_a_seat_that_flowed_is_that_of_the_released_press() -> None:
    steel = 'axle.material={yield_stress=200.0, hardening={law="linear", isotropic=2000.0}}'
    residual, bodies = pressed_and_released(small("wheel.bore_radius=94.7", steel))
    last = solve(small("wheel.bore_radius=94.7", steel, "motion.release=true"))
    axle = bodies["axle"]
    stress = list(last.fields.values())[-1]["axle"].stress[axle.trace[: len(axle.line.nodes)]]
    _, zz, tt, _ = (facet_mean(each.astype(np.complex128), axle.line.order).real for each in stress.T)
    assert residual.stress[:, TT] == pytest.approx(tt, abs=0.01)
    assert residual.stress[:, MM] == pytest.approx(zz, abs=2.0)  # along the axis here, along the seat there


def test_without_loads_nothing_concentrates_and_the_residual_stress_stays() -> None:
    unloaded = small("service.journal_force=0", "service.journal_moment=0", "service.revolutions=1")
    found, (residual, _) = serve(unloaded), pressed_and_released(unloaded)
    assert found.turned is not None
    assert [edge.concentration for edge in found.bonded.edges] == [None, None]
    assert np.abs(residual.stress).max() > 100.0
    assert found.turned.endurance.stress == pytest.approx(np.stack([residual.stress] * 28, axis=1), abs=1e-6)


def test_stress_beside_the_hub_turns_with_the_loads() -> None:
    # 20 mm behind the hub a slip of 30 mm at its edge changes the bonded stress by a few hundredths
    turned, first = served().turned, served().bonded.harmonics[1].stress[-1]
    assert turned is not None
    times = turned.endurance.stress[-1]
    loads = np.exp(-2j * np.pi * np.arange(1, len(times) + 1) / len(times))
    for component, family in ((MM, 1.0), (MT, -1j)):
        expected = 2.0 * (family * first[component] * loads).real
        found = times[:, component] - times[:, component].mean()
        assert found == pytest.approx(expected, abs=0.15 * np.abs(expected).max())


def test_a_guess_that_does_not_help_is_not_tried_first_again(monkeypatch: pytest.MonkeyPatch) -> None:
    # the wheel slips all over: slips that are turned on lead Newton's method away, step after step
    tried: list[bool] = []

    def counted(*given: object) -> slipping.Solved:
        solved = slipping.solve_step(*given)  # type: ignore[arg-type]
        tried.append(solved.converged)
        return solved

    monkeypatch.setattr(rotation, "solve_step", counted)
    found = serve(small("service.journal_force=3e6", "service.steps=14", "service.revolutions=1"))
    assert found.turned is not None
    assert tried.count(False) < 0.2 * len(tried)


def test_a_loose_wheel_that_tilts_and_opens_finds_its_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    # it touches at one end on top, at the other below; whole ways of Newton's method lose it at a tenth of the loads
    loose = load_scene("wheelset", [
        "mesh.coarse=60", "mesh.seat_facet=6", "mesh.order=1", "motion.start=90", "motion.travel=180",
        "motion.increment=30", "wheel.bore_radius=94.9871", "axle.inner_radius=42.9", "wheel.hub_length=59.82",
        "wheel.web_thickness=0", "friction.options.coefficient=0.2503", "service.journal_force=1.142e6",
        "service.journal_moment=1.29e8", "service.lateral_force=-1.374e4", "service.rim_offset=21.94",
        "service.harmonics=2", "service.steps=3", "service.revolutions=1",
    ])  # fmt: skip
    searched: list[bool] = []

    def counted(*given: object) -> slipping.Solved:
        solved = slipping.search_step(*given)  # type: ignore[arg-type]
        searched.append(solved.converged)
        return solved

    monkeypatch.setattr(rotation, "search_step", counted)
    found = serve(loose)
    assert found.turned is not None
    assert found.turned.fretting.opening.min() > 0.05
    assert any(searched)
    monkeypatch.setattr(rotation, "search_step", slipping.solve_step)
    with pytest.raises(ConvergenceError, match="no equilibrium was found"):
        serve(loose)


def test_where_all_slips_and_nothing_holds_the_wheel_slip_is_viscous() -> None:
    free = 1e5 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    found = slipping._regular_solution(free, np.array([10.0, 10.0]))
    assert found == pytest.approx(10.0 / (slipping.VISCOUS * slipping.RHO), rel=1e-6)


def test_more_torque_than_friction_carries_ends_in_one_line() -> None:
    with pytest.raises(ConvergenceError, match=r"no equilibrium was found beyond \d+% of the loads at"):
        serve(small("service.torque=1e9", "service.steps=7", "service.harmonics=1"))


@pytest.mark.parametrize(
    ("overrides", "error", "message"),
    [
        (("service.torsion_limit=90",), SceneError, "service.torsion_limit: 90 must be above 1/2"),
        (("motion.start=-900", "motion.travel=-900"), ConvergenceError, "nothing presses the wheel"),
    ],
)
def test_a_mistake_is_one_line(overrides: tuple[str, ...], error: type[MacrofitError], message: str) -> None:
    with pytest.raises(error, match=message):
        serve(small_press(*overrides))
