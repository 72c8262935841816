"""Watching a farm of friction tests: how many are done, and how long the rest will take."""

from __future__ import annotations

import os
import sys
import time
from typing import IO, Any, Protocol

LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK")
"""Variables of a process that mpirun started."""
PERIOD_S = 20.0
"""Between two plain lines [s]."""


class FarmMonitor(Protocol):
    """Told about samples as they end."""

    def started(self, total: int, done: int) -> None:
        """So many samples are asked for, and so many were there before."""
        ...

    def advanced(self, *, failed: bool) -> None:
        """One more is there, or cannot be computed."""
        ...

    def finished(self) -> None:
        """Nothing more will come. May be called twice."""
        ...


class Silent:
    """Shows nothing."""

    def started(self, total: int, done: int) -> None:
        """Nothing."""

    def advanced(self, *, failed: bool) -> None:
        """Nothing."""

    def finished(self) -> None:
        """Nothing."""


class Lines:
    """A plain line now and then, for log files and pipes."""

    def __init__(self, stream: IO[str] | None = None, period: float = PERIOD_S) -> None:
        self._stream, self._period = stream, period
        self._total = self._before = self._done = self._failed = 0
        self._since = self._told = time.perf_counter()

    def started(self, total: int, done: int) -> None:
        """Start the clock."""
        self._total, self._before, self._done, self._failed = total, done, done, 0
        self._since = self._told = time.perf_counter()

    def advanced(self, *, failed: bool) -> None:
        """Count, and say a line when the last one is old, or at the end."""
        self._done += 1
        self._failed += failed
        now = time.perf_counter()
        if now - self._told >= self._period or self._done == self._total:
            self._told = now
            print(self._line(now - self._since), file=self._stream or sys.stdout, flush=True)

    def finished(self) -> None:
        """Nothing: the last line has been said."""

    def _line(self, elapsed: float) -> str:
        rate = (self._done - self._before) / max(elapsed, 1e-9)
        left = f"about {duration((self._total - self._done) / rate)} left" if self._done < self._total else "all there"
        failed = f", {self._failed} failed" if self._failed else ""
        return f"Samples         {self._done} of {self._total}{failed}, {1.0 / rate:.2f} s each, {left}"


class Progress:
    """A live bar with the time left, for a terminal."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._task: Any = None
        self._failed = 0

    def started(self, total: int, done: int) -> None:
        """Show the bar."""
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        # a speed over the last quarter of an hour: samples end in bursts, one per worker
        columns = (
            TextColumn("Samples"), BarColumn(bar_width=30), MofNCompleteColumn(), TimeElapsedColumn(),
            TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.description}"),
        )  # fmt: skip
        self._bar = Bar(*columns, refresh_per_second=4, speed_estimate_period=900.0)
        self._bar.start()
        self._task = self._bar.add_task("", total=total, completed=done)

    def advanced(self, *, failed: bool) -> None:
        """Move the bar."""
        self._failed += failed
        if self._bar is not None:
            self._bar.update(self._task, advance=1, description=f"{self._failed} failed" if self._failed else "")

    def finished(self) -> None:
        """Leave the bar as it is, and give the terminal back."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def on_screen(*, quiet: bool) -> FarmMonitor:
    """The monitor that suits the standard output: a live bar on a terminal, lines elsewhere, or nothing."""
    if quiet:
        return Silent()
    launched = any(name in os.environ for name in LAUNCHED)  # mpirun gives its first rank a terminal, even into a file
    return Progress() if sys.stdout.isatty() and not launched else Lines()


def duration(seconds: float) -> str:
    """In words a reader needs no table for: 40 s, 12 min, 3.5 h."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"
