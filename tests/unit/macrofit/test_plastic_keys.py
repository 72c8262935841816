"""Keys of a material that yields: each mistake is one line that names its key; cards; what an elastic body is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from fakes import fake_solution
from small import YIELDING, small_press, solved

from macrofit.cli import main
from macrofit.errors import SceneError
from macrofit.plasticity.material import hardening
from macrofit.results.doubts import LARGE_STRAIN, doubts, past_table
from macrofit.results.summary import sentences, summary
from macrofit.scene import load_scene
from macrofit.scene.material import Material, cards, yield_stress

WITHOUT_HARDENING = [
    ({"yield_stress": "-1"}, "axle.material.yield_stress", "must be positive"),
    ({"yield_stress": "0"}, "axle.material.yield_stress", "must be positive"),
    ({"yield_stress": "nan"}, "axle.material.yield_stress", ""),
    ({"grade": "S355"}, "axle.material.grade", "S355"),
    ({"yield_stress": "4.1"}, "axle.material.yield_stress", "no solid yields so soon"),  # in kN/mm2 or GPa: 0.42
    ({"grade": "'EA1N'", "youngs_modulus": "206e9"}, "axle.material.grade", "no solid yields so soon"),  # in Pa
    ({"hardening": "{law='table', plastic_strain=[0, 1], stress=[0.4, 0.5]}"}, "hardening.stress", "both are in MPa"),
]
NEGATIVE = "must not be negative"
HARDENING = [  # law and keys; the key that is named; what is said
    ("'linear', isotropic=-1", "hardening.isotropic", NEGATIVE),
    ("'linear', kinematic=-1", "hardening.kinematic", NEGATIVE),
    ("'voce', saturation=-5, rate=2", "hardening.saturation", NEGATIVE),
    ("'voce', saturation=5", "hardening", "rate"),
    ("'square'", "hardening", "'square' (one of linear, voce, chaboche, table)"),
    ("'chaboche', moduli=[1e4, 1e3], recalls=[1e2]", "axle.material.hardening", "2 moduli and 1 recalls"),
    ("'chaboche', moduli=[1,1,1,1], recalls=[1,1,1,1]", "hardening.moduli", ""),
    ("'table', plastic_strain=[0, 0.1], stress=[300, 290]", "hardening.stress", "softens"),
    ("'table', plastic_strain=[0, 0.1, 0.1], stress=[300, 400, 500]", "hardening.plastic_strain", "must grow"),
    ("'table', plastic_strain=[0.01, 0.1], stress=[300, 400]", "hardening.plastic_strain", "begin with 0"),
    ("'table', plastic_strain=[0, 0.1], stress=[300, 400, 500]", "axle.material.hardening", "as many of both"),
    ("'table', plastic_strain=[0], stress=[300]", "hardening.plastic_strain", ""),
    ("'table', plastic_strain=[0, 0.1], stress=[310, 400]", "axle.material.yield_stress", "leave it out"),
]
MISTAKES = [
    *WITHOUT_HARDENING,
    *(({"yield_stress": "300", "hardening": f"{{law={law}}}"}, key, said) for law, key, said in HARDENING),
    ({"hardening": "{law='linear', isotropic=100}"}, "axle.material.hardening", "without a yield stress"),
    ({"yield_stress": "300", "hardening": "{isotropic=5}"}, "hardening", "law"),
]


def macrofit(*arguments: object) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


@pytest.mark.parametrize(("keys", "named", "said"), MISTAKES)
def test_a_mistake_is_one_line_with_its_key(keys: dict[str, str], named: str, said: str) -> None:
    changes = [word for key, value in keys.items() for word in ("--set", f"axle.material.{key}={value}")]
    done = macrofit("check", "wheelset", *changes)
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert named in done.stderr
    assert said in done.stderr


def test_a_mesh_too_coarse_for_flow_is_doubtful(tmp_path: Path) -> None:
    """One line for each key, with what to give; refused where no doubt is allowed."""
    steel = [w for body in ("axle", "wheel") for w in ("--set", f"{body}.material.yield_stress=420")]
    coarse = ["--set", "mesh.seat_facet=5", "--set", "mesh.coarse=40", "--set", "motion.travel=20"]
    done = macrofit("run", "wheelset", "-o", tmp_path / "out", "--quiet", "--strict", *steel, *coarse)
    assert done.exit_code == 2
    said = done.stderr.splitlines()[-1]
    for key in ("axle.taper_blend", "wheel.chamfer_blend"):
        assert f"coarse blend: the arc of {key}" in said
    assert "mesh.corner_facet = " in said


@pytest.mark.parametrize("theta", [-1, 1])
def test_theta_is_for_elastic_bodies(theta: int) -> None:
    """... for one that yields in Nitsche's method alone, and not where it is told to stay elastic."""
    steel = ("wheel.material.grade=ER7", f"contact.theta={theta}")
    with pytest.raises(SceneError, match=r"contact\.theta: -?1 is for elastic bodies, and wheel\.material yields"):
        load_scene("wheelset", steel)
    load_scene("wheelset", [*steel, "contact.formulation=penalty"])
    load_scene("wheelset", [*steel, "wheel.material.elastic=true"])


def test_every_grade_has_a_card_with_its_source() -> None:
    from typing import get_args

    from macrofit.scene.material import Grade

    assert set(cards()) == set(get_args(Grade))
    for grade, card in cards().items():
        assert float(card["yield_stress"]) > 200.0, grade
        assert "EN 132" in str(card["source"])
        law = hardening(Material(grade=grade))
        assert law is not None
        assert law.yield_stress == card["yield_stress"]
        assert str(card["yield_stress"]).removesuffix(".0") in str(card["source"])


