"""How exact a scene is: Richardson's formula on series that are known, and scenes whose answer is."""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from mpi4py import MPI

from macrofit.base.arrays import FloatArray
from macrofit.cli import main
from macrofit.converge import run as converging
from macrofit.converge.estimate import (
    GROWING,
    QUANTITIES,
    SHARP,
    Estimate,
    Figures,
    Quantity,
    distance,
    estimate,
    figures,
)
from macrofit.converge.ladder import given_scene, in_half_steps, preset_scene, remeshed
from macrofit.converge.run import Convergence, converge
from macrofit.scene import load_scene
from macrofit.solve import solve

SHORT = ("mesh.seat_facet=4", "mesh.coarse=40", "motion.start=16", "motion.travel=40", "motion.increment=4")
BY_KEY = {each.key: each for each in QUANTITIES}


def macrofit(*arguments: object) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


def known(value: float | FloatArray) -> Figures:
    """A run all of whose quantities are the same."""
    each = np.atleast_1d(np.asarray(value, dtype=np.float64))
    return Figures(force=each, curve=each, pressure=each, axle=each, wheel=each, least_force=0.0, dofs=1, cpu_s=0.0)


def of_series(quantity: Quantity, *values: float | FloatArray, formal: int = 2, sharp: bool = False) -> Estimate:
    coarse, own, fine = map(known, values)
    return estimate(quantity, (coarse, own, fine), own, formal, sharp=sharp)


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("key", ["force", "axle"])
def test_a_power_of_the_size_is_extrapolated_exactly(key: str, order: float) -> None:
    found = of_series(BY_KEY[key], *(100.0 + 3.0 * h**order for h in (2.0, 1.0, 0.5)))
    assert found.order == pytest.approx(order)
    assert found.limit == pytest.approx(100.0)
    assert found.mesh_error == pytest.approx(0.03)


def test_a_profile_is_extrapolated_point_by_point() -> None:
    exact, shape = np.linspace(1.0, 2.0, 50), np.sin(np.arange(50.0))
    found = of_series(BY_KEY["pressure"], *(exact + 0.1 * shape * h**2 for h in (2.0, 1.0, 0.5)))
    assert found.order == pytest.approx(2.0)
    assert found.limit == pytest.approx(exact)
    rms = float(np.sqrt(np.mean((0.1 * shape) ** 2) / np.mean(exact**2)))
    assert found.mesh_error == pytest.approx(rms)


@pytest.mark.parametrize(
    ("values", "error"),
    [
        (
            (108.0, 101.0, 100.0),
            101.0 / (100.0 - 1.0 / 3.0) - 1.0,
        ),  # faster than order 2, which is all that is believed
        ((98.0, 101.0, 100.0), 101.0 / (100.0 - 1.0 / 3.0) - 1.0),  # it turns
        ((101.5, 101.0, 100.0), 101.0 / (100.0 - 1.0 / 3.0) - 1.0),  # it does not fall
    ],
)
def test_where_there_is_no_order_the_two_finer_meshes_decide(values: tuple[float, ...], error: float) -> None:
    found = of_series(BY_KEY["force"], *values)
    assert found.mesh_error == pytest.approx(error)
    assert found.order is None or found.order > 2.0
    assert found.remark == ("irregular" if found.order is None else "")


def test_a_stress_that_goes_on_growing_has_no_error() -> None:
    growing = (700.0, 1000.0, 1300.0)
    assert of_series(BY_KEY["axle"], *growing).remark == GROWING
    assert of_series(BY_KEY["axle"], *growing).error is None
    assert of_series(BY_KEY["force"], *growing).error is not None  # a force has a limit
    falling = of_series(BY_KEY["axle"], *(1000.0 - 300.0 * h**2 for h in (2.0, 1.0, 0.5)))
    assert falling.order == pytest.approx(2.0)
    assert of_series(BY_KEY["axle"], 1000.0, 1001.0, 1001.1, sharp=True).remark == SHARP


def test_what_does_not_change_is_exact() -> None:
    found = of_series(BY_KEY["wheel"], 5.0, 5.0, 5.0)
    assert (found.error, found.remark, found.order) == (0.0, "exact", None)


