"""The commands of the README's tables start and end well on a small case."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

COMMANDS = [
    ["sweep", "contact-patch", "--set", "mesh.order=1"],
    ["cost", "--quick"],
    ["meso_cost", "--quick"],
    ["meso_sweep", "--slides", "3", "--spheres", "900"],
    ["meso_agreement", "--pairs", "1", "--spheres", "600"],
    ["meso_influence", "--quick"],
    ["dem_press", "--quick"],
    ["enriched_cost", "--quick"],
    ["surrogate_farm", "--quick"],
    ["surrogate_learning", "--quick"],
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_benchmark_runs(command: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks", *command],
        cwd=Path(__file__).parents[2], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("|\n") >= 3
