"""Curves as SVG within the page: a frame with ticks and labels, paths, bands. Lengths are pixels of the view box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from ..base.arrays import FloatArray
from ..base.figure import BLACK, COLOURS, ORANGE, PURPLE

WIDTH = 860.0
LEFT, RIGHT, TOP, BOTTOM = 72.0, 18.0, 14.0, 46.0
POST = 14.0
"""Width of the post of a window."""
WINDOW_COLOURS = (ORANGE, PURPLE)
DASHES = ("", "7 4", "7 3 2 3", "2 3")
MOST_LABELLED = 12
"""As many curves are told apart; more are drawn as one bundle."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """The final forces [kN] that a standard accepts."""

    name: str
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Axes from ``x0`` to ``x1`` and ``y0`` to ``y1`` in the units of the data."""

    x0: float
    x1: float
    y0: float
    y1: float
    height: float = 360.0

    def across(self, x: FloatArray | float) -> FloatArray:
        """The pixels of abscissas."""
        share = (np.asarray(x) - self.x0) / (self.x1 - self.x0)
        return LEFT + share * (WIDTH - LEFT - RIGHT)

    def up(self, y: FloatArray | float) -> FloatArray:
        """The pixels of ordinates, from the top."""
        share = (np.asarray(y) - self.y0) / (self.y1 - self.y0)
        return self.height - BOTTOM - share * (self.height - TOP - BOTTOM)

    def axes(self, below: str, beside: str) -> Markup:
        """Grid, ticks and the labels of both axes."""
        low, high = self.height - BOTTOM, TOP
        parts = [Markup('<g class="axes">')]
        for x in ticks(self.x0, self.x1, 10):
            parts.append(_tick(self.across(x), low, high, upright=True, text=f"{x:.6g}"))
        for y in ticks(self.y0, self.y1, 6):
            parts.append(_tick(self.up(y), LEFT, WIDTH - RIGHT, upright=False, text=f"{y:.6g}"))
        middle = 0.5 * (low + high)
        parts.append(
            Markup('<text x="{:.0f}" y="{:.0f}" class="label">{}</text><text class="label" '
                   'transform="translate(16 {:.0f}) rotate(-90)">{}</text></g>')
            .format(0.5 * (LEFT + WIDTH - RIGHT), self.height - 8.0, below, middle, beside)
        )  # fmt: skip
        return Markup("").join(parts)

    def line(self, x: FloatArray, y: FloatArray) -> str:
        """The path of a curve."""
        return _path(self.across(x), self.up(y))

    def stairs(self, edges: FloatArray, values: FloatArray) -> str:
        """The path of values (n,) that are constant between edges (n + 1,)."""
        return _path(np.repeat(self.across(edges), 2)[1:-1], np.repeat(self.up(values), 2))

    def drawing(self, *parts: str, name: str) -> Markup:
        """The whole SVG; ``name`` says to those who cannot see what it shows."""
        return Markup('<svg viewBox="0 0 {:.0f} {:.0f}" role="img" aria-label="{}">{}</svg>').format(
            WIDTH, self.height, name, Markup("").join(parts)
        )


