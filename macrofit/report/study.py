"""The page of a study, from the files in its folder alone."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..base.arrays import FloatArray
from ..base.files import read_regular
from ..base.progress import printable
from ..errors import OutputError
from ..results.curves import STUDY_CURVES, study_curves
from .chart import Window, overlay
from .inputs import MOST_ROWS, studied
from .page import MOST_BYTES, read_json

NEEDED = ("title", "keys", "runs", "statistics", "verdicts", "doubts", "versions")
MOST_POINTS = 100
"""Points of a curve of the overlay."""
COLUMNS = {
    "peak_force_N": ("peak force [kN]", 1e-3), "peak_force_displacement_mm": ("at [mm]", 1.0),
    "final_force_N": ("at the end [kN]", 1e-3), "axle_max_von_mises_MPa": ("stress, axle [MPa]", 1.0),
    "wheel_max_von_mises_MPa": ("stress, wheel [MPa]", 1.0), "doubts": ("doubts", 1.0),
}  # fmt: skip
STATISTICS = {
    "peak_force_N": ("peak force [kN]", 1e-3), "final_force_N": ("force at the end [kN]", 1e-3),
    "axle_max_von_mises_MPa": ("largest stress, axle [MPa]", 1.0),
    "wheel_max_von_mises_MPa": ("largest stress, wheel [MPa]", 1.0),
}  # fmt: skip


def study_page(folder: Path) -> dict[str, Any]:
    """What the template `study.html` is filled with.

    Raises:
        OutputError: a file of the folder is missing or damaged.
    """
    numbers = read_json(folder / "study.json", NEEDED)
    rows = study_rows(folder / "study.csv", ("run", "label", "verdict", "refused_for"), COLUMNS)
    curves = _drawn(folder / STUDY_CURVES)
    references = sum(not run["values"] for run in numbers["runs"]) if numbers["keys"] else 0
    drawn = overlay(curves, _windows(numbers["verdicts"]), references) if curves else Markup("")
    return studied(folder, numbers, rows, COLUMNS, STATISTICS) | {"curves": drawn}


def _drawn(path: Path) -> list[tuple[str, FloatArray, FloatArray]]:
    """The first fitting curves of a study, of few points: name, displacement [mm], force [kN]."""
    found = []
    for label, displacement, force in study_curves(path)[:MOST_ROWS]:
        few = np.append(np.arange(len(force))[:: -(-len(force) // MOST_POINTS) or 1], [len(force) - 1])
        found.append((printable(label), displacement[few], force[few] / 1e3))
    return found


def study_rows(path: Path, words: Iterable[str], numbers: Iterable[str]) -> list[dict[str, str]]:
    """The rows of the table of a study, which must have these columns; a number may be left out.

    Raises:
        OutputError: it cannot be read, or is of something else.
    """
    head, *rows = _rows(path)
    if not {*words, *numbers} <= set(head):
        raise OutputError(f"{path}: is no table of a study; compute the study again")
    try:
        found = [dict(zip(head, row, strict=True)) for row in rows]
        np.array([row[key] or "nan" for row in found for key in numbers], dtype=np.float64)
    except ValueError as error:
        raise OutputError(f"{path}: cannot be read ({error}); compute the study again") from None
    return found


def _rows(path: Path) -> list[list[str]]:
    try:
        text = read_regular(path, MOST_BYTES).decode()
    except UnicodeDecodeError:
        raise OutputError(f"{path}: is not text; compute the study again") from None
    rows = [row for row in csv.reader(io.StringIO(text)) if row]
    if not rows:
        raise OutputError(f"{path}: is empty; compute the study again")
    return rows


def _windows(verdicts: dict[str, Any]) -> list[Window]:
    """The windows of the final force, where all runs have the same."""
    return [
        Window(name=name, low=ends["low_N"] / 1e3, high=ends["high_N"] / 1e3)
        for name, ends in verdicts.get("windows", {}).items()
    ]
