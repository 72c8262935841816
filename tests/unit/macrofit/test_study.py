"""Studies: what is asked for, that sharing the bodies changes no bit, what is kept, resumed and refused."""

from __future__ import annotations

import csv
import dataclasses
import json
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import ClassVar

import msgspec
import numpy as np
import pytest
import rippled
from click.testing import CliRunner
from fakes import fake_field, fake_solution
from mpi4py import MPI
from small import small_press

from macrofit.acceptance import verdict as press_fit_verdict
from macrofit.assembly import assemble
from macrofit.base.progress import duration
from macrofit.cli import main
from macrofit.errors import ProviderError, SceneError
from macrofit.friction import registry
from macrofit.results.folder import read_curve
from macrofit.scene import dump_scene, load_scene
from macrofit.solve import solve
from macrofit.study.output import _verdict_totals, open_study
from macrofit.study.panels import _panel, stress_panels
from macrofit.study.plan import parse_vary, plan_study, reference_overrides, split_outside
from macrofit.study.run import RunWorker, carry_out_study
from macrofit.study.statistics import statistics

PROGRAM = Path(rippled.__file__)
SEED = "friction.options.seed"
RIPPLED = ("--set", "friction.provider=rippled")


@pytest.fixture(autouse=True)
def _rippled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.BUILT_IN, "rippled", rippled.ENTRY)


@pytest.fixture
def scene_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The small press with its stresses, in the current folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.toml"
    path.write_text(dump_scene(small_press("motion.travel=40", "output.stress=true")))
    return path


def macrofit(*arguments: object):
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "study.csv").open() as file:
        return list(csv.DictReader(file))


def curves_of(folder: Path) -> list[list[str]]:
    with (folder / "curves.csv").open() as file:
        return list(csv.reader(file))


def apart_from_time(folder: Path) -> list[dict[str, str]]:
    return [{name: value for name, value in row.items() if name != "cpu_s"} for row in rows(folder)]


def totals(folder: Path) -> dict[str, object]:
    return json.loads((folder / "study.json").read_text())


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a.b=0.01, 0.03", ["0.01", "0.03"]),
        ("a.b=1:4", ["1", "2", "3", "4"]),
        ("a.b=1:9:4,20", ["1", "5", "9", "20"]),
        ("a.b=-1:1", ["-1", "0", "1"]),
        ("a.b=0.1:0.5:0.1", ["0.1", "0.2", "0.3", "0.4", "0.5"]),
        ("a.b=-0.1:0.1:0.05,7", ["-0.1", "-0.05", "0.0", "0.05", "0.1", "7"]),
        ("a.b=1e-3:3e-3:1e-3", ["0.001", "0.002", "0.003"]),
        ("a.b=0:1:0.3", ["0.0", "0.3", "0.6", "0.9"]),
        ("a.b=c:d", ["c:d"]),
        ("a.b={c=1, d=[2,3]},x", ["{c=1, d=[2,3]}", "x"]),
        ('a.b="1,2",3', ['"1,2"', "3"]),
    ],
)
def test_values_of_a_key(text, values):
    assert parse_vary(text) == ("a.b", values)


def test_commas_in_brackets_do_not_part():
    assert split_outside("a={b=1,c=2},d=[1,2],e") == ["a={b=1,c=2}", "d=[1,2]", "e"]


