"""What all figures share: a sheet to draw on, colours, and how they are saved.

The colours are those of Okabe and Ito, which the colour-blind can tell apart. matplotlib is imported where it
is used, and without its interactive part.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..base.files import replacing

BLUE, ORANGE, GREEN, PURPLE, BROWN, SKY, BLACK = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000"
)  # fmt: skip
DPI = 150


def blank(width: float, height: float, rows: int = 1) -> tuple[Any, Any]:
    """A figure of this size [inch], and its axes, or as many as there are rows."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True)
    for each in np.atleast_1d(axes):
        each.spines[["top", "right"]].set_visible(False)
        each.tick_params(labelsize=9)
        if rows > 1:
            each.grid(color="0.9", lw=0.6)
            each.set_axisbelow(True)
    return figure, axes


def save(figure: Any, target: Path) -> Path:
    """Write the figure and give its path back. Raises OutputError when it cannot be written."""
    with replacing(target) as draft:
        figure.savefig(draft, bbox_inches="tight")  # the layout alone cuts labels off a drawing to scale
    return target
