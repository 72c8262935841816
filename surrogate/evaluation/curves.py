"""Loss curves of a training as CSV and as a figure."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from macrofit.base.figure import BLUE, VERMILION, save, sheet
from macrofit.base.files import replacing

from ..network.descent import Curves


def write_curves(curves: Curves, stem: Path, label: str, others: Sequence[Curves] = ()) -> list[Path]:
    """Write `stem`.loss.csv and `stem`.loss.png; gives their paths.

    Args:
        curves: of the training.
        stem: path without the endings.
        label: of the loss.
        others: of further members that were trained by themselves.

    Raises:
        OutputError: they cannot be written.
    """
    table, picture = stem.with_name(f"{stem.name}.loss.csv"), stem.with_name(f"{stem.name}.loss.png")
    each = [curves, *others]
    figure, (axes,) = sheet(6.0, 4.0)
    for number, one in enumerate(each):
        parts = ((one.training, BLUE, "training"), (one.validation, VERMILION, "validation"))
        for losses, colour, name in parts:
            axes.plot(range(len(losses)), losses, color=colour, lw=1.4 / len(each) ** 0.5, label=name * (not number))
        axes.axvline(one.best, color="0.5", lw=0.8, ls="--", label=f"kept: epoch {one.best}" * (not others))
    axes.set_xlabel("epoch")
    axes.set_ylabel(label)
    axes.legend(frameon=False)
    # the first epochs may leap far up
    settled = np.concatenate([one.validation[len(one.validation) // 20 :] for one in each])
    low, high = settled.min(), float(np.percentile(settled, 98))
    axes.set_ylim(low - 0.3 * (high - low) - 1e-9, high + 0.5 * (high - low) + 1e-9)
    _write_losses(each, table)
    return [table, save(figure, picture)]


def _write_losses(each: Sequence[Curves], table: Path) -> None:
    """A row for each epoch, two columns for each member; empty after its end."""
    ends = [f"_{number}" for number in range(1, len(each) + 1)] if len(each) > 1 else [""]
    with replacing(table) as draft, draft.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["epoch", *(f"{part}{end}" for end in ends for part in ("training", "validation"))])
        for epoch in range(max(len(one.training) for one in each)):
            cells: list[str] = []
            for one in each:
                there = epoch < len(one.training)
                cells += [f"{one.training[epoch]:.8g}" if there and epoch else ""]
                cells += [f"{one.validation[epoch]:.8g}" if there else ""]
            rows.writerow([epoch, *cells])
