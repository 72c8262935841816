"""Figures for a report: the fitting curve, pressure and shear along the seat; stress has its own module."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..acceptance import Verdict, judge_scene, verdict
from ..base.arrays import FloatArray
from ..base.figure import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, blank, placed, plain, save
from ..base.progress import printable
from ..results.curves import read_curves, without_rounding
from ..results.folder import SCENE
from ..scene import load_scene
from .friction import friction
from .stress import stress

if TYPE_CHECKING:
    from ..solution import Increment, Solution

ZOOM = 24.0
"""Width of the zoom on the largest stress [mm], less where the contact is small."""
WORDS = (0.45, 0.11)
"""Width and height of what is said of the windows, over those of the axes."""


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
    return [save(figure, folder / name) for name, figure in drawn.items()]


def fitting_curve(solution: Solution) -> Any:
    """Pushing force against displacement, its peak marked, with the windows of EN 13260 and GOST 11018 that apply."""
    figure, axes = curve_sheet()
    normal = np.array([record.normal_force for record in solution.increments])
    displacement, force = solution.displacement, without_rounding(solution.force, normal) / 1e3
    axes.plot(displacement, force, color=BLUE, lw=1.8)
    judged, _ = verdict(solution)
    draw_windows(axes, judged, [(displacement, force)])
    if len(force) and force.max() > 0.0:
        _mark_peak(axes, displacement, force)
    label_curve(axes, solution.scene.title)
    return figure


def curve_sheet(below: int = 0) -> tuple[Any, Any]:
    """A figure with one pair of axes for forces against displacement, and room for so many lines of words below."""
    room = 0.2 * below
    figure = blank(7.0, 4.4 + room)
    return figure, plain(placed(figure, 0.75, 0.55 + room, 6.1, 3.45), grid=False)


def draw_windows(axes: Any, judged: Verdict | None, curves: Sequence[tuple[FloatArray, FloatArray]]) -> None:
    """The forces at the end that the standards accept, as posts at the right; those far from the curves are not.

    Args:
        axes: forces in kN against displacements in mm.
        judged: a verdict with the windows.
        curves: displacement [mm] and force [kN] of what is drawn, which the words keep clear of.
    """
    top = max((float(force.max(initial=0.0)) for _, force in curves), default=0.0)
    known = () if judged is None else (("EN 13260", judged.en_13260), ("GOST 11018", judged.gost_11018))
    near = [(name, each) for name, each in known if each is not None and 0.3 * top < each.high / 1e3 < 3.0 * top]
    ends = [window.high / 1e3 for _, window in near]
    under = min(ends, default=0.0) - WORDS[1] * max([top, *ends])
    clear = bool(curves) and all((force[x <= WORDS[0] * x.max()] < under).all() for x, force in curves)
    for k, ((name, window), colour) in enumerate(zip(near, (ORANGE, PURPLE), strict=False)):
        low, high = window.low / 1e3, window.high / 1e3
        axes.axhspan(low, high, color=colour, alpha=0.10, lw=0)
        axes.axhspan(low, high, 0.965 - 0.03 * k, 0.99 - 0.03 * k, color=colour, alpha=0.6, lw=0)
        x, side = (0.015, "left") if clear else (0.92, "right")
        axes.annotate(
            f"{name}, force at the end: {low:.0f} to {high:.0f} kN", (x, high), (0, -4 - 13 * k), ha=side, va="top",
            xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=8.5, color="#5B4500",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8}, zorder=1.9,  # under the curves
        )  # fmt: skip


def compare(folders: Sequence[Path], target: Path) -> Path:
    """Overlay the fitting curves of several folders of runs and studies, read from their CSV files, in one figure.

    A curve is called by the title of its scene, or where others have the same by its folder's name.

    Raises:
        OutputError: a curve cannot be read or the figure cannot be written.
    """
    sources = [(folder, curve) for folder in folders for curve in read_curves(folder)]
    curves = [(displacement, force / 1e3) for _, (_, displacement, force) in sources]
    scenes = [load_scene(folder / SCENE) if (folder / SCENE).is_file() else None for folder, _ in sources]
    names = [printable(curve.label) for _, curve in sources]
    title, labels = called(names, ["" if scene is None else printable(scene.title) for scene in scenes])
    figure, axes = curve_sheet(len(labels))
    styles = ["-", "--", "-.", ":"]
    colours = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK]
    for k, ((displacement, force), label) in enumerate(zip(curves, labels, strict=True)):
        style = styles[k // len(colours) % len(styles)]
        axes.plot(displacement, force, style, color=colours[k % len(colours)], lw=1.6, label=label)
    judged = [
        judge_scene(scene, curve.displacement, curve.force, {})[0]
        for scene, (_, curve) in zip(scenes, sources, strict=True)
        if scene
    ]
    draw_windows(axes, common_window(judged), curves)
    figure.legend(loc="lower left", bbox_to_anchor=(0.09, 0.0), frameon=False, fontsize=9)
    label_curve(axes, title)
    return save(figure, target)


def common_window(judged: Sequence[Verdict | None]) -> Verdict | None:
    """A verdict whose windows are those of all; None where the seats' diameters differ."""
    known = [each for each in judged if each is not None and each.en_13260 is not None]
    same = len({each.seat_diameter_mm for each in known}) == 1
    return known[0] if known and same else None


