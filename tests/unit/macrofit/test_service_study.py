"""Studies of wheelsets in service: each run as alone, presses shared, early ends told; their page."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from browser import browser
from click.testing import CliRunner
from serving import SHORT, service

from macrofit.base.log import Log, frames
from macrofit.cli import main
from macrofit.errors import OutputError
from macrofit.report.pdf import found_browser
from macrofit.report.service_study import COLUMNS
from macrofit.service import run as service_run
from macrofit.service.output import NUMBERS
from macrofit.service.study.figures import write_service_figure
from macrofit.service.study.output import STUDY_FILE, _sentences, open_service_study, write_service_study
from macrofit.service.study.record import MAGIC, MEASURES, ServiceRecord
from macrofit.service.study.run import alike
from macrofit.study.plan import plan_study

with_browser = pytest.mark.skipif(found_browser() is None, reason="no chromium: make setup-test installs it")
KEYS = tuple(key for key in SHORT if "coefficient" not in key)
VARIED = ("friction.options.coefficient=0.2,0.4", "service.torque=0.0,1e9")


def study(folder: Path, *varied: str, more: tuple[str, ...] = ()) -> Any:
    words = [word for key in KEYS for word in ("--set", key)] + [word for each in varied for word in ("--vary", each)]
    command = ["study", "wheelset", "--service", *words, "-o", str(folder), *more]
    return CliRunner(mix_stderr=False).invoke(main, command)


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "service-study.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def presses() -> list[int]:
    return []


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, presses: list[int]) -> tuple[Path, str]:
    press = service_run.pressed_and_released
    folder = tmp_path_factory.mktemp("study") / "study"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(service_run, "pressed_and_released", lambda *given: presses.append(1) or press(*given))
        result = study(folder, *VARIED)
    assert result.exit_code == 0, result.stderr
    return folder, result.stdout


def test_each_run_is_the_one_alone_to_the_bit(done: tuple[Path, str], tmp_path: Path) -> None:
    assert service(tmp_path / "alone", "friction.options.coefficient=0.4").exit_code == 0
    alone = json.loads((tmp_path / "alone" / "service.json").read_text())
    row = rows(done[0])[2]
    assert (row["friction.options.coefficient"], row["service.torque"]) == ("0.4", "0.0")
    for name, key in MEASURES.items():
        value: Any = alone
        for part in key.split("."):
            value = value[part]
        assert float(row[name]) == value, name
    assert row["verdict"] == alone["verdict"]["word"]


def test_runs_that_differ_in_loads_alone_share_their_press(done: tuple[Path, str], presses: list[int]) -> None:
    assert len(rows(done[0])) == 4
    assert len(presses) == 2  # one for each coefficient


def test_runs_of_the_same_bodies_and_press_follow_each_other() -> None:
    # the loads vary slowest here: in the order of the plan each run would press anew
    plan = plan_study("wheelset", ("service.torque=0,1e6", "friction.options.coefficient=0.2,0.4", "mesh.order=2,1"))
    assert [run.number for run in alike(plan.runs)] == [1, 5, 3, 7, 2, 6, 4, 8]


@pytest.mark.parametrize("magic", [MAGIC, b"macrofit service study 999\n"])
def test_a_damaged_study_is_begun_anew_and_not_gone_on_with(tmp_path: Path, magic: bytes) -> None:
    log = Log.create(tmp_path / STUDY_FILE, magic)
    log.append(b"\xc1")  # a whole frame that holds no record
    log.close()
    plan = plan_study("wheelset", VARIED)
    with pytest.raises(OutputError, match="start again without --resume"):
        open_service_study(tmp_path, plan, resume=True)
    kept = open_service_study(tmp_path, plan, resume=False)
    assert kept.records == {}
    kept.close()


def test_a_wheel_that_slides_round_does_not_end_the_study(done: tuple[Path, str]) -> None:
    folder, said = done
    ended = [row["ended"] for row in rows(folder)]
    assert [bool(each) for each in ended] == [False, True, False, True]
    assert "no equilibrium was found" in ended[1]
    assert rows(folder)[1]["friction_work_N_mm"] == ""
    totals = json.loads((folder / "service-study.json").read_text())
    assert sorted(totals["ended"]) == ["2", "4"]
    assert totals["statistics"]["friction_work_N_mm"]["runs"] == 2
    assert totals["statistics"]["nominal_stress_MPa"]["runs"] == 4
    assert "Ended early     2 runs; run 2: service: no equilibrium" in said
    assert not (folder / "runs").exists()  # without --keep
    assert (folder / "service-study.png").stat().st_size > 10_000


def test_a_wheel_that_nothing_holds_is_one_run_that_ended(tmp_path: Path) -> None:
    """Without friction, or with a clearance; the others go on, and page and table say why."""
    folder = tmp_path / "study"
    varied = ("friction.options.coefficient=0,0.2", "wheel.bore_radius=94.85,95.02")
    result = study(
        folder, *varied, more=("--keep", "--set", "service.revolutions=1", "--set", "service.seat_limit=1000")
    )
    assert (result.exit_code, result.stderr) == (0, "")
    ended = [row["ended"] for row in rows(folder)]
    assert ["without it nothing holds the wheel" in each for each in ended[:2]] == [True, False]
    assert ended[2] == ""
    assert all("nothing presses the wheel onto its seat" in each for each in (ended[1], ended[3]))
    assert [row["verdict"] for row in rows(folder)] == ["not judged", "not judged", "accepted", "not judged"]
    assert [row["nominal_stress_MPa"] == "" for row in rows(folder)] == [True, True, False, True]
    assert [path.name for path in (folder / "runs").iterdir()] == ["0003"]
    told = report(folder)
    assert (told.exit_code, told.stderr) == (0, "")
    assert "nothing holds the wheel in service" in (folder / "report.html").read_text()


def test_a_value_that_no_scene_may_have_is_not_gone_on_with(tmp_path: Path) -> None:
    result = study(tmp_path / "study", "service.rim_offset=900,0")
    assert result.exit_code == 2
    assert "run 1 (rim_offset = 900): service.rim_offset: 900 mm is beyond the rim" in result.stderr
    assert "continue with --resume once its values are changed" in result.stderr
    again = study(tmp_path / "study", "service.rim_offset=0")
    assert again.exit_code == 0, again.stderr


def report(folder: Path, *more: str) -> Any:
    return CliRunner(mix_stderr=False).invoke(main, ["report", str(folder), *more])


@with_browser
def test_its_page_has_the_runs_over_what_is_varied(done: tuple[Path, str]) -> None:
    folder, _ = done
    told = report(folder)
    assert (told.exit_code, told.stderr) == (0, "")
    with browser() as page:
        page.open(folder / "report.html")
        shown, spread = page.cells(), page.numbers()
        heads = page.evaluate("[...document.querySelectorAll('#runs + div th')].map(e => e.textContent)")
        cells = page.evaluate("[...document.querySelectorAll('#runs + div tr')].map(e => e.textContent)")
        images = page.evaluate("[...document.images].map(i => i.complete && i.naturalWidth > 0)")
        text = page.evaluate("document.body.textContent")
        assert not page.errors
    table = {row["run"]: row for row in rows(folder)}
    assert {run for run, *_ in shown} == set(table)
    assert all(table[run][column] == value for run, column, value in shown)
    assert {column for run, column, _ in shown if run == "1"} == set(COLUMNS)
    assert {column for run, column, _ in shown if run == "2"} == {"nominal_stress_MPa"}  # it slid round
    assert heads[:3] == ["run", "friction.options.coefficient", "service.torque"]
    assert cells[3].startswith("30.40.0")
    assert "ended early" in cells[2]
    assert "run 2: service: no equilibrium was found" in text
    assert images == [True]
    totals = json.loads((folder / "service-study.json").read_text())["statistics"]
    assert len(spread) == 6 * len(COLUMNS)
    assert all(totals[key.split(".")[1]][key.split(".")[2]] == value for key, value in spread)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("service-study.json", "{}", "has no title"),
        ("service-study.csv", "", "is empty"),
        ("service-study.csv", "run,label\n1,a\n", "is no table of a study"),
        ("service-study.csv", None, "cannot be read"),
    ],
)
def test_a_damaged_study_has_no_page_and_one_line(
    done: tuple[Path, str], tmp_path: Path, name: str, content: str | None, said: str
) -> None:
    for each in ("service-study.json", "service-study.csv"):
        shutil.copy(done[0] / each, tmp_path)
    text = (tmp_path / name).read_text()
    (tmp_path / name).write_text(text[: int(0.8 * len(text))] if content is None else content)
    told = report(tmp_path)
    assert told.exit_code == 2
    assert len(told.stderr.splitlines()) == 1
    assert said in told.stderr
    assert not (tmp_path / "report.html").exists()


def test_a_standard_of_the_press_has_no_page_of_a_service(done: tuple[Path, str]) -> None:
    told = report(done[0], "--standard", "gost-11018")
    assert told.exit_code == 2
    assert "leave --standard and --wheel out" in told.stderr


def test_goes_on_with_the_runs_that_are_missing(done: tuple[Path, str], tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    folder.mkdir()
    data = (done[0] / STUDY_FILE).read_bytes()
    end = [place for _, place in frames(data, len(MAGIC))][1]
    (folder / STUDY_FILE).write_bytes(data[:end])
    refused = study(folder, *VARIED)
    assert refused.exit_code == 2
    assert "continue it with --resume" in refused.stderr
    result = study(folder, *VARIED, more=("--resume", "--keep"))
    assert result.exit_code == 0, result.stderr
    assert "2 of 4 runs are there already" in result.stdout
    assert sorted(path.name for path in (folder / "runs").iterdir()) == ["0003", "0004"]
    assert (folder / "runs" / "0003" / "seat.vtu").is_file()
    timeless = [[{**row, "cpu_s": ""} for row in rows(place)] for place in (folder, done[0])]
    assert timeless[0] == timeless[1]


def test_runs_of_an_older_study_are_not_left_beside_newer_results(tmp_path: Path) -> None:
    plan = plan_study("wheelset", VARIED)
    old, mine = tmp_path / "runs" / "0007", tmp_path / "runs" / "notes"
    for resume in (True, False):
        open_service_study(tmp_path, plan, resume=resume).close()
        assert (old.exists(), mine.exists()) == (False, not resume)
        for folder in (old, mine):
            folder.mkdir(parents=True, exist_ok=True)
        (old / NUMBERS).write_text("{}")
    open_service_study(tmp_path, plan, resume=True).close()
    assert old.exists()


def test_an_older_page_is_not_left_beside_newer_results(tmp_path: Path) -> None:
    plan = plan_study("wheelset", VARIED)
    records = [record_as(run.digest, 1.0) for run in plan.runs]
    for resume in (False, True):
        pages = [tmp_path / "report.html", tmp_path / "report.pdf"]
        kept = open_service_study(tmp_path, plan, resume=resume)
        for page in pages:
            page.write_text("older")
        write_service_study(tmp_path, plan, records)
        kept.close()
        assert not any(page.exists() for page in pages)
        pages[0].write_text("of these results")
        open_service_study(tmp_path, plan, resume=True).close()
        assert pages[0].exists()  # nothing has been written yet
        open_service_study(tmp_path, plan, resume=False).close()
        assert not pages[0].exists()


def record_as(digest: str, value: float | None) -> ServiceRecord:
    values = dict.fromkeys(MEASURES, value)
    return ServiceRecord(digest=digest, values=values, verdict="accepted", ended=None, doubts=[], cpu_s=0.0)


def test_each_kind_of_doubt_is_said_with_the_runs_that_have_it(tmp_path: Path) -> None:
    doubts = (["the wheel creeps: 2%"], ["the wheel creeps: 9%", "steel yielded"], [])
    empty = {"runs_cpu_s": 1.0, "statistics": {}, "verdicts": {}, "ended": {}}
    records = [
        ServiceRecord(digest=str(k), values={}, verdict="accepted", ended=None, doubts=each, cpu_s=1.0)
        for k, each in enumerate(doubts)
    ]
    said = [line for line in _sentences(records, empty) if line.startswith("Doubtful")]
    assert said == [
        "Doubtful: 2 of 3 runs, the first of them: the wheel creeps: 2%",
        "Doubtful: 1 of 3 runs, steel yielded",
    ]


def test_a_standard_of_the_press_judges_no_service(tmp_path: Path) -> None:
    result = study(tmp_path / "study", *VARIED, more=("--standard", "gost-11018"))
    assert result.exit_code == 2
    assert result.stderr.startswith("macrofit: --standard: gost-11018 judges presses")
    assert not (tmp_path / "study").exists()


def test_a_folder_of_a_press_study_is_refused(tmp_path: Path) -> None:
    (tmp_path / "study.bin").write_bytes(b"macrofit study 2\n")
    result = study(tmp_path, *VARIED)
    assert result.exit_code == 2
    assert f"{tmp_path}: holds a study, of macrofit study; choose another folder with -o" in result.stderr


@pytest.mark.parametrize(
    "vary", [("wheel.bore_radius=94.8:94.9:0.01", "service.steps=9,15"), ("mesh.seat_facet=4,5,6,7,8",)]
)
def test_figure_takes_any_number_of_runs(tmp_path: Path, vary: tuple[str, ...]) -> None:
    plan = plan_study("wheelset", vary)
    records = [record_as(run.digest, None if run.number == 2 else float(run.number)) for run in plan.runs]
    assert write_service_figure(tmp_path / "a.png", plan, records).stat().st_size > 10_000
    seeds = as_seeds(plan)
    assert write_service_figure(tmp_path / "b.png", seeds, records * 3).stat().st_size > 10_000


def as_seeds(plan: Any) -> Any:
    """The plan as if it had numbered surfaces, three times as many."""
    return replace(plan, keys=("friction.options.seed",), runs=plan.runs * 3)
