"""Steel yields alike on any number of ranks: to the bit on 1, 2 and 3."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from found import Found
from mpi4py import MPI
from small import YIELDING, small_press

from macrofit.base.arrays import FloatArray
from macrofit.scene import Scene
from macrofit.solution import Solution
from macrofit.solve import solve

PROGRAM = """
import sys
import numpy as np
from mpi4py import MPI
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/mpi"]
from test_plastic_ranks import numbers, scene
from macrofit.solve import solve
solution = solve(scene())
if MPI.COMM_WORLD.rank == 0:
    np.save(sys.argv[2], numbers(solution))
"""


def scene() -> Scene:
    """The small press that yields, and lets go."""
    return small_press(*YIELDING, "motion.travel=40", "motion.release=true", fields=True)


def numbers(solution: Solution) -> FloatArray:
    """Forces, plastic work and strain, iterations, stresses and zones."""
    records = [(r.force, r.plastic_work, r.plastic_strain, r.plastic_iterations) for r in solution.increments]
    zones = [(z.value, z.r_mm, z.depth_mm, z.area_mm2) for z in solution.flowed.values()]
    stresses = [extreme.value for extreme in solution.max_von_mises.values()]
    return np.concatenate([np.ravel(records), np.ravel(zones), stresses])


@pytest.mark.mpi
def test_same_bits_alone_and_together() -> None:
    """Every rank alone (COMM_SELF) and all of them together."""
    alone, together = solve(scene(), MPI.COMM_SELF), solve(scene(), MPI.COMM_WORLD)
    assert (numbers(alone) == numbers(together)).all()
    for a, b in zip(alone.increments, together.increments, strict=True):
        assert (a.facets.pressure == b.facets.pressure).all()


@pytest.mark.parametrize("ranks", [2, 3])
def test_other_processes(ranks: int, tmp_path: Path, mpirun, found: Found) -> None:  # type: ignore[no-untyped-def]
    """Another process, on more ranks than cores."""
    program, out = tmp_path / "program.py", tmp_path / "out.npy"
    program.write_text(PROGRAM)
    finished = mpirun(ranks, program, Path(__file__).parents[1], out, timeout=100.0)
    assert finished.returncode == 0, finished.stderr
    alone = numbers(solve(scene(), MPI.COMM_SELF))
    difference = np.abs(np.load(out) - alone).max() / np.abs(alone).max()
    assert found(f"one rank against {ranks}: force, plastic strain and work", difference, 0.0)
