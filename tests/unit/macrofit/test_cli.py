"""The command line: what it prints, its exit codes, and what a run that ends early leaves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner
from fakes import fake_increment, fake_scene, fake_solution

from macrofit import assembly
from macrofit.cli import main
from macrofit.errors import ConvergenceError
from macrofit.friction import BuildContext, build_provider, registry
from macrofit.results import folder as output
from macrofit.scene import scene_names

SCENE = """
title = "A short fit"
[axle]
seat_radius = 95.0
seat_length = 20.0
taper_length = 5.0
taper_height = 0.5
[wheel]
bore_radius = 94.85
hub_length = 20.0
hub_outer_radius = 140.0
[motion]
travel = 18.0
increment = 2.0
"""


def macrofit(*arguments: object):
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


@pytest.fixture
def scene_file(tmp_path, monkeypatch):
    """A scene in a folder of its own, which is the current one."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "short.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def solver(monkeypatch):
    """A solver that accepts the increments of a fake run; ``stop`` says what happens after how many."""
    import macrofit.run

    stop: dict[int, BaseException] = {}

    def solve(scene, comm, monitor, journal, friction):
        kept = [record for record, _ in journal.records()]
        solution = fake_solution(scene)
        monitor.started(scene, len(solution.increments), solution.dofs)
        for k, record in enumerate(solution.increments):
            if k in stop:
                raise stop[k]
            if k >= len(kept):
                journal.append(record, {})
                monitor.increment(record)
        monitor.finished()
        return solution

    monkeypatch.setattr(macrofit.run, "solve", solve)
    interrupt, terminate = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    yield stop
    signal.signal(signal.SIGINT, interrupt)
    signal.signal(signal.SIGTERM, terminate)


def test_help_names_every_command():
    shown = macrofit("--help")
    assert shown.exit_code == 0
    for command in ("run", "converge", "service", "scenes", "providers", "init", "check", "schema", "plot"):
        assert f"\n  {command} " in shown.stdout


def test_help_comes_without_numpy():
    code = "import runpy, sys\nsys.argv[1:] = ['--help']\ntry:\n"
    code += "    runpy.run_module('macrofit', run_name='__main__')\n"
    code += "finally:\n    print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"


def test_scenes_and_providers_are_listed():
    shown = macrofit("scenes").stdout
    assert all(name in shown for name in scene_names())
    assert "uniform  from macrofit (built in)" in macrofit("providers").stdout


def test_check_says_what_the_scene_will_do(scene_file):
    shown = macrofit("check", scene_file, "--set", "motion.travel=10")
    assert shown.exit_code == 0, shown.stderr
    assert "0.15 mm on the radius, 0.3 mm on the diameter" in shown.stdout
    assert "Increments      6, from 0 to 10 mm" in shown.stdout
    assert "First touch     at 0 mm" in shown.stdout


def test_check_builds_the_provider_that_a_run_would(scene_file, tmp_path, monkeypatch):
    """... for as many tiles: a measured strip may be too short for them."""
    seen: list[BuildContext] = []

    def noted(name, options, context):
        seen.append(context)
        return build_provider(name, options, context)

    monkeypatch.setattr(registry, "build_provider", noted)
    monkeypatch.setattr(assembly, "build_provider", noted)
    assert macrofit("check", scene_file).exit_code == 0
    assert macrofit("run", scene_file, "-o", tmp_path / "out", "--quiet").exit_code == 0
    checked, run = ((context.seat_tiles, context.bore_tiles) for context in seen)
    assert checked == run > (1, 1)


def test_check_says_what_the_steel_bears(scene_file):
    shown = macrofit(
        "check", scene_file, "--set", "axle.material={grade='EA4T', elastic=true}",
        "--set", "wheel.material.yield_stress=400",
    )  # fmt: skip
    assert "Steel, axle     bears 420 MPa, stays elastic" in shown.stdout
    assert "Steel, wheel    bears 400 MPa, then flows" in shown.stdout


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("wheel.bore_radus=3", "macrofit: wheel.bore_radus: unknown key (did you mean 'bore_radius'?)\n"),
        ("friction.provider=ice", "macrofit: no friction provider 'ice'"),
        ("friction.options={coeficient=0.1}", "macrofit: friction.options.coeficient: unknown option"),
        ("mesh.axle=none.msh", "macrofit: axle"),
        (
            'friction={provider="surrogate",options={micro_friction=0.5}}',
            "macrofit: friction provider 'surrogate' cannot be built: the network has not seen",
        ),
    ],
)
def test_a_mistake_is_one_line_and_code_2(scene_file, override, message):
    shown = macrofit("check", scene_file, "--set", override)
    assert shown.exit_code == 2
    assert shown.stderr.startswith(message)
    assert shown.stderr.count("\n") == 1


def test_the_schema_is_json():
    assert "$defs" in json.loads(macrofit("schema").stdout)


def test_a_run_writes_its_files_and_says_the_essence(scene_file, solver):
    shown = macrofit("run", scene_file)
    assert shown.exit_code == 0, shown.stderr
    folder = scene_file.parent / "short"
    assert {path.name for path in folder.iterdir()} == {
        "scene.toml", "fitting_curve.csv", "summary.json", "interface.h5", "journal.bin", "fields",
        "fitting_curve.png", "interface.png", "stress.png", "stress_entrance.png",
    }  # fmt: skip
    for part in ("10/10", "0.3 mm on the diameter", "760 kN", "512.9 MPa in the axle", "EN 13260", "short"):
        assert part in shown.stdout
    assert macrofit("run", scene_file, "--quiet").stdout == ""  # a finished run is replaced


