"""What MPI ranks share: errors raised together, and an end that leaves none of them waiting."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn

from .commands import flush

if TYPE_CHECKING:
    from mpi4py import MPI


@contextmanager
def raise_together(comm: MPI.Comm) -> Iterator[None]:
    """Run rank-local work that may fail; where any rank failed, every rank raises. Collective.

    A rank raises its own error, the others that of the lowest failing rank.
    """
    error: BaseException | None = None
    try:
        yield
    except Exception as caught:
        error = caught
    if comm.size == 1:
        if error is not None:
            raise error
        return
    errors = comm.allgather(None if error is None else _sent(error))
    first = error or next((other for other in errors if other is not None), None)
    if first is not None:
        raise first


def _sent(error: BaseException) -> BaseException:
    """The error as other ranks can have it: itself, or its type and words where it does not survive the way."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def leave(comm: MPI.Comm, code: int) -> NoReturn:
    """Exit, and under mpirun take along the ranks that may be waiting for this one."""
    flush()
    if comm.size > 1:
        comm.Abort(code)
    sys.exit(code)
