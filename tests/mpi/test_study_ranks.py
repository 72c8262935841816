"""Studies on several ranks: the same bits, and a failure on any rank ends them all."""

from __future__ import annotations

import csv
import json
import time
from pathlib import Path

import pytest
import rippled
from mpi4py import MPI
from small import small_press

from macrofit.base.farm import deal
from macrofit.scene import dump_scene

WORLD = MPI.COMM_WORLD
PROGRAM = Path(rippled.__file__)
SEED = "friction.options.seed"


@pytest.mark.mpi
def test_every_result_comes_to_the_first_rank() -> None:
    """Each task done once, by the rank its number says."""
    accepted: list[tuple[int, int]] = []
    deal(range(23), WORLD, lambda task, poll: (task, WORLD.rank), accepted.append)
    assert sorted(accepted) == ([(task, task % WORLD.size) for task in range(23)] if WORLD.rank == 0 else [])


@pytest.mark.mpi
@pytest.mark.parametrize("failing", range(4))
def test_a_failing_task_ends_all_ranks(failing: int) -> None:
    """All ranks raise its error; what was finished before is accepted; the others leave the task they are in."""
    accepted: list[int] = []
    begin = time.perf_counter()

    def work(task: int, poll) -> int:  # type: ignore[no-untyped-def]
        if task == failing:
            raise ValueError(f"task {task} fails")
        if task > 3:
            while WORLD.size > 1:  # would never end by itself
                poll()
        return task

    with pytest.raises(ValueError, match=f"task {failing} fails"):
        deal(range(12), WORLD, work, accepted.append)
    if WORLD.rank == 0:
        assert set(accepted) >= {task for task in range(failing) if task % WORLD.size == failing % WORLD.size}
        assert failing not in accepted
    assert time.perf_counter() - begin < 30.0


@pytest.mark.mpi
def test_results_that_cannot_be_kept_end_all_ranks() -> None:
    def full(result: int) -> None:
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        deal(range(9), WORLD, lambda task, poll: task, full)


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("study") / "small.toml"
    path.write_text(dump_scene(small_press("motion.travel=40", "output.stress=true")))
    return path


def test_one_and_two_ranks_give_the_same_bits(scene_file, mpirun) -> None:  # type: ignore[no-untyped-def]
    arguments = ["study", scene_file, "--set", "friction.provider=rippled", "--vary", f"{SEED}=1:10", "--quiet"]
    folders = [scene_file.parent / f"ranks{ranks}" for ranks in (1, 2)]
    for ranks, folder in enumerate(folders, start=1):
        done = mpirun(ranks, PROGRAM, *arguments, "-o", folder)
        assert done.returncode == 0, done.stderr
    one, two = (list(csv.DictReader((folder / "study.csv").open())) for folder in folders)
    for a, b in zip(one, two, strict=True):
        assert {**a, "cpu_s": ""} == {**b, "cpu_s": ""}
    assert (folders[0] / "curves.csv").read_text() == (folders[1] / "curves.csv").read_text()
    totals = [json.loads((folder / "study.json").read_text()) for folder in folders]
    assert [each["factorisations_per_rank"] for each in totals] == [[4], [4, 4]]
    assert totals[0]["statistics"] == totals[1]["statistics"]


def test_a_failing_run_ends_the_study_on_two_ranks(scene_file, mpirun) -> None:  # type: ignore[no-untyped-def]
    """Run 6 is of the second rank: one line, code 2; what was done is kept and --resume computes the rest."""
    here = scene_file.parent
    arguments = ["study", scene_file, "--set", "friction.provider=rippled", "--vary", f"{SEED}=1:10", "-o", "failing"]
    arguments += ["--set", "friction.options.fail_at=6"]
    done = mpirun(2, PROGRAM, *arguments, cwd=here)
    assert done.returncode == 2, done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("macrofit:")]
    assert len(said) == 1
    assert "run 6 (seed = 6): friction provider 'rippled' failed" in said[0]
    assert "Traceback" not in done.stderr
    (here / "repaired").touch()
    again = mpirun(2, PROGRAM, *arguments, "--resume", cwd=here)
    assert again.returncode == 0, again.stderr
    totals = json.loads((here / "failing" / "study.json").read_text())
    assert totals["computed_runs"] + totals["resumed_runs"] == 10
    assert totals["resumed_runs"] >= 4  # the others of its group, runs 7 to 10


def test_identification_on_two_ranks(scene_file, mpirun) -> None:  # type: ignore[no-untyped-def]
    """The ranks share one solver: the same bits as one rank."""
    curve = scene_file.parent / "m.csv"
    rows = "".join(f"{s},{8e3 * (s - 10)}\n" for s in range(16, 41))
    curve.write_text(f"displacement_mm,force_N\n{rows}")
    values = []
    for ranks in (1, 2):
        folder = scene_file.parent / f"identified{ranks}"
        done = mpirun(ranks, PROGRAM, "identify", scene_file, "--curve", curve, "-o", folder)
        assert done.returncode == 0, done.stderr
        values.append(json.loads((folder / "identification.json").read_text())["value"])
    assert values[0] == values[1]
