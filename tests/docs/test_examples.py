"""The example scripts run as they stand, and what they print is true."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import pages
import pytest
from click.testing import CliRunner

from macrofit.cli import main

EXAMPLES = pages.ROOT / "docs" / "examples"


def script(name: str, *words: str | Path) -> str:
    """What a script prints."""
    command = [sys.executable, EXAMPLES / name, *words]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_provider_of_ones_own_raises_the_force() -> None:
    """Friction that falls with the pressure stays above its lower value, on which the uniform run stands."""
    told = script("own_provider.py")
    uniform, pressed = (float(word) for word in re.findall(r"([\d.]+) kN", told))
    assert uniform < pressed < 1.4 * uniform
    assert "mean coefficient 0.1000" in told


def test_results_are_read_back(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    words = ["run", "wheelset", "-o", str(folder), "--preset", "fast", "--set", "motion.travel=30", "--quiet"]
    assert CliRunner().invoke(main, words).exit_code == 0
    told = script("read_results.py", folder)
    summary = json.loads((folder / "summary.json").read_text())
    assert f"curve: 31 increments, largest force {summary['peak_force_N'] / 1e3:.1f} kN" in told
    assert f"{summary['max_von_mises_MPa']['axle']['value']:.0f} MPa in the axle" in told
    assert "axle_0000.vtu" in told


def test_a_study_prints_each_combination(tmp_path: Path) -> None:
    """The force is nearly in proportion to the friction, and grows with the interference."""
    told = re.findall(r"mu = ([\d.]+), ([\d.]+) mm: (\d+) kN", script("study.py", tmp_path / "study"))
    force = {(mu, gap): float(value) for mu, gap, value in told}
    assert len(force) == 4
    assert force["0.12", "0.30"] == pytest.approx(1.2 * force["0.10", "0.30"], rel=0.02)
    assert force["0.10", "0.40"] > force["0.10", "0.30"]


def test_the_page_of_the_demo_has_the_numbers_of_its_study(tmp_path: Path) -> None:
    """As `make demo` does it, a short way: three runs, one page, every figure on it there."""
    folder = tmp_path / "demo"
    makefile = re.search(r"^demo:.*?(?=\n\n)", (pages.ROOT / "Makefile").read_text(), re.MULTILINE | re.DOTALL)
    assert makefile is not None
    (words,) = re.findall(
        r"macrofit (study .*?) -o demo\)", makefile[0].replace("\\\n", " ").replace("'", ""), re.DOTALL
    )
    command = pages.toy(["macrofit", *words.split()])[1:]
    done = CliRunner().invoke(main, [*command, "-o", str(folder), "--quiet"])
    assert done.exit_code == 0, done.output
    assert "demo/index.html" in script("demo_page.py", folder).replace(str(tmp_path) + "/", "")
    told = (folder / "index.html").read_text()
    with (folder / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    for row in rows:
        assert f"<td>{float(row['final_force_N']) / 1e3:.0f}</td>" in told
        assert f"{float(row['wheel_max_von_mises_MPa']):.0f}</td>" in told
    for picture in re.findall(r'src="([^"]+)"', told):
        assert (folder / picture).is_file()
    assert "resonance" in told


def test_a_seat_wears_and_is_pressed_anew(tmp_path: Path) -> None:
    """More is lost from line to line, and friction falls with it."""
    told = script("worn_seat.py", tmp_path / "worn")
    rows = [
        tuple(map(float, row)) for row in re.findall(r"work ([\d.]+) J; then up to ([\d.]+) um .* from ([\d.]+)", told)
    ]
    works, depths, frictions = zip(*rows, strict=True)
    assert len(works) == 4
    assert list(depths) == sorted(depths)
    assert list(frictions) == sorted(frictions, reverse=True)
    assert works[-1] != works[0]
    assert (tmp_path / "worn" / "worn.csv").read_text().startswith("z_mm,deviation_um\n")
    assert "pressed onto the worn seat: friction work" in told
