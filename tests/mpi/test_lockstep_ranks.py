"""Runs in lockstep whose ranks share each batch of pairs: one rank's failure ends one run, on all ranks."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import rippled
from mpi4py import MPI
from small import small_press

from macrofit.assembly import assemble
from macrofit.base.arrays import FloatArray
from macrofit.errors import ProviderError
from macrofit.friction import TilePairs
from macrofit.lockstep.solve import Run, solve_together
from macrofit.monitor import Silent
from macrofit.scene import dump_scene
from macrofit.solution import Solution

WORLD = MPI.COMM_WORLD
PROGRAM = Path(rippled.__file__)
PATIENCE_S = 60.0


class Tiles:
    """0.05 or 0.15 by the parity of the seat tile; it may fail on the last rank, at the tiles of half of the way."""

    depends_on = frozenset({"tiles"})

    def __init__(self, *, fails: bool = False) -> None:
        self.fails = fails

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        if self.fails and WORLD.rank == WORLD.size - 1 and int(pairs.seat.max()) > 20:
            raise RuntimeError("the table is empty")
        return np.asarray(0.05 + 0.1 * (pairs.seat % 2))


def pressed(comm: MPI.Comm, *providers: Tiles | None) -> list[Solution | Exception]:
    """One run for each provider, of the scene's uniform coefficient where there is none."""
    scene = small_press()
    runs = [Run(scene=scene, monitor=Silent(), friction=provider) for provider in providers]
    return [*solve_together(runs, comm, assemble(scene, comm))]


@pytest.mark.mpi
def test_a_provider_that_fails_on_one_rank_ends_its_run_alone() -> None:
    """A uniform run first, then two per pair: every rank has the error of the second, and the same forces of both."""
    first, failed, last = pressed(WORLD, None, Tiles(fails=True), Tiles())
    assert isinstance(failed, ProviderError)
    assert "the table is empty" in str(failed)
    assert WORLD.allgather(type(failed).__name__) == ["ProviderError"] * WORLD.size
    for own, alone in zip((first, last), pressed(MPI.COMM_SELF, None, Tiles()), strict=True):
        assert isinstance(own, Solution)
        assert isinstance(alone, Solution)
        assert own.force == pytest.approx(alone.force, abs=1e-9 * np.abs(alone.force).max())
        assert len({force.tobytes() for force in WORLD.allgather(own.force)}) == 1


@pytest.mark.parametrize("command", ["study", "identify"])
def test_a_rank_that_is_killed_ends_the_job(command: str, tmp_path: Path, mpirun) -> None:  # type: ignore[no-untyped-def]
    """In the midst of a group: a rank's own in a study, that of all ranks in an identification."""
    scene = tmp_path / "small.toml"
    scene.write_text(dump_scene(small_press("motion.travel=40", "friction.provider=rippled")))
    rows = "".join(f"{s},{8e3 * (s - 10)}\n" for s in range(16, 41))
    (tmp_path / "m.csv").write_text(f"displacement_mm,force_N\n{rows}")
    own = {
        "study": ["--set", "friction.options.kill_at=5", "--vary", "friction.options.seed=1:6"],
        "identify": ["--set", "friction.options.kill_at=1", "--curve", tmp_path / "m.csv"],
    }
    begin = time.perf_counter()
    done = mpirun(2, PROGRAM, command, scene, *own[command], "-o", tmp_path / "out", timeout=PATIENCE_S)
    assert done.returncode not in (0, 124), done.stderr
    assert time.perf_counter() - begin < PATIENCE_S
    assert "killed" in done.stderr.lower() or "signal 9" in done.stderr, done.stderr
