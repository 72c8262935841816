"""A study: many runs of one scene that share its factored bodies, dealt to the ranks, with their spread."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from mpi4py import MPI

from ..assembly import BODY_KEYS, Assembly, assemble
from ..base.farm import Stopped, deal
from ..base.ranks import raise_together
from ..errors import ConvergenceError, MacrofitError, MeshError, SceneError
from ..lockstep.solve import Run, common_to, solve_together
from ..monitor import Several, Silent
from ..results.agreement import agree
from ..run import open_folder, write_results
from ..scene import Scene
from ..solution import Increment, Solution
from .fields import lost_fields, save_fields
from .output import StudyProgress, open_study, run_folder, write_study
from .plan import Plan, PlannedRun
from .record import RecordFile, RunRecord, StudyFile

WRONG = (SceneError, MeshError, ConvergenceError)
"""What the values of a run are to blame for: it would end again."""
MOST_TOGETHER = 8
"""Runs in lockstep: what a rank has in hand, and what a study that is interrupted computes again."""


def carry_out_study(plan: Plan, comm: MPI.Comm, folder: Path, *, resume: bool, keep: bool, quiet: bool) -> list[str]:
    """Compute the runs of a study that ``folder`` does not hold yet, write everything, give the summary lines (rank 0).

    Every rank computes whole runs alone, in groups (see `groups_of`): other groups change a force by less than 1e-9 of
    the largest. ``keep`` writes the folder of each run, as `macrofit run` does. Collective.

    Raises:
        MacrofitError: on all ranks together; what was computed is kept.
    """
    with opened(plan, comm, lambda: open_study(folder, plan, resume=resume)) as kept:
        return _compute(plan, comm, folder, kept, resume=resume, keep=keep, quiet=quiet)


File = TypeVar("File", bound=RecordFile[Any])


@contextmanager
def opened(plan: Plan, comm: MPI.Comm, open_file: Callable[[], File]) -> Iterator[File | None]:
    """The file of the runs of a plan, which the first rank alone has. Collective.

    Raises:
        MacrofitError: on all ranks together; the ranks have different scenes, or it cannot be opened.
    """
    agree(comm, [run.scene for run in plan.runs])
    kept: File | None = None
    with raise_together(comm):
        if comm.rank == 0:
            kept = open_file()
    try:
        yield kept
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
    different = plan.different
    worker = RunWorker(plan, folder, resume=resume, keep=keep)
    whole = groups_of(different, comm.size)
    groups = [left for group in whole if (left := [run for run in group if run.digest not in done])]
    computed = sum(len(group) for group in groups)
    progress = StudyProgress(plan, already=len(different) - computed, quiet=quiet or comm.rank != 0)

    def accept(records: list[RunRecord]) -> None:
        assert kept is not None
        for behind, record in zip(reversed(range(len(records))), records, strict=True):
            kept.append(record)
            force, place = record.peak
            progress.finished(record.digest, f"peak {force / 1e3:10.6g} kN at {place:.6g} mm", behind)

    deal(groups, comm, worker.run, accept)
    with raise_together(comm):
        worker.check()
    costs = comm.gather((worker.factorisations, worker.assemblies, worker.cpu_s))
    lines: list[str] = []
    with raise_together(comm):
        if kept is not None:
            assert costs is not None
            records = [kept.records[run.digest] for run in plan.runs]
            lines = write_study(folder, plan, records, computed=computed, costs=costs)
    return lines


class RunWorker:
    """What one rank computes runs with: the last assembly, used again as long as the bodies are the same."""

    def __init__(self, plan: Plan, folder: Path, *, resume: bool = False, keep: bool = False) -> None:
        self.plan = plan
        self.folder, self.resume, self.keep = folder, resume, keep
        self.factorisations = self.assemblies = 0
        self.cpu_s = 0.0  # of assembling
        self._assembly: Assembly | None = None
        self._error: MacrofitError | None = None

    def run(self, group: Sequence[PlannedRun], poll: Callable[[], None]) -> list[RunRecord]:
        """Compute the runs of a group, in lockstep where there are several.

        Raises:
            MacrofitError: what ended a run, with its name. Where others of its group were finished they are given
                first, and the next call raises it, or `check`.
        """
        self.check()
        with naming(group[0]):
            assembly = self.assembly(group[0].scene)
        with ExitStack() as stack:
            tasks = [self._task(run, poll, stack) for run in group]
            began = time.process_time()
            solutions = solve_together(tasks, MPI.COMM_SELF, assembly)
            cpu_s = (time.process_time() - began) / len(group)
            records = [self._record(*each, cpu_s) for each in zip(group, tasks, solutions, strict=True)]
        finished = [record for record in records if record is not None]
        if not finished:
            self.check()
        return finished

    def check(self) -> None:
        """Raise the error that ended a run, if there was one."""
        if self._error is not None:
            raise self._error

    def _task(self, run: PlannedRun, poll: Callable[[], None], stack: ExitStack) -> Run:
        """A run as `solve_together` takes it, with its folder where that is kept."""
        friction = self.plan.friction_of(run.scene)
        if not self.keep:
            return Run(scene=without_fields(run.scene), monitor=Polling(poll), friction=friction)
        target = run_folder(self.folder, run)
        with naming(run):
            target.parent.mkdir(exist_ok=True)
            journal, curve = open_folder(target, run.scene, resume=self.resume)
        stack.enter_context(journal)
        return Run(scene=run.scene, monitor=Several(curve, Polling(poll)), journal=journal, friction=friction)

    def _record(self, run: PlannedRun, task: Run, solution: Solution | MacrofitError, cpu_s: float) -> RunRecord | None:
        """What is kept of a solution, once its files are written; None of a run that failed."""
        try:
            with naming(run):
                if isinstance(solution, MacrofitError):
                    raise solution
                began = time.process_time()
                if self.keep:
                    target = run_folder(self.folder, run)
                    write_results(target, solution, task.friction, standard=self.plan.standard)
                if asks_for_fields(run.scene):
                    save_fields(self.folder, run.digest, solution)
        except MacrofitError as error:
            self._error = self._error or error
            return None
        self.factorisations += solution.counters["factorisations"]
        return RunRecord.of(run.digest, solution, cpu_s + time.process_time() - began)

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
        changed = " once its values are changed" if isinstance(error, WRONG) else ""
        raise type(error)(f"{run.name}: {error}; what was computed is kept, continue with --resume{changed}") from error


def asks_for_fields(scene: Scene) -> bool:
    """Whether the scene names displacements for its fields: a study draws none otherwise."""
    return bool(scene.output.fields_at) and bool(scene.output.fields)


def without_fields(scene: Scene) -> Scene:
    """The scene without the fields that nobody will look at."""
    if asks_for_fields(scene):
        return scene
    return msgspec.structs.replace(scene, output=msgspec.structs.replace(scene.output, fields=(), frames=0))


def groups_of(runs: Sequence[PlannedRun], ranks: int) -> list[list[PlannedRun]]:
    """Runs that one rank computes in lockstep; those of the same bodies one after the other.

    They are at most `MOST_TOGETHER`, and so few that every rank has some. They do not depend on what is done already:
    a study that was interrupted goes on with the same groups, and so with the same bits.
    """
    most = min(MOST_TOGETHER, -(-len(runs) // ranks))
    bodies: dict[bytes, dict[bytes, list[PlannedRun]]] = {}
    for run in runs:
        bodies.setdefault(bodies_of(run.scene), {}).setdefault(common_to(run.scene) or run.digest.encode(), []).append(
            run
        )
    together = [group for groups in bodies.values() for group in groups.values()]
    return [[*part] for group in together for part in evenly(group, most)]


def bodies_of(scene: Scene) -> bytes:
    """What scenes that share their factored bodies have in common."""
    return msgspec.json.encode([getattr(scene, key) for key in BODY_KEYS], order="deterministic")


def evenly(group: Sequence[PlannedRun], most: int) -> Iterator[Sequence[PlannedRun]]:
    """As few parts of at most ``most`` as there can be, of sizes that differ by one at most."""
    parts = -(-len(group) // most)
    ends = [len(group) * part // parts for part in range(parts + 1)]
    return (group[first:last] for first, last in pairwise(ends))
