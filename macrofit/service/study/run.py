"""A study of wheelsets in service: the runs of a plan, dealt to the ranks, with bodies and presses shared."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
from mpi4py import MPI

from ...base.farm import deal
from ...base.ranks import raise_together
from ...errors import ConvergenceError
from ...study.output import StudyProgress, run_folder
from ...study.plan import Plan, PlannedRun
from ...study.run import RunWorker, bodies_of, naming, opened
from ..journal import Kept
from ..output.numbers import numbers
from ..output.write import write_service
from ..run import Course, Service, Shared, pressed
from .output import open_service_study, told_of, write_service_study
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
    with opened(plan, comm, lambda: open_service_study(folder, plan, resume=resume)) as kept:
        return _compute(plan, comm, folder, kept, keep=keep, quiet=quiet)


def _compute(
    plan: Plan, comm: MPI.Comm, folder: Path, kept: ServiceStudyFile | None, *, keep: bool, quiet: bool
) -> list[str]:
    done = comm.bcast(set() if kept is None else set(kept.records))
    left = [run for run in plan.different if run.digest not in done]
    progress = StudyProgress(plan, already=len(plan.different) - len(left), quiet=quiet or comm.rank != 0)

    def accept(record: ServiceRecord) -> None:
        assert kept is not None
        kept.append(record)
        progress.finished(record.digest, told_of(record))

    deal(alike(left), comm, ServiceWorker(plan, folder, keep=keep).run, accept)
    lines: list[str] = []
    with raise_together(comm):
        if kept is not None:
            lines = write_service_study(folder, plan, [kept.records[run.digest] for run in plan.runs])
    return lines


def alike(runs: Sequence[PlannedRun]) -> list[PlannedRun]:
    """The runs of the same bodies one after the other, and those of the same press: each is computed once."""
    places: dict[bytes, int] = {}

    def place(run: PlannedRun) -> list[int]:
        same = (bodies_of(run.scene), msgspec.msgpack.encode(pressed(run.scene)))
        return [places.setdefault(each, len(places)) for each in same]

    return sorted(runs, key=place)


class ServiceWorker:
    """What one rank computes runs with: the bodies of the last one, and its press where only loads differ."""

    def __init__(self, plan: Plan, folder: Path, *, keep: bool) -> None:
        self.plan, self.folder, self.keep = plan, folder, keep
        self.shared = Shared(RunWorker(plan, folder).assembly)

    def run(self, run: PlannedRun, poll: Callable[[], None]) -> ServiceRecord:
        """Compute one run; one that ends early, in its press already, is kept with its reason.

        Raises:
            MacrofitError: what is wrong with its scene, or with the folder, with the run's name.
        """
        begin, course, ended = time.process_time(), Course(run.scene, lambda _: poll(), Kept(), self.shared), None
        with naming(run):
            found: Service | None
            try:
                found = course.carry_out(self.plan.friction_of(run.scene))
            except ConvergenceError as error:
                ended = str(error)
                found = course.so_far(ended)
            if self.keep and found is not None:
                target = run_folder(self.folder, run)
                target.mkdir(parents=True, exist_ok=True)
                write_service(target, found)
        told = None if found is None else numbers(found)
        return record_of(run.digest, told, ended, time.process_time() - begin)
