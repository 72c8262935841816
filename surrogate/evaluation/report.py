"""What the command prints about an evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .parts import FROM, parts_lines


def evaluation_lines(result: Mapping[str, Any]) -> list[str]:
    """The report of `surrogate.evaluation.run`, for a reader."""
    floor = result["noise_floor"]
    first = f"Judged          {result['network']} ({result['faces']} faces) by {result['pairs']} pairs of surfaces"
    lines = [
        f"{first}, {result['packings']} packings each; contact lost in {result['lost_contact']} runs",
        *_in_its_range(result["parts"]),
        f"Relative error  {_percent(result)} against one packing, median {100 * result['median_relative_error']:.2f} %",
        f"                {_percent(result, '_all_packings')} against the mean over packings",
        f"Noise floor     {_cell(floor)} % against one packing",
        f"R2 of b         {result['r2_b']:.3f}",
    ]
    lines.append(f"Straight line   within {result['largest_bend']:.1e}, median {result['median_bend']:.1e}")
    at = result["by_micro_friction"].get("0.07")
    if at is not None:
        lines.append(
            f"At 0.07         {_percent(at)} against one packing, {_percent(at, '_all_packings')} against the mean, "
            f"R2 {at['r2_all_packings']:.3f}"
        )
    if "coverage_90" in result:
        lines.append(f"Inside 90 %     {100 * result['coverage_90']:.0f} % of all runs")
    names = ["constant ratio", *result["beside"], "this network", "noise floor"]
    lines += ["", "error [%]       " + "".join(f"{name:>18}" for name in names)]
    for micro, row in result["by_micro_friction"].items():
        beside = [row[name]["mean_relative_error"] for name in result["beside"]]
        values = [row["baseline_mean_relative_error"], *beside, row["mean_relative_error"], row["noise_floor"]]
        lines.append(f"  micro {micro:<8}" + "".join(f"{_cell(value):>18}" for value in values))
    return lines + parts_lines(result["parts"])


def _in_its_range(parts: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The error that the docs state, where the table knows parts: small micro coefficients have errors without end."""
    if "all" not in parts:
        return []
    row = parts["all"]
    error = f"{100 * row['error']:.2f} ± {100 * row['standard_error']:.2f} %"
    floor = _cell(row["floor"])
    return [f"In its range    {error} against the mean over packings, micro from {FROM:g} on (floor {floor} %)"]


def _percent(result: Mapping[str, Any], against: str = "") -> str:
    mean, error = result[f"mean_relative_error{against}"], result[f"standard_error{against}"]
    return f"{100 * mean:.2f} ± {100 * error:.2f} %"


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f}"
