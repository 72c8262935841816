"""The page of a run and of a study: what it says is what the files say, it needs no network, and it moves."""

from __future__ import annotations

import base64
import csv
import json
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from browser import Browser, browser
from click.testing import CliRunner

from macrofit.cli import main
from macrofit.report.chart import BOTTOM, Frame, Window, names, overlay, ticks
from macrofit.report.inputs import MOST_ROWS, studied
from macrofit.report.page import pictures
from macrofit.report.pdf import found_browser
from macrofit.report.seat import MOST_VALUES, SHOWN, Seat, seat_view, shown_increments
from macrofit.results.folder import write_summary

TITLE = "A <b>short</b> fit & its ends"
SCENE = f"""
title = "{TITLE}"
[axle]
seat_radius = 95.0
seat_length = 190.0
taper_length = 5.0
taper_height = 0.5
material = {{ yield_stress = 120.0, elastic = true }}
[wheel]
bore_radius = 94.85
hub_length = 180.0
hub_outer_radius = 140.0
material = {{ yield_stress = 240.0 }}
[motion]
travel = 180.0
increment = 4.0
[mesh]
order = 1
seat_facet = 3.0
coarse = 30.0
"""
MOST_BYTES = 2_000_000
MOST_CPU_S = 1.0
NOT_SHOWN = re.compile(r"title|versions|provenance|verdict|doubts|.*\.low|.*\.high|.*\.at_mm")
"""Keys of summary.json whose values are words, or limits that stand within the words of a check."""

with_browser = pytest.mark.skipif(found_browser() is None, reason="no chromium: make setup-test installs it")


def macrofit(*arguments: object) -> Any:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that is over, with its page."""
    place = tmp_path_factory.mktemp("report")
    (place / "fit.toml").write_text(SCENE)
    assert macrofit("run", place / "fit.toml", "-o", place / "run", "--quiet").exit_code == 0
    done = macrofit("report", place / "run")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == f"Report          {place / 'run' / 'report.html'}\n"
    return place / "run"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study that is over, with its page."""
    place = tmp_path_factory.mktemp("study")
    (place / "fit.toml").write_text(SCENE)
    vary = "friction.options.coefficient=0.05,0.08"
    done = macrofit("study", place / "fit.toml", "--vary", vary, "--reference", "uniform=0.1", "-o", place / "study")
    assert done.exit_code == 0, done.stderr
    assert macrofit("report", place / "study").exit_code == 0
    return place / "study"


@pytest.fixture(scope="module")
def page(folder: Path) -> Iterator[Browser]:
    """The run's page in a real browser."""
    with browser() as chromium:
        chromium.open(folder / "report.html")
        yield chromium


