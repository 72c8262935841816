"""A provider's failure on one rank ends the run on all of them, with the provider's name; good ones share the work."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from small import small_press
from untrained import untrained

from macrofit.base.arrays import FloatArray
from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, TilePairs, build
from macrofit.parallel import SharedAsk, joined
from macrofit.results.folder import read_curve
from macrofit.scene import load_scene
from macrofit.solution import Increment
from macrofit.solve import solve

WORLD = MPI.COMM_WORLD


class Tiles:
    """0.05 or 0.15 by the parity of the seat tile, until ``break_at`` pairs were answered on the last rank."""

    depends_on = frozenset({"tiles"})

    def __init__(self, bad: Callable[[FloatArray], FloatArray] | None = None, break_at: int = 0) -> None:
        self.bad, self.break_at, self.asked = bad, break_at, 0

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        self.asked += len(pairs.seat)
        answer = 0.05 + 0.1 * (pairs.seat % 2)
        if self.bad is not None and WORLD.rank == WORLD.size - 1 and self.asked > self.break_at:
            return self.bad(answer)
        return answer


def raises(answer: FloatArray) -> FloatArray:
    raise RuntimeError("the table is empty")


class OwnError(Exception):
    """It cannot be pickled: its words are no argument of its own."""

    def __init__(self, code: int, words: str) -> None:
        super().__init__(f"{words}, code {code}")


def raises_what_cannot_be_sent(answer: FloatArray) -> FloatArray:
    raise OwnError(7, "a plugin's own error")


def exits(answer: FloatArray) -> FloatArray:
    sys.exit(0)


FAILURES: dict[str, tuple[Callable[[FloatArray], FloatArray], str]] = {
    "raises": (raises, "the table is empty"),
    "raises what cannot be sent": (raises_what_cannot_be_sent, "a plugin's own error, code 7"),
    "exits": (exits, "it asked the program to exit, with 0"),
    "nan": (lambda answer: answer * np.nan, "nan"),
    "shape": (lambda answer: answer[:-1], "shape"),
    "negative": (lambda answer: -answer, "-0."),
    "large": (lambda answer: answer + 2.0, "2."),
}


class Kept:
    """A monitor and journal that remember what was accepted."""

    def __init__(self) -> None:
        self.records: list[Increment] = []

    def started(self, scene: object, total_increments: int, dofs: int) -> None: ...

    def increment(self, record: Increment) -> None:
        self.records.append(record)

    def finished(self) -> None: ...


@pytest.mark.mpi
@pytest.mark.parametrize(("bad", "message"), FAILURES.values(), ids=FAILURES.keys())
def test_failure_on_one_rank(bad: Callable[[FloatArray], FloatArray], message: str) -> None:
    """Every rank gets the ProviderError; the increments accepted before it were told on every rank."""
    provider = Tiles(bad, break_at=60)
    kept = Kept()
    with pytest.raises(ProviderError, match="test_providers:Tiles") as caught:
        solve(small_press(), WORLD, kept, friction=provider)
    assert message in str(caught.value)
    assert 0 < len(kept.records) < 10
    assert WORLD.allgather(len(kept.records)) == [len(kept.records)] * WORLD.size


@pytest.mark.mpi
def test_the_batch_is_shared_and_each_pair_asked_once() -> None:
    provider = Tiles()
    solution = solve(small_press(), WORLD, friction=provider)
    asked = WORLD.allgather(provider.asked)
    assert sum(asked) == solution.counters["pairs_asked"]
    assert max(asked) - min(asked) <= len(solution.increments)
    alone = Tiles()
    assert (solve(small_press(), MPI.COMM_SELF, friction=alone).force == solution.force).all()


@pytest.mark.mpi
def test_a_monitor_that_fails_on_one_rank() -> None:
    class Full(Kept):
        def increment(self, record: Increment) -> None:
            super().increment(record)
            if WORLD.rank == 0 and record.index == 3:
                raise OSError("no space left on device")

    kept = Full()
    with pytest.raises(OSError, match="no space left"):
        solve(small_press(), WORLD, kept)
    assert len(kept.records) == 4


@pytest.mark.mpi
def test_uniform_of_any_kind_is_the_same_to_the_bit() -> None:
    class Constant:
        depends_on = frozenset({"tiles", "pressure", "sliding"})

        def coefficients(self, pairs: TilePairs) -> FloatArray:
            return np.full(len(pairs.seat), 0.11)

    uniform = solve(small_press(), WORLD)
    assert uniform.counters["provider_calls"] == 1
    assert uniform.counters["pairs_asked"] == 1
    assert (solve(small_press(), WORLD, friction=Constant()).force == uniform.force).all()


@pytest.mark.mpi
def test_uncertainty_is_gathered_with_the_coefficients() -> None:
    """Each rank states it for its share; all know it for all pairs, as one rank alone does."""

    class Doubtful(Tiles):
        def uncertainty(self, pairs: TilePairs) -> FloatArray:
            return 0.001 * (1.0 + pairs.seat + 0.1 * pairs.bore)

    together, alone = (solve(small_press(), comm, friction=Doubtful()).friction for comm in (WORLD, MPI.COMM_SELF))
    assert together is not None
    assert alone is not None
    for name in ("seat", "bore", "coefficient", "uncertainty"):
        assert getattr(together, name).tobytes() == getattr(alone, name).tobytes()
    assert WORLD.allgather(together.uncertainty.tobytes()) == [alone.uncertainty.tobytes()] * WORLD.size
    assert alone.uncertainty.tolist() == (0.001 * (1.0 + alone.seat + 0.1 * alone.bore)).tolist()


@pytest.mark.mpi
def test_a_bad_uncertainty_on_one_rank() -> None:
    class Doubtful(Tiles):
        def uncertainty(self, pairs: TilePairs) -> FloatArray:
            return np.full(len(pairs.seat), -0.5 if WORLD.rank == WORLD.size - 1 and self.asked > 60 else 0.01)

    kept = Kept()
    with pytest.raises(ProviderError, match=r"Doubtful' answered, asked for its uncertainty, -0\.5"):
        solve(small_press(), WORLD, kept, friction=Doubtful())
    assert WORLD.allgather(len(kept.records)) == [len(kept.records)] * WORLD.size
    assert kept.records


@pytest.mark.mpi
def test_evolving_friction_has_the_same_bits_on_any_number_of_ranks(shared_tmp_path: Path) -> None:
    """The share of a rank changes as pairs come and go; what it knows of them must not matter."""
    file = shared_tmp_path / "mu.csv"
    if WORLD.rank == 0:
        file.write_text("z_mm,coefficient,uncertainty\n0,0.1,0.01\n60,0.14,0.02\n")
    WORLD.Barrier()
    options = f"{{base='table', options={{file='{file}'}}, flat_coefficient=0.02, work=1e4}}"
    scene = small_press("friction.provider=evolving", f"friction.options={options}")
    alone, together = solve(scene, MPI.COMM_SELF), solve(scene, WORLD)
    assert (alone.force == together.force).all()
    for a, b in zip(alone.increments, together.increments, strict=True):
        assert (a.facets.friction == b.facets.friction).all()
    assert alone.friction is not None
    assert together.friction is not None
    assert (alone.friction.uncertainty == together.friction.uncertainty).all()


FRAGILE = """
import os
import msgspec, numpy as np

