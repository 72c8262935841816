"""Profiles of seat and bore on top of the drawn radii, without friction.

The gap changes and the mesh does not: what the profile gives locally is Lamé's pressure of the local interference,
where the profile is slow against the decay of a disturbance, which a hub of these radii forgets within 150 mm.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from found import Found
from small import NO_FIELDS, small_press, solved
from verification.closed_forms import drawn_rings_pressure
from verification.test_lame import bodies, rings

from macrofit.scene import Scene, load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

SEAT = np.linspace(0.0, 640.0, 65)  # mm, of long-fit
MEASURED = 8.0 * np.sin(2.0 * np.pi * SEAT / 1500.0) - 4e-5 * (SEAT - 320.0) ** 2 + SEAT / 100.0 + 2.0
MEASURED = np.round(MEASURED, 2)  # um: what is left of a record once waves below 500 mm are filtered out
WIDE = ("axle.seat_radius=96.0", "wheel.bore_radius=95.0")
SHAPES = {
    "taper 1:300": ((SEAT - 320.0) / 600.0 * 1e3, WIDE),  # of the diameter: 1.07 mm of the radius over the seat
    "barrel of 40 um": (40.0 * (1.0 - ((SEAT - 320.0) / 320.0) ** 2), ()),
    "as measured": (MEASURED, ()),
}
"""Deviations along the seat [um], and the fit they belong to."""


def write(path: Path, z: np.ndarray, deviation: np.ndarray, head: str = "z_mm,deviation_um") -> Path:
    path.write_text("\n".join([head, *(f"{a!r},{b!r}" for a, b in zip(z.tolist(), deviation.tolist(), strict=True))]))
    return path


def long_fit(*overrides: str) -> Solution:
    return solved(load_scene("long-fit", [*NO_FIELDS, *overrides]))


def local_error(solution: Solution, deviation: np.ndarray, within: float = 100.0) -> float:
    """Largest relative error of the pressure against Lamé's of the local interference, ``within`` mm of the middle."""
    axle, wheel = bodies(solution.scene)
    drawn = axle.seat_radius - wheel.bore_radius
    middle, record = 0.5 * (solution.seat[1:] + solution.seat[:-1]), solution.increments[-1]
    inner = np.abs(middle - record.displacement + 0.5 * wheel.hub_length) < within
    local = drawn_rings_pressure(axle, wheel) * (1.0 + 1e-3 * deviation / drawn)
    return float(np.abs(record.facets.pressure / local - 1.0)[inner].max())


@pytest.mark.parametrize("shape", SHAPES)
def test_the_pressure_is_locally_lames(shape: str, tmp_path: Path, found: Found) -> None:
    """On the seat, and turned over on the bore, where a wider radius is less interference.

    The bar of 0.5 % is the issue's. Without a profile the same fit has 0.03 %; the rest is what a slow profile still
    bends, and it grows as its curvature: waves of 400 mm and 8 um have 1 %.
    """
    deviation, radii = SHAPES[shape]
    seat = long_fit(*radii, f"axle.profile={write(tmp_path / 'seat.csv', SEAT, deviation)}")
    _, wheel = bodies(seat.scene)
    middle = 0.5 * (seat.seat[1:] + seat.seat[:-1])
    along = np.interp(middle, SEAT, deviation)
    assert found(f"profile, {shape}: pressure against local Lamé, seat", local_error(seat, along), 5e-3)
    depth = np.linspace(0.0, wheel.hub_length, 121)  # from the leading face into the bore
    place = seat.scene.displacements[-1] - depth  # on the seat
    bore = write(tmp_path / "bore.csv", depth, -np.interp(place, SEAT, deviation))
    error = local_error(long_fit(*radii, f"wheel.profile={bore}"), along)
    assert found(f"profile, {shape}: pressure against local Lamé, bore", error, 5e-3)


def pressed_hub(*overrides: str) -> Scene:
    """The 180 mm hub on a straight axle, without friction."""
    straight = ("axle.seat_length=180", "wheel.hub_length=180", "motion.start=180", "motion.travel=180")
    return rings(2, 6.0, *straight, *overrides)


def test_no_deviation_is_no_profile_to_the_bit(tmp_path: Path) -> None:
    """Of a hub of 180 mm in place, and of a wheel pressed on with friction over taper and chamfer."""
    zero = write(tmp_path / "zero.csv", np.array([-20.0, 77.7, 400.0]), np.zeros(3))
    keys = (f"axle.profile={zero}", f"wheel.profile={zero}")
    for plain, profiled in ((pressed_hub(), pressed_hub(*keys)), (small_press(), small_press(*keys))):
        with_it, without = solve(profiled), solved(plain)
        assert [record.normal_force for record in with_it.increments] == [r.normal_force for r in without.increments]
        assert (with_it.force == without.force).all()
        assert (with_it.increments[-1].facets.pressure == without.increments[-1].facets.pressure).all()


def test_a_constant_deviation_is_another_interference(tmp_path: Path, found: Found) -> None:
    """30 um more on the seat, or less on the bore, are 30 um more in the gap.

    The normal force of plane rings does not know the seat's radius itself: pressure falls with it, the area grows.
    """
    up = write(tmp_path / "up.csv", np.array([0.0, 180.0]), np.array([30.0, 30.0]))
    down = write(tmp_path / "down.csv", np.array([0.0, 180.0]), np.array([-30.0, -30.0]))
    normal = [
        solved(pressed_hub(*keys)).increments[-1].normal_force
        for keys in ((f"axle.profile={up}",), (f"wheel.profile={down}",), ("axle.seat_radius=95.03",), ())
    ]
    assert normal[0] == pytest.approx(normal[1], rel=1e-12)
    assert normal[0] / normal[3] == pytest.approx(1.1, rel=1e-9)  # 0.33 for 0.3 mm
    assert found("profile of 30 um against a drawn radius: normal force", abs(normal[0] / normal[2] - 1.0), 1e-8)


def test_a_taper_about_the_middle_keeps_the_normal_force(tmp_path: Path, found: Found) -> None:
    """By symmetry: the normal force of a 180 mm hub is that on a straight axle, 1.5e-5 for the axial support."""
    z = np.linspace(0.0, 180.0, 19)
    taper = write(tmp_path / "taper.csv", z, (z - 90.0) / 600.0 * 1e3)
    straight, tapered = (
        solved(pressed_hub(*keys)).increments[-1].normal_force for keys in ((), (f"axle.profile={taper}",))
    )
    assert found("profile, taper about the middle: normal force", abs(tapered / straight - 1.0), 1e-4)


def test_the_pressure_of_waves_grows_with_them(tmp_path: Path) -> None:
    """Superposition, for waves of 60 mm, far too short for Lamé: half the waves make half the change."""
    waves = 4.0 * np.sin(2.0 * np.pi * SEAT / 60.0)
    half, whole, plain = (
        long_fit(*(() if file is None else (f"axle.profile={file}",))).increments[-1].facets.pressure
        for file in (write(tmp_path / "half.csv", SEAT, 0.5 * waves), write(tmp_path / "whole.csv", SEAT, waves), None)
    )
    change = whole - plain
    assert np.abs(change).max() > 2.0
    np.testing.assert_allclose(half - plain, 0.5 * change, atol=1e-3 * np.abs(change).max())
