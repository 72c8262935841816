"""The script of the manual runs alone and under mpirun, and prints the same."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pages
from launcher import Mpirun

SCRIPT = Path(__file__).with_name("press.py")
PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def test_the_manual_shows_the_script() -> None:
    first = next(block for block in pages.blocks(PAGE) if block.language == "python")
    assert first.text.strip() == SCRIPT.read_text().split('"""\n', 1)[1].strip()


def test_script_alone_and_on_two_ranks(mpirun: Mpirun) -> None:
    alone = subprocess.run(
        [sys.executable, SCRIPT], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True, timeout=100
    )
    together = mpirun(2, SCRIPT, timeout=100.0)
    assert together.returncode == 0, together.stderr
    assert together.stdout == alone.stdout
    assert alone.stdout.splitlines()[2].startswith(" 40.0 mm")
