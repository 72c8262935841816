"""Reads the fitting curves back that a folder holds, be it of a run or of a study."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..base.arrays import FloatArray
from ..base.files import read_regular
from ..errors import OutputError
from .folder import CURVE, read_curve

STUDY_CURVES = "curves.csv"
"""What a study has of all its runs."""
MOST_BYTES = 100_000_000
"""Size of the curves of a study."""
ROUNDING = 1e-9
"""A force below this share of the largest normal force is rounding: that of a wheel which cools in place."""
_PLACE, _FORCE = "displacement_mm", "force_N "


class LabelledCurve(NamedTuple):
    """A fitting curve and what to call it in a figure."""

    label: str
    displacement: FloatArray  # mm
    force: FloatArray  # N


def without_rounding(force: FloatArray, normal_force: FloatArray) -> FloatArray:
    """Forces [N] for people, with those set to 0 that are rounding beside the normal forces [N]."""
    return np.where(np.abs(force) < ROUNDING * float(normal_force.max(initial=0.0)), 0.0, force)


def read_curves(folder: Path) -> list[LabelledCurve]:
    """The curve of a run, or those of all runs of a study, called by the folder's name.

    Raises:
        OutputError: there is none, or a file is not one of macrofit.
    """
    name = folder.name or str(folder)
    path = folder / STUDY_CURVES
    if (folder / CURVE).exists() or not path.exists():
        return [LabelledCurve(name, *read_curve(folder))]
    return [curve._replace(label=f"{name}, {curve.label}") for curve in study_curves(path)]


def study_curves(path: Path) -> list[LabelledCurve]:
    """The curves of all runs of a study, called by what sets them apart.

    Raises:
        OutputError: the file cannot be read, or is not one of a study.
    """
    try:
        text = read_regular(path, MOST_BYTES).decode()
        head, *rows = [row for row in csv.reader(text.splitlines()) if row]
        columns = [np.array([float(cell) for cell in column if cell]) for column in zip(*rows, strict=True)]
        return _labelled(path, list(zip(head, columns, strict=True)))
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise OutputError(f"{path}: is not the curves of a study: a header, and rows of as many numbers") from None


def _labelled(path: Path, named: list[tuple[str, FloatArray]]) -> list[LabelledCurve]:
    """Each column of forces with the displacements before it."""
    found: list[LabelledCurve] = []
    place = None
    for name, column in named:
        if name.startswith(_PLACE):
            place = column
        elif name.startswith(_FORCE) and place is not None and len(place) == len(column):
            label = name.removeprefix(_FORCE).partition(": ")
            found.append(LabelledCurve(label[2] or label[0], place, column))
        else:
            raise OutputError(f"{path}: is not the curves of a study, its column '{name}' is another")
    return found