def ticks(low: float, high: float, most: int) -> FloatArray:
    """Round numbers between two, at most ``most`` and one."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return step * np.arange(first, last + 1)


def span(values: FloatArray) -> tuple[float, float]:
    """Ends of an axis for values: with zero, and with some room; never empty."""
    low, high = min(0.0, float(values.min(initial=0.0))), max(0.0, float(values.max(initial=0.0)))
    room = 0.05 * (high - low) or 1.0
    return (low - room if low < 0.0 else 0.0), high + room


def curve_frame(x: FloatArray, force: FloatArray) -> Frame:
    """The axes of fitting curves: displacements [mm], which may be a single one or none, and forces [kN]."""
    low, high = span(force)
    first, last = (float(x.min()), float(x.max())) if len(x) else (0.0, 1.0)
    return Frame(x0=first, x1=last if last > first else first + 1.0, y0=low, y1=high)


def path(d: str, colour: str, *, width: float = 2.0, dash: str = "", mark: str = "") -> Markup:
    """A path in a colour; ``mark`` is its id."""
    return Markup('<path d="{}" fill="none" stroke="{}" stroke-width="{}"{}{}/>').format(
        d, colour, width,
        Markup(' stroke-dasharray="{}"').format(dash) if dash else "",
        Markup(' id="{}"').format(mark) if mark else "",
    )  # fmt: skip


def bands(frame: Frame, windows: Sequence[Window]) -> Markup:
    """The windows of final forces, each with a post of its own at the end; those beyond the axis are left out."""
    parts = []
    for k, window in enumerate(_within(frame, windows)):
        low, high = float(frame.up(window.low)), float(frame.up(min(window.high, frame.y1)))
        x, colour = WIDTH - RIGHT - POST * (k + 1) - 4.0 * k, WINDOW_COLOURS[k % 2]
        parts.append(
            Markup('<rect x="{}" y="{:.1f}" width="{:.1f}" height="{:.1f}" fill="{}" fill-opacity=".1"/>'
                   '<rect x="{:.1f}" y="{:.1f}" width="{}" height="{:.1f}" fill="{}" class="window"/>')
            .format(LEFT, high, x - LEFT, low - high, colour, x, high, POST, low - high, colour)
        )  # fmt: skip
    return Markup("").join(parts)


def names(frame: Frame, windows: Sequence[Window]) -> Markup:
    """What the windows are called and their numbers, above the curves."""
    said: list[Markup] = []
    above = 0.0
    for window in sorted(_within(frame, windows), key=lambda each: -each.high):
        above = max(float(frame.up(min(window.high, frame.y1))) + 14.0, above + 16.0 if said else 0.0)
        text = Markup('<text x="{}" y="{:.1f}" class="note">{}: {:.0f} to {:.0f} kN at the end</text>')
        said.append(text.format(LEFT + 8.0, above, window.name, window.low, window.high))
    return Markup("").join(said)


def _within(frame: Frame, windows: Sequence[Window]) -> list[Window]:
    return [window for window in windows if window.low < frame.y1]


def overlay(
    curves: Sequence[tuple[str, FloatArray, FloatArray]], windows: Sequence[Window], references: int = 0
) -> Markup:
    """Fitting curves (name, displacement [mm], force [kN]) in one frame; the first ``references`` black and dashed."""
    frame = curve_frame(*(np.concatenate(values) for values in list(zip(*curves, strict=True))[1:]))
    few = len(curves) <= MOST_LABELLED
    drawn = [
        path(frame.line(place, force), **_style(k, references, few=few)) for k, (_, place, force) in enumerate(curves)
    ]
    above = [*drawn[references:], *drawn[:references]]
    axes = frame.axes("displacement of the wheel [mm]", "pushing force [kN]")
    return (
        frame.drawing(bands(frame, windows), axes, *above, names(frame, windows), name="fitting curves")
        + (_legend([name for name, *_ in curves], references) if few else "")
    )  # fmt: skip


def _style(k: int, references: int, *, few: bool) -> dict[str, Any]:
    """How the curve of this number is drawn."""
    if k < references:
        return {"colour": BLACK, "dash": DASHES[1 + k % (len(DASHES) - 1)]}
    if not few:
        return {"colour": "#7a868e", "width": 0.4}
    k -= references
    return {"colour": COLOURS[k % len(COLOURS)], "dash": DASHES[k // len(COLOURS) % len(DASHES)]}


def _legend(labels: Sequence[str], references: int) -> Markup:
    styles = [_style(k, references, few=True) for k in range(len(labels))]
    return legend([(label, each["colour"], each["dash"]) for label, each in zip(labels, styles, strict=True)])


def legend(curves: Sequence[tuple[str, str, str]]) -> Markup:
    """A list of what curves are called, each with its colour and dashes."""
    keys = [
        Markup('<li><svg viewBox="0 0 36 10" class="key">{}</svg>{}</li>').format(
            path("M0 5H36", colour, dash=dash), label
        )
        for label, colour, dash in curves
    ]
    return Markup('<ul class="legend">{}</ul>').format(Markup("").join(keys))


def _path(x: FloatArray, y: FloatArray) -> str:
    return "M" + "L".join(f"{a:.2f} {b:.2f}" for a, b in zip(x.tolist(), y.tolist(), strict=True)) if len(x) else ""


def _tick(at: FloatArray, start: float, end: float, *, upright: bool, text: str) -> Markup:
    if upright:
        return Markup('<path d="M{0:.1f} {1}V{2}"/><text x="{0:.1f}" y="{3}" text-anchor="middle">{4}</text>').format(
            float(at), start, end, start + 17.0, escape(text)
        )
    return Markup('<path d="M{1} {0:.1f}H{2}"/><text x="{3}" y="{4:.1f}" text-anchor="end">{5}</text>').format(
        float(at), start, end, start - 7.0, float(at) + 4.5, escape(text)
    )
