"""A study: many runs of one scene that share its factored bodies, dealt to the ranks, with their spread."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
from mpi4py import MPI

from ..assembly import BODY_KEYS, Assembly, assemble
from ..base.farm import Stopped, deal
from ..base.ranks import raise_together
from ..errors import MacrofitError
from ..monitor import Several, Silent
from ..results.agreement import agree
from ..run import open_folder, write_results
from ..scene import Scene
from ..solution import Increment, Solution
from ..solve import solve
from .fields import lost_fields, save_fields
from .output import StudyProgress, open_study, run_folder, write_study
from .plan import Plan, PlannedRun
from .record import RunRecord, StudyFile


def carry_out_study(plan: Plan, comm: MPI.Comm, folder: Path, *, resume: bool, keep: bool, quiet: bool) -> list[str]:
    """Compute the runs of a study that ``folder`` does not hold yet, write everything, give the summary lines (rank 0).

    Every rank computes whole runs alone, so that the results do not depend on their number. ``keep`` writes the
    folder of each run, as `macrofit run` does. Collective.

    Raises:
        MacrofitError: on all ranks together; what was computed is kept.
    """
    agree(comm, [run.scene for run in plan.runs])
    kept: StudyFile | None = None
    with raise_together(comm):
        if comm.rank == 0:
            kept = open_study(folder, plan, resume=resume)
    try:
        return _compute(plan, comm, folder, kept, resume=resume, keep=keep, quiet=quiet)
    finally:
        if kept is not None:
            kept.close()


def _compute(
    plan: Plan, comm: MPI.Comm, folder: Path, kept: StudyFile | None, *, resume: bool, keep: bool, quiet: bool
) -> list[str]:
    done: set[str] = set()
    if kept is not None:
        held = [run for run in plan.runs if run.digest in kept.records and asks_for_fields(run.scene)]
        done = set(kept.records) - lost_fields(folder, held)
    done = comm.bcast(done)
    different = {run.digest: run for run in reversed(plan.runs)}  # a reference may be one of the varied runs
    left = [run for run in plan.runs if different[run.digest] is run and run.digest not in done]
    worker = RunWorker(plan, folder, resume=resume, keep=keep)
    progress = StudyProgress(plan, already=len(different) - len(left), quiet=quiet or comm.rank != 0)

    def accept(record: RunRecord) -> None:
        assert kept is not None
        kept.append(record)
        progress.finished(record)

    deal(sorted_by_bodies(left), comm, worker.run, accept)
    costs = comm.gather((worker.factorisations, worker.assemblies, worker.cpu_s))
    lines: list[str] = []
    with raise_together(comm):
        if kept is not None:
            assert costs is not None
            records = [kept.records[run.digest] for run in plan.runs]
            lines = write_study(folder, plan, records, computed=len(left), costs=costs)
    return lines


class RunWorker:
    """What one rank computes runs with: the assembly of the last one, used again as long as the bodies are the same."""

    def __init__(self, plan: Plan, folder: Path, *, resume: bool = False, keep: bool = False) -> None:
        self.plan = plan
        self.folder, self.resume, self.keep = folder, resume, keep
        self.factorisations = self.assemblies = 0
        self.cpu_s = 0.0  # of assembling
        self._assembly: Assembly | None = None

    def run(self, run: PlannedRun, poll: Callable[[], None]) -> RunRecord:
        """Compute one run.

        Raises:
            MacrofitError: what ended it, with the run's name.
        """
        with naming(run):
            assembly = self.assembly(run.scene)
            begin = time.process_time()
            if self.keep:
                solution = self._with_folder(run, assembly, poll, run_folder(self.folder, run))
            else:
                scene, friction = without_fields(run.scene), self.plan.friction_of(run.scene)
                solution = solve(scene, MPI.COMM_SELF, Polling(poll), None, assembly, friction=friction)
            self.factorisations += solution.counters["factorisations"]
            if asks_for_fields(run.scene):
                save_fields(self.folder, run.digest, solution)
            return RunRecord.of(run.digest, solution, time.process_time() - begin)

    def assembly(self, scene: Scene) -> Assembly:
        """The factored bodies of a scene."""
        if self._assembly is None or not self._assembly.serves(scene):
            begin = time.process_time()
            self._assembly = None  # two need not be held at once
            self._assembly = assemble(scene, MPI.COMM_SELF)
            self.assemblies += 1
            self.factorisations += self._assembly.work()["factorisations"]
            self.cpu_s += time.process_time() - begin
        return self._assembly

    def _with_folder(self, run: PlannedRun, assembly: Assembly, poll: Callable[[], None], target: Path) -> Solution:
        target.parent.mkdir(exist_ok=True)
        journal, curve = open_folder(target, run.scene, resume=self.resume)
        watching, friction = Several(curve, Polling(poll)), self.plan.friction_of(run.scene)
        with journal:
            solution = solve(run.scene, MPI.COMM_SELF, watching, journal, assembly, friction=friction)
            write_results(target, solution, friction, standard=self.plan.standard)
        return solution


class Polling(Silent):
    """The monitor that lets the ranks hear of each other between increments."""

    def __init__(self, poll: Callable[[], None]) -> None:
        self.poll = poll

    def increment(self, record: Increment) -> None:
        """Look for messages."""
        self.poll()


@contextmanager
def naming(run: PlannedRun) -> Iterator[None]:
    """Let an error say which run it ended."""
    try:
        yield
    except Stopped:
        raise
    except MacrofitError as error:
        raise type(error)(f"{run.name}: {error}; what was computed is kept, continue with --resume") from error


def asks_for_fields(scene: Scene) -> bool:
    """Whether the scene names displacements for its fields: a study draws none otherwise."""
    return bool(scene.output.fields_at) and bool(scene.output.fields)


def without_fields(scene: Scene) -> Scene:
    """The scene without the fields that nobody will look at."""
    if asks_for_fields(scene):
        return scene
    return msgspec.structs.replace(scene, output=msgspec.structs.replace(scene.output, fields=(), frames=0))


def sorted_by_bodies(runs: list[PlannedRun]) -> list[PlannedRun]:
    """Runs of the same bodies one after the other, so that each body is factored once."""
    groups: dict[bytes, list[PlannedRun]] = {}
    for run in runs:
        bodies = msgspec.json.encode([getattr(run.scene, key) for key in BODY_KEYS], order="deterministic")
        groups.setdefault(bodies, []).append(run)
    return [run for group in groups.values() for run in group]
