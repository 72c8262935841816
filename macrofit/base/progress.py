"""Showing how far a computation is: a live bar on a terminal, plain lines elsewhere, or nothing."""

from __future__ import annotations

import atexit
import errno
import os
import sys
import termios
import time
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any, Literal, TypeVar

from .errors import OutputError

Shown = TypeVar("Shown")

LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK")
"""Variables of a process that mpirun started."""
RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK")
"""Variables that hold the rank of such a process."""
REFRESH_S = 0.1
"""Shortest time between two redraws of a bar [s]: drawing costs as much as a small increment."""


def launched() -> bool:
    """Whether mpirun started this process."""
    return any(name in os.environ for name in LAUNCHED)


def is_first_rank() -> bool:
    """Whether this process is alone or the first that mpirun started; asked of the launcher, without MPI."""
    return next((os.environ[name] for name in RANKS if name in os.environ), "0") == "0"


def way_of_showing(*, quiet: bool) -> Literal["bar", "lines", "nothing"]:
    """What suits the standard output; mpirun gives its first rank a terminal even where it writes into a file."""
    if quiet:
        return "nothing"
    return "bar" if sys.stdout.isatty() and not launched() else "lines"


def suited(bar: Callable[[], Shown], lines: Callable[[], Shown], nothing: Callable[[], Shown], *, quiet: bool) -> Shown:
    """What shows a computation, by `way_of_showing`."""
    ways = {"bar": bar, "lines": lines, "nothing": nothing}
    return ways[way_of_showing(quiet=quiet)]()


def say(text: str, stream: IO[str] | None = None) -> None:
    """One plain line, at once; characters of control are shown, not obeyed.

    Raises:
        OutputError: the disk behind the stream is full.
        BrokenPipeError: nobody reads any more, which ends the command without a word.
    """
    stream = stream or sys.stdout
    try:
        print(printable(text), file=stream, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        swallow(stream)
        raise OutputError(
            f"standard output: cannot be written: {error.strerror} (make room, then give the same command, with "
            f"--resume where it has that)"
        ) from None


def announce(text: str, *, quiet: bool) -> None:
    """Say on the first rank what is going to be done, at once: before the libraries are loaded that it needs.

    Raises:
        OutputError: as `say`.
    """
    if is_first_rank() and not quiet:
        say(text)


def swallow(stream: IO[str]) -> None:
    """Let a stream that cannot be written lose what it still holds: Python would fail on it once more in the end."""
    with suppress(OSError, ValueError):
        number, nothing = stream.fileno(), os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, number)
        os.close(nothing)


def printable(text: str) -> str:
    """The text with every character that would move or colour the terminal written as its code."""
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


class Paced:
    """Says how far something is, at most every few seconds, and nothing in the first of them."""

    def __init__(self, tell: Callable[[str], None], every_s: float = 5.0) -> None:
        self._tell, self._every, self._told = tell, every_s, time.monotonic()

    def __call__(self, text: str) -> None:
        """Say it, unless something was said a moment ago."""
        now = time.monotonic()
        if now - self._told >= self._every:
            self._told = now
            self._tell(text)


def duration(seconds: float) -> str:
    """A time in words a reader needs no table for: 40 s, 12 min, 3.5 h."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


class Bar:
    """A live bar of rich, imported when it is shown; every call is allowed before `start` and after `stop`.

    Args:
        columns: names of the classes of `rich.progress`, or texts as `TextColumn` takes them.
        options: of `rich.progress.Progress`.
    """

    def __init__(self, *columns: str, **options: Any) -> None:
        self._columns, self._options = columns, options
        self._bar: Any = None
        self._task: Any = None
        self._echo = ControlEcho()
        self._drawn = 0.0

    def start(self, total: int, completed: int = 0, description: str = "", **fields: Any) -> None:
        """Show the bar for so many steps."""
        from rich import progress

        columns = [
            getattr(progress, name)() if hasattr(progress, name) else progress.TextColumn(name)
            for name in self._columns
        ]
        self._echo.hide()
        self._bar = progress.Progress(*columns, auto_refresh=False, **self._options)
        self._bar.start()
        self._task = self._bar.add_task(description, total=total, completed=completed, **fields)

    def update(self, *, at_once: bool = False, **changes: Any) -> None:
        """Move the bar or change its texts; it is redrawn a few times a second, or at once."""
        if self._bar is None:
            return
        self._bar.update(self._task, **changes)
        now = time.monotonic()
        if at_once or now - self._drawn >= REFRESH_S:
            self._drawn = now
            self._bar.refresh()

    def print(self, text: str) -> None:
        """A line above the bar."""
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False)

    @property
    def shown(self) -> bool:
        """Whether the bar is on the screen."""
        return self._bar is not None

    def stop(self, *, keep: bool = True) -> None:
        """Draw the bar a last time and give the terminal back; without ``keep`` it is taken away."""
        if self._bar is not None:
            self._bar.live.transient |= not keep
            self._bar.refresh()
            self._bar.stop()
            self._bar = None
        self._echo.show()


class ControlEcho:
    """The `^C` that a terminal shows where Ctrl-C is typed: it would push a bar off the line it is redrawn on."""

    def __init__(self) -> None:
        self._terminal = -1

    def hide(self) -> None:
        """Show it no more; nothing where the standard output is no terminal or belongs to another job."""
        with suppress(OSError, ValueError, termios.error):
            terminal = sys.stdout.fileno()
            if termios.tcgetattr(terminal)[3] & termios.ECHOCTL:
                self._switch(terminal, shown=False)
                self._terminal = terminal
                atexit.register(self.show)

    def show(self) -> None:
        """Show it again, as before."""
        if self._terminal >= 0:
            with suppress(OSError, termios.error):
                self._switch(self._terminal, shown=True)
            self._terminal = -1
            atexit.unregister(self.show)

    @staticmethod
    def _switch(terminal: int, *, shown: bool) -> None:
        if os.tcgetpgrp(terminal) != os.getpgrp():  # in the background it would stop the process
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        attributes = termios.tcgetattr(terminal)
        attributes[3] = attributes[3] & ~termios.ECHOCTL | (termios.ECHOCTL if shown else 0)
        termios.tcsetattr(terminal, termios.TCSANOW, attributes)
