"""Nominal stress of a seat held against what its steel bears for ever."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from serving import SHORT, service

from macrofit.scene import load_scene
from macrofit.scene.keys import ServiceKeys
from macrofit.scene.material import Material, cards
from macrofit.service.fatigue.limits import limits_of, seat_limit
from macrofit.service.output import NUMBERS
from macrofit.service.output.numbers import numbers
from macrofit.service.run import bonded_only

GRADE = ("axle.material.elastic=true", "axle.material.grade=EA1N")


def judged(folder: Path, *more: str) -> tuple[dict[str, object], str]:
    result = service(folder, *more, bonded=True)
    assert result.exit_code == 0, result.stderr
    verdict = json.loads((folder / NUMBERS).read_text())["verdict"]
    assert verdict["sentence"] in result.stdout
    return verdict, result.stdout


def test_axle_grades_have_limits_with_their_source() -> None:
    for grade, card in cards().items():
        assert ("fatigue_seat" in card) == grade.startswith("EA")
        if grade.startswith("EA"):
            for name in ("bending", "seat", "hollow_seat", "safety"):
                assert f"{card[f'fatigue_{name}']:g}" in str(card["fatigue_source"])
            assert card["fatigue_known"] == "from memory: confirm against the text"


@pytest.mark.parametrize(
    ("force", "moment", "doubted"), [(110.0, 60.0, True), (110e3, 6e7, False), (0.0, 0.0, False), (110e3, 6e8, True)]
)
def test_loads_in_kilonewtons_or_of_another_axle_are_doubted(force: float, moment: float, doubted: bool) -> None:
    keys = (f"service.journal_force={force}", f"service.journal_moment={moment}")
    found = numbers(bonded_only(load_scene("wheelset", [*SHORT, *keys])))
    assert ["service.journal_force in N" in doubt for doubt in found["doubts"]] == [True] * doubted


def test_what_is_given_beats_the_card() -> None:
    steel = Material(grade="EA1N")
    found = seat_limit(ServiceKeys(seat_limit=95.0), steel, hollow=False)
    assert found is not None
    assert (found.stress, found.safety, found.known) == (95.0, 1.2, "as given")
    other = seat_limit(ServiceKeys(safety=1.5), steel, hollow=True)
    assert other is not None
    assert (other.stress, other.safety) == (110.0, 1.5)
    assert seat_limit(ServiceKeys(), Material(), hollow=False) is None
    assert limits_of(ServiceKeys(), steel).bending == 200.0


@pytest.mark.parametrize(
    ("loads", "word"), [(("service.journal_force=9e4", "service.journal_moment=5e7"), "accepted"), ((), "refused")]
)
def test_verdict_is_that_of_the_nominal_stress(tmp_path: Path, loads: tuple[str, ...], word: str) -> None:
    verdict, said = judged(tmp_path / "served", *GRADE, *loads)
    force, moment = (9e4, 5e7) if loads else (110e3, 6e7)
    # solid axle of 190 mm; the front end is 40 mm before the seat, the rim's middle stands over the hub's
    assert verdict["axle"] == "solid"
    stress = verdict["nominal_stress_MPa"]
    assert isinstance(stress, float)
    arm = stress * math.pi * 190.0**3 / 32.0 - moment
    assert 40.0 < arm / force < 230.0
    assert verdict["limit_MPa"] == 120.0
    assert verdict["word"] == word == ("accepted" if stress <= 100.0 else "refused")
    assert f"Verdict         {word} by EN 13103-1" in said
    assert "permitted 100.0 MPa (120 / 1.2; from memory: confirm against the text)" in said


def test_hollow_axle_bears_less_and_torque_counts(tmp_path: Path) -> None:
    hollow, _ = judged(tmp_path / "hollow", *GRADE, "axle.inner_radius=30")
    assert (hollow["axle"], hollow["limit_MPa"]) == ("hollow", 110.0)
    solid, _ = judged(tmp_path / "solid")
    twisted, _ = judged(tmp_path / "twisted", "service.torque=5e7")
    ratio = math.hypot(1.0, 5e7 / (float(str(solid["nominal_stress_MPa"])) * math.pi * 190.0**3 / 32.0))
    assert float(str(twisted["nominal_stress_MPa"])) == pytest.approx(
        ratio * float(str(solid["nominal_stress_MPa"])), rel=1e-3
    )


def test_without_a_grade_nothing_is_judged(tmp_path: Path) -> None:
    verdict, said = judged(tmp_path / "served")
    assert verdict["word"] == "not judged"
    assert verdict["limit_MPa"] is None
    assert "state axle.material.grade, EA1N or EA4T, or service.seat_limit" in said


def test_steel_of_wheels_has_no_limit_of_a_seat(tmp_path: Path) -> None:
    verdict, said = judged(tmp_path / "served", "axle.material.grade=ER7", "axle.material.elastic=true")
    assert verdict["word"] == "not judged"
    assert "EA1N or EA4T, or service.seat_limit" in said
