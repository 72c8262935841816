"""Every benchmark starts and ends well on its toy size; the book of them is put together and fills the README."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks import _book
from benchmarks._book import names

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", names())
def test_benchmark_runs(name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks", name, "--quick"],
        cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("|\n") >= 3


def test_book_keeps_what_was_measured(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A benchmark leaves its words, its tables and its figure; one that fails leaves nothing and is told."""
    folder = tmp_path / "benchmarks"
    assert _book.main(["press_profile", "--quick", "--into", str(folder)]) == 0
    assert {file.name for file in folder.iterdir()} == {f"press_profile.{end}" for end in ("md", "csv", "png")}
    book = (tmp_path / "benchmarks.md").read_text()
    assert "## press_profile" in book
    assert "](benchmarks/press_profile.png)" in book
    rows = _book.tables(book)[0]
    assert rows[0][:2] == ["stage", "CPU [ms]"]
    assert (folder / "press_profile.csv").read_text().count("\n") == len(rows)
    with pytest.raises(SystemExit):
        _book.main(["nothing"])


def test_readme_is_renewed_between_its_marks(tmp_path: Path) -> None:
    (tmp_path / "cost.md").write_text("<!-- a1 -->\n| a |\n|---|\n| 1 |\n\nwords\n\n| b |\n|---|\n| 2 |\n")
    text = "x\n<!-- bench cost 2 -->\n| old |\n<!-- end -->\ny\n<!-- bench cost -->\n<!-- end -->\n"
    assert _book.renewed(text, tmp_path) == (
        "x\n<!-- bench cost 2 -->\n| b |\n|---|\n| 2 |\n<!-- end -->\n"
        "y\n<!-- bench cost -->\n| a |\n|---|\n| 1 |\n<!-- end -->\n"
    )


def test_readme_holds_what_was_measured_last() -> None:
    """Tables of the README that a benchmark makes are those of docs/benchmarks, and docs/benchmarks.md is the book."""
    readme, folder = (ROOT / "README.md").read_text(), ROOT / "docs" / "benchmarks"
    assert len(re.findall("<!-- bench ", readme)) == readme.count("<!-- end -->") >= 3
    assert _book.renewed(readme, folder) == readme
    book = (ROOT / "docs" / "benchmarks.md").read_text()
    records = [path for path in folder.glob("*.md") if not path.name.endswith(".failed.md")]
    assert {path.stem for path in records} <= set(names())
    for path in records:
        assert path.read_text().partition("\n")[2].strip() in book
