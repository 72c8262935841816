"""Watching a run: what the solver tells while it works, and who shows it.

The solver calls a monitor on every rank; the ones below are given to the first rank alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import IO, TYPE_CHECKING, Protocol

from .base.progress import Bar, say, suited

if TYPE_CHECKING:
    from mpi4py import MPI

    from .scene import Scene
    from .solution import Increment


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
        """Show nothing of the start."""

    def increment(self, record: Increment) -> None:
        """Show nothing of an increment."""

    def finished(self) -> None:
        """Show nothing of the end."""


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
        say(f"{title}{total_increments} increments, {dofs} degrees of freedom", self._stream)

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
        say(text, self._stream)

    def finished(self) -> None:
        """Nothing: the last line has been said."""


class Progress:
    """A live bar with displacement, force and the time left, for a terminal.

    Args:
        planned: increments, to show the bar at once, while the bodies are made; 0: when they are ready.
    """

    def __init__(self, planned: int = 0) -> None:
        self._bar = Bar(
            "{task.description}", "BarColumn", "MofNCompleteColumn", "{task.fields[place]}", "TimeRemainingColumn",
            expand=True,
        )  # fmt: skip
        self._total, self._ready = planned, False
        if planned:
            self._bar.start(planned, description="meshing and factoring", place="")

    def started(self, scene: Scene, total_increments: int, dofs: int) -> None:
        """Show the bar at its start, or say on it that the bodies are ready."""
        self._total, self._ready = total_increments, True
        if self._bar.shown:
            self._bar.update(total=total_increments, description=f"{dofs} dofs", at_once=True)
        else:
            self._bar.start(total_increments, description=f"{dofs} dofs", place="")

    def increment(self, record: Increment) -> None:
        """Move the bar by what is done."""
        place = f"{record.displacement:.6g} mm  {record.force / 1e3:.5g} kN"
        self._bar.update(completed=min(record.index + 1, self._total), place=place)

    def finished(self) -> None:
        """Draw the bar a last time and give the terminal back; one that never moved is taken away."""
        self._bar.stop(keep=self._ready)


def lines_of_first(comm: MPI.Comm, *, quiet: bool) -> Callable[[str], None]:
    """What says a line on the first rank, unless it is to be quiet; other ranks say nothing."""
    return say if comm.rank == 0 and not quiet else lambda line: None


def on_screen(*, quiet: bool, planned: int = 0) -> Monitor:
    """The monitor that suits the standard output: a live bar on a terminal, lines elsewhere, or nothing.

    With so many increments ``planned`` the bar is there at once.
    """
    ways: tuple[Callable[[], Monitor], ...] = (lambda: Progress(planned), Lines, Silent)
    return suited(*ways, quiet=quiet)
