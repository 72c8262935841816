"""Work in a process of its own, made of this one where all is imported, with bounds on its time and memory."""

from __future__ import annotations

import os
import resource
import select
import signal
import time
from collections.abc import Callable
from typing import NamedTuple


class Ended(NamedTuple):
    """How work in a process of its own ended."""

    told: str
    """What it gave, or the signal or exit code where it ended otherwise."""
    how: str
    """One of `WELL`, `ABORTED`, `UNFINISHED`."""


WELL, ABORTED, UNFINISHED = "well", "aborted", "unfinished"


def alone(work: Callable[[], str], *, most_cpu_s: int = 20, most_wall_s: float = 60.0, most_bytes: int) -> Ended:
    """What ``work`` gives, or how its process ended.

    Args:
        work: what is done.
        most_cpu_s: after so much time of the processor the process is ended [s].
        most_wall_s: after so much time it is ended, too [s].
        most_bytes: of its address space, with all that is imported.
    """
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(reading)
        _end_with(work, writing, most_cpu_s, most_bytes)
    os.close(writing)
    told, last = b"", time.monotonic() + most_wall_s
    while select.select([reading], [], [], max(0.0, last - time.monotonic()))[0]:
        part = os.read(reading, 65536)
        if not part:
            break
        told += part
    else:
        os.kill(process, signal.SIGKILL)
    os.close(reading)
    _, status = os.waitpid(process, 0)
    if os.WIFEXITED(status):
        code = os.WEXITSTATUS(status)
        return Ended(f"exit code {code}", ABORTED) if code else Ended(told.decode(errors="replace"), WELL)
    number = os.WTERMSIG(status)
    late = number in (signal.SIGXCPU, signal.SIGKILL)
    return Ended(signal.Signals(number).name, UNFINISHED if late else ABORTED)


def _end_with(work: Callable[[], str], writing: int, most_cpu_s: int, most_bytes: int) -> None:
    """Within the bounds, do the work of a child, tell what it gives and end it; nothing else of it is heard."""
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (most_cpu_s, most_cpu_s + 1))
        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        rest = memoryview(work().encode())
        while rest:
            rest = rest[os.write(writing, rest) :]
        os._exit(0)
    finally:
        os._exit(3)