def test_the_ladder_scales_every_size_and_keeps_the_displacements() -> None:
    scene = load_scene("wheelset", ("mesh.corner_facet=0.5", "motion.travel=3"))
    finer = remeshed(scene, 0.5).mesh
    assert (finer.seat_facet, finer.corner_facet, finer.coarse, finer.growth) == (0.5, 0.25, 10.0, 0.175)
    assert finer.bore_facet is None
    halved = in_half_steps(scene)
    assert halved.displacements == (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
    there_and_back = load_scene("wheelset", ("motion={displacements=[1.0, 5.0, 1.0]}",))
    assert in_half_steps(there_and_back).displacements == (1.0, 3.0, 5.0, 3.0, 1.0)


def test_a_curve_that_turns_is_read_at_its_own_displacements() -> None:
    scene = given_scene(
        "wheelset", ("mesh.seat_facet=8", "mesh.coarse=40", "motion={displacements=[20.0, 28.0, 20.0]}")
    )
    whole = solve(in_half_steps(scene), MPI.COMM_SELF)
    assert figures(whole, np.array(scene.displacements)).curve == pytest.approx(whole.force[[0, 2, 4]])


def test_a_preset_counts_less_than_a_key_and_more_than_another_preset() -> None:
    scene = preset_scene("wheelset", ("preset=accurate", "mesh.growth=0.3"), "fast")
    assert (scene.mesh.seat_facet, scene.mesh.growth) == (3.0, 0.3)


def short(*overrides: str) -> Convergence:
    """A short push of `wheelset` on coarse meshes; about 1 s."""
    given = (*SHORT, *overrides)
    return converge(given_scene("wheelset", given), partial(preset_scene, "wheelset", given), MPI.COMM_SELF, 0.05)


def test_the_predicted_error_is_the_one_against_a_much_finer_mesh() -> None:
    """Force and pressure within a factor of two on meshes of 4 mm; the bar of `wheelset` is the benchmark's."""
    found = short()
    scene = found.scene
    truth = figures(solve(remeshed(scene, 0.25), MPI.COMM_SELF), np.array(scene.displacements))
    for each in found.estimates:
        if each.quantity.kind != "stress":
            true = distance(each.quantity.key, found.runs["the scene"], getattr(truth, each.quantity.key))
            assert each.mesh_error is not None
            assert 0.5 < each.mesh_error / true < 2.0, each.quantity.label


def test_sharp_corners_have_no_order() -> None:
    found = short("axle.taper_blend=0", "wheel.chamfer_blend=0")
    stresses = [each for each in found.estimates if each.quantity.kind == "stress"]
    assert {each.remark for each in stresses} == {SHARP}
    assert {(each.error, each.order) for each in stresses} == {(None, None)}
    assert all(set(errors) == {"force", "curve", "pressure"} for errors in found.presets.values())


def test_the_exact_patch_is_exact_and_fast_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shown = macrofit("converge", "contact-patch")
    assert shown.exit_code == 0, shown.stderr
    assert "Preset          fast is within 5 %: --preset fast" in shown.stdout
    assert "largest stress, wheel" in shown.stdout
    kept = json.loads((tmp_path / "contact-patch-convergence" / "convergence.json").read_text())
    assert kept["preset_within_tolerance"] == "fast"
    assert kept["scene_within_tolerance"] is True
    assert list(kept["quantities"]) == [each.key for each in QUANTITIES]
    assert all(each["error"] < 1e-6 and each["remark"] == "exact" for each in kept["quantities"].values())
    assert macrofit("converge", "contact-patch", "--quiet").stdout == ""  # a finished one is replaced


def test_presets_are_tried_until_one_is_good_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """The dearer ones are not computed for nothing; where none is, that is said."""
    found = short()
    assert list(found.presets) == ["fast", "balanced", "accurate"]
    assert found.meeting is None
    assert "none is within 5 %" in "\n".join(converging.sentences(found))
    given = (*SHORT,)
    loose = converge(found.scene, partial(preset_scene, "wheelset", given), MPI.COMM_SELF, 0.5)
    assert loose.meeting == "fast"
    assert list(loose.presets) == ["fast"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nowhere",), "no scene 'nowhere'"),
        (
            ("wheelset", "--set", "wheel.bore_radius=96", "--set", "motion.travel=2"),
            "motion: seat and bore never touch",
        ),
        (("wheelset", "--tolerance", "0"), "--tolerance"),
        (("contact-patch", "-o", "."), "is not empty"),
    ],
)
def test_a_mistake_is_said(words: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "something").write_text("else")
    monkeypatch.chdir(tmp_path)
    shown = macrofit("converge", *words)
    assert shown.exit_code == 2
    assert said in shown.stderr
    assert "Traceback" not in shown.stderr


def test_meshes_from_files_are_refused(tmp_path: Path) -> None:
    scene = tmp_path / "files.toml"
    scene.write_text("mesh = { axle = 'a.msh', wheel = 'w.msh' }\nmotion = { travel = 3.0 }\n")
    shown = macrofit("converge", scene)
    assert shown.exit_code == 2
    assert shown.stderr.startswith("macrofit: mesh.axle, mesh.wheel: converge cannot refine meshes from files; make ")
    assert shown.stderr.count("\n") == 1


def test_a_preset_that_is_the_scene_itself_is_not_computed_again() -> None:
    given = ("preset=fast", "motion.travel=0.004", "motion.increment=0.002")
    lines: list[str] = []
    scene = given_scene("contact-patch", given)
    found = converge(scene, partial(preset_scene, "contact-patch", given), MPI.COMM_SELF, 0.05, lines.append)
    assert found.runs["preset fast"] is found.runs["the scene"]
    assert not [line for line in lines if "preset" in line]


@pytest.mark.parametrize(
    "command", [("converge", "contact-patch"), ("identify", "contact-patch", "--curve", "curve.csv")]
)
def test_an_interruption_promises_nothing_that_is_not_there(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither command has --resume."""

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("macrofit.base.ranks.leave", lambda comm, code: sys.exit(code))
    monkeypatch.setattr("macrofit.converge.run.given_scene", interrupted)
    monkeypatch.setattr("macrofit.identify.output.read_measured", interrupted)
    shown = macrofit(*command)
    assert shown.exit_code == 130
    assert shown.stderr == "macrofit: interrupted; nothing was kept\n"
