"""`macrofit service`: its folder, its lines, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mpi4py import MPI
from serving import SHORT, read_table, service

from macrofit.base import progress
from macrofit.cli import main
from macrofit.results.folder import SCENE
from macrofit.scene import load_scene
from macrofit.scene.keys import ServiceKeys
from macrofit.service import output, run
from macrofit.service.bonded import _without, _without_power
from macrofit.service.output.numbers import _shares_said, unit_doubts
from macrofit.service.run import bonded_only, carry_out_service


def test_folder_has_numbers_tables_and_a_figure(tmp_path: Path) -> None:
    folder = tmp_path / "served"
    result = service(folder)
    assert result.exit_code == 0, result.stderr
    found = json.loads((folder / output.NUMBERS).read_text())
    seat, wear = read_table(folder / output.SEAT), read_table(folder / output.FRETTING)
    assert (folder / "service.png").stat().st_size > 10_000
    assert found["friction"]["steps"] == 9
    assert found["endurance"]["crossland"]["value"] == pytest.approx(seat["crossland"].max())
    assert np.diff(wear["z_mm"]).min() > 0.0
    parts = (seat["largest_axial_stress_MPa"], wear["largest_shear_MPa"], wear["axial_slip_range_mm"])
    assert 0.1 < seat["ruiz_MPa2_mm"].max() / np.prod([part.max() for part in parts]) <= 1.0
    assert (wear["largest_shear_MPa"] <= 0.2 * wear["largest_pressure_MPa"] + 1e-3).all()
    for word in ("Released", "Revolution 3", "Front edge", "Inner slip", "Friction work", "Share of limit"):
        assert word in result.stdout


def test_bonded_solution_takes_no_press_and_replaces_what_was_there(tmp_path: Path) -> None:
    folder = tmp_path / "served"
    assert service(folder).exit_code == 0
    result = service(folder, bonded=True)
    assert result.exit_code == 0, result.stderr
    found = json.loads((folder / output.NUMBERS).read_text())
    assert found["friction"] is None
    assert 1.0 < found["bonded"]["inner"]["stress_concentration"] < 3.0
    assert not (folder / output.FRETTING).exists()


@pytest.mark.parametrize(
    ("more", "edge", "why"),
    [
        ((), "Front", "the last facet is 1.3 mm beside the hub, and it is taken 4 mm beside"),
        (("service.journal_force=0", "service.journal_moment=0"), "Inner", "nothing bends the axle there"),
    ],
)
def test_bonded_solution_says_why_there_is_no_concentration(
    tmp_path: Path, more: tuple[str, ...], edge: str, why: str
) -> None:
    result = service(tmp_path / "bonded", *more, bonded=True)
    assert result.exit_code == 0, result.stderr
    line = next(line for line in result.stdout.splitlines() if line.startswith(f"{edge} edge"))
    assert f"bonded: no concentration, for {why}" in line
    found = json.loads((tmp_path / "bonded" / output.NUMBERS).read_text())["bonded"][edge.lower()]
    assert found["stress_concentration"] is None
    assert found["no_concentration_because"] == why


def test_hub_that_reaches_the_end_of_the_seat_is_said_to() -> None:
    assert _without(98.0, -1.0) == "the hub reaches the end of the seat, and it is taken 4 mm beside"


@pytest.mark.parametrize(
    ("nominal", "power", "why"),
    [
        (98.0, -0.4555, None),
        (98.0, -1.0, "the shear grows as the distance to the power -1.00, which no edge does; lower mesh.seat_facet"),
        (98.0, 0.0, "the shear does not grow towards the edge"),
        (98.0, float("nan"), "fewer than 4 points are 2 to 8 mm from the edge"),
        (0.0, float("nan"), "nothing bends the axle there"),
    ],
)
def test_a_power_of_the_shear_that_no_edge_has_is_not_said(nominal: float, power: float, why: str | None) -> None:
    assert _without_power(nominal, power) == why


def test_bonded_solution_says_why_the_shear_has_no_power(tmp_path: Path) -> None:
    """Of three facets the power was -1.58; that of a right angle is -0.46."""
    result = service(tmp_path / "bonded", "mesh.seat_facet=2.5", bonded=True)
    assert result.exit_code == 0, result.stderr
    front, inner = (line for line in result.stdout.splitlines() if " edge " in line)
    assert inner.endswith(
        ", no power of the shear, for the shear grows as the distance to the power -1.58, which no edge "
        "does; lower mesh.seat_facet"
    )
    assert "shear as the distance to the power -0." in front
    found = json.loads((tmp_path / "bonded" / output.NUMBERS).read_text())["bonded"]
    assert found["inner"]["shear_power"] is None
    assert found["inner"]["no_shear_power_because"] in inner
    assert -1.0 < found["front"]["shear_power"] < 0.0
    assert found["front"]["no_shear_power_because"] is None
    page = CliRunner().invoke(main, ["report", str(tmp_path / "bonded")])
    assert page.exit_code == 0
    assert "no power of the shear, for the shear grows" in (tmp_path / "bonded" / "report.html").read_text()


def test_what_takes_long_says_how_far_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    quick = ("service.revolutions=1", "service.steps=3")
    assert "Turning" not in service(tmp_path / "quick", *quick).stdout
    monkeypatch.setattr(run, "Paced", lambda say: say)  # as if each step took seconds
    told = service(tmp_path / "long", *quick).stdout.splitlines()
    assert "Pressed         to 120 of 180 mm" in told
    assert "Turning         33% of the loads at 120 degrees" in told
    assert "Turning         100% of the loads at 240 degrees of revolution 1" in told


def test_progress_is_paced(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, told = iter([0.0, 1.0, 5.5, 6.0, 11.0]), list[str]()
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    tell = progress.Paced(told.append)
    for text in "abcd":
        tell(text)
    assert told == ["b", "d"]


@pytest.mark.parametrize("load", ["journal_force=1e5", "torque=1e6", "lateral_force=1e4"])
def test_bonded_solution_factors_the_harmonic_that_bends_alone(load: str) -> None:
    found = bonded_only(load_scene("wheelset", [*SHORT, f"service.{load}"]))
    assert list(found.bonded.harmonics) == [1]
    for body in (found.whole.fit.axle, found.whole.fit.wheel):
        assert list(body._factors) == [1]


def test_loads_scale_the_nominal_stress(tmp_path: Path) -> None:
    service(tmp_path / "one", bonded=True)
    service(tmp_path / "two", "service.journal_force=220e3", "service.journal_moment=12e7", bonded=True)
    one, two = (read_table(tmp_path / name / output.SEAT) for name in ("one", "two"))
    for column in ("nominal_stress_MPa", "bonded_bending_stress_MPa", "bonded_shear_MPa"):
        assert two[column] == pytest.approx(2.0 * one[column], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("load", "doubt"),
    [
        ("service.torque=1e7", "of the slip, around the axle"),
        ("service.torque=1e8", "the work of the loads is not that of friction"),
        ("service.journal_moment=2e9", "the wheel lifts off as it turns"),
    ],
)
def test_a_wheel_that_does_not_stay_is_doubted(tmp_path: Path, load: str, doubt: str) -> None:
    result = service(tmp_path / "served", load)
    assert result.exit_code == 0, result.stderr
    assert any(
        doubt in sentence for sentence in json.loads((tmp_path / "served" / output.NUMBERS).read_text())["doubts"]
    )
    assert "Doubtful: " in result.stdout


def test_slip_of_a_wheel_that_lifts_off_everywhere_is_not_known(tmp_path: Path) -> None:
    # places that open slip freely; a largest value over none of them is no slip of 0
    result = service(tmp_path / "served", "service.journal_moment=2e9")
    found = json.loads((tmp_path / "served" / output.NUMBERS).read_text())["friction"]
    assert found["slip_range_mm"] == {"front": None, "inner": None}
    assert found["slip_left_by_revolution"] == found["wave_error"] == {"axial": None, "around": None}
    assert found["friction_work_N_mm"] > 0.0
    assert "Front slip      not known, no place there stays in contact all around" in result.stdout
    assert "Steady          not known" in result.stdout


@pytest.mark.parametrize(
    ("nominal", "odd"), [(0.0, False), (0.9, True), (1.0, False), (110.0, False), (250.0, False), (251.0, True)]
)
def test_loads_that_no_axle_has_at_work_are_doubted(nominal: float, odd: bool) -> None:
    assert [doubt.partition(":")[0] for doubt in unit_doubts(nominal)] == ["odd loads"] * odd


def test_a_wheel_that_lifts_off_is_turned_as_often_as_asked(tmp_path: Path) -> None:
    # where no place stays in contact nothing is left to measure, which is no steady state
    load = ("service.journal_moment=2e9", "service.revolutions=2", "service.periodicity=0.5")
    result = service(tmp_path / "served", *load)
    found = json.loads((tmp_path / "served" / output.NUMBERS).read_text())
    assert found["turned_revolutions"] == 2.0
    assert found["friction"]["slip_left_of_revolutions"] == [None, None]
    assert "Revolution 2" in result.stdout
    assert "no place stays in contact all around" in result.stdout


def test_the_scene_that_is_kept_has_the_loads(tmp_path: Path) -> None:
    meshed = [key for key in SHORT if not key.startswith("service.")]
    carry_out_service(load_scene("wheelset", meshed), MPI.COMM_SELF, tmp_path / "served", bonded=True, quiet=True)
    assert load_scene(tmp_path / "served" / SCENE).service == ServiceKeys()


def test_a_rail_beside_the_rim_is_refused(tmp_path: Path) -> None:
    result = service(tmp_path / "served", "service.rim_offset=1e6", bonded=True)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "service.rim_offset: 1e+06 mm is beyond the rim, which ends " in result.stderr


def test_each_criterion_is_said_at_its_own_place() -> None:
    found = {"crossland": {"value": 1.1, "z_mm": 163.8}, "dang_van": {"value": 2.58, "z_mm": 4.0}}
    apart = _shares_said(found | {"findley": {"value": 2.67, "z_mm": 4.0}})
    assert apart.startswith("Crossland 1.10 at z = 163.8 mm, Dang Van 2.58 at z = 4.0 mm, Findley 2.67 at z = 4.0 mm")
    together = _shares_said({name: {"value": 0.5, "z_mm": 6.0} for name in ("crossland", "dang_van", "findley")})
    assert together == "Crossland 0.50, Dang Van 0.50, Findley 0.50 of a smooth surface, worst at z = 6.0 mm"


@pytest.mark.parametrize("resumed", [False, True])
def test_strain_too_large_for_the_press_is_doubted_in_service_too(tmp_path: Path, resumed: bool) -> None:
    table = 'axle.material.hardening={law="table", plastic_strain=[0, 0.01], stress=[150, 151]}'
    steel = (table, "wheel.bore_radius=94.6")
    assert service(tmp_path / "served", *steel).exit_code == 0
    if resumed:
        (tmp_path / "served" / output.NUMBERS).unlink()
        assert service(tmp_path / "served", *steel, resume=True).exit_code == 0
    found = json.loads((tmp_path / "served" / output.NUMBERS).read_text())["doubts"]
    for doubt in ("large strain: the steel flowed by 0.", "past the table: the axle flowed by up to 0."):
        assert any(sentence.startswith(doubt) for sentence in found)


@pytest.mark.parametrize(
    ("scene", "more", "said"),
    [
        ("wheelset", ("service.harmonics=0",), "service.harmonics: 0 must not be below 1"),
        ("wheelset", ("service.torsion_limit=250",), "must be above 1/2 and below 1 of bending_limit"),
        ("wheelset", ("friction.options.coefficient=0",), "friction: without it nothing holds the wheel in service"),
    ],
)
def test_mistakes_end_in_one_line(tmp_path: Path, scene: str, more: tuple[str, ...], said: str) -> None:
    result = service(tmp_path / "served", *more, scene=scene)
    assert result.exit_code == 2
    assert said in result.stderr
    assert result.stderr.strip().count("\n") == 0


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    result = service(tmp_path)
    assert result.exit_code == 2
    assert "holds no run of macrofit" in result.stderr
