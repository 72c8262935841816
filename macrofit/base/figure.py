"""What all figures share: a sheet to draw on, colours, and how they are saved.

The colours are those of Okabe and Ito (2008, https://jfly.uni-koeln.de/color/), which the colour-blind can tell apart.
matplotlib is imported where it is used, and without its interactive part.
"""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

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
    return figure_class()(figsize=(width, height), dpi=DPI)


def figure_class() -> Any:
    """matplotlib's Figure, imported on the first call, with its own settings.

    A matplotlibrc of the user's may ask for a TeX that is missing, or for letters that find no room. Where somebody has
    imported matplotlib already, or sits at a prompt or in a notebook, nothing is changed.
    """
    ensure_cache()
    if "matplotlib" in sys.modules or hasattr(sys, "ps1"):
        from matplotlib.figure import Figure

        return Figure
    with _without_tables():
        from matplotlib.figure import Figure
    from matplotlib import rcParams, rcParamsDefault

    dict.update(rcParams, {key: rcParamsDefault[key] for key in rcParamsDefault if key != "backend"})
    return Figure


@contextmanager
def _without_tables() -> Iterator[None]:
    """Import matplotlib without the tables of properties it writes into its docstrings: two fifths of its import."""
    from matplotlib import artist

    owners = ((artist, "kwdoc"), (artist.Artist, "_update_set_signature_and_docstring"))
    kept = [(owner, name, vars(owner)[name]) for owner, name in owners if name in vars(owner)]
    for owner, name, _ in kept:
        setattr(owner, name, staticmethod(_no_table))
    try:
        yield
    finally:
        for owner, name, value in kept:
            setattr(owner, name, value)


def sheet(width: float, height: float, rows: int = 1, columns: Sequence[float] = (1.0,)) -> tuple[Any, list[Any]]:
    """A figure of this size [inch] and its axes, row by row, in columns of these relative widths."""
    figure = figure_class()(figsize=(width, height), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, len(columns), sharex="col", squeeze=False, width_ratios=columns)
    return figure, [plain(each, grid=rows > 1 or len(columns) > 1) for each in axes.flat]


def placed(figure: Any, left: float, bottom: float, width: float, height: float, **sharing: Any) -> Any:
    """New axes at a place in the figure [inch]; the layout engines of matplotlib take longer than all the rest.

    Give a title its place (y = 1): to find one, matplotlib measures all ticks.
    """
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up), **sharing)


def _no_table(*_: Any) -> str:
    return ""


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
    _take_words_as_written(figure)
    with replacing(target) as draft:
        if target.suffix == ".png" and not trim:
            draft.write_bytes(_drawn(figure))
        else:
            figure.savefig(draft, bbox_inches="tight" if trim else None)
    return target


def _take_words_as_written(figure: Any) -> None:
    """A dollar in a user's title or label begins no formula."""
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    words = [figure._suptitle] if figure._suptitle else []
    for axes in figure.axes:
        words += [*axes.texts, axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label]
    for text in [*words, *figure.texts, *(text for legend in legends for text in legend.get_texts())]:
        text.set_parse_math(False)


def _drawn(figure: Any) -> bytes:
    """The figure as a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return png(np.asarray(canvas.buffer_rgba())[..., :3])


def png(picture: npt.NDArray[np.uint8]) -> bytes:
    """A PNG file of a picture (rows, columns, 3), in half of the time of PIL, which tries five filters a row.

    Rows are stored as differences to the one above (filter 2), by zlib at its fastest.
    """
    rows, columns, _ = picture.shape
    lines = np.empty((rows, 1 + 3 * columns), dtype=np.uint8)
    lines[:, 0], lines[:, 1:] = 2, picture.reshape(rows, -1)
    lines[1:, 1:] -= picture.reshape(rows, -1)[:-1]
    head = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    density = struct.pack(">IIB", *2 * [round(DPI / 0.0254)], 1)
    parts = ((b"IHDR", head), (b"pHYs", density), (b"IDAT", zlib.compress(lines.tobytes(), 1)), (b"IEND", b""))
    framed = (struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in parts)
    return b"\x89PNG\r\n\x1a\n" + b"".join(framed)
