"""What the benchmarks share: CPU times with their spread, tables, growth, the efficient frontier, and its figure."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")


@dataclass(frozen=True)
class Cost:
    """CPU seconds of repeats of the same work, in the order they were taken."""

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median of the repeats [s]."""
        return median(self.seconds)

    def __str__(self) -> str:
        """Median and range, such as 0.58 (0.55-0.61)."""
        if len(self.seconds) == 1:
            return f"{self.median:.3g}"
        return f"{self.median:.3g} ({min(self.seconds):.3g}-{max(self.seconds):.3g})"


def cpu(work: Callable[[], Result], repeats: int = 3, warm: int = 1) -> tuple[Cost, Result]:
    """CPU time of ``work`` after ``warm`` runs that are not counted, and its last result."""
    for _ in range(warm):
        work()
    taken = []
    for _ in range(repeats):
        started = time.process_time()
        result = work()
        taken.append(time.process_time() - started)
    return Cost(tuple(taken)), result


def peak_memory() -> float:
    """The most memory this process has had [MiB]; ru_maxrss would begin with that of the one that started it."""
    status = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024.0 for line in status if line.startswith("VmHWM"))


def alone(code: str, timeout: float = 3600.0) -> list[str]:
    """The words that ``code`` prints in a process of its own, and then the peak of its memory [MiB]."""
    ending = "\nfrom tests.benchmarks._measure import peak_memory; print(peak_memory())"
    done = subprocess.run(
        [sys.executable, "-c", code + ending], capture_output=True, text=True, timeout=timeout, check=False,
        cwd=Path(__file__).parents[2], stdin=subprocess.DEVNULL,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(done.stderr)
    return done.stdout.split()


def head(*columns: str) -> str:
    """First two lines of a Markdown table."""
    return f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}"


def row(*cells: object) -> str:
    """One line of a Markdown table."""
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def growth(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Exponent k of cost ~ size^k, by least squares on the logarithms; NaN with fewer than two sizes."""
    if len(sizes) < 2:
        return float("nan")
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def frontier(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices, by rising cost, of the points that no other beats in both cost and error."""
    kept: list[int] = []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if not kept or errors[k] < errors[kept[-1]]:
            kept.append(k)
    return kept


@dataclass(frozen=True)
class Point:
    """One choice of a work-precision diagram."""

    series: str
    label: str
    cost: float  # CPU s
    error: float


def draw_work_precision(panels: dict[str, Sequence[Point]], target: Path, xlabel: str = "CPU time [s]") -> None:
    """Error against CPU time, a panel per kind of error, series in colours, the efficient frontier as a dashed line."""
    from matplotlib.figure import Figure

    colours = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
    figure = Figure(figsize=(4.6 * len(panels), 4.2), dpi=150, layout="constrained")
    for axes, (title, points) in zip(np.ravel(figure.subplots(1, len(panels))), panels.items(), strict=True):
        names = list(dict.fromkeys(point.series for point in points))
        for name, colour in zip(names, colours * 3, strict=False):
            own = [point for point in points if point.series == name]
            axes.loglog([p.cost for p in own], [p.error for p in own], "o", ms=4, color=colour, label=name)
        best = [points[k] for k in frontier([p.cost for p in points], [p.error for p in points])]
        axes.loglog(
            [p.cost for p in best], [p.error for p in best], "--", lw=1, color="0.5", zorder=0, label="frontier"
        )
        for point in best:
            axes.annotate(point.label, (point.cost, point.error), textcoords="offset points", xytext=(5, 4), fontsize=7)
        axes.set_xlabel(xlabel)
        axes.set_ylabel(title)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=7)
    save(figure, target)


def draw_growth(
    series: dict[str, tuple[Sequence[float], Sequence[float]]], target: Path, xlabel: str, ylabel: str
) -> None:
    """Cost against size on logarithmic axes, the exponent of each series in the legend."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 4.2), dpi=150, layout="constrained")
    axes = figure.subplots()
    for name, (sizes, costs) in series.items():
        axes.loglog(sizes, costs, "o-", ms=4, lw=1.2, label=f"{name}, exponent {growth(sizes, costs):.2f}")
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    save(figure, target)


def save(figure, target: Path) -> None:  # type: ignore[no-untyped-def]
    """Write a figure, with the folder it goes to."""
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target)


def lines(rows: Iterable[str]) -> None:
    """Print rows as they come."""
    for text in rows:
        print(text, flush=True)
