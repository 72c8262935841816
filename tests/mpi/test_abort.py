"""The tests themselves under MPI: a rank that fails takes the others with it, and says why."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest
from launcher import Mpirun

FAILS_ON_ONE_RANK = """
from mpi4py import MPI

def test_one_rank_fails_before_a_barrier():
    if MPI.COMM_WORLD.rank == 1:
        raise ValueError("only the second rank knows")
    MPI.COMM_WORLD.Barrier()
"""

FAILS_WHEN_COLLECTED = """
from mpi4py import MPI

if MPI.COMM_WORLD.rank == 1:
    raise ValueError("only the second rank knows")

def test_barrier():
    MPI.COMM_WORLD.Barrier()
"""

HANGS = """
from mpi4py import MPI

def test_a_message_never_comes():
    MPI.COMM_WORLD.recv(source=1 - MPI.COMM_WORLD.rank)
"""

TESTS = Path(__file__).parents[1]
PATIENCE_S = 60.0  # without the abort the job would wait for ever; with it a start of Python and MPI is all


@pytest.mark.parametrize("text", [FAILS_ON_ONE_RANK, FAILS_WHEN_COLLECTED], ids=["test", "collection"])
def test_a_failing_rank_ends_the_job(text, tmp_path, mpirun):
    for name in ("conftest.py", "found.py", "launcher.py"):
        shutil.copy(TESTS / name, tmp_path)
    (tmp_path / "test_generated.py").write_text(text)
    begin = time.perf_counter()
    done = mpirun(2, "-m", "pytest", "-p", "no:cacheprovider", "test_generated.py", timeout=PATIENCE_S, cwd=tmp_path)
    assert time.perf_counter() - begin < PATIENCE_S / 2
    assert done.returncode not in (0, 124), done.stdout + done.stderr
    assert "rank 1 of 2 failed" in done.stderr
    assert "only the second rank knows" in done.stderr


def test_a_hanging_test_ends_the_job_with_its_traceback(tmp_path, mpirun):
    conftest = (TESTS / "conftest.py").read_text()
    for name in ("found.py", "launcher.py"):
        shutil.copy(TESTS / name, tmp_path)
    (tmp_path / "conftest.py").write_text(conftest.replace("LIMIT_S = 120.0", "LIMIT_S = 2.0"))
    (tmp_path / "test_generated.py").write_text(HANGS)
    done = mpirun(2, "-m", "pytest", "-p", "no:cacheprovider", "test_generated.py", timeout=PATIENCE_S, cwd=tmp_path)
    assert done.returncode not in (0, 124), done.stdout + done.stderr
    assert "in test_a_message_never_comes" in done.stderr


@pytest.mark.mpi
def test_the_shared_folder_is_the_same_on_every_rank(shared_tmp_path):
    from mpi4py import MPI

    everywhere = MPI.COMM_WORLD.allgather(str(shared_tmp_path))
    assert set(everywhere) == {str(shared_tmp_path)}
    (shared_tmp_path / f"rank{MPI.COMM_WORLD.rank}").touch()
    MPI.COMM_WORLD.Barrier()
    assert len(list(shared_tmp_path.iterdir())) == MPI.COMM_WORLD.size


ALONE = """
from mpi4py import MPI
from macrofit.assembly import assemble
from macrofit.scene import load_scene

if MPI.COMM_WORLD.rank == 1:
    assemble(load_scene("wheelset", ["mesh.coarse=60", "mesh.seat_facet=8", "output.stress=false"]), MPI.COMM_SELF)
MPI.COMM_WORLD.Barrier()
"""


def test_a_rank_that_needs_dolfinx_does_not_wait_for_those_that_do_not(
    tmp_path: Path, mpirun: Mpirun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PETSc would begin on all ranks together; where stiffnesses are kept, some ranks never load it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    done = mpirun(2, "-c", ALONE, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr
