"""The same numbers on any number of ranks: to the bit on 1 and 2, to 1e-12 on 3 and 4."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from found import Found
from mpi4py import MPI
from small import small_press

from macrofit.solve import solve

PROGRAM = """
import sys
import numpy as np
from mpi4py import MPI
sys.path.insert(0, sys.argv[1])
from small import small_press
from macrofit.solve import solve
solution = solve(small_press(fields=True))
if MPI.COMM_WORLD.rank == 0:
    np.savez(sys.argv[2], force=solution.force, stress=[e.value for e in solution.max_von_mises.values()])
"""


@pytest.mark.mpi
def test_same_bits_alone_and_together() -> None:
    """Every rank alone (COMM_SELF) and all of them together give the same bits, stresses included."""
    alone = solve(small_press(fields=True), MPI.COMM_SELF)
    together = solve(small_press(fields=True), MPI.COMM_WORLD)
    assert (alone.force == together.force).all()
    assert alone.max_von_mises == together.max_von_mises
    for a, b in zip(alone.increments, together.increments, strict=True):
        assert (a.facets.pressure == b.facets.pressure).all()
        assert a.newton_iterations == b.newton_iterations


@pytest.mark.parametrize("ranks", [2, 3, 4])
def test_other_processes(ranks: int, tmp_path: Path, mpirun, found: Found) -> None:  # type: ignore[no-untyped-def]
    """Another process, on more ranks than cores: 1e-12 (and on 2 ranks the same bits)."""
    program, out = tmp_path / "program.py", tmp_path / "out.npz"
    program.write_text(PROGRAM)
    finished = mpirun(ranks, program, Path(__file__).parents[1], out, timeout=100.0)
    assert finished.returncode == 0, finished.stderr
    alone = solve(small_press(fields=True), MPI.COMM_SELF)
    with np.load(out) as other:
        difference = np.abs(other["force"] - alone.force).max() / alone.force.max()
        assert found(f"one rank against {ranks}: force", difference, 0.0 if ranks == 2 else 1e-12)
