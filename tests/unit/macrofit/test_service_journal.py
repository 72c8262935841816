"""A service computation that is killed, interrupted or ends early: what it keeps, and how it goes on."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from serving import SHORT, service

from macrofit.base.log import frames
from macrofit.results.folder import SCENE
from macrofit.scene import load_scene
from macrofit.service import journal, output

TABLES = (output.SEAT, output.FRETTING, output.SURFACE, output.HISTORIES)


def contents(folder: Path) -> list[object]:
    """What a computation told, to the bit; but when and by which command."""
    numbers = json.loads((folder / output.NUMBERS).read_text())
    del numbers["provenance"]
    return [numbers, *((folder / name).read_bytes() for name in TABLES)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("service") / "whole"
    assert service(folder).exit_code == 0
    return folder


def left_behind(whole: Path, folder: Path, steps: int, torn: int = 0) -> Path:
    """What a computation leaves that is killed after so many frames of its rotation."""
    folder.mkdir()
    shutil.copy(whole / journal.PRESS, folder)
    data = (whole / journal.ROTATION).read_bytes()
    ends = [end for _, end in frames(data, len(journal.MAGIC))]
    (folder / journal.ROTATION).write_bytes(data[: ends[steps] + torn])
    return folder


@pytest.mark.parametrize(("steps", "torn"), [(0, 0), (1, 0), (12, 17), (25, 1000)])
def test_goes_on_to_the_same_bits_after_a_kill(whole: Path, tmp_path: Path, steps: int, torn: int) -> None:
    folder = left_behind(whole, tmp_path / "killed", steps, torn)
    result = service(folder, resume=True)
    assert result.exit_code == 0, result.stderr
    assert contents(folder) == contents(whole)
    assert (folder / journal.ROTATION).read_bytes() == (whole / journal.ROTATION).read_bytes()


def test_steps_that_are_kept_are_not_solved_again(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise AssertionError("computed anew")

    folder = left_behind(whole, tmp_path / "killed", -1)
    monkeypatch.setattr("macrofit.service.run.pressed_and_released", refused)
    monkeypatch.setattr("macrofit.service.rotation.solve_step", refused)
    assert service(folder, resume=True).exit_code == 0
    assert contents(folder) == contents(whole)


def test_a_wheel_turns_on_by_more_revolutions(whole: Path, tmp_path: Path) -> None:
    """... from where it was, as one that was asked for them at once; its scene says what loads it had."""
    folder = tmp_path / "more"
    shutil.copytree(whole, folder)
    turned = json.loads((whole / output.NUMBERS).read_text())["turned_revolutions"]
    more = f"service.revolutions={turned + 1:g}"
    assert service(folder, more, "service.periodicity=1e-12", resume=True).exit_code == 0
    assert service(tmp_path / "at once", more, "service.periodicity=1e-12").exit_code == 0
    assert contents(folder) == contents(tmp_path / "at once")
    assert json.loads((folder / output.NUMBERS).read_text())["turned_revolutions"] == turned + 1.0
    assert "journal_force = 110000.0" in (folder / SCENE).read_text()


def test_a_new_computation_leaves_no_page_of_the_old_one_even_if_it_is_killed(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "again"
    shutil.copytree(whole, folder)
    (folder / "report.html").write_text("older")
    with journal.open_folder(folder, load_scene(folder / SCENE), resume=True):
        assert (folder / "report.html").exists()
    with journal.open_folder(folder, load_scene(folder / SCENE), resume=False):
        assert not (folder / "report.html").exists()


YIELDS = ("axle.material.grade=EA1N", "wheel.material.grade=ER8", "wheel.bore_radius=94.8", "service.revolutions=1")


@pytest.mark.parametrize("keys", [(), YIELDS], ids=["elastic", "yields"])
def test_press_that_was_killed_goes_on_to_the_same_bits(tmp_path: Path, keys: tuple[str, ...]) -> None:
    whole = tmp_path / "whole"
    assert service(whole, *keys).exit_code == 0
    data = (whole / journal.PRESS).read_bytes()
    ends = [end for _, end in frames(data, data.index(b"\n") + 1)]
    for number, end in enumerate((ends[2], ends[-1])):  # in the middle, and before the press lets go
        folder = tmp_path / f"killed{number}"
        folder.mkdir()
        (folder / journal.PRESS).write_bytes(data[:end])
        assert service(folder, *keys, resume=True).exit_code == 0
        assert contents(folder) == contents(whole)


def test_what_is_unfinished_is_not_lost_and_other_loads_are_refused(whole: Path, tmp_path: Path) -> None:
    folder = left_behind(whole, tmp_path / "killed", 5)
    again = service(folder)
    assert again.exit_code == 2
    assert "continue it with --resume" in again.stderr
    other = service(folder, "service.journal_force=1e5", resume=True)
    assert other.exit_code == 2
    assert "service.journal_force" in other.stderr
    assert service(folder, resume=True).exit_code == 0
    assert service(folder).exit_code == 0  # all is written, a new one may take its place


def test_loads_that_slide_the_wheel_round_leave_what_was_had(tmp_path: Path) -> None:
    result = service(tmp_path / "served", "service.torque=1e9")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "% of the loads at" in result.stderr
    assert f"what was computed until then is in {tmp_path / 'served'}" in result.stderr
    found = json.loads((tmp_path / "served" / output.NUMBERS).read_text())
    assert "no equilibrium was found" in found["ended"]
    assert -1.0 < found["turned_revolutions"] < 0.0
    assert found["friction"] is None
    assert found["bonded"]["inner"]["nominal_stress_MPa"] > 100.0
    assert (tmp_path / "served" / output.SEAT).is_file()


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_keeps_what_was_turned(whole: Path, tmp_path: Path, sent: signal.Signals) -> None:
    folder = tmp_path / "served"
    changes = [word for change in (*SHORT, "service.revolutions=60") for word in ("--set", change)]
    command = [sys.executable, "-m", "macrofit", "service", "wheelset", *changes, "-o", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        for line in running.stdout:
            if line.startswith("Revolution 2"):
                break
        running.send_signal(sent)
        said = running.stderr.read()
        assert running.wait() == 130
    assert said == f"macrofit: interrupted; what was computed is in {folder}, continue with --resume\n"
    found = json.loads((folder / output.NUMBERS).read_text())
    assert found["ended"] == "interrupted"
    first = json.loads((whole / output.NUMBERS).read_text())["friction"]["friction_work_of_revolutions_N_mm"]
    assert found["friction"]["friction_work_of_revolutions_N_mm"][:2] == first[:2]


def test_a_bonded_solution_has_nothing_to_go_on_from(tmp_path: Path) -> None:
    result = service(tmp_path / "served", bonded=True, resume=True)
    assert result.exit_code == 2
    assert "has no steps to go on from" in result.stderr
