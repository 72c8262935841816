"""The figure of a study of wheelsets in service: what each run says over what is varied, or the spread of many."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arrays import FloatArray
from ...base.figure import BLUE, GREEN, ORANGE, SKY, VERMILION, blank, placed, plain, save
from ...study.figures import draw_bars
from ...study.plan import Plan
from ...study.statistics import MANY, statistics
from .record import ServiceRecord, measured

SLIPS = (("front_slip_range_mm", "front", BLUE), ("inner_slip_range_mm", "inner", VERMILION))
CRITERIA = (("crossland", "Crossland", BLUE), ("dang_van", "Dang Van", VERMILION), ("findley", "Findley", ORANGE))
PANELS = (
    ("friction work [J]", 1e-3, (("friction_work_N_mm", "", BLUE),)),
    ("slip range along the axle [um]", 1e3, SLIPS),
    ("criterion [of the limit]", 1.0, CRITERIA),
    ("Ruiz and Chen [MPa2 mm]", 1.0, (("ruiz_MPa2_mm", "", GREEN),)),
)
"""Ordinate, factor, and curves (measure, name, colour) of each panel."""


def write_service_figure(target: Path, plan: Plan, records: Sequence[ServiceRecord]) -> Path:
    """Draw the runs over the first varied key, one line for each combination of the others; of many runs the spread.

    Raises:
        OutputError: the file cannot be written.
    """
    figure = blank(11.0, 7.0)
    places = _places(plan)
    spread = places is None and len(records) >= MANY
    for k, panel in enumerate(PANELS):
        axes = plain(placed(figure, 0.8 + 5.3 * (k % 2), 3.8 - 3.25 * (k // 2), 4.6, 2.5))
        if spread:
            _histogram(axes, plan, records, panel)
        else:
            _lines(axes, plan, records, panel, places)
    figure.suptitle(plan.title, fontsize=10, y=0.985, va="top")
    return save(figure, target)


def _places(plan: Plan) -> list[float] | None:
    """The values of the first key as numbers, by run; None where it has none, or only numbers a surface."""
    if not plan.keys or plan.keys[0].endswith("seed"):
        return None
    try:
        return [float(run.values[plan.keys[0]]) if run.values else float("nan") for run in plan.runs]
    except ValueError:
        return None


def _groups(plan: Plan) -> dict[str, list[int]]:
    """The numbers of the runs that differ in the first key alone, by what the others are."""
    found: dict[str, list[int]] = {}
    for number, run in enumerate(plan.runs):
        if run.values:
            label = ", ".join(f"{key.split('.')[-1]} = {run.values[key]}" for key in plan.keys[1:])
            found.setdefault(label, []).append(number)
    return found or {"": list(range(len(plan.runs)))}


def _lines(axes: Any, plan: Plan, records: Sequence[ServiceRecord], panel: Any, places: list[float] | None) -> None:
    ordinate, factor, curves = panel
    groups = _groups(plan)
    for dash, (label, numbers) in zip(("-", "--", ":", "-.") * len(groups), groups.items(), strict=False):
        x = np.array([number + 1.0 if places is None else places[number] for number in numbers])
        for name, word, colour in curves:
            values = [records[number].values[name] for number in numbers]
            y = np.array([np.nan if value is None else factor * value for value in values])
            axes.plot(
                x, y, dash, marker="o", ms=3.5, color=colour, lw=1.3, label=", ".join(filter(None, (word, label)))
            )
    axes.set_xlabel("run" if places is None else plan.keys[0])
    axes.set_ylabel(ordinate)
    axes.set_ylim(bottom=0.0)
    if len(curves) * len(groups) > 1:
        axes.legend(frameon=False, fontsize=8)


def _histogram(axes: Any, plan: Plan, records: Sequence[ServiceRecord], panel: Any) -> None:
    ordinate, factor, curves = panel
    said = []
    for name, word, colour in curves:
        values: FloatArray = factor * measured(plan, records, name)
        draw_bars(axes, values, color=SKY if len(curves) == 1 else colour, alpha=0.8, label=word)
        found = statistics(values)
        said.append(f"{word} {found['mean']:.4g} ± {found['standard_deviation']:.2g}".strip())
    axes.set_title(", ".join(said), fontsize=9)
    axes.set_xlabel(ordinate)
    if len(curves) > 1:
        axes.legend(frameon=False, fontsize=8)
