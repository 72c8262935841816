"""Whole runs dealt to the ranks: each works alone, the first one hears of every result, a failure ends them all."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from mpi4py import MPI

from ..parallel import raise_together

RESULT, LEFT, STOP = 11, 12, 13  # tags
WAIT_S = 0.02
"""How often the first rank, its own work done, looks for results of the others [s]."""

Task = TypeVar("Task")
Result = TypeVar("Result")


class Stopped(Exception):
    """Another rank has failed: leave the run that is going on."""


class Exchange(Generic[Result]):
    """What the ranks tell each other while they work; `poll` is called as often as one likes."""

    def __init__(self, comm: MPI.Comm, accept: Callable[[Result], None]) -> None:
        self.comm, self.accept = comm, accept
        self.at_work = comm.size - 1  # the other ranks, on the first one
        self.failed = False  # or, on the first rank, all others were told to leave
        self._sent: list[Any] = []

    def tell(self, result: Result) -> None:
        """A result of this rank."""
        if self.comm.rank == 0:
            self.accept(result)
        else:
            self._sent.append(self.comm.isend(result, dest=0, tag=RESULT))

    def poll(self) -> None:
        """Take in what has come. Raises Stopped where another rank failed."""
        if self.comm.rank == 0:
            self._receive()
        elif not self.failed and self.comm.iprobe(source=0, tag=STOP):
            self.comm.recv(source=0, tag=STOP)
            self.failed = True
        if self.failed:
            raise Stopped

    def leave(self, *, failed: bool) -> None:
        """This rank has no more work; the first one waits here for the results of the others.

        Raises what ``accept`` raises, when all have left.
        """
        if self.comm.rank != 0:
            self._sent.append(self.comm.isend(failed, dest=0, tag=LEFT))
            MPI.Request.waitall(self._sent)
            if not self.failed:
                self.comm.recv(source=0, tag=STOP)  # sent to every rank exactly once
            return
        if failed:
            self._stop()
        refused: Exception | None = None
        while self.at_work:
            try:
                self._receive()
            except Exception as error:
                refused = refused or error
                self._stop()
            time.sleep(WAIT_S)
        self._stop()
        MPI.Request.waitall(self._sent)
        if refused is not None:
            raise refused

    def _receive(self) -> None:
        status = MPI.Status()
        while self.at_work and self.comm.iprobe(tag=MPI.ANY_TAG, status=status):
            told = self.comm.recv(source=status.source, tag=status.tag)
            if status.tag == RESULT:
                self.accept(told)
                continue
            self.at_work -= 1
            if told:
                self._stop()

    def _stop(self) -> None:
        """Tell every other rank, once, that nothing more is wanted."""
        if self.failed:
            return
        self.failed = True
        self._sent += [self.comm.isend(None, dest=rank, tag=STOP) for rank in range(1, self.comm.size)]


def deal(
    tasks: Sequence[Task],
    comm: MPI.Comm,
    work: Callable[[Task, Callable[[], None]], Result],
    accept: Callable[[Result], None],
) -> None:
    """Do every task, rank r those of number r, r + size, ...; ``accept`` each result on the first rank. Collective.

    ``work(task, poll)`` calls ``poll()`` now and then. Where a rank fails, the others leave what they are doing, the
    finished results are accepted, and every rank raises the error.
    """
    private = comm.Dup()  # its messages meet no others
    exchange: Exchange[Result] = Exchange(private, _silent_once_failed(accept))
    try:
        with raise_together(private):
            try:
                for task in tasks[comm.rank :: comm.size]:
                    exchange.poll()
                    exchange.tell(work(task, exchange.poll))
            except Stopped:
                exchange.leave(failed=False)
            except Exception:
                exchange.leave(failed=True)
                raise
            else:
                exchange.leave(failed=False)
    finally:
        private.Free()


def _silent_once_failed(accept: Callable[[Result], None]) -> Callable[[Result], None]:
    """The same; after an exception it keeps still, so that the last messages can still be taken in."""
    broken = False

    def guarded(result: Result) -> None:
        nonlocal broken
        if broken:
            return
        try:
            accept(result)
        except BaseException:
            broken = True
            raise

    return guarded