class Fragile(msgspec.Struct, frozen=True):
    depends_on = frozenset({"tiles"})

    def build(self, context):
        return self

    def coefficients(self, pairs):
        if os.environ.get("BREAKS") and os.environ["OMPI_COMM_WORLD_RANK"] == "1" and pairs.seat.max(initial=0) > 45:
            raise RuntimeError("the plates are gone")
        return 0.05 + 0.01 * ((7 * pairs.seat + 3 * pairs.bore) % 10)
"""
PROGRAM = """
import os, sys
os.environ["BREAKS"] = sys.argv[1]
sys.path[:0] = sys.argv[2:4]
from small import small_press
from macrofit.cli import main
from macrofit.scene import dump_scene
with open(f"{sys.argv[3]}/fit.toml.{os.environ['OMPI_COMM_WORLD_RANK']}", "w") as file:
    file.write(dump_scene(small_press("friction.provider=fragile", "friction.options={}")))
main(["run", file.name, "-o", f"{sys.argv[3]}/{sys.argv[4]}", *sys.argv[5:]])
"""


def test_a_failure_on_one_of_two_ranks_ends_the_run_and_it_resumes(  # type: ignore[no-untyped-def]
    tmp_path: Path, mpirun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 2, one line, every accepted increment kept; --resume goes on to the bits of a run without failure."""
    (tmp_path / "fragile.py").write_text(FRAGILE)
    (tmp_path / "fragile-1.0.dist-info").mkdir()
    (tmp_path / "fragile-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: fragile\nVersion: 1\n")
    (tmp_path / "fragile-1.0.dist-info" / "entry_points.txt").write_text(
        "[macrofit.friction]\nfragile = fragile:Fragile\n"
    )
    (tmp_path / "program.py").write_text(PROGRAM)
    tests = Path(__file__).parents[1]

    def run(breaks: str, *more: str) -> subprocess.CompletedProcess[str]:
        done = mpirun(2, tmp_path / "program.py", breaks, tests, tmp_path, *more)
        return done  # type: ignore[no-any-return]

    broken = run("1", "out")
    assert broken.returncode == 2, broken.stderr
    said = [line for line in broken.stderr.splitlines() if line.startswith("macrofit:")]
    assert len(said) == 1
    assert "friction provider 'fragile' failed on" in said[0]
    assert "the plates are gone" in said[0]
    assert "Traceback" not in broken.stderr
    kept = (tmp_path / "out" / "fitting_curve.csv").read_bytes()
    assert 3 <= kept.count(b"\n") <= 9
    resumed = run("", "out", "--resume")
    assert resumed.returncode == 0, resumed.stderr
    curve = (tmp_path / "out" / "fitting_curve.csv").read_bytes()
    assert curve.startswith(kept)
    assert len(curve) > len(kept)
    monkeypatch.syspath_prepend(tmp_path)
    whole = solve(load_scene(tmp_path / "out" / "scene.toml"), MPI.COMM_SELF)
    assert whole.friction is not None
    assert (read_curve(tmp_path / "out")[1] == whole.force).all()
    with h5py.File(tmp_path / "out" / "interface.h5") as file:
        for name in ("pressure", "friction"):
            assert (file[name][()] == [getattr(record.facets, name) for record in whole.increments]).all()
        for name in ("seat", "bore", "coefficient"):
            assert (file[f"pairs/{name}"][()] == getattr(whole.friction, name)).all()
    asked = json.loads((tmp_path / "out" / "summary.json").read_text())["counters"]["pairs_asked"]
    assert 0 < asked < whole.counters["pairs_asked"]


