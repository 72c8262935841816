"""A friction provider as a user writes it: the manual's, installed by its entry point, checked, and run."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pages
import pytest
from mpi4py import MPI
from small import plain_shaft

from macrofit.friction import BuildContext, build, names
from macrofit.friction.conformance import check
from macrofit.solve import solve

HERE = Path(__file__)
SOURCE = HERE.parents[1] / "data" / "polished.py"
PAGE = HERE.parents[2] / "docs" / "rough-friction.md"
ITS_TEST = """\
from macrofit.friction import BuildContext, build
from macrofit.friction.conformance import check

check(build("polished", {}, BuildContext(seat_tiles=9, bore_tiles=9, youngs_modulus=210e3, poisson_ratio=0.3)))
"""
CONTEXT = BuildContext(seat_tiles=60, bore_tiles=30, youngs_modulus=206e3, poisson_ratio=0.3)


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The module and the metadata that an installer writes, in a folder on the path."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "polished", raising=False)
    (tmp_path / "polished.py").write_text(SOURCE.read_text())
    info = tmp_path / "polished-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: polished\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[macrofit.friction]\npolished = polished:Polished\n")


def test_it_takes_twenty_five_lines_of_code() -> None:
    lines = [line for line in SOURCE.read_text().splitlines() if line.strip()]
    assert len(lines) <= 25


def test_the_manual_shows_this_one() -> None:
    blocks = [block.text for block in pages.blocks(PAGE) if block.language == "python"]
    assert [block for block in blocks if "class Polished" in block] == [SOURCE.read_text()]
    assert ITS_TEST in blocks


def test_it_is_listed() -> None:
    assert [tuple(found) for found in names() if found.name == "polished"] == [
        ("polished", "polished 1.0", "polished:Polished")
    ]


def test_polished_keeps_the_contract() -> None:
    check(build("polished", {"worn": 0.05}, CONTEXT), tolerance=0.0)
    exec(ITS_TEST, {})


def test_it_decides_the_friction_of_a_run() -> None:
    """On the plain shaft each facet is a tile, and its friction the formula at its middle; with its uncertainty."""
    solution = solve(plain_shaft("polished", worn=0.05, length=20.0), MPI.COMM_SELF)
    middle = 0.5 * (solution.seat[1:] + solution.seat[:-1])
    for record in solution.increments:
        held = record.facets.pressure > 0.0
        np.testing.assert_allclose(
            record.facets.friction[held], (0.12 - 0.07 * np.exp(-middle / 20.0))[held], rtol=1e-12
        )
    assert solution.friction is not None
    assert set(solution.friction.uncertainty.tolist()) == {0.01}
    assert solution.counters["pairs_asked"] == solution.friction.seat.size