def called(names: Sequence[str], titles: Sequence[str]) -> tuple[str, list[str]]:
    """The title of a figure of several curves, and what each is called in it."""
    if len(names) > 1 and titles[0] and len(set(titles)) == 1:
        return titles[0], [*names]
    twice = {title for title in titles if titles.count(title) > 1}
    return "", [
        name if not title else f"{title} ({name})" if title in twice else title
        for name, title in zip(names, titles, strict=True)
    ]


def interface(solution: Solution) -> Any:
    """Pressure and shear on the facets of the seat, a row for the last displacement and a few before it."""
    shown = _stages(solution.increments)
    high, gap = (1.2, 0.16) if len(shown) > 2 else (2.2, 0.16)
    figure = blank(9.6, 1.2 + len(shown) * (high + gap))
    labels = ("contact pressure [MPa]", "shear on the axle [MPa]")
    coordinate = "z along the axle" if solution.scene.direction == "radial" else "radius r"
    for column, (left, label) in enumerate(zip((0.75, 5.6), labels, strict=True)):
        rows = [placed(figure, left, 0.55 + (len(shown) - 1 - k) * (high + gap), 3.85, high) for k in range(len(shown))]
        for axes, record in zip(rows, shown, strict=True):
            plain(axes)
            axes.stairs(
                record.facets.traction if column else record.facets.pressure, solution.seat, color=BLUE, lw=1.4,
                baseline=None,
            )  # fmt: skip
            if column:
                _bound(axes, record, solution.seat)
            else:
                style = {"fontsize": 9.5, "fontweight": "bold", "ha": "right", "va": "top"}
                axes.annotate(_stage(solution, record), (0.985, 0.93), xycoords="axes fraction", **style)
        _same_limits(rows, solution.seat)
        rows[0].set_title(label, fontsize=10, loc="left", y=1.0)
        rows[-1].set_xlabel(f"{coordinate} [mm]")
    style = {"frameon": False, "fontsize": 8.5, "loc": "lower right", "bbox_to_anchor": (1.0, 0.98)}
    if rows[0].get_legend_handles_labels()[0]:
        rows[0].legend(**style, borderaxespad=0.0)
    when = f"at {len(shown)} displacements" if len(shown) > 1 else f"at {shown[0].displacement:g} mm"
    title = "\n".join(filter(None, (solution.scene.title, f"along the seat {when}")))
    figure.suptitle(title, fontsize=10, y=1.0 - 0.08 / figure.get_figheight(), va="top")
    return figure


def _same_limits(rows: Sequence[Any], seat: FloatArray) -> None:
    """One scale for axes above each other, few ticks, those along the seat at the lowest alone: ticks take long."""
    from matplotlib.ticker import MaxNLocator

    low, high = min(axes.get_ylim()[0] for axes in rows), max(axes.get_ylim()[1] for axes in rows)
    for axes in rows:
        axes.set(xlim=(seat[0], seat[-1]), ylim=(low, high))
        axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        if axes is not rows[-1]:
            axes.set_xticks([])


def _bound(axes: Any, record: Increment, seat: FloatArray) -> None:
    """What friction can hold, on the side or sides where there is shear."""
    bound = record.facets.friction * record.facets.pressure
    signs = [sign for sign in (1.0, -1.0) if (sign * record.facets.traction).max() > 0.0]
    for k, sign in enumerate(signs):
        label = "" if k else "friction times pressure"
        style = {"color": VERMILION, "lw": 1.0, "ls": (0, (4, 2)), "baseline": None}
        axes.stairs(sign * bound, seat, label=label, **style)


def _contact_length(solution: Solution) -> float:
    """Length of the seat that carries pressure at the end [mm], all of it where nothing does."""
    loaded = np.flatnonzero(solution.increments[-1].facets.pressure > 0.0)
    first, last = (loaded[0], loaded[-1] + 1) if len(loaded) else (0, -1)
    return float(solution.seat[last] - solution.seat[first])


def _stage(solution: Solution, record: Increment) -> str:
    """Where the wheel is in an increment, and in which one where it was there in others too: while it cools."""
    same = [k for k, each in enumerate(solution.increments, start=1) if each.displacement == record.displacement]
    which = [k for k in same if solution.increments[k - 1] is record]
    return f"{record.displacement:g} mm" + (f", increment {which[0]}" if len(same) > 1 else "")


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


def label_curve(axes: Any, title: str) -> None:
    """Words, grid and limits of a figure of forces [kN] against displacement [mm]."""
    axes.set_xlabel("displacement of the wheel [mm]")
    axes.set_ylabel("pushing force [kN]")
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.02)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.0) if low < -0.06 * high else 0.0, high + 0.04 * (high - low))
    if title:
        axes.set_title(title, fontsize=10, y=1.0)
