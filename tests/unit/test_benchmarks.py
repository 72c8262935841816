"""Every benchmark starts and ends well on its toy size; the book of them is put together and fills the README."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

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