@pytest.mark.mpi
def test_a_network_answers_alike_on_any_number_of_ranks(shared_tmp_path: Path) -> None:
    """To the bit, though each rank predicts a part of the batch."""
    context = BuildContext(seat_tiles=8, bore_tiles=8, youngs_modulus=206e3, poisson_ratio=0.3)
    if WORLD.rank == 0:
        untrained(shared_tmp_path / "network.safetensors")
    WORLD.Barrier()
    options = {"model": str(shared_tmp_path / "network.safetensors")}
    provider = build("surrogate", options, context)
    seat, bore = np.divmod(np.arange(11), 4)
    pairs = TilePairs(seat, bore, np.zeros(11), np.zeros(11))
    alone = provider.coefficients(pairs)
    shared = SharedAsk(WORLD, "surrogate")(build("surrogate", options, context), pairs)
    assert (shared.coefficient == alone).all()
    assert (shared.uncertainty == provider.uncertainty(pairs)).all()
    assert np.ptp(alone) > 1e-3


@pytest.mark.mpi
def test_what_all_ranks_are_told_of_files_is_said_once(shared_tmp_path: Path) -> None:
    """A table that ends before the seat: once, and by the first rank."""
    file = shared_tmp_path / "mu.csv"
    if WORLD.rank == 0:
        file.write_text("z_mm,coefficient\n0,0.1\n60,0.14\n")
    WORLD.Barrier()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        solve(small_press("friction.provider=table", f"friction.options={{file='{file}'}}"), WORLD)
    assert WORLD.allgather(len(said)) == [1] + [0] * (WORLD.size - 1)


@pytest.mark.mpi
def test_what_a_network_does_not_know_is_the_same_on_any_number_of_ranks() -> None:
    """Each rank looks at its part of the pairs."""
    scene = small_press("friction.provider=surrogate", "wheel.bore_radius=94.995")
    shared, alone = solve(scene, WORLD).outside, solve(scene, MPI.COMM_SELF).outside
    assert [each.reason.partition(":")[0] for each in alone] == ["unknown pressures"]
    assert shared == alone


@pytest.mark.mpi
def test_what_one_rank_alone_names_is_heard() -> None:
    """A provider may name a reason only where a pair has it: others of that part are 0."""
    rank = WORLD.rank
    mine = {"odd": np.full(2 + rank, 0.5)} if rank == 0 else {}
    found = joined(WORLD, mine, 2 + rank)
    sizes = [2 + each for each in range(WORLD.size)]
    assert list(found) == ["odd"]
    assert found["odd"].tolist() == [0.5] * 2 + [0.0] * (sum(sizes) - 2)
