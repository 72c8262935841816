"""Errors by part of the range: roughness, pressure, form, lay and micro coefficient, each with floor and coverage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from macrofit.base.arrays import BoolArray

from ..data.samples import select_samples
from ..network.score import QUANTILE_90
from .errors import coverage_interval, slope_r2
from .measured import MeasuredPairs
from .predicted import PredictedPairs

HEIGHTS = (0.0, 0.005, 0.02, 0.05, 1.0)
"""Edges of the parts by R [mm]."""
PRESSURES = (0.0, 30.0, 100.0, 300.0, 5000.0)
"""Edges of the parts by pressure [MPa]."""
FROM = 0.05
"""Micro coefficient from which errors of a part are counted [-]: below, coefficients of rough pairs are near zero."""
SHARES = "error", "standard_error", "floor", "error_beyond_floor", "error_over_mean", "coverage_90"
"""What is told of a part in per cent."""
FEWEST = 4
"""Pairs from which a part is told."""
FEWEST_TESTS = 2
"""Packings from which a pair has a mean with a floor."""


def parts_report(data: MeasuredPairs, predicted: PredictedPairs) -> dict[str, dict[str, Any]]:
    """Errors, floors and coverages by part, where the pairs differ in more than R, level and exponent; else nothing.

    Errors are against the mean over packings, at micro coefficients from `FROM` on. A pair is doubtful where the plates
    found no equilibrium with one of its packings and were slid at a speed instead: no network learns from such tests.
    Where settled tests are named, pairs are judged by their other packings.
    """
    first = select_samples(data.samples, np.arange(0, len(data.samples), data.packings))
    if not np.ptp(first.pressure):
        return {}
    found = {}
    doubtful = (data.samples.remark != b"").reshape(-1, data.packings).any(axis=1)
    kinds = (first.form.astype(str), first.lay.astype(str), np.where(doubtful, "doubtful", "settled"))
    for name, rows in _parts(first.max_height, first.pressure, kinds):
        if rows.sum() >= FEWEST:
            found[name] = _measures(*_taken(data, predicted, rows, data.micro >= FROM))
    settled = (data.samples.remark == b"").reshape(-1, data.packings)
    for name, rows in (
        ("settled tests", first.max_height > 0.0),
        ("R from 50 µm, settled tests", first.max_height >= HEIGHTS[-2]),
    ):
        some = rows & (settled.sum(axis=1) >= FEWEST_TESTS)
        if some.sum() >= FEWEST:
            found[name] = _measures(*_taken(data, predicted, some, data.micro >= FROM), settled[some])
    every = np.ones(len(first), dtype=np.bool_)
    for micro in data.micro:
        found[f"micro {micro:g}"] = _measures(*_taken(data, predicted, every, data.micro == micro))
    return found


def parts_lines(parts: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The report for a reader."""
    if not parts:
        return []
    head = ("pairs", "error", "std.err.", "floor", "beyond", "over mean", "90 %", "from few", "R2 of b")
    lines = ["", f"{'part [%]':30}" + "".join(f"{name:>10}" for name in head)]
    for name, row in parts.items():
        shares = [row[name] for name in SHARES]
        r2 = "-" if row["r2_b"] is None else f"{row['r2_b']:.3f}"
        lines.append(
            f"  {name:28}{row['pairs']:10d}"
            + "".join(f"{100 * share:10.2f}" for share in shares)
            + f"{interval_text(row):>10}{r2:>10}"
        )
    return [
        *lines,
        f"errors against the mean over packings, micro coefficients from {FROM:g} on where none is named; floor: what "
        "the few packings leave to chance; beyond: root of error^2 - floor^2; over mean: of all pairs over the mean "
        "coefficient of all, for single rough pairs have coefficients near zero; from few: what share of all pairs may "
        "lie inside the stated 90 %, by so many pairs (95 %)",
    ]


def interval_text(row: Mapping[str, Any]) -> str:
    """Where the share inside the stated 90 % may lie, judged by so few pairs [%]."""
    low, high = row["coverage_interval"]
    return f"{100.0 * low:.0f}-{100.0 * high:.0f}"


def _parts(heights: Any, pressures: Any, kinds: Sequence[Any]) -> Iterator[tuple[str, BoolArray]]:
    """Name and pairs of each part but those by micro coefficient."""
    yield "all", np.ones(len(heights), dtype=np.bool_)
    for name, values, edges, unit in (("R", 1e3 * heights, [1e3 * edge for edge in HEIGHTS], "µm"),
                                      ("p", pressures, PRESSURES, "MPa")):  # fmt: skip
        for label, rows in _between(values, edges):
            yield f"{name} {label} {unit}", rows
    for values in kinds:
        for value in np.unique(values):
            yield str(value), values == value


def _between(values: Any, edges: Sequence[float]) -> Iterator[tuple[str, BoolArray]]:
    """Parts between edges, which the values' own range cuts off."""
    for low, high in pairwise(edges):
        rows = (values >= low) & (values < high)
        if rows.any():
            yield f"{max(low, values.min()):.3g}-{min(high, values.max()):.3g}", rows


def _taken(
    data: MeasuredPairs, predicted: PredictedPairs, rows: BoolArray, micros: BoolArray
) -> tuple[MeasuredPairs, PredictedPairs]:
    """Some of the pairs, at some of the micro coefficients."""
    some = np.ix_(rows, np.ones(data.packings, dtype=np.bool_), micros)
    spread = None if predicted.spread is None else predicted.spread[some]
    taken = replace(data, micro=data.micro[micros], meso=data.meso[some], in_contact=data.in_contact[rows])
    return taken, replace(predicted, mean=predicted.mean[some], spread=spread)


def _measures(data: MeasuredPairs, predicted: PredictedPairs, kept: BoolArray | None = None) -> dict[str, Any]:
    """Error against the mean over packings with its standard error, floor of that, coverage and R2 of b.

    The mean over few packings is itself off by the floor, which adds to the network's error as squares do. Where `kept`
    names some of the packings (n, p), pairs are judged by these, two at least, and there is no R2.
    """
    r2 = slope_r2(data, predicted) if kept is None and len(data.micro) > 1 else None
    kept = np.ones(data.meso.shape[:2], dtype=np.bool_) if kept is None else kept
    counts, meso = kept.sum(axis=1)[:, None], np.where(kept[:, :, None], data.meso, np.nan)
    mean, between = np.nanmean(meso, axis=1), list(combinations(range(kept.shape[1]), 2))
    apart = np.nanmean([np.abs(meso[:, i] - meso[:, j]) for i, j in between], axis=0) if between else np.nan
    wrong = np.abs(predicted.mean.mean(1) - mean)
    of_mean = (wrong / np.abs(mean)).mean(axis=1)
    error, floor = float(of_mean.mean()), float((apart / np.sqrt(2.0 * counts) / np.abs(mean)).mean())
    inside = float("nan")
    if predicted.spread is not None:
        inside = float((np.abs(predicted.mean - data.meso) <= QUANTILE_90 * predicted.spread)[kept].mean())
    return {
        "pairs": len(data.meso),
        "error": error,
        "standard_error": float(of_mean.std(ddof=1) / np.sqrt(len(of_mean))),
        "floor": floor,
        "error_beyond_floor": float(np.sqrt(np.maximum(error**2 - floor**2, 0.0))),
        "error_over_mean": float(wrong.sum() / np.abs(mean).sum()),
        "coverage_90": inside,
        "coverage_interval": coverage_interval(inside, len(data.meso)),
        "r2_b": r2,
    }
