"""A run is judged: each kind of doubt is raised by what causes it, and by nothing else.

The right values beside them are those of `python -m tests.benchmarks doubts`.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from fakes import fake_solution
from small import NO_FIELDS, small_press, solved

from macrofit.cli import main
from macrofit.errors import SceneError
from macrofit.results.doubts import doubtful_runs, doubts, interpenetration, large_strain
from macrofit.results.foresight import foreseen
from macrofit.scene import Scene, load_scene, scene_names
from macrofit.solution import Solution, energy_balance

HUB = """
axle   = { seat_radius = 50.0, seat_length = 60.0, taper_length = 8.0, taper_height = 0.4, taper_blend = 100.0 }
wheel  = { bore_radius = 49.95, hub_length = 60.0, hub_outer_radius = 90.0, chamfer_length = 5.0, chamfer_height = 0.5,
           chamfer_blend = 80.0 }
mesh   = { corner_facet = 0.5 }
motion = { travel = 20.0, increment = 1.0 }
output = { fields_at = [] }
friction = { options = { coefficient = 0.12 } }
"""
GRADED = ("axle.material.grade=EA4T", "motion.increment=0.5")
STEEL = 'axle.material.hardening={{law="{}", {}}}'
QUICK = ("motion.travel=20", "motion.increment=10", "mesh.seat_facet=4", *NO_FIELDS)


def macrofit(*arguments: object) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


def hub(folder: Path, *overrides: str) -> Scene:
    (folder / "hub.toml").write_text(HUB.replace("chamfer_height = 0.5,\n          ", "chamfer_height = 0.5,"))
    return load_scene(folder / "hub.toml", overrides)


def kinds(sentences: list[str]) -> set[str]:
    return {sentence.partition(":")[0] for sentence in sentences}


@pytest.mark.parametrize("name", scene_names())
def test_no_built_in_scene_is_doubtful(name: str) -> None:
    """Before a run; `press-and-pull` and `wheelset` are run whole by the verification."""
    assert foreseen(load_scene(name)) == []


@pytest.mark.parametrize("name", ["lame-rings", "contact-patch", "hertz-sphere", "push-out"])
def test_no_built_in_run_is_doubtful(name: str) -> None:
    assert doubts(solved(load_scene(name, NO_FIELDS))) == []


@pytest.mark.parametrize(
    ("overrides", "kind"),
    [
        ((), ""),
        (("mesh.corner_facet=1.0",), "coarse blend"),
        (("mesh.seat_facet=6.0",), "too few facets"),
        (("mesh.bore_facet=20.0",), "too few facets"),
        (("motion.increment=5.0",), "long steps"),
        (("motion.increment=5.0", "output.stress=false"), ""),
        (("axle.taper_blend=0",), "sharp corners"),
        (("wheel.chamfer_blend=0",), "sharp corners"),
        (("axle.taper_length=0", "axle.taper_height=0", "axle.taper_blend=0"), "sharp corners"),
        (
            ("axle.taper_blend=0", "motion.start=20.0", "motion.travel=30.0"),
            "sharp corners",
        ),  # a hub of 60 mm covers the seat's start
        (("axle.taper_blend=0", "axle.seat_length=100.0", "motion.start=80.0", "motion.travel=90.0"), ""),
        (("wheel.chamfer_blend=0", "motion.start=20.0"), ""),  # nothing moves
        (("axle.material.poisson_ratio=0.49",), ""),
        (("axle.material.youngs_modulus=70e3",), ""),
        (("axle.material.youngs_modulus=206",), "odd modulus"),
        (("wheel.material.youngs_modulus=206e9",), "odd modulus"),
        (("wheel.material.yield_stress=420e6", "motion.increment=0.5"), "odd yield stress"),
        (
            (
                "wheel.material.yield_stress=400",
                'wheel.material.hardening={law="linear", kinematic=5e6}',
                "motion.increment=0.5",
            ),
            "odd hardening",
        ),
        (("mesh.order=1", "output.stress=false"), ""),
        (("mesh.order=1",), "stress of order 1"),
        (("mesh.order=1", "output.stress=false", "axle.material.poisson_ratio=0.49"), "locking"),
        (("contact.gamma0=0.1",), "weak contact"),
        (("contact.gamma0=0.1", "contact.theta=-1"), ""),
        (("wheel.bore_radius=50.1",), "clearance"),
        (("wheel.material.yield_stress=400", "motion.increment=0.5"), ""),
        (("wheel.material.yield_stress=400", "motion.increment=1.0"), "long steps for flow"),
        (
            ("axle.material.grade=EA4T", "mesh.order=1", "motion.increment=0.5", "output.stress=false"),
            "flow of order 1",
        ),
        (GRADED, ""),  # its card
        ((*GRADED, "axle.material.yield_stress=420"), ""),
        ((*GRADED, "axle.material.yield_stress=400"), "weaker than its grade"),
        ((*GRADED, "axle.material.elastic=true", "axle.material.yield_stress=400"), "weaker than its grade"),
        ((*GRADED, STEEL.format("table", "plastic_strain=[0, 0.05], stress=[300, 450]")), "weaker than its grade"),
        ((*GRADED, STEEL.format("table", "plastic_strain=[0, 0.002], stress=[300, 420]")), ""),  # Rp0.2 is the card's
        ((*GRADED, "axle.material.yield_stress=400", STEEL.format("linear", "kinematic=1e4")), ""),
        ((*GRADED, "axle.material.yield_stress=400", STEEL.format("chaboche", "moduli=[12e3], recalls=[150]")), ""),
        (
            (*GRADED, "axle.material.yield_stress=400", STEEL.format("chaboche", "moduli=[12e3], recalls=[300]")),
            "weaker than its grade",
        ),  # C / g (1 - exp(-0.002 g)) is 18.0 MPa with g = 300, and 20.7 MPa with 150
        (("wheel.material.grade=ER8", "wheel.material.elastic=true", "mesh.order=1", "output.stress=false"), ""),
    ],
)
def test_what_a_scene_foretells(overrides: tuple[str, ...], kind: str, tmp_path: Path) -> None:
    assert kinds(foreseen(hub(tmp_path, *overrides))) == ({kind} if kind else set())


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ((), False),
        (("contact.formulation=penalty",), False),
        (("contact.formulation=penalty", "contact.penalty_stiffness=206e3"), True),
        (("contact.formulation=penalty", "contact.penalty_stiffness=2060"), True),
    ],
)
def test_interpenetration_is_measured(overrides: tuple[str, ...], told: bool) -> None:
    """A penalty of E per mm leaves 2 % of the interference and a force 0.5 % low; of E / 100, most of it."""
    solution = solved(small_press(*overrides))
    assert ("interpenetration" in kinds(doubts(solution))) is told
    assert (interpenetration(solution) > 0.01) is told


def test_no_interference_is_no_negative_clearance(tmp_path: Path) -> None:
    told = [sentence for sentence in foreseen(hub(tmp_path, "wheel.bore_radius=50")) if "clearance" in sentence]
    assert "the bore is 0 mm wider" in told[0]


@pytest.mark.parametrize(
    ("override", "key"),
    [
        (("contact.gamma0=1e-300",), "contact.gamma0"),
        (("contact.formulation=penalty", "contact.penalty_stiffness=1e-3"), "contact.penalty_stiffness"),
    ],
)
def test_contact_that_is_not_enforced_is_refused(override: tuple[str, ...], key: str) -> None:
    with pytest.raises(SceneError, match=key):
        small_press(*override)


def test_energy_balance_is_judged() -> None:
    solution = dataclasses.replace(fake_solution(), energy_balance=0.06)
    assert "energy balance" in kinds(doubts(solution))
    assert "energy balance" not in kinds(doubts(fake_solution()))
    assert "energy balance" in kinds(doubts(dataclasses.replace(solution, energy_balance=float("nan"))))


def test_partial_slip_needs_no_short_steps() -> None:
    """Where slip spreads under a constant bound, one step knows the work of the press as well as ten: no doubt."""
    works = []
    for steps in (1, 10):
        path = np.linspace(380.0, 380.2, steps + 1).tolist()
        solution = solved(load_scene("push-out", [*NO_FIELDS, f"motion.displacements={path}"]))
        assert not doubts(solution)
        assert solution.energy_balance < 1e-4  # 0.4 and 0.07, were the whole of the last force taken
        works.append(sum(record.work for record in solution.increments[1:]))
    assert works[0] == pytest.approx(works[1], rel=5e-3)  # the mean of the forces is 25 % more in one step


def test_nothing_moved_without_friction_is_no_imbalance() -> None:
    solution = solved(load_scene("push-out", [*NO_FIELDS, "friction.options.coefficient=0"]))
    assert energy_balance(solution.increments) < 0.02


def apart(solution: Solution) -> Solution:
    zero = np.zeros_like(solution.increments[0].facets.pressure)
    records = tuple(dataclasses.replace(record, active_facets=0) for record in solution.increments)
    facets = dataclasses.replace(records[0].facets, pressure=zero)
    return dataclasses.replace(
        solution, increments=tuple(dataclasses.replace(record, facets=facets) for record in records)
    )


def test_bodies_that_never_touch() -> None:
    assert "no contact" in kinds(doubts(apart(fake_solution())))
    assert "no contact" not in kinds(doubts(fake_solution()))


def test_command_says_and_keeps_the_doubts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line each, also of a quiet run, and in summary.json; the exit code stays 0 unless --strict."""
    monkeypatch.chdir(tmp_path)
    soft = ("contact.formulation=penalty", "contact.penalty_stiffness=20600", *QUICK)
    sets = [part for key in soft for part in ("--set", key)]
    shown = macrofit("run", "wheelset", *sets, "-o", "out")
    assert shown.exit_code == 0, shown.stderr
    lines = [line for line in shown.stdout.splitlines() if line.startswith("Doubtful: ")]
    kept = json.loads(Path("out/summary.json").read_text())["doubts"]
    assert [f"Doubtful: {sentence}" for sentence in kept] == lines
    assert "interpenetration" in kinds(kept)
    quiet = macrofit("run", "wheelset", *sets, "-o", "out", "--quiet")
    assert (quiet.exit_code, quiet.stdout, quiet.stderr.splitlines()) == (0, "", lines)
    strict = macrofit("run", "wheelset", *sets, "-o", "out", "--quiet", "--strict")
    assert strict.exit_code == 2
    assert strict.stderr.count("\n") == 1
    assert "interpenetration" in strict.stderr
    assert json.loads(Path("out/summary.json").read_text())["doubts"] == kept
    assert {"fitting_curve.csv", "interface.h5", "fitting_curve.png"} <= {path.name for path in Path("out").iterdir()}


