"""A wheel warmer than its axle: less interference, and a shrink fit that cools in place."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from found import Found
from small import NO_FIELDS, condensed_press, small_press, solved
from verification.test_lame import HOLLOW_AND_SOFT, bodies, rings
from verification.test_profiles import pressed_hub, write

from macrofit.scene import Scene, load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

EXPANSION = 1.15e-5


def cooling(steps: int, *overrides: str) -> Scene:
    """The flush rings, put on 300 K warmer than needed to pass, and cooled."""
    return rings(2, 2.0, "wheel.temperature=400", f"motion.cooling={steps}", *overrides)


def same(a: Solution, b: Solution) -> float:
    """Largest relative difference of normal and axial forces."""
    forces = [np.array([[r.normal_force, r.force] for r in solution.increments]) for solution in (a, b)]
    return float(np.abs(forces[0] - forces[1]).max() / np.abs(forces[1]).max())


@pytest.mark.parametrize("kelvin", [20.0, 137.3, 200.0])
def test_heat_is_less_interference(kelvin: float, tmp_path: Path, found: Found) -> None:
    """The bore is alpha dT r wider, as by a profile of as much: in place, and pressed on with friction."""
    for number, scene in enumerate((pressed_hub, press_on)):
        _, wheel = bodies(scene())
        wider = 1e3 * EXPANSION * kelvin * wheel.bore_radius  # um
        profile = write(tmp_path / f"{number}.csv", np.array([0.0, wheel.hub_length]), np.array([wider, wider]))
        warm = solve(scene(f"wheel.temperature={kelvin}", f"wheel.material.expansion={EXPANSION}"))
        less = solve(scene(f"wheel.profile={profile}"))
        assert less.increments[-1].normal_force > 0.0
        assert found(f"heated wheel, {kelvin:g} K: forces against less interference", same(warm, less), 1e-10)


def press_on(*overrides: str) -> Scene:
    """A plain hub pressed on from 15 to 60 mm with friction: no chamfer, so that its bore has one radius."""
    plain = ("wheel.chamfer_length=0", "wheel.chamfer_height=0", "wheel.chamfer_blend=0", "wheel.bore_radius=94.6")
    return small_press(*plain, *overrides)


def test_the_example_of_the_design() -> None:
    """137.3 K release 0.3 mm on a diameter of 190 mm at 1.15e-5 1/K."""
    keys = ("wheel.bore_radius=95", "axle.seat_radius=95.15")
    tight, warm, loose = (
        solve(rings(2, 4.0, *keys, f"wheel.temperature={kelvin}")).increments[-1].normal_force
        for kelvin in (0.0, 137.0, 137.3)
    )
    assert 190.0 * rings(2, 4.0, *keys, "wheel.temperature=137.3").thermal_strain == pytest.approx(0.3, rel=1e-5)
    assert loose == 0.0
    assert warm / tight == pytest.approx(1.0 - 190.0 * EXPANSION * 137.0 / 0.3, rel=1e-6)


@pytest.mark.parametrize("overrides", [(), HOLLOW_AND_SOFT], ids=["solid", "hollow-soft"])
def test_a_wheel_that_cools_is_shrunk_on(overrides: tuple[str, ...], found: Found) -> None:
    """Without friction the way does not matter: the cold fit is the fit in place, and no force was needed."""
    cooled, placed = solved(cooling(10, *overrides)), solved(rings(2, 2.0, *overrides))
    first, last = cooled.increments[0], cooled.increments[-1]
    assert len(cooled.increments) == 11
    assert first.normal_force == 0.0
    assert all(a.normal_force <= b.normal_force for a, b in pairwise(cooled.increments))
    error = abs(last.normal_force / placed.increments[0].normal_force - 1.0)
    assert found("wheel that cools without friction: normal force of the fit in place", error, 1e-10)
    assert abs(last.force) < 1e-6 * last.normal_force


def test_cooling_needs_no_force_and_balances_its_energy(found: Found) -> None:
    """With friction nothing pushes either; heat does the work that the fit stores and friction takes."""
    solution = solved(cooling(40, "friction.options.coefficient=0.12"))
    largest = max(abs(record.force) for record in solution.increments)
    held = 0.12 * solution.increments[-1].normal_force
    assert found("wheel that cools with friction: force from outside over what friction holds", largest / held, 1e-9)
    assert found("wheel that cools with friction: energy balance", solution.energy_balance, 5e-3)
    assert solution.increments[-1].dissipation > 0.0
    assert sum(record.work for record in solution.increments) > 0.0


@pytest.mark.parametrize("steps", [1, 4])
def test_what_is_in_contact_cools_to_the_balance_of_the_mesh(steps: int, found: Found) -> None:
    """Where all of the seat presses from the start, stick and slip are counted exactly, however long the steps are."""
    keys = ("wheel.temperature=150", f"motion.cooling={steps}", "friction.options.coefficient=0.12")
    balance = solved(rings(2, 2.0, *keys)).energy_balance
    assert found(f"wheel in contact that cools in {steps} steps: energy balance", balance, 3e-5)


def test_friction_holds_back_what_contracts_along_the_axis() -> None:
    """Friction keeps the wheel from contracting along the seat, which adds to its pressure by Poisson's ratio alone."""
    free = ("axle.material.poisson_ratio=0", "wheel.material.poisson_ratio=0")
    with_ratio, without = (
        solved(cooling(10, "friction.options.coefficient=0.12", *keys)).increments[-1].normal_force
        / solved(rings(2, 2.0, *keys)).increments[-1].normal_force
        for keys in ((), free)
    )
    assert 1.002 < with_ratio < 1.02
    assert without == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("extra", [(), ("solver=monolithic",), ("contact.theta=1",), ("contact.formulation=penalty",)])
