"""The figures of a study: its fitting curves, their spread, and stress fields side by side on one scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..base.figure import BLACK, BLUE, DPI, GREEN, ORANGE, PURPLE, SKY, VERMILION, save, sheet
from ..figures.curves import ZOOM, _label_curve
from ..figures.stress import _deformed, _draw_body, _inside
from ..scene.keys import Shaft
from ..solution import BodyField
from .fields import load_fields
from .plan import Plan, PlannedRun
from .record import RunRecord
from .statistics import BODIES, MANY, measured_samples, statistics, varied

LABELLED = 8
"""As many curves are told apart by colour; more are drawn as a bundle with its band."""
SIDE_BY_SIDE = 6
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, "#A6761D", "#8C510A")
GREY = "#5F6B76"


def write_study_figures(folder: Path, plan: Plan, records: Sequence[RunRecord]) -> list[Path]:
    """Write every figure the study has data for.

    Raises:
        OutputError: one cannot be written.
    """
    drawn = {"fitting_curves.png": fitting_curves(plan, records)}
    if len(varied(plan, records)) >= MANY:
        drawn["distributions.png"] = distributions(plan, records)
    fields = {run.number: load_fields(folder, run) for run in plan.runs[:SIDE_BY_SIDE]}
    shown = [(run, fields[run.number]) for run in plan.runs[:SIDE_BY_SIDE] if fields[run.number]]
    if shown:
        drawn["stress.png"] = stress_panels(shown)
        drawn["stress_entrance.png"] = stress_panels(shown, zoom=ZOOM)
    return [save(figure, folder / name, trim=True) for name, figure in drawn.items()]


def fitting_curves(plan: Plan, records: Sequence[RunRecord]) -> Any:
    """Force against displacement: each curve with its label, or many as a bundle with median and 5-95 % band."""
    figure, (axes,) = sheet(7.0, 4.4)
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
    axes.legend(frameon=False, fontsize=9)
    _label_curve(axes, plan.title)
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
    from matplotlib.figure import Figure

    sample = varied(plan, records)
    samples = measured_samples(sample)
    shown = {"peak force [kN]": samples["peak_force_N"] / 1e3}
    for body in BODIES:
        if f"{body}_max_von_mises_MPa" in samples:
            shown[f"largest von Mises stress, {body} [MPa]"] = samples[f"{body}_max_von_mises_MPa"]
    figure = Figure(figsize=(3.6 * len(shown) + 0.4, 3.6), dpi=DPI, layout="constrained")
    for axes, (title, values) in zip(np.atleast_1d(figure.subplots(1, len(shown))), shown.items(), strict=True):
        _histogram(axes, title, values)
    if plan.title:
        figure.suptitle(f"{plan.title}, {len(sample)} runs", fontsize=10)
    return figure


def _histogram(axes: Any, title: str, values: FloatArray) -> None:
    found = statistics(values)
    bins = int(np.clip(2.0 * len(values) ** (1.0 / 3.0), 5, 40))  # Rice's rule
    axes.hist(values, bins=bins, color=SKY, edgecolor="white", lw=0.6)
    mean, low, high = found["mean"], found["percentile_5"], found["percentile_95"]
    axes.axvline(mean, color=BLUE, lw=1.6)
    for edge in (low, high):
        axes.axvline(edge, color=VERMILION, lw=1.1, ls=(0, (4, 2)))
    axes.set_title(
        f"{mean:.5g} ± {found['standard_deviation']:.2g}, 5-95 %: {low:.5g} to {high:.5g}", fontsize=9, color=GREY
    )
    axes.set_xlabel(title)
    axes.set_ylabel("runs")
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9)
    axes.margins(x=0.04)


def stress_panels(
    shown: Sequence[tuple[PlannedRun, dict[float, dict[str, BodyField]]]], zoom: float | None = None
) -> Any:
    """Von Mises stress, a column per run and a row per displacement, with a scale of its own.

    With ``zoom`` [mm]: a window of that width on the seat's entrance.
    """
    from matplotlib.figure import Figure

    at = sorted({displacement for _, fields in shown for displacement in fields})
    window = _window(shown, zoom)
    extent = window[1] - window[0]
    width = 3.4 if zoom is not None else 3.0
    height = float(np.clip(width * extent[0] / extent[1], 1.2, 6.0))
    figure = Figure(figsize=(width * len(shown) + 1.2, (height + 0.45) * len(at) + 0.5), dpi=DPI, layout="compressed")
    grid = figure.subplots(len(at), len(shown), sharex=True, sharey=True, squeeze=False)
    for row, displacement in enumerate(at):
        every = [field for _, fields in shown for field in fields.get(displacement, {}).values()]
        top = max(float(field.von_mises[_inside(_deformed(field), window)].max(initial=0.0)) for field in every)
        for column, (run, fields) in enumerate(shown):
            axes = grid[row][column]
            for field in fields.get(displacement, {}).values():
                drawn = _draw_body(axes, field, window, top)
            (low_r, low_z), (high_r, high_z) = window
            axes.set(xlim=(low_z, high_z), ylim=(low_r, high_r), aspect="equal")
            axes.set_title(f"{run.label}\n{displacement:g} mm" if row == 0 else f"{displacement:g} mm", fontsize=9)
            axes.tick_params(labelsize=8)
        figure.colorbar(drawn, ax=grid[row].tolist(), label="von Mises stress [MPa]", fraction=0.03, pad=0.02)
    figure.supxlabel("z [mm]", fontsize=9)
    figure.supylabel("r [mm]", fontsize=9)
    return figure


def _window(
    shown: Sequence[tuple[PlannedRun, dict[float, dict[str, BodyField]]]], zoom: float | None
) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest (r, z) [mm] of every panel."""
    axle = shown[0][0].scene.axle
    if zoom is not None and isinstance(axle, Shaft):
        half = 0.5 * zoom * np.array([0.75, 1.0])
        centre = np.maximum([axle.seat_radius, 0.0], [half[0], -np.inf])
        return centre - half, centre + half
    points = np.concatenate(
        [_deformed(f) for _, fields in shown for bodies in fields.values() for f in bodies.values()]
    )
    margin = 0.03 * np.ptp(points, axis=0)
    return points.min(axis=0) - margin, points.max(axis=0) + margin
