"""Reads the fitting curves back that a folder holds, be it of a run or of a study."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..base.arrays import FloatArray
from ..errors import OutputError
from .folder import CURVE, read_curve

STUDY_CURVES = "curves.csv"
"""What a study has of all its runs."""
_PLACE, _FORCE = "displacement_mm", "force_N "


class LabelledCurve(NamedTuple):
    """A fitting curve and what to call it in a figure."""

    label: str
    displacement: FloatArray  # mm
    force: FloatArray  # N


def read_curves(folder: Path) -> list[LabelledCurve]:
    """The curve of a run, or those of all runs of a study.

    Raises:
        OutputError: there is none, or a file is not one of macrofit.
    """
    path = folder / STUDY_CURVES
    if (folder / CURVE).exists() or not path.exists():
        return [LabelledCurve(str(folder), *read_curve(folder))]
    try:
        head, *rows = list(csv.reader(path.read_text().splitlines()))
        columns = [np.array([float(cell) for cell in column if cell]) for column in zip(*rows, strict=True)]
        named = list(zip(head, columns, strict=True))
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise OutputError(f"{path}: is not the curves of a study: a header, and rows of as many numbers") from None
    return _labelled(path, named)


def _labelled(path: Path, named: list[tuple[str, FloatArray]]) -> list[LabelledCurve]:
    """Each column of forces with the displacements before it."""
    found: list[LabelledCurve] = []
    place = None
    for name, column in named:
        if name.startswith(_PLACE):
            place = column
        elif name.startswith(_FORCE) and place is not None and len(place) == len(column):
            label = name.removeprefix(_FORCE).partition(": ")
            found.append(LabelledCurve(f"{path.parent}, {label[2] or label[0]}", place, column))
        else:
            raise OutputError(f"{path}: is not the curves of a study, its column '{name}' is another")
    return found
