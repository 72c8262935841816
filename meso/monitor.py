"""Watching a friction test: what it is doing, what is done, and who shows it."""

from __future__ import annotations

import sys
import time
from typing import IO, Any, Protocol


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
        """Nothing."""

    def stage(self, text: str) -> None:
        """Nothing."""

    def done(self, text: str) -> None:
        """Nothing."""

    def finished(self) -> None:
        """Nothing."""


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
        print(f"{text}  ({now - self._since:.2f} s)", file=self._stream or sys.stdout, flush=True)
        self._since = now

    def finished(self) -> None:
        """Nothing: the last line has been said."""


class Progress:
    """A live bar with the stage and the time since the start, for a terminal; what is done is listed above it."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._task: Any = None
        self._since = time.perf_counter()

    def started(self, stages: int) -> None:
        """Show the bar."""
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        columns = (BarColumn(bar_width=30), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
        self._bar = Bar(*columns, refresh_per_second=4, transient=True)
        self._bar.start()
        self._task = self._bar.add_task("", total=stages)
        self._since = time.perf_counter()

    def stage(self, text: str) -> None:
        """Show what is going on."""
        if self._bar is not None:
            self._bar.update(self._task, description=text, refresh=True)

    def done(self, text: str) -> None:
        """Move the bar, and list what came of the stage."""
        if self._bar is not None:
            now = time.perf_counter()
            self._bar.console.print(f"{text}  ({now - self._since:.2f} s)", markup=False, highlight=False)
            self._bar.advance(self._task)
            self._since = now

    def finished(self) -> None:
        """Take the bar away and give the terminal back."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def on_screen(*, quiet: bool) -> Monitor:
    """The monitor that suits the standard output: a live bar on a terminal, lines elsewhere, or nothing."""
    if quiet:
        return Silent()
    return Progress() if sys.stdout.isatty() else Lines()