def test_check_says_what_is_known_before(tmp_path: Path) -> None:
    hub(tmp_path)
    shown = macrofit("check", tmp_path / "hub.toml", "--set", "wheel.chamfer_blend=0")
    assert shown.exit_code == 0
    assert "\nDoubtful: sharp corners: the force ripples" in shown.stdout
    assert "wheel.chamfer_blend (150 in wheelset)" in shown.stdout


def test_a_strain_that_is_no_number_is_doubtful() -> None:
    assert large_strain(0.1) == []
    assert large_strain(0.11)[0].startswith("large strain: the steel flowed by 0.11")
    assert large_strain(np.nan)[0].startswith("large strain: the steel flowed by nan")


def test_runs_are_counted_by_the_kind_of_doubt_and_the_first_is_said() -> None:
    runs = [["held: 3 facets"], [], ["held: 5 facets", "held: 6 facets", "energy: 2 %"]]
    assert doubtful_runs(runs) == [
        "Doubtful: 2 of 3 runs, the first of them: held: 3 facets",
        "Doubtful: 1 of 3 runs, energy: 2 %",
    ]
    assert doubtful_runs([["held: 3 facets"]] * 2) == ["Doubtful: 2 of 2 runs, held: 3 facets"]


def test_study_counts_doubts(tmp_path: Path) -> None:
    sets = [part for key in ("contact.formulation=penalty", *QUICK) for part in ("--set", key)]
    vary = ("--vary", "contact.penalty_stiffness=2e4,2e6")
    shown = macrofit("study", "wheelset", *sets, *vary, "-o", tmp_path / "out")
    assert shown.exit_code == 0, shown.stderr
    assert "Doubtful: 1 of 2 runs, interpenetration: " in shown.stdout
    told = json.loads((tmp_path / "out" / "study.json").read_text())["doubts"]
    assert kinds(told["1"]) - kinds(told.get("2", [])) == {"interpenetration"}