def test_the_folder_of_something_else_is_refused(scene_file, solver):
    shown = macrofit("run", scene_file, "-o", scene_file.parent)
    assert shown.exit_code == 2
    assert "is not empty and holds no run of macrofit" in shown.stderr
    assert [path.name for path in scene_file.parent.iterdir()] == ["short.toml"]


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (ConvergenceError("increment 4:\nno step is small enough"), 2, "increment 4: no step is small"),
        (KeyboardInterrupt(), 130, "interrupted; what was computed is in out, continue with --resume"),
    ],
)
def test_what_was_accepted_is_kept_and_continued(scene_file, solver, error, code, message):
    h5py = pytest.importorskip("h5py")
    solver[4] = error
    shown = macrofit("run", scene_file, "-o", "out")
    assert shown.exit_code == code
    assert shown.stderr.startswith(f"macrofit: {message}")
    assert shown.stderr.count("\n") == 1
    folder = scene_file.parent / "out"
    assert len(output.read_curve(folder)[0]) == 4
    with h5py.File(folder / "interface.h5") as file:
        assert file["pressure"].shape == (4, 25)
        assert file["facet_start"][0] == pytest.approx(-5.0)
    assert not (folder / "summary.json").exists()

    shown = macrofit("run", scene_file, "-o", "out")
    assert shown.exit_code == 2
    assert "unfinished run of this scene, 4 increments" in shown.stderr
    assert len(output.read_curve(folder)[0]) == 4

    solver.clear()
    shown = macrofit("run", scene_file, "-o", "out", "--resume")
    assert shown.exit_code == 0, shown.stderr
    assert " 4/10" not in shown.stdout
    assert " 5/10" in shown.stdout
    assert len(output.read_curve(folder)[0]) == 10


def test_resume_without_anything_to_resume_is_a_run(scene_file, solver):
    assert macrofit("run", scene_file, "--resume").exit_code == 0


def test_a_bug_shows_its_traceback(scene_file, solver):
    solver[2] = ZeroDivisionError("a mistake of ours")
    shown = macrofit("run", scene_file)
    assert shown.exit_code == 1
    assert isinstance(shown.exception, ZeroDivisionError)
    assert len(output.read_curve(scene_file.parent / "short")[0]) == 2


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unwritable for root")
def test_an_unwritable_folder_is_said(scene_file, solver):
    locked = scene_file.parent / "locked"
    locked.mkdir(mode=0o500)
    shown = macrofit("run", scene_file, "-o", locked / "out")
    assert shown.exit_code == 2
    assert "out: cannot be written: Permission denied" in shown.stderr


def test_a_folder_that_cannot_be_made_is_said(scene_file, solver):
    shown = macrofit("run", scene_file, "-o", scene_file / "out")
    assert shown.exit_code == 2
    assert "out: cannot be written: Not a directory" in shown.stderr


def test_plot_overlays_curves(scene_file):
    for name in ("one", "two"):
        output.prepare(scene_file.parent / name, owned=False)
        curve = output.CurveFile(scene_file.parent / name)
        for k in range(3):
            curve.increment(fake_increment(k, float(k), 1e5 * k))
    shown = macrofit("plot", "one", "two", "-o", "both.png")
    assert shown.exit_code == 0, shown.stderr
    assert (scene_file.parent / "both.png").exists()
    assert macrofit("plot", "three").exit_code == 2


def test_the_fake_scene_is_the_scene_of_the_file(scene_file):
    from macrofit.scene import load_scene

    assert load_scene(scene_file) == fake_scene()


def test_a_closed_pipe_ends_a_run_quietly(tmp_path):
    """`macrofit run ... | head`: no traceback and no word of a crash."""
    words = [sys.executable, "-m", "macrofit", "run", "contact-patch", "-o", str(tmp_path / "run")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        run.stdout.close()
        said = run.stderr.read()
        assert run.wait(timeout=60) == 1
    assert said == ""


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.3, 0.7, 1.1, 1.6, 2.2])
def test_two_runs_into_one_folder(delay, tmp_path):
    """One has the folder until its results are written; the other is refused, or comes after it."""
    folder = tmp_path / "run"
    words = [sys.executable, "-m", "macrofit", "run", "lame-rings", "--quiet", "-o", str(folder)]
    words += ["--set", "friction.options.coefficient="]
    runs = []
    for coefficient in ("0.1", "0.2"):
        runs.append(subprocess.Popen([*words[:-1], words[-1] + coefficient], stderr=subprocess.PIPE, text=True))
        time.sleep(delay)
    said = [run.communicate(timeout=60)[1] for run in runs]
    codes = [run.returncode for run in runs]
    assert set(codes) <= {0, 2}
    assert 0 in codes
    refused = ["another process is writing" in text or "not empty" in text for text in said]
    assert refused == [code == 2 for code in codes]
    last = "0.2" if codes[1] == 0 else "0.1"
    assert f"coefficient = {last}" in (folder / "scene.toml").read_text()
    names = {path.name for path in folder.iterdir()}
    assert {"summary.json", "fitting_curve.csv", "interface.h5", "journal.bin"} <= names