def test_references():
    assert reference_overrides("uniform=0.11") == (
        "uniform 0.11",
        ["friction.provider=uniform", "friction.options={coefficient=0.11}"],
    )
    assert reference_overrides("motion.increment=5,contact.theta=1")[1] == ["motion.increment=5", "contact.theta=1"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vary", "friction.options.coefficient="], "no value"),
        (["--vary", "friction.options.coefficient=0.1,,0.2"], "an empty value"),
        (["--vary", "friction.options.coefficient"], "write key=v1,v2"),
        (["--vary", "friction.options.coefficient=abc"], "must be a number, not text"),
        (["--vary", "friction.options.coefficient=0.1,0.1"], "0.1 is given twice"),
        (["--vary", "friction.options.coefficient=0.1,0.10"], "are the same scene"),
        (["--vary", "friction.options.seed=5:1"], "the range 5:1 is empty"),
        (["--vary", "friction.options.coefficient=0.1:0.5"], "has no step; write first:last:step"),
        (["--vary", "friction.options.coefficient=0.5:0.1:0.1"], "the range 0.5:0.1:0.1 is empty"),
        (["--vary", "friction.options.coefficient=0.1:0.5:1e-999999"], "is empty"),
        (["--vary", "friction.options.coefficient=1e400:1e401:1"], "is no range of numbers"),
        (["--vary", "friction.options.coefficient=0:1:1e-9"], "more than 100000"),
        (["--vary", "friction.options.seed=1:999999"], "more than 100000"),
        (["--vary", "friction.options.seed=1:3"], "--set friction.provider=NAME"),
        (["--vary", "motion.travl=1,2"], "motion.travl: unknown key"),
        (["--vary", "motion.travel=30", "--vary", "motion.travel=40"], "given more than once"),
        (["--vary", "motion.travel=30", "--reference", "uniform"], "write uniform=0.11"),
        (["--vary", "motion.travel=30", "--reference", "uniform=9"], "run 1 (uniform 9)"),
    ],
)
def test_a_mistake_is_one_line_and_code_2(scene_file, arguments, message):
    shown = macrofit("study", scene_file, *arguments, "-o", "out")
    assert shown.exit_code == 2, shown.stdout
    assert shown.stderr.startswith("macrofit: ")
    assert message in shown.stderr
    assert shown.stderr.count("\n") == 1
    assert not Path("out").exists()


def test_every_combination_after_the_references():
    plan = plan_study("wheelset", ["motion.travel=20,30", "mesh.order=1,2"], ["motion.increment=5"], ["uniform=0.2"])
    assert [run.label for run in plan.runs] == [
        "uniform 0.2", "travel = 20, order = 1", "travel = 20, order = 2", "travel = 30, order = 1",
        "travel = 30, order = 2",
    ]  # fmt: skip
    assert plan.runs[0].scene.friction.options == {"coefficient": 0.2}
    assert plan.runs[4].scene.motion.travel == 30.0
    assert all(run.scene.motion.increment == 5.0 for run in plan.runs)


def test_another_provider_starts_without_the_options_of_the_first():
    """... whatever the order of the overrides; the same provider keeps them."""
    scene = load_scene("wheelset", ["friction.options.seed=3", "friction.provider=rippled"])
    assert scene.friction.options == {"seed": 3}
    assert load_scene("wheelset", ["friction.provider=uniform"]).friction.options == {"coefficient": 0.11}


