"""What all figures share: a sheet to draw on, colours, and how they are saved.

The colours are those of Okabe and Ito (2008, https://jfly.uni-koeln.de/color/), which the colour-blind can tell apart.
matplotlib is imported where it is used, and without its interactive part.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .caches import ensure_cache
from .files import replacing

BLUE, ORANGE, GREEN, PURPLE, VERMILION, SKY, BLACK = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000"
)  # fmt: skip
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""In the order in which curves of one figure take them."""
DPI = 150


def blank(width: float, height: float) -> Any:
    """An empty figure of this size [inch], without a layout engine."""
    ensure_cache()
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI)


def sheet(width: float, height: float, rows: int = 1, columns: Sequence[float] = (1.0,)) -> tuple[Any, list[Any]]:
    """A figure of this size [inch] and its axes, row by row, in columns of these relative widths."""
    ensure_cache()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, len(columns), sharex="col", squeeze=False, width_ratios=columns)
    return figure, [plain(each, grid=rows > 1 or len(columns) > 1) for each in axes.flat]


def placed(figure: Any, left: float, bottom: float, width: float, height: float, **sharing: Any) -> Any:
    """New axes at a place in the figure [inch]; the layout engines of matplotlib take longer than all the rest."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up), **sharing)


def plain(axes: Any, *, grid: bool = True) -> Any:
    """The axes with two spines, small ticks, a faint grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9)
    if grid:
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)
    return axes


def save(figure: Any, target: Path, *, trim: bool = False) -> Path:
    """Write the figure and give its path back.

    Args:
        figure: what `blank` or `sheet` made.
        target: the file, its ending the format.
        trim: cut the sheet to what is drawn; the layout alone cuts labels off a drawing to scale.

    Raises:
        OutputError: it cannot be written.
    """
    options: dict[str, Any] = {"bbox_inches": "tight"} if trim else {}
    if target.suffix == ".png":
        options["pil_kwargs"] = {"compress_level": 1}  # three times as fast as 6, a fifth larger
    with replacing(target) as draft:
        figure.savefig(draft, **options)
    return target
