"""The page of a wheelset in service: what it says is what the files say, and it needs no network."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from browser import browser
from click.testing import CliRunner
from serving import read_table, service

from macrofit.cli import main
from macrofit.report.pdf import found_browser

with_browser = pytest.mark.skipif(found_browser() is None, reason="no chromium: make setup-test installs it")
NOT_SHOWN = re.compile(r"turned_revolutions|displacement_mm|verdict|friction.(friction_work|slip_left)_of_revolutions")
"""Keys of service.json that the page says in words, or not at all."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("service") / "served"
    # friction work alone would be steady: a torque makes the wheel creep, which is doubted
    keys = ("service.torque=1e7", "axle.material.grade=EA1N", "axle.material.elastic=true")
    assert service(place, *keys).exit_code == 0
    done = report(place)
    assert (done.exit_code, done.stderr) == (0, "")
    return place


def report(folder: Path, *more: str) -> Any:
    return CliRunner(mix_stderr=False).invoke(main, ["report", str(folder), *more])


def numbers_of(tables: Any, before: str = "") -> dict[str, float]:
    """The numbers of a JSON file by their keys."""
    if isinstance(tables, bool | str) or tables is None:
        return {}
    if isinstance(tables, int | float):
        return {before: float(tables)}
    found: dict[str, float] = {}
    for key, value in tables.items() if isinstance(tables, dict) else enumerate(tables):
        found |= numbers_of(value, f"{before}.{key}" if before else str(key))
    return found


@with_browser
def test_numbers_curves_and_doubts_are_those_of_the_files(folder: Path) -> None:
    with browser() as page:
        page.open(folder / "report.html")
        shown = page.numbers()
        text = page.evaluate("document.body.textContent")
        word = page.evaluate("document.querySelector('.verdict').className")
        curves = page.evaluate("[...document.querySelectorAll('path[id]')].map(e => [e.id, e.getAttribute('d')])")
        images = page.evaluate("[...document.images].map(i => i.complete && i.naturalWidth > 0)")
        assert not page.errors
        assert all(url == (folder / "report.html").resolve().as_uri() or url.startswith("data:") for url in page.asked)
    found = json.loads((folder / "service.json").read_text())
    wanted = {key: value for key, value in numbers_of(found).items() if not NOT_SHOWN.match(key)}
    assert dict(shown) == wanted
    assert found["doubts"]
    assert all(doubt in text for doubt in found["doubts"])
    assert word == "verdict refused"
    assert found["verdict"]["sentence"].removeprefix("refused") in text
    assert found["verdict"]["source"] in text
    assert images == [True]
    paths, seat = dict(curves), read_table(folder / "seat.csv")
    assert {"nominal_stress_MPa", "dang_van", "axial_slip_range_mm"} <= set(paths)
    heights = [float(pair.split()[1]) for pair in paths["crossland"][1:].split("L")]
    assert heights.index(min(heights)) == seat["crossland"].argmax()


def test_a_bonded_solution_has_a_page_and_no_standard_of_the_press(folder: Path, tmp_path: Path) -> None:
    assert service(tmp_path / "bonded", bonded=True).exit_code == 0
    assert report(tmp_path / "bonded").exit_code == 0
    text = (tmp_path / "bonded" / "report.html").read_text()
    assert "Friction work" not in text
    assert "not judged: state axle.material.grade" in text
    refused = report(folder, "--standard", "gost-11018")
    assert refused.exit_code == 2
    assert "leave --standard and --wheel out" in refused.stderr


def test_what_is_not_known_is_a_dash(tmp_path: Path) -> None:
    assert service(tmp_path / "served", "service.journal_moment=2e9").exit_code == 0
    assert report(tmp_path / "served").exit_code == 0
    text = (tmp_path / "served" / "report.html").read_text()
    assert "<tr><th>Front slip</th><td>–&nbsp;" not in text
    assert "<tr><th>Front slip</th><td>– along the axle, over " in text


def test_page_of_an_older_computation_is_removed(tmp_path: Path) -> None:
    assert service(tmp_path / "served", bonded=True).exit_code == 0
    assert report(tmp_path / "served").exit_code == 0
    assert service(tmp_path / "served", "service.torque=1e6", bonded=True).exit_code == 0
    assert not (tmp_path / "served" / "report.html").exists()


def test_what_ended_early_says_why(tmp_path: Path) -> None:
    assert service(tmp_path / "served", "service.torque=1e9").exit_code == 2
    assert report(tmp_path / "served").exit_code == 0
    text = (tmp_path / "served" / "report.html").read_text()
    assert "<strong>Ended early</strong>: service: no equilibrium was found beyond" in text


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("service.json", "{}", "has no title"),
        ("service.json", "{", "cannot be read"),
        ("seat.csv", "z_mm,crossland\n1,nothing\n", "seat.csv: cannot be read"),
        ("seat.csv", "a,b\n1,2\n3,4\n", "is no table of a seat"),
        ("fretting.csv", "", "fretting.csv: cannot be read"),
    ],
)
def test_damaged_files_are_one_line(folder: Path, tmp_path: Path, name: str, content: str, said: str) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / name).write_text(content)
    done = report(copy, "-o", str(tmp_path / "page.html"))
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr
