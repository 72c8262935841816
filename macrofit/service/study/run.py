"""A study of wheelsets in service: the runs of a plan, dealt to the ranks, with bodies and presses shared."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

from ...base.farm import deal
from ...base.ranks import raise_together
from ...errors import ConvergenceError
from ...results.agreement import agree
from ...study.output import StudyProgress
from ...study.plan import Plan, PlannedRun
from ...study.run import RunWorker, bodies_of, naming
from ..journal import Kept
from ..output.numbers import numbers
from ..output.write import write_service
from ..run import Course, Service, Shared
from .output import open_service_study, run_folder, told_of, write_service_study
from .record import ServiceRecord, ServiceStudyFile, record_of


def carry_out_service_study(
    plan: Plan, comm: MPI.Comm, folder: Path, *, resume: bool, keep: bool, quiet: bool
) -> list[str]:
    """Compute the runs that ``folder`` does not hold yet, write table and figures, give the summary lines (rank 0).

    Every rank computes whole runs alone. Where a wheel slides round or lifts off, the study goes on and says so.
    ``keep`` writes the results of each run into a folder of its own. Collective.

    Raises:
        MacrofitError: on all ranks together; what was computed is kept.
    """
    agree(comm, [run.scene for run in plan.runs])
    kept: ServiceStudyFile | None = None
    with raise_together(comm):
        if comm.rank == 0:
            kept = open_service_study(folder, plan, resume=resume)
    try:
        return _compute(plan, comm, folder, kept, keep=keep, quiet=quiet)
    finally:
        if kept is not None:
            kept.close()


def _compute(
    plan: Plan, comm: MPI.Comm, folder: Path, kept: ServiceStudyFile | None, *, keep: bool, quiet: bool
) -> list[str]:
    done = comm.bcast(set() if kept is None else set(kept.records))
    different = {run.digest: run for run in reversed(plan.runs)}  # a reference may be one of the varied runs
    left = [run for run in plan.runs if different[run.digest] is run and run.digest not in done]
    progress = StudyProgress(plan, already=len(different) - len(left), quiet=quiet or comm.rank != 0)

    def accept(record: ServiceRecord) -> None:
        assert kept is not None
        kept.append(record)
        progress.finished(record.digest, told_of(record))

    alike: dict[bytes, list[PlannedRun]] = {}  # one after the other, so that each body is factored once
    for run in left:
        alike.setdefault(bodies_of(run.scene), []).append(run)
    deal([run for runs in alike.values() for run in runs], comm, ServiceWorker(plan, folder, keep=keep).run, accept)
    lines: list[str] = []
    with raise_together(comm):
        if kept is not None:
            lines = write_service_study(folder, plan, [kept.records[run.digest] for run in plan.runs])
    return lines


class ServiceWorker:
    """What one rank computes runs with: the bodies of the last one, and its press where only loads differ."""

    def __init__(self, plan: Plan, folder: Path, *, keep: bool) -> None:
        self.plan, self.folder, self.keep = plan, folder, keep
        self.shared = Shared(RunWorker(plan, folder).assembly)

    def run(self, run: PlannedRun, poll: Callable[[], None]) -> ServiceRecord:
        """Compute one run; one that ends early is kept with its reason.

        Raises:
            MacrofitError: what ended it before the wheel was released, with the run's name.
        """
        begin = time.process_time()
        with naming(run):
            found = self._served(run, poll)
            if self.keep:
                target = run_folder(self.folder, run)
                target.mkdir(parents=True, exist_ok=True)
                write_service(target, found)
        return record_of(run.digest, numbers(found), time.process_time() - begin)

    def _served(self, run: PlannedRun, poll: Callable[[], None]) -> Service:
        course = Course(run.scene, lambda _: poll(), Kept(), self.shared)
        try:
            return course.carry_out(self.plan.friction_of(run.scene))
        except ConvergenceError as error:
            found = course.so_far(str(error))
            if found is None:
                raise
            return found