def test_both_engines_and_all_formulations_cool(extra: tuple[str, ...]) -> None:
    """To 1e-8 the condensed engine's; the penalty leaves 2e-3 of the interference, and theta = 1 errs otherwise."""
    keys = ("friction.options.coefficient=0.12", "mesh.seat_facet=5", "mesh.coarse=5")
    reference, other = (solved(cooling(4, *keys, *more)).increments[-1].normal_force for more in ((), extra))
    bar = {"contact.formulation=penalty": 5e-3, "contact.theta=1": 1e-4}.get(*extra, 1e-8) if extra else 1e-14
    assert other == pytest.approx(reference, rel=bar)


def test_a_cooled_fit_is_pulled_off_by_what_it_holds(found: Found) -> None:
    """Cooled, then pulled until it slides, without Poisson's effect: mu 2 pi a L p, and sticking before."""
    free = ("axle.material.poisson_ratio=0", "wheel.material.poisson_ratio=0", "friction.options.coefficient=0.12")
    path = [40.0, 39.999, 39.995, 39.975]
    motion = ("motion.start=0", "motion.travel=0", f"motion.displacements={path}")
    solution = solved(cooling(6, *free, *motion))
    assert solution.displacement.tolist() == [40.0] * 6 + path
    last, cold = solution.increments[-1], solution.increments[6]
    assert last.sticking_facets == 0
    assert found("cooled wheel that is pulled: force against what it holds", -last.force / cold.pull_off, 1.0 + 3e-3)
    assert -last.force / cold.pull_off > 1.0 - 3e-3


def test_an_interrupted_cooling_goes_on_to_the_bit() -> None:
    """From the state after any increment, through the arrays of a journal."""
    from macrofit.state import State

    scene = cooling(5, "friction.options.coefficient=0.12", "motion.start=40", "motion.travel=40")
    press, _ = condensed_press(scene)
    whole = list(press.increments(press.rest()))
    for number in (1, 3, 5):
        state = State.restored(whole[number - 1][1].arrays())
        rest = list(press.increments(state, number))
        assert [r.normal_force for r, _ in rest] == [r.normal_force for r, _ in whole[number:]]


def test_a_heated_wheel_of_the_library_cools_on(found: Found) -> None:
    """A whole wheel with web, which is not symmetric: the support finds its place without force at every step."""
    keys = ("motion.start=190", "motion.travel=190", "wheel.temperature=320", "motion.cooling=8", "mesh.seat_facet=5")
    solution = solved(load_scene("wheelset", [*NO_FIELDS, *keys, "mesh.bore_facet=4.7", "mesh.coarse=40"]))
    last = solution.increments[-1]
    largest = max(abs(record.force) for record in solution.increments) / (last.mean_friction * last.normal_force)
    assert found("wheelset that cools: force from outside over what friction holds", largest, 1e-8)
    assert last.facets.traction.min() < 0.0 < last.facets.traction.max()
