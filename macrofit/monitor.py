"""Watching a run: what the solver tells while it works, and who shows it.

The solver calls a monitor on every rank; the ones below are given to the first rank alone.
"""

from __future__ import annotations

import os
import sys
import time
from typing import IO, TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from .scene import Scene
    from .solution import Increment

REFRESH_S = 0.1
"""Shortest time between two redraws of the live bar [s]: drawing costs as much as a small increment."""


class Monitor(Protocol):
    """Told about a run while it goes on."""

    def started(self, scene: Scene, total_increments: int, dofs: int) -> None:
        """The bodies are ready; so many increments are planned, with so many degrees of freedom."""
        ...

    def increment(self, record: Increment) -> None:
        """An increment was accepted."""
        ...

    def finished(self) -> None:
        """Nothing more will come. May be called twice."""
        ...


class Silent:
    """Shows nothing: the default."""

    def started(self, scene: Scene, total_increments: int, dofs: int) -> None:
        """Nothing."""

    def increment(self, record: Increment) -> None:
        """Nothing."""

    def finished(self) -> None:
        """Nothing."""


class Several:
    """Tells several monitors in turn."""

    def __init__(self, *monitors: Monitor) -> None:
        self.monitors = monitors

    def started(self, scene: Scene, total_increments: int, dofs: int) -> None:
        """Tell all of them."""
        for monitor in self.monitors:
            monitor.started(scene, total_increments, dofs)

    def increment(self, record: Increment) -> None:
        """Tell all of them."""
        for monitor in self.monitors:
            monitor.increment(record)

    def finished(self) -> None:
        """Tell all of them."""
        for monitor in self.monitors:
            monitor.finished()


class Lines:
    """One plain line per increment, for log files and pipes."""

    def __init__(self, stream: IO[str] | None = None) -> None:
        self._stream = stream
        self._total = 0

    def started(self, scene: Scene, total_increments: int, dofs: int) -> None:
        """Say what is computed."""
        self._total = total_increments
        title = f"{scene.title}: " if scene.title else ""
        self._say(f"{title}{total_increments} increments, {dofs} degrees of freedom")

    def increment(self, record: Increment) -> None:
        """Say where the wheel is and what it takes to push it."""
        text = (
            f"increment {record.index + 1:4d}/{self._total}  displacement {record.displacement:10.6g} mm"
            f"  force {record.force / 1e3:10.6g} kN  pressure {record.max_pressure:8.5g} MPa"
            f"  Newton {record.newton_iterations:2d}"
        )
        if record.cutbacks:
            text += f"  cutbacks {record.cutbacks}"
        if not record.converged:
            text += "  not converged"
        self._say(text)

    def finished(self) -> None:
        """Nothing: the last line has been said."""

    def _say(self, text: str) -> None:
        print(text, file=self._stream or sys.stdout, flush=True)


class Progress:
    """A live bar with displacement, force and the time left, for a terminal."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._task: Any = None
        self._total = 0
        self._drawn = 0.0

    def started(self, scene: Scene, total_increments: int, dofs: int) -> None:
        """Show the bar."""
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        self._total = total_increments
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TextColumn("{task.fields[place]}"),
            TimeRemainingColumn(),
            auto_refresh=False,
            expand=True,
        )
        self._bar.start()
        self._task = self._bar.add_task(f"{dofs} dofs", total=total_increments, place="")

    def increment(self, record: Increment) -> None:
        """Move the bar; redrawn a few times a second."""
        if self._bar is None:
            return
        place = f"{record.displacement:.6g} mm  {record.force / 1e3:.5g} kN"
        self._bar.update(self._task, completed=min(record.index + 1, self._total), place=place)
        now = time.monotonic()
        if now - self._drawn >= REFRESH_S:
            self._drawn = now
            self._bar.refresh()

    def finished(self) -> None:
        """Draw the bar a last time and give the terminal back."""
        if self._bar is not None:
            self._bar.refresh()
            self._bar.stop()
            self._bar = None


def on_screen(*, quiet: bool) -> Monitor:
    """The monitor that suits the standard output: a live bar on a terminal, lines elsewhere, or nothing."""
    if quiet:
        return Silent()
    launched = any(name in os.environ for name in ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE"))  # gives rank 0 a terminal
    return Progress() if sys.stdout.isatty() and not launched else Lines()