def test_options_that_another_provider_starts_without_are_named(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(
        "axle = { seat_radius = 50.0, seat_length = 60.0 }\n"
        "wheel = { bore_radius = 49.95, hub_length = 60.0, hub_outer_radius = 90.0, chamfer_length = 5.0, "
        "chamfer_height = 0.5 }\n"
        "motion = { travel = 20.0, increment = 1.0 }\n"
        'friction = { provider = "dem", options = { micro_friction = 0.07, seed = 3 } }\n'
    )
    with pytest.warns(UserWarning, match=r"without the options of 'dem': .* is meant of micro_friction = 0.07$"):
        scene = load_scene(path, ["friction.provider=surrogate", "friction.options.seed=4"])
    assert scene.friction.options == {"seed": 4}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_scene(path, ["friction.provider=uniform"])
        load_scene(path, ["friction.provider=surrogate", "friction.options={seed=4}"])
        load_scene("wheelset", ["friction.provider=surrogate"])


@pytest.mark.parametrize("solver", ["condensed", "monolithic"])
def test_sharing_an_assembly_changes_no_bit(solver):
    """Forces, stresses and counts of a second scene are those of a run of its own; nothing is factored again."""
    change = (f"solver={solver}", "motion.travel=30", "output.stress=true")
    first = small_press(*change, "friction.options.coefficient=0.3", "motion.increment=4")
    second = small_press(*change, "friction.options.coefficient=0.1")
    assembly = assemble(first, MPI.COMM_SELF)
    one = solve(first, MPI.COMM_SELF, assembly=assembly)
    made = dict(assembly.evaluators)
    shared, alone = solve(second, MPI.COMM_SELF, assembly=assembly), solve(second, MPI.COMM_SELF)
    assert (shared.force == alone.force).all()
    assert shared.max_von_mises == alone.max_von_mises
    for a, b in zip(shared.increments, alone.increments, strict=True):
        assert (a.facets.pressure == b.facets.pressure).all()
        assert a.newton_iterations == b.newton_iterations
    assert made == assembly.evaluators  # the very same
    assert set(made) == {"axle", "wheel"}
    name = "factorisations"
    assert assembly.work()[name] == alone.counters[name]
    assert (one.counters[name], shared.counters[name]) == (2, 0)  # those for the stresses
    assert shared.counters["interface_factorisations"] == alone.counters["interface_factorisations"]


def test_an_assembly_of_other_bodies_is_refused():
    scene = small_press()
    assembly = assemble(scene, MPI.COMM_SELF)
    with pytest.raises(SceneError, match=r"wheel, mesh: differ from the scene that was assembled"):
        solve(small_press("wheel.bore_radius=94.8", "mesh.seat_facet=4"), MPI.COMM_SELF, assembly=assembly)
    other = MPI.COMM_SELF.Dup()
    with pytest.raises(SceneError, match="another communicator"):
        solve(scene, other, assembly=assembly)
    other.Free()


def test_a_row_has_the_numbers_of_a_run(scene_file):
    """To 1e-9: study.csv and curves.csv against summary.json and fitting_curve.csv of `macrofit run`."""
    arguments = (*RIPPLED, "--vary", f"{SEED}=1:3", "--reference", "uniform=0.11")
    shown = macrofit("study", scene_file, *arguments, "-o", "out")
    assert shown.exit_code == 0, shown.stderr
    assert "run 4/4" in shown.stdout
    table, curves = rows(Path("out")), curves_of(Path("out"))
    assert [row["label"] for row in table] == ["uniform 0.11", "seed = 1", "seed = 2", "seed = 3"]
    for number, override in ((1, "friction.options.coefficient=0.11"), (3, f"{SEED}=2")):
        provider = () if number == 1 else RIPPLED
        assert macrofit("run", scene_file, *provider, "--set", override, "-o", "single").exit_code == 0
        summary, row = json.loads(Path("single/summary.json").read_text()), table[number - 1]
        assert float(row["peak_force_N"]) == pytest.approx(summary["peak_force_N"], rel=1e-9)
        assert float(row["peak_force_displacement_mm"]) == summary["peak_force_displacement_mm"]
        assert float(row["final_force_N"]) == pytest.approx(summary["final_force_N"], rel=1e-9)
        failed = [check["name"] for check in summary["verdict"]["checks"] if check["result"] == "fail"]
        assert (row["verdict"], row["refused_for"]) == (summary["verdict"]["word"], " ".join(failed))
        assert totals(Path("out"))["verdicts"]["refused_for"].get(str(number), []) == failed
        for body in ("axle", "wheel"):
            at = summary["max_von_mises_MPa"][body]
            assert float(row[f"{body}_max_von_mises_MPa"]) == pytest.approx(at["value"], rel=1e-9)
            for name in ("r_mm", "z_mm", "displacement_mm"):
                assert float(row[f"{body}_{name}"]) == at[name]
        for name in ("pairs_asked", "provider_calls"):
            assert int(row[name]) == summary["counters"][name]
        s, force = read_curve(Path("single"))
        assert [float(line[0]) for line in curves[1:]] == s.tolist()
        found = np.array([float(line[number]) for line in curves[1:]])
        assert found == pytest.approx(force, abs=1e-9 * force.max())
    assert sum(totals(Path("out"))["verdicts"]["runs"].values()) == 4
    assert "Verdict         EN 13260: 4 " in shown.stdout
    assert totals(Path("out"))["factorisations_per_rank"] == [summary["counters"]["factorisations"]]
    assert not any((Path("out") / name).exists() for name in ("runs", "fields", "stress.png", "distributions.png"))


def test_other_bodies_are_factored_once_each(scene_file):
    vary = ("--vary", "friction.options.coefficient=0.1,0.2", "--vary", "wheel.bore_radius=94.7,94.8")
    assert macrofit("study", scene_file, *vary, "--set", "output.stress=false", "-o", "out").exit_code == 0
    assert totals(Path("out"))["assemblies_per_rank"] == [2]
    assert totals(Path("out"))["factorisations_per_rank"] == [4]


def test_many_runs_have_bands_and_distributions(scene_file):
    arguments = (*RIPPLED, "--vary", f"{SEED}=1:12", "--set", "motion.travel=30", "--quiet", "-o", "out")
    shown = macrofit("study", scene_file, *arguments)
    assert (shown.exit_code, shown.stdout) == (0, ""), shown.stderr
    assert (Path("out") / "distributions.png").exists()
    found = totals(Path("out"))["statistics"]["peak_force_N"]
    peaks = np.array([float(row["peak_force_N"]) for row in rows(Path("out"))])
    assert np.ptp(peaks) > 0.0
    assert found["runs"] == 12
    assert found["mean"] == pytest.approx(peaks.mean(), rel=1e-14)
    assert found["standard_deviation"] == pytest.approx(peaks.std(ddof=1), rel=1e-12)


def test_runs_of_a_group_share_its_time(scene_file):
    """The CPU time of all runs is no more than that of the process while it computed them."""
    plan = plan_study("small.toml", [f"{SEED}=1:4"], ["friction.provider=rippled"])
    worker, began = RunWorker(plan, scene_file.parent), time.process_time()
    records = worker.run(plan.runs, lambda: None)
    assert len(records) == 4
    assert 0.0 < sum(record.cpu_s for record in records) + worker.cpu_s <= time.process_time() - began


def test_the_time_left_counts_the_whole_group(scene_file, monkeypatch):
    """Two of four runs came in after 40 s, at 20 s each: three times as much is left behind the first one's line."""
    now, computed = [0.0], RunWorker.run

    def run(self, group, poll):
        now[0] += 40.0
        return computed(self, group, poll)

    monkeypatch.setattr("macrofit.study.output.time.monotonic", lambda: now[0])
    monkeypatch.setattr("macrofit.study.run.MOST_TOGETHER", 2)
    monkeypatch.setattr(RunWorker, "run", run)
    told = macrofit("study", "small.toml", *RIPPLED, "--vary", f"{SEED}=1:4", "-o", "out").stdout
    left = [line.rpartition("  ")[2] for line in told.splitlines() if line.startswith("run ")]
    assert left[:3] == [f"{duration(seconds)} left" for seconds in (60.0, 40.0, 20.0)]


def test_statistics_of_known_numbers():
    found = statistics(np.arange(101.0))
    assert (found["percentile_5"], found["percentile_95"], found["mean"]) == (5.0, 95.0, 50.0)
    assert statistics(np.array([3.0]))["standard_deviation"] == 0.0


def test_runs_of_different_motion_share_a_table(scene_file):
    vary = ("--vary", "motion.increment=5,10", "--set", "output.stress=false")
    assert macrofit("study", scene_file, *vary, "-o", "out").exit_code == 0
    head, *lines = curves_of(Path("out"))
    assert head[2:] == ["displacement_mm run 2", "force_N run 2: increment = 10"]
    assert [line[0] for line in lines] == ["15.0", "20.0", "25.0", "30.0", "35.0", "40.0"]
    assert [line[2] for line in lines] == ["15.0", "25.0", "35.0", "40.0", "", ""]
    assert float(lines[3][3]) == float(rows(Path("out"))[1]["final_force_N"])


def test_fields_are_drawn_where_they_are_asked_for(scene_file):
    vary = ("--vary", "friction.options.coefficient=0.1,0.2", "--set", "output.fields_at=[25,40]")
    assert macrofit("study", scene_file, *vary, "-o", "out").exit_code == 0
    assert {path.name for path in Path("out").glob("*.png")} == {
        "fitting_curves.png", "stress.png", "stress_entrance.png"
    }  # fmt: skip


@pytest.mark.parametrize("zoom", [None, 10.0])
def test_of_later_runs_the_difference_from_the_first_is_drawn(scene_file, zoom):
    """Panels of the same mesh; one scale for stresses, one about zero for differences."""
    plan = plan_study(scene_file, ["friction.options.coefficient=0.1,0.2"])
    first = {18.0: {"axle": fake_field(), "wheel": fake_field(4.0)}}
    more = {
        place: {body: dataclasses.replace(field, von_mises=1.5 * field.von_mises) for body, field in bodies.items()}
        for place, bodies in first.items()
    }
    figure = stress_panels(list(zip(plan.runs, (first, more), strict=True)), zoom)
    limits = [each.get_clim() for axes in figure.axes for each in axes.collections if each.get_array() is not None]
    stresses, differences = {each for each in limits if each[0] == 0.0}, {each for each in limits if each[0] < 0.0}
    assert len(stresses) == len(differences) == 1
    ((low, high),) = differences
    assert -low == high == pytest.approx(0.5 * stresses.pop()[1])
    assert "less coefficient = 0.1" in figure.axes[1].get_title()


def test_a_difference_is_that_of_the_later_run_and_of_the_same_nodes():
    first = {"axle": fake_field()}
    more = {"axle": dataclasses.replace(fake_field(), von_mises=1.5 * fake_field().von_mises)}
    panel = _panel(first, more, first=False)
    assert panel.difference
    np.testing.assert_allclose(panel.values["axle"], 0.5 * first["axle"].von_mises)
    other = _panel(first, {"axle": fake_field(0.5)}, first=False)
    assert not other.difference
    np.testing.assert_array_equal(other.values["axle"], first["axle"].von_mises)


def test_the_windows_of_a_study_are_those_of_its_runs(scene_file):
    """None where the seats differ."""
    plan = plan_study(scene_file, ["friction.options.coefficient=0.1,0.2"])
    same, _ = press_fit_verdict(fake_solution())
    other = msgspec.structs.replace(same, seat_diameter_mm=150.0)
    windows = {"EN 13260": same.en_13260, "GOST 11018": same.gost_11018}
    assert _verdict_totals(plan, [same, same])["windows"] == {
        name: {"low_N": window.low, "high_N": window.high} for name, window in windows.items()
    }
    assert _verdict_totals(plan, [same, other])["windows"] == {}


@pytest.mark.parametrize(
    ("direction", "displacement", "arrows"), [("radial", 40.0, 1), ("axial", 40.0, 0), ("radial", 39.96, 0)]
)
def test_panels_show_the_push_along_the_axle_alone(scene_file, direction, displacement, arrows):
    """Discs are pressed face on face: an arrow at the rear of a hub would mislead, and so where the press lets go."""
    (run,) = plan_study(scene_file, [], [f"contact.direction={direction}", "motion.release=true"]).runs
    bodies = {body: dataclasses.replace(fake_field(), von_mises=np.zeros(9)) for body in ("axle", "wheel")}
    (panel, *_) = stress_panels([(run, {displacement: bodies})]).axes
    said = [text.get_text() for text in panel.texts]
    assert said.count("push") == arrows
    assert not [text for text in said if "MPa" in text]


@pytest.mark.parametrize("spoil", [lambda data: data[:-9], lambda data: data[:300] + b"x" + data[301:], None])
def test_fields_that_are_damaged_or_gone_are_computed_again(scene_file, spoil):
    """A damaged file was a traceback of zipfile, and for ever; one that was gone was left out in silence."""
    vary = ("--vary", "friction.options.coefficient=0.1,0.2", "--set", "output.fields_at=[40]")
    assert macrofit("study", scene_file, *vary, "-o", "out").exit_code == 0
    first, second = sorted(Path("out/fields").iterdir())
    whole, other = first.read_bytes(), second.stat().st_mtime_ns
    if spoil is None:
        first.unlink()
    else:
        first.write_bytes(spoil(whole))
    again = macrofit("study", scene_file, *vary, "-o", "out", "--resume")
    assert again.exit_code == 0, again.stderr
    assert ("damaged" in again.stderr) == (spoil is not None)
    Path("whole.npz").write_bytes(whole)
    with np.load("whole.npz") as before, np.load(first) as after:  # alone now, in lockstep with the other before
        for name, values in before.items():
            assert after[name] == pytest.approx(values, rel=1e-9, abs=1e-6)
    assert second.stat().st_mtime_ns == other


def test_keep_writes_the_folder_of_each_run(scene_file):
    vary = ("--vary", "friction.options.coefficient=0.1,0.2")
    assert macrofit("study", scene_file, *vary, "--keep", "-o", "out").exit_code == 0
    for number, row in enumerate(rows(Path("out")), start=1):
        folder = Path(f"out/runs/{number:04d}")
        assert read_curve(folder)[1].max() == float(row["peak_force_N"])
        assert (folder / "interface.h5").exists()


def test_a_failing_run_keeps_what_is_done_and_is_continued(scene_file):
    arguments = (*RIPPLED, "--vary", f"{SEED}=1:4", "-o", "out")
    failing = macrofit("study", scene_file, *arguments, "--set", "friction.options.fail_at=3")
    assert failing.exit_code == 2
    assert failing.stderr.startswith("macrofit: run 3 (seed = 3): friction provider 'rippled'")
    assert "no such surface" in failing.stderr
    assert failing.stderr.count("\n") == 1
    assert not Path("out/study.json").exists()
    again = macrofit("study", scene_file, *arguments, "--set", "friction.options.fail_at=3")
    assert again.exit_code == 2
    assert "holds an unfinished study with 3 of these runs" in again.stderr  # the others of its group went on
    other = macrofit("study", scene_file, *arguments, "--set", "motion.travel=30")  # another study replaces it
    assert other.exit_code == 0, other.stderr
    assert totals(Path("out"))["computed_runs"] == 4


def test_resume_after_a_kill(scene_file):
    """A process killed in its second group: the first one is not computed again, and the bits are the same."""
    arguments = ["study", str(scene_file), *RIPPLED, "--set", "output.stress=false", "--vary", f"{SEED}=1:10"]
    kill = ["--set", "friction.options.kill_at=7"]
    done = subprocess.run([sys.executable, PROGRAM, *arguments, *kill, "-o", "out"], capture_output=True, text=True)
    assert done.returncode == -9, done.stderr
    with Path("out/study.bin").open("ab") as file:
        file.write(b"\x99\x00\x00\x00torn")  # and a record of which only a part was written
    real = rippled.Rippled.coefficients
    asked: list[int] = []

    def counting(self, pairs):
        asked.append(self.seed)
        return real(rippled.Rippled(seed=self.seed), pairs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rippled.Rippled, "coefficients", counting)
        shown = macrofit(*arguments, *kill, "--resume", "-o", "out")
    assert shown.exit_code == 0, shown.stderr
    assert shown.stdout.splitlines()[1] == "5 of 10 runs are there already"
    assert set(asked) == {6, 7, 8, 9, 10}
    assert totals(Path("out"))["resumed_runs"] == 5
    assert macrofit(*arguments, "-o", "fresh").exit_code == 0
    assert apart_from_time(Path("out")) == apart_from_time(Path("fresh"))
    assert Path("out/curves.csv").read_text() == Path("fresh/curves.csv").read_text()
    again = macrofit(*arguments, *kill, "--resume", "-o", "out", "--quiet")  # the torn record is out of the way
    assert again.exit_code == 0, again.stderr
    assert totals(Path("out"))["resumed_runs"] == 10


def test_a_changed_table_is_computed_again(scene_file, tmp_path):
    """The digest of a run is of the files it names, too."""
    table = ("--set", "friction.provider=table", "--set", "friction.options.file=mu.csv")
    arguments = ["study", scene_file, *table, "--set", "output.stress=false", "--vary", "motion.increment=10,20"]
    for number, mu in enumerate((0.1, 0.2, 0.2)):
        Path("mu.csv").write_text(f"z_mm,coefficient\n0,{mu}\n100,{mu}\n")
        done = macrofit(*arguments, "-o", "out", *(["--resume"] if number else []))
        assert done.exit_code == 0, done.stderr
        assert totals(Path("out"))["resumed_runs"] == (2 if number == 2 else 0)


def test_a_value_the_provider_refuses_is_known_before_anything_runs(scene_file, monkeypatch):
    def build(self, context):
        if self.seed == 2:
            raise ValueError("no such surfaces")
        return self

    monkeypatch.setattr(rippled.Rippled, "build", build)
    done = macrofit("study", scene_file, *RIPPLED, "--vary", f"{SEED}=1,2", "-o", "out")
    assert done.exit_code == 2
    assert "run 2 (seed = 2)" in done.stderr
    assert "no such surfaces" in done.stderr
    assert not Path("out").exists()


def test_a_study_is_extended(scene_file):
    """A finished study with more seeds computes the new ones alone."""
    vary = (*RIPPLED, "--set", "output.stress=false", "--resume", "-o", "out", "--vary")
    assert macrofit("study", scene_file, *vary, f"{SEED}=1:2").exit_code == 0
    assert macrofit("study", scene_file, *vary, f"{SEED}=1:3").exit_code == 0
    assert (totals(Path("out"))["computed_runs"], totals(Path("out"))["resumed_runs"]) == (1, 2)


def test_a_reference_may_be_one_of_the_runs(scene_file):
    vary = ("--vary", "friction.options.coefficient=0.1,0.11", "--reference", "uniform=0.11", "-o", "out")
    assert macrofit("study", scene_file, *vary).exit_code == 0
    assert (totals(Path("out"))["computed_runs"], totals(Path("out"))["resumed_runs"]) == (2, 0)
    first, _, last = rows(Path("out"))
    assert first["peak_force_N"] == last["peak_force_N"]


def test_a_new_study_leaves_no_page_of_the_old_one_even_if_it_is_killed(scene_file):
    plan, page = plan_study(scene_file, ["motion.travel=30,40"]), Path("out/report.html")
    open_study(Path("out"), plan, resume=False).close()
    page.write_text("older")
    open_study(Path("out"), plan, resume=True).close()
    assert page.exists()
    open_study(Path("out"), plan, resume=False).close()
    assert not page.exists()


def test_the_folder_of_something_else_is_refused(scene_file):
    shown = macrofit("study", scene_file, "--vary", "motion.travel=30", "-o", scene_file.parent)
    assert shown.exit_code == 2
    assert "is not empty" in shown.stderr


def test_a_law_of_a_script_is_studied(scene_file):
    """Its class, whose options vary, beside an installed reference; resumed by its digest; refused without one."""

    class Stated(rippled.Rippled, frozen=True):
        digest: ClassVar[str] = "1"

    def study(friction, *, resume, keep=False, vary=f"{SEED}=1,2"):
        plan = plan_study(scene_file, [vary], ["output.stress=false"], ["uniform=0.11"], friction=friction)
        carry_out_study(plan, MPI.COMM_SELF, Path("out"), resume=resume, keep=keep, quiet=True)
        return totals(Path("out"))["computed_runs"], totals(Path("out"))["resumed_runs"]

    assert study(Stated, resume=False) == (3, 0)
    by_name = macrofit(
        "study", scene_file, *RIPPLED, "--set", "output.stress=false", "--vary", f"{SEED}=1,2", "-o", "n"
    )
    assert by_name.exit_code == 0
    forces = [[float(row["peak_force_N"]) for row in rows(Path(folder))][-2:] for folder in ("out", "n")]
    assert forces[0] == pytest.approx(forces[1], rel=1e-9)
    assert study(Stated, resume=True) == (0, 3)
    Stated.digest = "2"
    assert study(Stated, resume=True) == (2, 1)
    assert study(Stated(), resume=False, keep=True, vary="motion.increment=5,10") == (3, 0)
    with pytest.raises(ProviderError, match="Rippled' is an object without a digest"):
        study(rippled.Rippled, resume=False)
    with pytest.raises(SceneError, match=r"friction\.options\.seed: cannot change"):
        study(Stated(), resume=False)
