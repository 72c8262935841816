"""What is verified, how exact is it, and where is the bar?

    python -m tests.benchmarks verification

Runs the tests behind the README's tables of what is verified and prints what each of them found beside the bar that it
asserts. A row is the worst of all cases of its test: meshes, orders, theta, friction.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ._measure import head, lines, row

ROOT = Path(__file__).parents[2]
TABLES = {
    "The press-fit": (
        "verification/test_patch.py", "verification/test_lame.py", "verification/test_hertz.py",
        "verification/test_push_out.py", "verification/test_reversal.py", "verification/test_energy.py",
        "verification/test_engines.py", "mpi/test_ranks.py", "verification/test_wheelset.py",
        "verification/test_field_ripple.py", "verification/test_sweep.py",
    ),
    "The plates": (
        "verification/test_lattice.py", "verification/test_calibration.py", "verification/test_external_faces.py",
        "verification/test_two_spheres.py", "verification/test_friction_test.py", "verification/test_breakage.py",
    ),
}  # fmt: skip
QUICK = {"The press-fit": ("verification/test_push_out.py",)}

Figure = dict[str, Any]


def tested(files: Sequence[str]) -> tuple[int, list[Figure]]:
    """Exit code of pytest on these files, and what it found; its own words go to stderr."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "figures.json"
        words = ["-q", "--no-header", "-p", "no:cacheprovider", f"--figures={target}"]
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *words, *(f"tests/{file}" for file in files)],
            cwd=ROOT, stdin=subprocess.DEVNULL, stdout=sys.stderr, check=False,
        )  # fmt: skip
        return done.returncode, json.loads(target.read_text())


def worst(figures: Sequence[Figure]) -> list[tuple[Figure, int]]:
    """Of each value and bar the one nearest to the bar or beyond it, and how many there were."""
    groups: dict[tuple[str, float, bool], list[Figure]] = {}
    for figure in figures:
        groups.setdefault((figure["what"], figure["bar"], figure["at_least"]), []).append(figure)
    return [
        ((min if at_least else max)(group, key=lambda figure: float(figure["value"])), len(group))
        for (_, _, at_least), group in groups.items()
    ]


def number(value: float) -> str:
    """Two digits, such as 1.1e-5; three where it is not small."""
    return f"{value:.{2 if abs(value) < 0.1 else 3}g}".replace("e-0", "e-").replace("e+", "e")


def cells(figure: Figure, count: int) -> tuple[str, ...]:
    """Against what, found, bar, test."""
    name = figure["test"].rpartition("::")[2].partition("[")[0]
    bar = f"{'at least' if figure['at_least'] else 'at most'} {number(figure['bar'])}" if figure["bar"] else "0"
    cases = f", {count} values" if count > 1 else ""
    return figure["what"], number(figure["value"]), bar, f"`{name}`{cases}"


def main(words: Sequence[str]) -> int:
    """Print a table for the press-fit and one for the plates; 1 where a test fails."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks verification", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one fast file of tests")
    options = parser.parse_args(words)
    tables = QUICK if options.quick else TABLES
    code, figures = tested([file for files in tables.values() for file in files])
    for title, files in tables.items():
        rows = worst([figure for file in files for figure in figures if f"{file}::" in figure["test"]])
        print(f"\n{title}:\n")
        lines([head("against what", "found", "bar", "test"), *(row(*cells(*each)) for each in rows)])
    kept = sum(figure["value"] >= figure["bar"] if figure["at_least"] else figure["value"] <= figure["bar"]
               for figure in figures)  # fmt: skip
    print(f"\n{kept} of {len(figures)} values keep their bar; the tests {'failed' if code else 'passed'}.")
    return int(code != 0)
