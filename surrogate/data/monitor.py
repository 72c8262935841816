"""Watching a farm of friction tests: how many are done, and how long the rest will take."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import IO, Protocol

from macrofit.base.progress import Bar, duration, say, suited

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
        """Show nothing of the start."""

    def advanced(self, *, failed: bool) -> None:
        """Show nothing of a sample."""

    def finished(self) -> None:
        """Show nothing of the end."""


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
            say(self._line(now - self._since), self._stream)

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
        # a speed over the last quarter of an hour: samples end in bursts, one per worker
        self._bar = Bar(
            "Samples", "BarColumn", "MofNCompleteColumn", "TimeElapsedColumn", "left", "TimeRemainingColumn",
            "{task.description}", speed_estimate_period=900.0,
        )  # fmt: skip
        self._failed = 0

    def started(self, total: int, done: int) -> None:
        """Show the bar at its start."""
        self._bar.start(total, done)

    def advanced(self, *, failed: bool) -> None:
        """Move the bar by what is done."""
        self._failed += failed
        self._bar.update(advance=1, description=f"{self._failed} failed" if self._failed else "")

    def finished(self) -> None:
        """Leave the bar as it is, and give the terminal back."""
        self._bar.stop()


def on_screen(*, quiet: bool) -> FarmMonitor:
    """The monitor that suits the standard output: a live bar on a terminal, lines elsewhere, or nothing."""
    ways: tuple[Callable[[], FarmMonitor], ...] = (Progress, Lines, Silent)
    return suited(*ways, quiet=quiet)
