"""Watching a friction test: what it is doing, what is done, and who shows it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import IO, Protocol

from macrofit.base.progress import Bar, say, suited


class Monitor(Protocol):
    """Told about the stages of a run."""

    def started(self, stages: int) -> None:
        """So many stages are to come."""
        ...

    def stage(self, text: str) -> None:
        """A stage begins, or what it does has changed."""
        ...

    def done(self, text: str) -> None:
        """A stage is over; this came of it."""
        ...

    def finished(self) -> None:
        """Nothing more will come. May be called twice."""
        ...


class Silent:
    """Shows nothing."""

    def started(self, stages: int) -> None:
        """Show nothing of the start."""

    def stage(self, text: str) -> None:
        """Show nothing of a stage."""

    def done(self, text: str) -> None:
        """Show nothing of what a stage gave."""

    def finished(self) -> None:
        """Show nothing of the end."""


class Lines:
    """One plain line per stage, with the time it took, for log files and pipes."""

    def __init__(self, stream: IO[str] | None = None) -> None:
        self._stream = stream
        self._since = time.perf_counter()

    def started(self, stages: int) -> None:
        """Start the clock."""
        self._since = time.perf_counter()

    def stage(self, text: str) -> None:
        """Nothing: a stage is told of when it is over."""

    def done(self, text: str) -> None:
        """Say what came of the stage and how long it took."""
        now = time.perf_counter()
        say(f"{text}  ({now - self._since:.2f} s)", self._stream)
        self._since = now

    def finished(self) -> None:
        """Nothing: the last line has been said."""


class Progress:
    """A live bar with the stage and the time since the start, for a terminal; what is done is listed above it."""

    def __init__(self) -> None:
        self._bar = Bar("BarColumn", "MofNCompleteColumn", "TimeElapsedColumn", "{task.description}", transient=True)
        self._since = time.perf_counter()
        self._done = 0

    def started(self, stages: int) -> None:
        """Show the bar at its start."""
        self._bar.start(stages)
        self._since = time.perf_counter()

    def stage(self, text: str) -> None:
        """Show what is going on."""
        self._bar.update(description=text, at_once=True)

    def done(self, text: str) -> None:
        """Move the bar, and list what came of the stage."""
        now = time.perf_counter()
        self._bar.print(f"{text}  ({now - self._since:.2f} s)")
        self._done += 1
        self._bar.update(completed=self._done, at_once=True)
        self._since = now

    def finished(self) -> None:
        """Take the bar away and give the terminal back."""
        self._bar.stop()


def on_screen(*, quiet: bool) -> Monitor:
    """The monitor that suits the standard output: a live bar on a terminal, lines elsewhere, or nothing."""
    ways: tuple[Callable[[], Monitor], ...] = (Progress, Lines, Silent)
    return suited(*ways, quiet=quiet)
