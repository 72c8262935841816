"""The figures of a study: its fitting curves, their spread, and stress fields side by side on one scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..acceptance import Verdict
from ..base.arrays import FloatArray
from ..base.figure import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, blank, placed, plain, save
from ..figures.curves import ZOOM, common_window, curve_sheet, draw_windows, label_curve
from .fields import load_fields
from .panels import stress_panels
from .plan import Plan
from .record import RunRecord
from .statistics import BODIES, MANY, measured_samples, statistics, varied

LABELLED = 8
"""As many curves are told apart by colour; more are drawn as a bundle with its band."""
SIDE_BY_SIDE = 6
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, "#A6761D", "#8C510A")
GREY = "#5F6B76"


def write_study_figures(
    folder: Path, plan: Plan, records: Sequence[RunRecord], verdicts: Sequence[Verdict | None] = ()
) -> list[Path]:
    """Write every figure the study has data for; with the runs' verdicts their windows of the final force.

    Raises:
        OutputError: one cannot be written.
    """
    drawn = {"fitting_curves.png": fitting_curves(plan, records, verdicts)}
    if len(varied(plan, records)) >= MANY:
        drawn["distributions.png"] = distributions(plan, records)
    fields = {run.number: load_fields(folder, run) for run in plan.runs[:SIDE_BY_SIDE]}
    shown = [(run, fields[run.number]) for run in plan.runs[:SIDE_BY_SIDE] if fields[run.number]]
    if shown:
        drawn["stress.png"] = stress_panels(shown)
        drawn["stress_entrance.png"] = stress_panels(shown, zoom=ZOOM)
    return [save(figure, folder / name) for name, figure in drawn.items()]


def fitting_curves(plan: Plan, records: Sequence[RunRecord], verdicts: Sequence[Verdict | None] = ()) -> Any:
    """Force against displacement: each curve with its label, or many as a bundle with median and 5-95 % band."""
    figure, axes = curve_sheet()
    pairs = list(zip(plan.runs, records, strict=True))
    references = [pair for pair in pairs if not pair[0].values and plan.keys]
    others = [pair for pair in pairs if pair not in references]
    if len(others) <= LABELLED:
        for colour, (run, record) in zip(COLOURS, others, strict=False):
            axes.plot(record.displacement, record.force / 1e3, color=colour, lw=1.6, label=run.label or "run")
    else:
        _bundle(axes, [record for _, record in others])
    for style, (run, record) in zip(("--", "-.", ":") * len(references), references, strict=False):
        axes.plot(record.displacement, record.force / 1e3, style, color=BLACK, lw=1.6, label=run.label)
    draw_windows(axes, common_window(verdicts), [(record.displacement, record.force / 1e3) for record in records])
    axes.legend(framealpha=0.85, edgecolor="none", fontsize=9)
    label_curve(axes, plan.title)
    return figure


def _bundle(axes: Any, records: Sequence[RunRecord]) -> None:
    for record in records:
        axes.plot(record.displacement, record.force / 1e3, color="0.75", lw=0.4, alpha=min(1.0, 30.0 / len(records)))
    places = records[0].displacement
    if any(record.displacement_mm != records[0].displacement_mm for record in records):
        if any((np.diff(record.displacement) <= 0.0).any() for record in records):
            return  # the motions differ and turn back: there is no common displacement
        last = min(record.displacement_mm[-1] for record in records)
        first = max(record.displacement_mm[0] for record in records)
        places = places[(places >= first) & (places <= last)]
        forces = np.stack([np.interp(places, record.displacement, record.force) for record in records])
    else:
        forces = np.stack([record.force for record in records])
    low, middle, high = np.percentile(forces / 1e3, [5.0, 50.0, 95.0], axis=0)
    axes.fill_between(places, low, high, color=BLUE, alpha=0.22, lw=0, label="5 to 95 %")
    axes.plot(places, middle, color=BLUE, lw=1.8, label=f"median of {len(records)} runs")


def distributions(plan: Plan, records: Sequence[RunRecord]) -> Any:
    """Histograms of the peak force and of the largest stresses, with mean, deviation and percentiles."""
    sample = varied(plan, records)
    samples = measured_samples(sample)
    shown = {"peak force [kN]": samples["peak_force_N"] / 1e3}
    for body in BODIES:
        if f"{body}_max_von_mises_MPa" in samples:
            shown[f"largest von Mises stress, {body} [MPa]"] = samples[f"{body}_max_von_mises_MPa"]
    figure = blank(3.8 * len(shown) + 0.2, 3.6)
    for k, (title, values) in enumerate(shown.items()):
        _histogram(plain(placed(figure, 0.7 + 3.8 * k, 0.55, 2.95, 2.3), grid=False), title, values)
    title = ", ".join(filter(None, (plan.title, f"{len(sample)} runs")))
    figure.suptitle(title, fontsize=10, y=0.98, va="top")
    return figure


def _histogram(axes: Any, title: str, values: FloatArray) -> None:
    found = statistics(values)
    draw_bars(axes, values, color=SKY)
    mean, low, high = found["mean"], found["percentile_5"], found["percentile_95"]
    axes.axvline(mean, color=BLUE, lw=1.6)
    for edge in (low, high):
        axes.axvline(edge, color=VERMILION, lw=1.1, ls=(0, (4, 2)))
    axes.set_title(
        f"{mean:.5g} ± {found['standard_deviation']:.2g}, 5-95 %: {low:.5g} to {high:.5g}", fontsize=9, color=GREY
    )
    axes.set_xlabel(title)
    axes.margins(x=0.04)


def draw_bars(axes: Any, values: FloatArray, **style: Any) -> None:
    """The numbers of runs of a sample as bars, so many as Rice's rule says."""
    bins = int(np.clip(2.0 * len(values) ** (1.0 / 3.0), 5, 40))
    axes.hist(values, bins=bins, edgecolor="white", lw=0.6, **style)
    axes.set_ylabel("runs")