class Addresses(HTMLParser):
    """Every attribute of a page by which a browser would load something."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = ("src", "href", "data", "poster", "action", "xlink:href", "srcset")
        self.found += [value or "" for name, value in attrs if name in names]


def numbers_of(tables: Any, before: str = "") -> Iterator[tuple[str, float]]:
    """The numbers of a JSON file by their keys."""
    if isinstance(tables, bool | str) or tables is None:
        return
    if isinstance(tables, int | float):
        yield before, float(tables)
        return
    for key, value in tables.items() if isinstance(tables, dict) else enumerate(tables):
        yield from numbers_of(value, f"{before}.{key}" if before else str(key))


def rounded(text: str, value: float) -> bool:
    """Whether a text is the value to the digits it shows, in the units that pages use."""
    shown = re.match(r"-?[\d.]+(e[-+]?\d+)?", text)[0]
    digits = len(re.sub(r"e.*|[-.]", "", shown).lstrip("0")) or 1
    room = 0.51 * 10.0 ** (1 - digits) * abs(float(shown))
    return any(abs(float(shown) - factor * value) <= room for factor in (1.0, 1e-3, 1e-6, 100.0))


@with_browser
def test_the_numbers_on_the_page_are_those_of_the_summary(folder, page):
    shown = page.evaluate(
        "[...document.querySelectorAll('data[data-key]')].map(e => [e.dataset.key, e.value, e.textContent])"
    )
    wanted = dict(numbers_of(json.loads((folder / "summary.json").read_text())))
    assert len(shown) > 40
    for key, value, text in shown:
        assert float(value) == wanted[key], key
        assert rounded(text, wanted[key]), (key, text, wanted[key])
    missing = {key for key in wanted if not NOT_SHOWN.match(key)} - {key for key, *_ in shown}
    assert not missing
    asked = {"verdict.checks.2.value", "beyond_yield.axle.depth_mm", "plastic_strain.wheel.area_mm2"}
    assert asked | {"holding.push_off_N", "holding.torque_N_mm"} <= {key for key, *_ in shown}


@with_browser
def test_each_check_has_its_verdict_and_each_doubt_is_said(folder, page):
    summary = json.loads((folder / "summary.json").read_text())
    text = page.evaluate("document.body.textContent")
    rows = page.evaluate("[...document.querySelectorAll('#checks ~ table')][0].tBodies[0].rows.length")
    results = page.evaluate(
        "[...[...document.querySelectorAll('#checks ~ table')][0].tBodies[0].rows].map(r => r.cells[1].textContent)"
    )
    checks = summary["verdict"]["checks"]
    assert rows == len(checks)
    assert results == [check["result"] for check in checks]
    assert summary["doubts"]
    assert all(doubt in text for doubt in summary["doubts"])
    assert page.evaluate("document.querySelector('.verdict').textContent").startswith(
        summary["verdict"]["word"].capitalize()
    )
    for said in summary["provenance"].values():
        assert said in (None, {}) or str(said) in text


@with_browser
def test_the_section_has_every_key_of_the_shapes(folder, page):
    drawn = page.evaluate("document.querySelector('#inputs ~ .wide svg').textContent")
    keys = ("axle.seat_radius = 95", "axle.taper_height = 0.5", "wheel.bore_radius = 94.85", "wheel.hub_length = 180")
    for key in keys:
        assert key in drawn


@with_browser
def test_the_slider_moves_what_it_says(folder, page):
    """Keys as a user presses them; numbers from the files, the path from its own pixels."""
    read = (
        "Object.fromEntries([...document.querySelectorAll('data[data-column]')].map(e => [e.dataset.column, +e.value]))"
    )
    rows = list(csv.DictReader((folder / "fitting_curve.csv").open()))
    with h5py.File(folder / "interface.h5") as file:
        pressure, edges = file["pressure"][:], np.append(file["facet_start"][:], file["facet_end"][-1:])
    frame = Frame(x0=edges[0], x1=edges[-1], y0=0.0, y1=1.05 * pressure.max(), height=280.0)
    page.evaluate("document.getElementById('slider').focus()")
    last = page.evaluate(read)
    for key, code, number in (
        ("Home", 36, 0),
        ("ArrowRight", 39, 1),
        ("End", 35, len(rows) - 1),
        ("ArrowLeft", 37, -2),
    ):
        page.press(key, code)
        found = page.evaluate(read)
        assert found == {name: float(rows[number][name]) for name in found}
        drawn = page.evaluate("document.getElementById('pressure').getAttribute('d')")
        heights = np.array([float(y) for y in re.findall(r"(?:M\S+ |V)([\d.]+)", drawn)])
        assert np.abs(heights - frame.up(pressure[number])).max() < 0.02
    assert found != last
    dot = page.evaluate("+document.getElementById('dot').getAttribute('cx')")
    x = float(rows[-2]["displacement_mm"])
    assert dot == pytest.approx(float(Frame(x0=0.0, x1=180.0, y0=0.0, y1=1.0).across(x)), abs=0.01)


@with_browser
def test_nothing_is_loaded_from_outside(folder, page):
    own = (folder / "report.html").resolve().as_uri()
    assert own in page.asked
    assert all(url == own or url.startswith("data:") for url in page.asked)
    assert not page.errors
    assert page.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")


@with_browser
def test_the_title_is_text_and_no_markup(page):
    assert page.evaluate("document.querySelector('h1').textContent") == TITLE
    assert page.evaluate("document.querySelectorAll('b').length") == 0


def test_the_page_names_no_other_file(folder, study):
    for place in (folder, study):
        text = (place / "report.html").read_text()
        addresses = Addresses()
        addresses.feed(text)
        assert addresses.found or place == study
        assert all(address.startswith(("data:image/png;base64,", "#")) for address in addresses.found)
        assert not re.search(r"@import|url\((?!#)|fetch\(|XMLHttpRequest|import\(", re.sub(r"base64,[^\"]*", "", text))


@with_browser
def test_the_page_of_a_study_has_its_runs(study):
    with browser() as chromium:
        chromium.open(study / "report.html")
        shown, spread = chromium.cells(), chromium.numbers()
        legend = chromium.evaluate("[...document.querySelectorAll('.legend li')].map(e => e.textContent)")
        windows = chromium.evaluate("document.querySelectorAll('rect.window').length")
    rows = {row["run"]: row for row in csv.DictReader((study / "study.csv").open())}
    assert {run for run, *_ in shown} == set(rows)
    assert all(rows[run][column] == value for run, column, value in shown)
    assert legend == ["uniform 0.1", "coefficient = 0.05", "coefficient = 0.08"]
    assert windows == 2
    totals = dict(numbers_of(json.loads((study / "study.json").read_text())))
    assert len(spread) == 24
    assert all(totals[key] == value for key, value in spread)


@with_browser
def test_a_pdf_is_printed(folder, tmp_path):
    done = macrofit("report", folder, "-o", tmp_path / "page.html", "--pdf")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.splitlines()[1] == f"PDF             {tmp_path / 'page.pdf'}"
    content = (tmp_path / "page.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert content.count(b"/Type /Page\n") >= 3
    assert sorted(each.name for each in tmp_path.iterdir()) == ["page.html", "page.pdf"]


def test_without_a_printer_one_line_says_so_and_the_page_is_there(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda *_: None)
    done = macrofit("report", folder, "-o", tmp_path / "page.html", "--pdf")
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert "neither chromium nor weasyprint" in done.stderr
    assert (tmp_path / "page.html").exists()


def test_a_printer_that_fails_leaves_no_half_file(folder, tmp_path, monkeypatch):
    fake = tmp_path / "bin" / "chromium"
    fake.parent.mkdir()
    fake.write_text("#!/bin/sh\necho 'no display' >&2\nexit 3\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{fake.parent}:{os.environ['PATH']}")
    done = macrofit("report", folder, "-o", tmp_path / "page.html", "--pdf")
    assert done.exit_code == 2
    assert "failed: no display" in done.stderr
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bin", "page.html"]


def test_it_is_quick_and_small(folder, study):
    """The whole command, start-up included; dolfinx is never loaded."""
    for place in (folder, study):
        script = (
            "import sys; from macrofit.cli import main; main(['report', sys.argv[1]], standalone_mode=False); "
            "assert not {'dolfinx', 'gmsh', 'petsc4py'} & set(sys.modules)"
        )
        subprocess.run([sys.executable, "-c", script, str(place)], check=True, capture_output=True)  # warm
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", script, str(place)], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime <= MOST_CPU_S
        assert (place / "report.html").stat().st_size <= MOST_BYTES


def test_another_standard_judges_anew(folder, tmp_path):
    done = macrofit("report", folder, "-o", tmp_path / "page.html", "--standard", "gost-11018", "--wheel", "emu")
    assert done.exit_code == 0, done.stderr
    text = (tmp_path / "page.html").read_text()
    assert "by GOST 11018, emu" in text
    assert "by EN 13260" not in text


def damage(folder: Path, name: str, content: bytes | None) -> None:
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_bytes(content)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("summary.json", None, "has not ended"),
        ("summary.json", b"{", "summary.json: cannot be read"),
        ("summary.json", b"{}", "has no peak_force_N"),
        ("scene.toml", None, "holds no run of macrofit"),
        ("fitting_curve.csv", b"displacement\n", "its header is another"),
        ("interface.h5", b"nothing", "interface.h5: cannot be read"),
    ],
)
def test_a_folder_that_is_none_is_one_line(folder, tmp_path, name, content, said):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    damage(copy, name, content)
    done = macrofit("report", copy, "-o", tmp_path / "page.html")
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere: is no folder"),
        (["{folder}", "-o", "page.txt"], "end it with .html"),
        (["{folder}", "--wheel", "emu"], "name it with --standard"),
        (["{folder}", "--standard", "none"], "no standard 'none'"),
    ],
)
def test_a_mistake_is_one_line(folder, arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = macrofit("report", *(each.format(folder=folder) for each in arguments))
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"), [(["--standard", "gost-11018"], "leave --standard"), (["-o", "page.html"], "is a folder")]
)
def test_a_mistake_with_a_study_is_one_line(study, arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "page.html").mkdir()
    done = macrofit("report", study, *arguments)
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr


def test_pictures_have_their_size_together(tmp_path):
    for name, size in (("stress.png", 50), ("stress_entrance.png", 30), ("friction.png", 30), ("distributions.png", 5)):
        (tmp_path / name).write_bytes(bytes(size))
    shown, left = pictures(tmp_path, 90)
    assert [len(base64.b64decode(each["address"].split(",")[1])) for each in shown] == [50, 30, 5]
    assert left == ["friction.png"]


def test_a_run_of_an_older_version_has_a_page_without_what_it_did_not_record(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    numbers = json.loads((copy / "summary.json").read_text())
    del numbers["provenance"], numbers["holding"], numbers["heat"]
    (copy / "summary.json").write_text(json.dumps(numbers))
    assert macrofit("report", copy).exit_code == 0
    assert "not recorded" in (copy / "report.html").read_text()


@pytest.mark.parametrize("renew", ["run", "results"])
def test_page_of_older_results_is_removed(folder, tmp_path, renew):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "report.pdf").write_text("older")
    (copy / "fit-4711.html").write_text("of somebody's own")
    assert (copy / "report.html").exists()
    if renew == "run":
        assert macrofit("run", copy / "scene.toml", "-o", copy, "--quiet", "--set", "motion.travel=10").exit_code == 0
    else:  # of a run that goes on, or is judged anew
        write_summary(copy, json.loads((copy / "summary.json").read_text()))
    assert not (copy / "report.html").exists()
    assert not (copy / "report.pdf").exists()
    assert (copy / "fit-4711.html").exists()


def test_the_table_of_a_study_ends_and_says_so(tmp_path):
    """It has the measures of which there is a spread, and the first runs; how many more there are is said."""
    numbers = {"title": "many", "keys": ["a"], "statistics": {"peak": {}}}
    found = studied(tmp_path, numbers, list(range(MOST_ROWS + 3)), {}, {"peak": ("peak", 1.0), "slip": ("slip", 1.0)})
    assert (found["rows"], found["more"]) == (list(range(MOST_ROWS)), 3)
    assert list(found["statistics"]) == ["peak"]
    assert studied(tmp_path, numbers, [1], {}, {})["more"] == 0


def test_what_made_a_run_is_in_its_summary(folder):
    made = json.loads((folder / "summary.json").read_text())["provenance"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", made["date"])
    assert re.fullmatch(r"[0-9a-f]{64}", made["scene_sha256"])
    assert made["friction_digest"] is None
    assert made["command"]


def test_the_largest_page_is_small_all_the_same(folder, tmp_path):
    """As many facets and increments as there may be, and pictures beyond the bound: those left out are named."""
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    head, *rows = (copy / "fitting_curve.csv").read_text().splitlines()
    (copy / "fitting_curve.csv").write_text("\n".join([head, *(rows * 20)[:500]]) + "\n")
    rng = np.random.default_rng(1)
    with h5py.File(copy / "interface.h5", "w") as file:
        file.attrs["coordinate"] = "z"
        edges = np.linspace(0.0, 180.0, 1001)
        file["facet_start"], file["facet_end"] = edges[:-1], edges[1:]
        file["displacement"] = np.arange(500.0)
        for name in ("pressure", "traction", "friction"):
            file[name] = rng.random((500, 1000))
    for name, size in (("stress.png", 890_000), ("stress_entrance.png", 400_000)):
        (copy / name).write_bytes(rng.bytes(size))
    assert macrofit("report", copy).exit_code == 0
    text = (copy / "report.html").read_text()
    assert len(text) <= MOST_BYTES
    assert "Left out for their size: stress_entrance.png." in text
    assert "428 displacements are left out of this page" in text


@pytest.mark.parametrize(("increments", "facets"), [(1, 10), (181, 200), (181, 10_000), (5000, 3000)])
def test_as_many_displacements_as_fit_a_page(increments, facets):
    shown = shown_increments(increments, facets)
    assert shown[-1] == increments - 1
    assert len(shown) * facets <= max(MOST_VALUES, facets)
    assert len(set(np.diff(shown))) <= 1


def test_names_of_windows_do_not_lie_on_each_other():
    frame = Frame(x0=0.0, x1=170.0, y0=0.0, y1=1250.0)
    close = [Window(name="A", low=612.0, high=1045.0), Window(name="B", low=794.0, high=1100.0)]
    heights = [float(y) for y in re.findall(r' y="([\d.]+)"', names(frame, close))]
    assert len(heights) == 2
    assert heights[1] - heights[0] >= 15.9


def test_curves_of_a_single_displacement_are_drawn():
    drawn = overlay([("one", np.array([180.0]), np.array([5.0]))], [])
    assert "nan" not in drawn
    assert "180" in drawn


def test_references_are_drawn_with_the_others():
    x = np.array([0.0, 180.0])
    drawn = overlay([("reference", x, x), ("run", x, x)], [], 1)
    assert drawn.count('stroke-width="2.0"') == 4  # two curves and their keys in the legend


def test_what_friction_holds_stays_within_its_drawing_when_the_push_turns():
    shear = np.array([[10.0, 12.0, 9.0], [-3.0, 1.0, -4.0], [0.0, 0.0, 0.0]])
    seat = Seat(coordinate="z", edges=np.arange(4.0), pressure=np.full((3, 3), 100.0), traction=shear,
                friction=np.full((3, 3), 0.15), shown=np.arange(3))  # fmt: skip
    curve = {key: np.arange(1.0, 4.0) for key in SHOWN}
    line = seat_view(seat, curve, Frame(x0=0.0, x1=3.0, y0=0.0, y1=1.0))["data"]["lines"][2]
    values = np.frombuffer(base64.b64decode(line["values"]), "<i2").reshape(3, 3)
    heights = line["zero"] + line["pixels"] * values
    assert (np.sign(values[:, 0]) == [1, -1, 1]).all()
    assert 0.0 < heights.min() < heights.max() < 280.0 - BOTTOM


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.0, 2728.5), (-3e-3, 1e-2), (100.0, 101.0)])
def test_ticks_are_round_and_within(low, high):
    found = ticks(low, high, 6)
    assert 2 <= len(found) <= 7
    assert (found >= low - 1e-9 * (high - low)).all()
    assert (found <= high + 1e-9 * (high - low)).all()
