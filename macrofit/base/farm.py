"""Independent tasks dealt to whoever can work: this process, processes of this machine, or the ranks of mpirun.

A farm does every task and hands each result to ``accept``, which runs in the process (on the rank) that gave the
order; results come in any order. Studies deal whole runs, databases deal friction tests.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

from .errors import MacrofitError
from .ranks import raise_together

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

    from mpi4py import MPI

RESULT, LEFT, STOP = 11, 12, 13
"""Tags of messages: a result; a rank has no more work; nothing more is wanted."""
WAIT_S = 0.02
"""How often the first rank, its own work done, looks for results of the others [s]."""

Task = TypeVar("Task")
Result = TypeVar("Result")


class FarmError(MacrofitError):
    """A worker that was lost."""


class Farm(Protocol):
    """Whoever computes the tasks of a study or a database."""

    def run(self, tasks: Sequence[Task], work: Callable[[Task], Result], accept: Callable[[Result], None]) -> None:
        """Do every task with ``work`` and hand every result to ``accept``."""
        ...


class SerialFarm:
    """This process, one task after the other."""

    def run(self, tasks: Sequence[Task], work: Callable[[Task], Result], accept: Callable[[Result], None]) -> None:
        """In the order of the tasks."""
        for task in tasks:
            accept(work(task))


class ProcessFarm:
    """Processes of their own on this machine; they end with the one that started them, however it ends.

    Each has a pipe of its own, read by the main thread alone. (An executor of `concurrent.futures` shares one pipe of
    results: where a process is ended while it writes there, the thread that reads it waits for the rest for ever.)

    Args:
        jobs: how many of them.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def run(self, tasks: Sequence[Task], work: Callable[[Task], Result], accept: Callable[[Result], None]) -> None:
        """As they end; ``work``, the tasks and the results are sent between processes, so all must be picklable.

        Raises:
            FarmError: a process was killed, as by a machine that runs out of memory.
        """
        ahead = iter(tasks)
        workers: dict[Connection, BaseProcess] = {}
        resource_tracker.ensure_running()  # where the first process starts it, Ctrl-C gets through again
        try:
            with _ctrl_c_withheld():  # they keep this
                for task in islice(ahead, self._jobs):
                    connection, process = _worker(work)
                    workers[connection] = process
                    with _alive():
                        connection.send(task)
            at_work = set(workers)
            while at_work:
                for connection in cast("list[Connection]", wait(list(at_work))):
                    with _alive():
                        done, answer = connection.recv()
                        try:
                            connection.send(next(ahead))
                        except StopIteration:
                            at_work.discard(connection)
                    if not done:
                        raise answer
                    accept(answer)
        finally:
            for process in workers.values():
                process.terminate()
            for connection, process in workers.items():
                process.join()
                connection.close()


class MpiFarm:
    """The ranks of a communicator: the first one gives orders by `run`, the others `help` until it leaves the block.

    The first rank works too, and accepts results between two tasks of its own.

    Args:
        comm: the ranks.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm

    def run(self, tasks: Sequence[Task], work: Callable[[Task], Result], accept: Callable[[Result], None]) -> None:
        """As they end; ``work`` and the tasks are sent to the ranks, so both must be picklable; see `deal`."""
        self._comm.bcast((tasks, work))
        deal(tasks, self._comm, _without_poll(work), accept)

    def help(self) -> None:
        """Do what the first rank orders, on every other rank."""
        while (order := self._comm.bcast(None)) is not None:
            tasks, work = order
            deal(tasks, self._comm, _without_poll(work), _nothing)

    def __enter__(self) -> MpiFarm:
        return self

    def __exit__(self, *_: object) -> None:
        if self._comm.rank == 0:
            self._comm.bcast(None)


def _without_poll(work: Callable[[Task], Result]) -> Callable[[Task, Callable[[], None]], Result]:
    """Work that is too short to look for messages in between."""
    return lambda task, _: work(task)


def _nothing(result: object) -> None:
    """Accept a result on a rank that gets none."""


class Stopped(Exception):
    """Another rank has failed: leave the task that is going on."""


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
    exchange: _Exchange[Result] = _Exchange(private, _silent_once_failed(accept))
    try:
        with raise_together(private):
            try:
                for task in tasks[comm.rank :: comm.size]:
                    exchange.poll()
                    exchange.tell(work(task, exchange.poll))
            except Stopped:
                exchange.leave(failed=False)
            except (Exception, SystemExit):
                exchange.leave(failed=True)
                raise
            else:
                exchange.leave(failed=False)
    finally:
        private.Free()


class _Exchange(Generic[Result]):
    """What the ranks tell each other while they work; `poll` is called as often as one likes."""

    def __init__(self, comm: MPI.Comm, accept: Callable[[Result], None]) -> None:
        self.comm, self.accept = comm, accept
        self.at_work = comm.size - 1  # the other ranks, on the first one
        self.failed = False  # or, on the first rank, all others were told to leave
        self._sent: list[Any] = []

    def tell(self, result: Result) -> None:
        """Hand over a result of this rank."""
        if self.comm.rank == 0:
            self.accept(result)
        else:
            self._sent.append(self.comm.isend(result, dest=0, tag=RESULT))

    def poll(self) -> None:
        """Take in what has come.

        Raises:
            Stopped: another rank failed.
        """
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
        from mpi4py import MPI

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
        from mpi4py import MPI

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


def _worker(work: Callable[[Task], Result]) -> tuple[Connection, BaseProcess]:
    """A new process that does what comes through the connection."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, work), daemon=True)
    process.start()
    there.close()  # so that a process that is killed is the end of the pipe
    return here, process


def _serve(connection: Connection, work: Callable[[Task], Result]) -> None:
    """Answer each task with (True, result), or (False, exception) with a note of where it was raised."""
    _end_with_parent()
    with suppress(EOFError, ConnectionError):  # nobody asks any more
        while True:
            task = connection.recv()
            try:
                connection.send((True, work(task)))
            except Exception as error:
                told = f"in a process of the farm:\n{traceback.format_exc()}"
                error.add_note(told)
                try:
                    connection.send((False, error))
                except (TypeError, AttributeError, pickle.PicklingError):
                    connection.send((False, FarmError(told)))


@contextmanager
def _alive() -> Iterator[None]:
    """A pipe that ends is a process that was killed."""
    try:
        yield
    except (EOFError, ConnectionError):
        raise FarmError(
            "a process of the farm was killed (out of memory?); what was computed is kept, and the same command "
            "goes on; try fewer --jobs"
        ) from None


def _end_with_parent() -> None:
    """Let this process end with its parent: without it, it would wait for tasks for ever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _ctrl_c_withheld() -> Iterator[None]:
    """Ctrl-C reaches all processes of a terminal; those started here leave it to this one, which gets it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
