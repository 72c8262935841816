"""What the figures share: a sheet to draw on, colours, and how they are saved.

The colours are those of Okabe and Ito, which the colour-blind can tell apart, but for a redder red. matplotlib is
imported where it is used, and without its interactive part.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..files import replacing

BLUE, RED, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#C8352B", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
COLOURS = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
DPI = 180


def sheet(width: float, height: float) -> Any:
    """An empty figure of this size [inch]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI)


def placed(figure: Any, left: float, bottom: float, width: float, height: float, **sharing: Any) -> Any:
    """New axes at a place in the figure [inch]; the layout engines of matplotlib take longer than all the rest."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up), **sharing)


def plain(axes: Any, *, grid: bool = True) -> None:
    """Two spines, small ticks, a faint grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9)
    if grid:
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)


def save(figure: Any, target: Path) -> Path:
    """Write the figure and give its path back.

    Raises:
        OutputError: it cannot be written.
    """
    with replacing(target) as draft:
        figure.savefig(draft, pil_kwargs={"compress_level": 3})  # twice as fast as 6, a seventh larger
    return target
