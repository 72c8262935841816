"""Figures for a report: the fitting curve, pressure and shear along the seat; stress has its own module."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..acceptance import verdict
from ..base.arrays import FloatArray
from ..base.figure import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, save, sheet
from ..results.curves import read_curves
from .friction import friction
from .stress import stress

if TYPE_CHECKING:
    from ..solution import Increment, Solution

ZOOM = 24.0
"""Width of the zoom on the largest stress [mm], less where the contact is small."""


def write_figures(folder: Path, solution: Solution) -> list[Path]:
    """Write every figure the run has data for.

    Raises:
        OutputError: one cannot be written.
    """
    drawn = {"fitting_curve.png": fitting_curve(solution)}
    if any(record.normal_force > 0.0 for record in solution.increments):
        drawn["interface.png"] = interface(solution)
        if solution.friction is not None and solution.friction.seat.size:
            drawn["friction.png"] = friction(solution, solution.friction)
    if solution.fields:
        drawn["stress.png"] = stress(solution)
        drawn["stress_entrance.png"] = stress(solution, zoom=min(ZOOM, 4.0 * _contact_length(solution)))
    return [save(figure, folder / name, trim=True) for name, figure in drawn.items()]


def fitting_curve(solution: Solution) -> Any:
    """Pushing force against displacement, its peak marked, with the window of EN 13260 where it applies."""
    figure, (axes,) = sheet(7.0, 4.4)
    displacement, force = solution.displacement, solution.force / 1e3
    axes.plot(displacement, force, color=BLUE, lw=1.8)
    judged, _ = verdict(solution)
    window = None if judged is None else judged.en_13260
    if window is not None and 0.3 * force.max() < window.high / 1e3 < 3.0 * force.max():
        low, high = window.low / 1e3, window.high / 1e3
        axes.axhspan(low, high, color=ORANGE, alpha=0.18, lw=0)
        clear = np.interp(0.35, displacement / displacement.max(), force) < low  # the curve passes below the text
        x, side = (0.015, "left") if clear else (0.985, "right")
        place = {"transform": axes.get_yaxis_transform(), "ha": side, "va": "center"}
        axes.text(x, 0.5 * (low + high), "EN 13260, force at the end", fontsize=9, color="#7A5200", **place)
    if len(force) and force.max() > 0.0:
        _mark_peak(axes, displacement, force)
    _label_curve(axes, solution.scene.title)
    return figure


def compare(folders: Sequence[Path], target: Path) -> Path:
    """Overlay the fitting curves of several folders of runs and studies, read from their CSV files, in one figure.

    Raises:
        OutputError: a curve cannot be read or the figure cannot be written.
    """
    curves = [curve for folder in folders for curve in read_curves(folder)]
    figure, (axes,) = sheet(7.0, 4.4)
    styles = ["-", "--", "-.", ":"]
    colours = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK]
    for k, (label, displacement, force) in enumerate(curves):
        style = styles[k // len(colours) % len(styles)]
        axes.plot(displacement, force / 1e3, style, color=colours[k % len(colours)], lw=1.6, label=label)
    axes.legend(frameon=False, fontsize=9)
    _label_curve(axes, "")
    return save(figure, target, trim=True)


def interface(solution: Solution) -> Any:
    """Pressure and shear on the facets of the seat at the last displacement and a few before it."""
    from matplotlib import colormaps

    figure, (upper, lower) = sheet(7.0, 6.0, rows=2)
    shown = _stages(solution.increments)
    colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(shown))[::-1])
    for record, colour in zip(shown, colours, strict=True):
        style = {"color": colour, "lw": 1.8 if record is shown[-1] else 1.2, "baseline": None}
        upper.stairs(record.facets.pressure, solution.seat, label=f"{record.displacement:g} mm", **style)
        lower.stairs(record.facets.traction, solution.seat, **style)
    last = shown[-1]
    bound = last.facets.friction * last.facets.pressure
    style = {"color": VERMILION, "lw": 1.0, "ls": (0, (4, 2)), "baseline": None}
    signs = [sign for sign in (1.0, -1.0) if (sign * last.facets.traction).max() > 0.0]
    for k, sign in enumerate(signs):
        label = "" if k else f"friction bound at {last.displacement:g} mm"
        lower.stairs(sign * bound, solution.seat, label=label, **style)
    upper.set_ylabel("contact pressure [MPa]")
    lower.set_ylabel("shear on the axle [MPa]")
    coordinate = "z along the axle" if solution.scene.direction == "radial" else "radius r"
    lower.set_xlabel(f"{coordinate} [mm]")
    upper.set_ylim(0.0, 1.18 * upper.get_ylim()[1])  # room for the legend
    upper.legend(title="displacement", frameon=False, fontsize=9, title_fontsize=9, ncols=4, loc="upper center")
    if lower.get_legend_handles_labels()[0]:
        lower.legend(frameon=False, fontsize=9, loc="best")
    if solution.scene.title:
        upper.set_title(solution.scene.title, fontsize=10)
    return figure


def _contact_length(solution: Solution) -> float:
    """Length of the seat that carries pressure at the end [mm], all of it where nothing does."""
    loaded = np.flatnonzero(solution.increments[-1].facets.pressure > 0.0)
    first, last = (loaded[0], loaded[-1] + 1) if len(loaded) else (0, -1)
    return float(solution.seat[last] - solution.seat[first])


def _stages(records: Sequence[Increment]) -> list[Increment]:
    """Up to four increments in contact, evenly spaced, the last of them included."""
    touching = [record for record in records if record.normal_force > 0.0]
    places = np.linspace(0, len(touching), 5)[1:].round().astype(int) - 1
    return [touching[k] for k in dict.fromkeys(places.tolist()) if k >= 0]


def _mark_peak(axes: Any, displacement: FloatArray, force: FloatArray) -> None:
    top = int(force.argmax())
    axes.plot(displacement[top], force[top], "o", color=VERMILION, ms=5, zorder=3)
    axes.annotate(
        f"peak {force[top]:.4g} kN at {displacement[top]:g} mm", (displacement[top], force[top]), (-8, 6),
        textcoords="offset points", ha="right", va="bottom", fontsize=9,
    )  # fmt: skip


def _label_curve(axes: Any, title: str) -> None:
    axes.set_xlabel("displacement of the wheel [mm]")
    axes.set_ylabel("pushing force [kN]")
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.02)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.0) if low < -0.06 * high else 0.0, high + 0.04 * (high - low))
    if title:
        axes.set_title(title, fontsize=10)
