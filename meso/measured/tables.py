"""Heights in arrays of numpy and in texts: a grid of heights, or a list of points x, y, z."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from macrofit.base.arrayfile import read_npy, read_npz
from macrofit.base.arrays import FloatArray
from macrofit.base.textfile import TextTable, read_text_table
from macrofit.base.units import LENGTHS, read_heading

from .clean import MOST_MISSING
from .keys import MOST_BYTES
from .raw import RawScan, ScanError, length_unit

NOT_MEASURED = {"nan", "bad", "-", "--", "---", "", "***", "n/a", "na", "#n/a", "inf", "-inf"}
"""What stands in a text in place of a height, in small letters."""
_EXTENT = re.compile(r"rows along x = 0 \.\.\. ([\d.e+-]+) mm, \d+ columns along y = 0 \.\.\. ([\d.e+-]+) mm")
_LENGTH = r"([\d.]+(?:e[+-]?\d+)?)"
_SPACING = re.compile(rf"spacing\s*[:=]?\s*{_LENGTH}(?:\s*[,x]\s*{_LENGTH})?\s*(mm|µm|um|nm|m)\b", re.IGNORECASE)
SLACK = 0.02
"""Largest distance of a point of a list from its place on the grid, in spacings [-]."""


def read_array(path: Path) -> RawScan:
    """A grid of heights in an .npy file, rows along the slide; nothing says their unit or spacing.

    Raises:
        ScanError: it is no table of real numbers.
        OutputError: it is damaged.
    """
    return RawScan(_real(read_npy(path, MOST_BYTES)), None, None)


def read_archive(path: Path) -> RawScan:
    """Heights in an .npz file: `heights`, and if they are there `spacing` [mm] (one or two) and `unit`.

    Raises:
        ScanError: there are no such arrays, or of other shapes.
        OutputError: it is damaged.
    """
    arrays = read_npz(path, MOST_BYTES)
    grids = [name for name, array in arrays.items() if array.ndim == 2]
    name = "heights" if "heights" in arrays else grids[0] if len(grids) == 1 else None
    if name is None:
        raise ScanError(f"it holds no array 'heights' (but {', '.join(arrays) or 'nothing'})")
    spacing, unit = arrays.get("spacing"), arrays.get("unit")
    apart: tuple[float, float] | None = None
    if spacing is not None:
        given = np.ravel(_real(spacing))
        if given.size not in (1, 2) or not (np.isfinite(given) & (given > 0.0)).all():
            raise ScanError("its array 'spacing' is not one or two lengths in mm")
        apart = float(given[0]), float(given[-1])
    return RawScan(_real(arrays[name]), None if unit is None else length_unit(str(unit.astype(str))), apart)


def read_text(path: Path) -> RawScan:
    """A grid of heights in a text, one row for each place along the slide; a head may say unit and spacing.

    Three columns of which the first two are the places of a grid, most of them, are a list, as for `read_points`.

    Known in the head are ``[µm]`` after a name, ``spacing = 5 µm`` or ``spacing = 5, 4 µm``, and what
    `macrofit-meso surface` writes there.

    Raises:
        ScanError: rows of different lengths, words in place of heights, a unit that is not known.
        OutputError: it is no text.
    """
    table = read_text_table(path, MOST_BYTES)
    rows: list[list[float]] = []
    unit: float | None = None
    head = ""
    for number, line, cells in table.rows():
        values = _values(table, cells)
        if line.startswith("#") or (not rows and None in values):
            if not rows:
                head += line.strip("# ") + "\n"
                unit = _unit(line.strip("# "), unit)
            continue
        row = [value for value in values if value is not None]
        if len(row) < len(values):
            raise ScanError(f"line {number}: is no row of heights: '{line[:60]}'")
        if rows and len(row) != len(rows[0]):
            raise ScanError(f"line {number}: has {len(row)} heights, those before it {len(rows[0])}")
        rows.append(row)
    if not rows:
        raise ScanError("it is no table of heights: it has no row of numbers")
    heights = np.array(rows, dtype=np.float64)
    if _is_list(heights):
        return read_points(path)
    return RawScan(heights, unit, _spacing(head, heights.shape))


def read_points(path: Path) -> RawScan:
    """A list of points x, y, z in a text, in any order, on a regular grid; x runs along the slide.

    Units stand in the head, ``x [mm], y [mm], z [µm]``; without them x and y are in mm.

    Raises:
        ScanError: fewer than three columns, or points on no grid.
        OutputError: it is no text.
    """
    table = read_text_table(path, MOST_BYTES)
    points: list[list[float]] = []
    units: list[float | None] = [None, None, None]
    for number, line, cells in table.rows():
        values = _values(table, cells)
        if line.startswith("#") or (not points and None in values):
            bracketed = re.findall(r"\[([^\]]+)\]", line)
            units = [length_unit(each) for each in bracketed] if len(bracketed) == 3 else units
            continue
        if len(values) < 3 or None in values[:3]:
            raise ScanError(f"line {number}: is no point x, y, z: '{line[:60]}'")
        points.append([math.nan if value is None else value for value in values[:3]])
    if not points:
        raise ScanError("it has no points x, y, z")
    x, y, z = np.array(points, dtype=np.float64).T
    x, y = (each * (unit or 1.0) for each, unit in zip((x, y), units[:2], strict=True))
    return _gridded(x, y, z, units[2])


def _is_list(numbers: FloatArray) -> bool:
    """Whether rows of three numbers are points x, y, z: x goes with y once at most, and few are missing on the grid."""
    if numbers.shape[1] != 3 or len(numbers) < 9:
        return False
    x, y = (len(np.unique(column)) for column in numbers[:, :2].T)
    few_missing = (1.0 - MOST_MISSING) * x * y <= len(numbers) <= x * y
    return min(x, y) > 2 and few_missing and len(np.unique(numbers[:, :2], axis=0)) == len(numbers)


def _gridded(x: FloatArray, y: FloatArray, z: FloatArray, unit: float | None) -> RawScan:
    """Heights of points on the grid that they form; places without a point are missing."""
    places, apart = [], []
    for name, values in (("x", x), ("y", y)):
        if not np.isfinite(values).all():
            raise ScanError(f"a place {name} is not finite")
        distinct = np.unique(values)
        steps = np.diff(distinct)
        steps = steps[steps > 1e-6 * max(1e-300, float(np.ptp(distinct)))]
        step = float(np.median(steps)) if steps.size else 0.0
        if step > 0.0:
            step = float(np.ptp(distinct)) / max(1, round(float(np.ptp(distinct)) / step))
        place = np.round((values - distinct[0]) / step) if step > 0.0 else np.zeros(len(values))
        if step <= 0.0 or np.abs((values - distinct[0]) / step - place).max() > SLACK or place.max() > 1e6:
            raise ScanError(f"its places {name} are no regular grid: resample it, or write a table of heights")
        places.append(place.astype(np.int64))
        apart.append(step)
    shape = int(places[0].max()) + 1, int(places[1].max()) + 1
    if shape[0] * shape[1] > 4 * len(z):
        raise ScanError(f"its {len(z)} points fill a grid of {shape[0]} x {shape[1]} to less than a quarter")
    heights = np.full(shape, math.nan)
    heights[places[0], places[1]] = z
    return RawScan(heights, unit, (apart[0], apart[1]))


def _real(array: npt.NDArray[Any]) -> FloatArray:
    """Real numbers in double precision."""
    if array.dtype.kind not in "fiu":
        raise ScanError(f"it is no table of heights: its numbers are {array.dtype}, not real ones")
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite counts as missing
        return array.astype(np.float64)


def _values(table: TextTable, cells: list[str]) -> list[float | None]:
    """The numbers of a line, NaN for what says that nothing was measured; None where a cell is neither."""
    found = [table.style.number(cell) for cell in cells]
    return [
        math.nan if value is None and cell.lower() in NOT_MEASURED else value
        for value, cell in zip(found, cells, strict=True)
    ]


def _unit(line: str, before: float | None) -> float | None:
    """Unit of the heights under this line [mm]; as before where it names none."""
    heading = read_heading(line.partition(";")[0])
    strange = heading.strange or (heading.unit if heading.unit not in (None, *LENGTHS) else None)
    if strange is not None:
        return length_unit(strange)
    return before if heading.unit is None else LENGTHS[heading.unit]


def _spacing(head: str, shape: tuple[int, ...]) -> tuple[float, float] | None:
    """Spacings that the head of a text says [mm], if it does."""
    extent, apart = _EXTENT.search(head), _SPACING.search(head)
    if extent is not None and min(shape) > 1:
        return float(extent.group(1)) / (shape[0] - 1), float(extent.group(2)) / (shape[1] - 1)
    if apart is None:
        return None
    along, across, unit = apart.groups()
    scale = length_unit(unit) or 1.0
    return scale * float(along), scale * float(across or along)
