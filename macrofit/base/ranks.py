"""What MPI ranks share: errors raised together, work of one for all, and an end that leaves none of them waiting."""

from __future__ import annotations

import importlib
import pickle
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn, TypeVar, cast

from .commands import BUG, INTERRUPTED, USER_MISTAKE, complain, flush, say_bug, was_interrupted
from .errors import MacrofitError

if TYPE_CHECKING:
    from mpi4py import MPI

Made = TypeVar("Made")
PATIENCE_S = 2.0
"""How long an interrupted rank leaves the first one to write what was accepted, before it ends the job [s]."""


class _Told(NamedTuple):
    """An error on its way to other ranks: itself where that can be had, and its type and text in any case."""

    whole: bytes | None
    module: str  # of the class of the project that it is of, or of RuntimeError
    name: str
    text: str


@contextmanager
def raise_together(comm: MPI.Comm) -> Iterator[None]:
    """Run rank-local work that may fail; where any rank failed, every rank raises. Collective.

    A rank raises its own error, the others that of the lowest failing rank: the same, or, where it cannot be sent,
    one of its type in the project (RuntimeError for others) with its text. SystemExit is an error here.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as caught:
        error = caught
    except SystemExit as caught:
        error = RuntimeError(f"SystemExit({caught}) was raised where nothing may end the program")
    if comm.size == 1:
        if error is not None:
            raise error
        return
    told = comm.allgather(None if error is None else _told(error))
    if error is not None:
        raise error
    first = next((each for each in told if each is not None), None)
    if first is not None:
        raise _heard(first)


def made_by_first(comm: MPI.Comm, make: Callable[[], Made]) -> Made:
    """What the first rank makes, on every rank: it alone reads files and settings. Collective.

    Raises:
        Exception: what ``make`` raises, on every rank.
    """
    made: Made | None = None
    with raise_together(comm):
        if comm.rank == 0:
            made = make()
    if comm.size > 1:
        made = comm.bcast(made)
    return cast(Made, made)


def leave(comm: MPI.Comm, code: int) -> NoReturn:
    """Exit, and under mpirun take along the ranks that may be waiting for this one."""
    flush()
    if comm.size > 1:
        comm.Abort(code)
    sys.exit(code)


@contextmanager
def ending(comm: MPI.Comm, folder: Path, *, resumes: bool = True) -> Iterator[None]:
    """End every rank with the right code and one message: never a rank that waits for one that is gone.

    ``resumes``: what was computed is in ``folder`` and can be gone on with; otherwise nothing is kept.
    """
    try:
        yield
    except MacrofitError as error:  # raised on every rank together
        if comm.rank == 0:
            complain(error)
        sys.exit(USER_MISTAKE)
    except (KeyboardInterrupt, Exception) as error:
        if was_interrupted(error):
            if comm.rank == 0:
                kept = (
                    f"; what was computed is in {folder}, continue with --resume" if resumes else "; nothing was kept"
                )
                complain(f"interrupted{kept}")
            else:
                time.sleep(PATIENCE_S)
            leave(comm, INTERRUPTED)
        if comm.size == 1:
            raise
        say_bug(comm.rank, comm.size)
        leave(comm, BUG)


def _told(error: Exception) -> _Told:
    kind = next((each for each in type(error).__mro__ if _is_ours(each)), RuntimeError)
    text = str(error) if kind is not RuntimeError else f"{type(error).__name__}: {error}"
    whole: bytes | None = None
    try:
        whole = pickle.dumps(error)
        if type(pickle.loads(whole)) is not type(error):
            whole = None
    except BaseException:  # foreign code may do anything where it is pickled
        whole = None
    return _Told(whole, kind.__module__, kind.__qualname__, text)


def _is_ours(kind: type) -> bool:
    """Whether it is an error of the project, which another rank can import and make of a text."""
    return issubclass(kind, MacrofitError) and kind.__module__.partition(".")[0] in ("macrofit", "meso", "surrogate")


def _heard(told: _Told) -> Exception:
    if told.whole is not None:
        try:
            error = pickle.loads(told.whole)
            if isinstance(error, Exception):
                return error
        except BaseException:  # a class that is not on this rank, or that cannot be made again
            pass
    kind = getattr(importlib.import_module(told.module), told.name)
    made: Exception = kind(told.text)
    return made
