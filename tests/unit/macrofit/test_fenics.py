"""The compiled forms: silent when cold, and mended where a killed compilation left its source behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

FACTORS = """
import numpy as np, resource, scipy.sparse as sp
from macrofit.bodies.fenics import Factor, schur_complement

line = sp.diags([-1.0, 2.1, -1.0], [-1, 0, 1], shape=(60, 60))
matrix = sp.kronsum(line, line, format="csr")

def resident(times):
    for _ in range(times):
        schur_complement(matrix, np.arange(800))
        Factor(matrix, symmetric=True).solve(np.ones(3600))
    return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() / 2**20

before = resident(3)
print(resident(10) - before)
"""
COMPILE = "from macrofit.bodies.body import compile_form; compile_form(1)"


@pytest.mark.slow
def test_cold_and_broken_cache(tmp_path: Path) -> None:
    """Twice: with an empty cache, and with sources but no libraries, for which the compiler waits ten seconds."""
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", COMPILE],
            env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100, check=True,
        )  # fmt: skip
        assert done.stdout + done.stderr == ""
        libraries = list((tmp_path / "fenics").glob("*.so"))
        assert libraries
        for path in [*libraries, *(tmp_path / "fenics").glob("*.cached")]:
            path.unlink()


def test_factors_leave_the_memory() -> None:
    """A Schur complement of 800 unknowns takes 5 MiB, twice in its factor: ten that stayed would add 100 MiB."""
    done = subprocess.run(
        [sys.executable, "-c", FACTORS],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True, timeout=100,
    )  # fmt: skip
    assert float(done.stdout) < 25.0