def test_what_is_stated_beats_the_card() -> None:
    assert yield_stress(Material(grade="EA4T")) == 420.0
    assert yield_stress(Material(grade="EA4T", yield_stress=400.0)) == 400.0
    assert yield_stress(Material()) is None
    assert hardening(Material(grade="EA4T", elastic=True)) is None


def test_an_elastic_body_says_how_far_beyond_yield_it_is() -> None:
    """The value is its largest stress over the yield stress; a body that yields, or states nothing, says nothing."""
    scene = small_press("motion.travel=40", "output.stress=true", "axle.material.grade=EA1N",
                        "axle.material.elastic=true")  # fmt: skip
    solution = solved(scene)
    peak = solution.max_von_mises["axle"]
    assert set(solution.beyond_yield) == {"axle"}
    assert not solution.flowed
    zone = solution.beyond_yield["axle"]
    assert zone.value == peak.value / 320.0 > 1.5
    assert (zone.r_mm, zone.z_mm) == (peak.r_mm, peak.z_mm)
    assert 3.0 < zone.depth_mm < 60.0
    assert 20.0 < zone.area_mm2 < 5e3
    numbers = summary(solution)
    assert numbers["beyond_yield"]["axle"]["stress_over_yield"] == zone.value
    told = [sentence for sentence in doubts(solution) if sentence.startswith("beyond yield")]
    assert len(told) == 1
    assert f"{zone.value:.3g} times" in told[0]
    assert any("beyond yield" in line for line in sentences(numbers))


def test_an_elastic_body_below_yield_is_not_doubted() -> None:
    scene = small_press("motion.travel=40", "output.stress=true", "axle.material.yield_stress=5000",
                        "axle.material.elastic=true")  # fmt: skip
    assert not solved(scene).beyond_yield


def test_elastic_steel_has_the_bits_of_no_steel() -> None:
    steel = [f"{body}.material.{key}" for body in ("axle", "wheel") for key in ("grade=EA1N", "elastic=true")]
    assert (solved(small_press(*steel)).force == solved(small_press()).force).all()


@pytest.mark.parametrize("stress", [True, False])
def test_large_strain_is_doubtful_with_stresses_and_without(stress: bool) -> None:
    """A run that asks for no stresses must not flow without limit in silence: soft steel in a rough fit."""
    soft = [f"{body}.material.yield_stress=150" for body in ("axle", "wheel")]
    rough = ("motion.travel=30", "friction.options.coefficient=0.3", f"output.stress={str(stress).lower()}")
    scene = small_press(*soft, *rough)
    solution = solved(scene)
    most = max(record.plastic_strain for record in solution.increments)
    assert most > LARGE_STRAIN
    told = [sentence for sentence in doubts(solution) if sentence.startswith("large strain")]
    assert len(told) == 1
    assert f"{most:.2g}" in told[0]
    assert not [sentence for sentence in doubts(fake_solution()) if sentence.startswith("large strain")]


@pytest.mark.parametrize("stress", [True, False])
def test_flow_past_the_end_of_a_table_is_doubtful(stress: bool) -> None:
    """With its strain and the end of the table; not where the table reaches on, is level there, or is not used."""
    table = 'axle.material.hardening={{law="table", plastic_strain=[0, {}], stress=[300, {}]}}'
    scene = small_press("motion.travel=30", table.format(1e-4, 301), f"output.stress={str(stress).lower()}")
    solution = solved(scene)
    most = max(record.plastic_strain for record in solution.increments)
    assert most > 1e-4
    told = [sentence for sentence in doubts(solution) if sentence.startswith("past the table")]
    assert len(told) == 1
    assert f"the axle flowed by up to {most:.3g}, and axle.material.hardening ends at 0.0001" in told[0]
    assert list(past_table(scene, {"axle": float("nan"), "wheel": 0.0}))
    for other in (table.format(most, 301), table.format(1e-4, 300)):
        assert not list(past_table(small_press(other), {"axle": most, "wheel": 1.0}))
    elastic = small_press(table.format(1e-4, 301), "axle.material.elastic=true")
    assert not list(past_table(elastic, {"axle": most, "wheel": most}))


def test_a_run_writes_what_flowed(tmp_path: Path) -> None:
    """summary.json, its sentences and the VTK fields; the fields hold the largest plastic strain of the end."""
    import meshio

    changes = [word for change in (*YIELDING, "mesh.seat_facet=5", "mesh.bore_facet=4.7", "mesh.coarse=40",
               "motion.start=15", "motion.travel=40", "motion.increment=5") for word in ("--set", change)]  # fmt: skip
    done = macrofit("run", "wheelset", "-o", tmp_path / "run", "--quiet", *changes)
    assert done.exit_code == 0, done.stderr
    numbers = json.loads((tmp_path / "run" / "summary.json").read_text())
    for body in ("axle", "wheel"):
        zone = numbers["plastic_strain"][body]
        assert set(zone) == {"value", "r_mm", "z_mm", "depth_mm", "area_mm2"}
        assert zone["value"] > 5e-3
        file = sorted((tmp_path / "run" / "fields").glob(f"{body}*.vtu"))[-1]
        field = meshio.read(file).point_data["plastic_strain"]
        assert field.min() == 0.0
        assert 0.5 * zone["value"] < field.max() < 2.0 * zone["value"]
    assert numbers["plastic_work_N_mm"] > 1e5
