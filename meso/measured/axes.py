"""Tables of heights with the places of their columns in the first row, and of their rows in the first column."""

from __future__ import annotations

import numpy as np

from macrofit.base.arrays import FloatArray

from .raw import ScanError

LEAST = 5
"""Numbers in a row or column, at least, that may be places."""
UNEVEN = 0.26
"""Largest distance of a place from even steps, as rounding leaves it [steps]."""


def without_axes(table: FloatArray) -> tuple[FloatArray, tuple[float, float] | None, tuple[str, ...]]:
    """The heights alone, the steps of their places where they are there, and what was taken for what.

    Places rise or fall along the first row where the second row does not; so does no measured face. Whole numbers from
    0 or 1 on are counts, and say no distance.

    Raises:
        ScanError: places in uneven steps, or along one axis alone.
    """
    if min(table.shape) < 3:
        return table, None, ()
    row, column = _rises(table[0, 1:], table[1, 1:]), _rises(table[1:, 0], table[1:, 1])
    if row and column:
        across, along = table[0, 1:], table[1:, 0]
        if _counted(across) and _counted(along):
            return table[1:, 1:], None, ("first row and first column taken for numbers of columns and rows",)
        steps = tuple(abs(float(np.mean(np.diff(places)))) for places in (along, across))
        if not (_even(across) and _even(along)):
            raise ScanError(
                "its first row and first column are places in uneven steps: resample it (scipy.interpolate.griddata)"
            )
        return table[1:, 1:], (steps[0], steps[1]), ("first row and first column taken for places of columns and rows",)
    if _rises(table[0], table[1]) and _counted(table[0]):
        return table[1:], None, ("first row taken for numbers of the columns",)
    if _rises(table[:, 0], table[:, 1]):
        if _counted(table[:, 0]):
            return table[:, 1:], None, ("first column taken for numbers of the rows",)
        if len(table) > 2 * LEAST and _even(table[:, 0]):
            raise ScanError(
                "its first column rises in even steps: if these are places, take them out and say the spacing"
            )
    return table, None, ()


def _rises(places: FloatArray, beside: FloatArray) -> bool:
    """Whether numbers rise or fall all along, and those beside them do not."""
    return len(places) >= LEAST and _monotonous(places) and not _monotonous(beside)


def _monotonous(values: FloatArray) -> bool:
    steps = np.diff(values)
    return bool((steps > 0.0).all() or (steps < 0.0).all())


def _even(places: FloatArray) -> bool:
    even = np.linspace(places[0], places[-1], len(places))
    return bool(np.abs(places - even).max() <= UNEVEN * abs(even[1] - even[0]))


def _counted(places: FloatArray) -> bool:
    return bool((np.diff(places) == 1.0).all() and places[0] in (0.0, 1.0))
