"""The commands of the README's tables start and end well on a small case."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize("command", [["sweep", "contact-patch", "--set", "mesh.order=1"], ["cost", "--quick"]])
def test_benchmark_runs(command: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks", *command],
        cwd=Path(__file__).parents[2], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n|") >= 3
