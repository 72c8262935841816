"""Loss curves of a training as CSV and as a figure."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from macrofit.base.figure import BLUE, VERMILION, save, sheet
from macrofit.base.files import replacing

from ..network.descent import Curves


def write_curves(curves: Curves, stem: Path, label: str) -> list[Path]:
    """Write `stem`.loss.csv and `stem`.loss.png; gives their paths.

    Args:
        curves: of the training.
        stem: path without the endings.
        label: of the loss.

    Raises:
        OutputError: they cannot be written.
    """
    table, picture = stem.with_name(f"{stem.name}.loss.csv"), stem.with_name(f"{stem.name}.loss.png")
    epochs = range(len(curves.training))
    figure, (axes,) = sheet(6.0, 4.0)
    axes.plot(epochs, curves.training, color=BLUE, label="training")
    axes.plot(epochs, curves.validation, color=VERMILION, label="validation")
    axes.axvline(curves.best, color="0.5", linewidth=0.8, linestyle="--", label=f"kept: epoch {curves.best}")
    axes.set_xlabel("epoch")
    axes.set_ylabel(label)
    axes.legend(frameon=False)
    settled = np.array(curves.validation)[len(curves.validation) // 20 :]  # the first epochs may leap far up
    low, high = settled.min(), float(np.percentile(settled, 98))
    axes.set_ylim(low - 0.3 * (high - low) - 1e-9, high + 0.5 * (high - low) + 1e-9)
    with replacing(table) as draft, draft.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["epoch", "training", "validation"])
        for epoch in epochs:
            before = "" if epoch == 0 else f"{curves.training[epoch]:.8g}"
            rows.writerow([epoch, before, f"{curves.validation[epoch]:.8g}"])
    return [table, save(figure, picture)]
