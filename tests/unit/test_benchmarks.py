"""The book of the benchmarks fills the pages; that each of them runs is seen by `make bench-check`."""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks import _book
from benchmarks._book import names

ROOT = Path(__file__).parents[2]


def test_page_is_renewed_between_its_marks(tmp_path: Path) -> None:
    (tmp_path / "cost.md").write_text("<!-- a1 -->\n| a |\n|---|\n| 1 |\n\nwords\n\n| b |\n|---|\n| 2 |\n")
    text = "x\n<!-- bench cost 2 -->\n| old |\n<!-- end -->\ny\n<!-- bench cost -->\n<!-- end -->\n"
    assert _book.renewed(text, tmp_path) == (
        "x\n<!-- bench cost 2 -->\n| b |\n|---|\n| 2 |\n<!-- end -->\n"
        "y\n<!-- bench cost -->\n| a |\n|---|\n| 1 |\n<!-- end -->\n"
    )


def test_pages_hold_what_was_measured_last() -> None:
    """Tables of the pages that a benchmark makes are those of docs/benchmarks, and docs/benchmarks.md is the book."""
    folder, shown = ROOT / "docs" / "benchmarks", 0
    for path in _book.pages():
        page = path.read_text()
        assert len(re.findall("<!-- bench ", page)) == page.count("<!-- end -->"), path
        assert _book.renewed(page, folder) == page, f"{path}: make bench, or python -m tests.benchmarks book --write"
        shown += page.count("<!-- bench ")
    assert shown >= 7
    book = (ROOT / "docs" / "benchmarks.md").read_text()
    records = [path for path in folder.glob("*.md") if not path.name.endswith(".failed.md")]
    assert {path.stem for path in records} <= set(names())
    for path in records:
        assert path.read_text().partition("\n")[2].strip() in book
