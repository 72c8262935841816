"""Every benchmark starts and ends well on its toy size, and the book keeps what it says: `make bench-check`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks import _book

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", _book.names())
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
