"""Who computes the samples: this process, processes of this machine, or the ranks of mpirun."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Protocol

from ..errors import SurrogateError
from .sample import Result, Task, simulate


class Farm(Protocol):
    """Who computes."""

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """The results of the tasks, in any order."""
        ...


class Here:
    """This process, one task after the other."""

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """In the order of the tasks."""
        return map(simulate, tasks)


class Ranks:
    """The workers of an executor, such as those of `mpi4py.futures.MPICommExecutor`."""

    def __init__(self, executor: Executor, workers: int) -> None:
        self._executor, self._workers = executor, workers

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """As they end. The first are under way when this returns; two per worker are, or wait, at any time."""
        ahead = iter(tasks)
        return self._ended({self._executor.submit(simulate, task) for task in islice(ahead, 2 * self._workers)}, ahead)

    def _ended(self, pending: set[Future[Result]], ahead: Iterator[Task]) -> Iterator[Result]:
        while pending:
            ended, pending = wait(pending, return_when=FIRST_COMPLETED)
            pending |= {self._executor.submit(simulate, task) for task in islice(ahead, len(ended))}
            yield from (future.result() for future in ended)


class Pool:
    """Processes of their own on this machine; they end with the one that started them, however it ends."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """As they end.

        Raises:
            SurrogateError: a process was killed, as by a machine that runs out of memory.
        """
        others = set(multiprocessing.active_children())
        pool = ProcessPoolExecutor(self._jobs, multiprocessing.get_context("spawn"), initializer=_end_with_parent)
        try:
            with _ctrl_c_withheld():  # the processes start with the first tasks, and keep this
                running = Ranks(pool, self._jobs).results(tasks)
            yield from running
            pool.shutdown()
        except BrokenProcessPool:
            raise SurrogateError(
                "a process of the farm was killed (out of memory?); what was computed is kept, and the same command "
                "goes on; try fewer --jobs"
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()


def _end_with_parent() -> None:
    """A process whose parent was killed would wait for tasks for ever."""

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
