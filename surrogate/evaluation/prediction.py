"""What the command says about the prediction for one pair of faces: lines, a table or a figure."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from macrofit.base.files import replacing

from ..pair import PairPrediction


def prediction_lines(pair: PairPrediction) -> list[str]:
    """What a network says about one pair of faces."""
    roughness = ", ".join(
        f"{name} {1e3 * face.std():.2f} µm" for name, face in (("wheel", pair.wheel), ("axle", pair.axle))
    )
    lines = [f"File            {line}" for line in pair.done]
    lines += [f"Faces           rms height: {roughness}", "  micro     meso      90 % interval of a friction test"]
    for micro, mean, half in zip(pair.micro, pair.mean, pair.half, strict=True):
        lines.append(f"  {micro:<8g}  {mean:.4f}    {mean - half:.4f} ... {mean + half:.4f}")
    if not pair.in_contact:
        lines.append("Contact         is probably lost somewhere along the slide; there errors are twice as large")
    return lines


def write_prediction(pair: PairPrediction, target: Path) -> None:
    """A figure (.png) or a table (.csv) of it.

    Raises:
        OutputError: it cannot be written.
    """
    if target.suffix.lower() == ".png":
        from .plots import draw_prediction

        draw_prediction(pair, target)
        return
    columns = np.stack([pair.micro, pair.mean, pair.spread, pair.mean - pair.half, pair.mean + pair.half])
    with replacing(target) as draft, draft.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["micro_friction", "meso_friction", "standard_deviation", "low_90", "high_90"])
        for values in columns.T:
            rows.writerow([f"{value:.6g}" for value in values])
