"""What a fit carries before it slides: axial force and torque, against Lamé's pressure and against a push that slides.

Long flush rings, whose pressure is Lamé's all along: F = mu 2 pi a L p and T = F a. The bar of 0.3 % is the issue's.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from found import Found
from small import NO_FIELDS, solved
from verification.closed_forms import drawn_rings_pressure
from verification.test_lame import bodies, rings

from macrofit.acceptance.run import holding
from macrofit.results.summary import sentences, summary
from macrofit.scene import Scene, load_scene
from macrofit.solution import Solution

MU, LENGTH = 0.12, 400.0
AWAY = [LENGTH - 0.02 * k for k in range(1, 11)]
NO_POISSON = ("axle.material.poisson_ratio=0", "wheel.material.poisson_ratio=0")


def long_rings(path: list[float], *overrides: str) -> Scene:
    """Flush rings of 400 mm, shrunk on and then moved along ``path`` [mm]."""
    motion = ("motion.start=0", "motion.travel=0", f"motion.displacements={[LENGTH, *path]}")
    size = (f"axle.seat_length={LENGTH}", f"wheel.hub_length={LENGTH}", f"friction.options.coefficient={MU}")
    return rings(2, 4.0, "mesh.coarse=20", *size, *motion, *overrides)


def sliding_force(solution: Solution) -> float:
    axle, wheel = bodies(solution.scene)
    return MU * drawn_rings_pressure(axle, wheel) * 2.0 * math.pi * axle.seat_radius * wheel.hub_length


@pytest.mark.parametrize("overrides", [(), ("wheel.temperature=300", "motion.cooling=6", *NO_POISSON)])
def test_force_and_torque_are_lames(overrides: tuple[str, ...], found: Found) -> None:
    """Of the fit in place, and of one that cooled, whatever is pulled afterwards."""
    solution = solved(long_rings([LENGTH - 0.01, LENGTH - 30.0], *overrides))
    force, numbers = sliding_force(solution), holding(solution)
    assert numbers is not None
    assert numbers["displacement_mm"] == LENGTH
    assert found("long fit: torque against Lamé", abs(numbers["torque_N_mm"] / (95.0 * force) - 1.0), 3e-3)
    for key in ("push_off_N", "pull_off_N"):
        assert found(f"long fit: {key} against Lamé", abs(numbers[key] / force - 1.0), 3e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["pulled", "pushed"])
def test_the_wheel_slides_at_what_the_fit_holds(sign: float, found: Found) -> None:
    """Without Poisson's effect, which changes the pressure of an axle that is pulled or pushed by some per cent.

    The seat goes on by 40 mm on either side of the wheel, so that nothing is left when it slides.
    """
    seat = (f"axle.seat_length={LENGTH + 80.0}", "axle.lead_length=0")
    path = [LENGTH + 40.0, *(LENGTH + 40.0 + sign * (at - LENGTH) for at in [*AWAY, LENGTH - 0.5])]
    motion = ("motion.start=0", "motion.travel=0", f"motion.displacements={path}")
    solution = solved(long_rings([], *NO_POISSON, *seat, *motion))
    last = solution.increments[-1]
    assert last.sticking_facets == 0
    numbers = holding(solution)
    assert numbers is not None
    held = numbers["pull_off_N" if sign > 0.0 else "push_off_N"]
    assert found("long fit: force that slides it against what it holds", abs(abs(last.force) / held - 1.0), 3e-3)
    assert (np.abs(solution.force[:-1]) < held).all()


def test_poissons_effect_is_left_out() -> None:
    """A pull makes the hub's and the axle's pressure fall: with nu = 0.3 it slides 2 % below, as documented."""
    solution = solved(long_rings([*AWAY, LENGTH - 0.5]))
    numbers = holding(solution)
    assert numbers is not None
    assert -solution.force.min() / numbers["pull_off_N"] == pytest.approx(0.98, abs=0.01)


def test_a_cone_holds_less_one_way() -> None:
    """Pushed up the cone the slope adds p sin a, pulled off it takes as much: mu cos a +- sin a of the normal force."""
    from verification.test_cone import cone

    record = solved(cone(0.02, 0.12, start=0.5)).increments[0]
    slope = math.atan(0.01)
    assert record.push_off / record.normal_force == pytest.approx(0.12 * math.cos(slope) + math.sin(slope), rel=2e-2)
    assert record.pull_off / record.normal_force == pytest.approx(0.12 * math.cos(slope) - math.sin(slope), rel=2e-2)


def test_the_torque_of_a_long_fit_per_length(found: Found) -> None:
    """A hub on a longer axle, at its middle: mu p 2 pi a^2 of Lamé's p, 0.3 %, from the pressures of the facets."""
    solution = solved(load_scene("long-fit", [*NO_FIELDS, f"friction.options.coefficient={MU}"]))
    axle, wheel = bodies(solution.scene)
    record = solution.increments[-1]
    lengths = np.diff(solution.seat)
    middle = 0.5 * (solution.seat[1:] + solution.seat[:-1])
    per_length = 2.0 * math.pi * axle.seat_radius**2 * MU * record.facets.pressure
    wanted = 2.0 * math.pi * axle.seat_radius**2 * MU * drawn_rings_pressure(axle, wheel)
    inner = np.abs(middle - record.displacement + 0.5 * wheel.hub_length) < 100.0
    assert found("long fit: torque per length at mid-length", abs(per_length[inner].mean() / wanted - 1.0), 3e-3)
    covered = np.clip(np.minimum(solution.seat[1:], 620.0) - np.maximum(solution.seat[:-1], 20.0), 0.0, lengths)
    assert record.torque == pytest.approx(float(per_length @ covered), rel=1e-6)


def test_the_summary_says_what_the_fit_holds() -> None:
    solution = solved(long_rings([LENGTH - 0.01]))
    numbers = summary(solution)
    assert numbers["holding"] == holding(solution)
    line = next(line for line in sentences(numbers) if line.startswith("Holds"))
    assert f"{numbers['holding']['pull_off_N'] / 1e3:.5g} kN pulled off" in line
    assert f"{numbers['holding']['torque_N_mm'] / 1e6:.4g} kN m" in line
