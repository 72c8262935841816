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
from macrofit.base.errors import shortened
from macrofit.base.textfile import TextTable, read_text_table
from macrofit.base.units import LENGTHS

from .axes import without_axes
from .clean import MOST_MISSING, MUCH_MISSING
from .head import read_head, speaks
from .keys import MOST_BYTES
from .raw import RawScan, Remarks, ScanError, length_unit, unmangled

NOT_MEASURED = {"nan", "bad", "-", "--", "---", "", "***", "n/a", "na", "#n/a", "inf", "-inf"}
"""What stands in a text in place of a height, in small letters."""
MILLIMETRES = "places taken for mm: no unit was given"
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
    strange = tuple(f"its array '{other}' is not taken" for other in arrays if spacing is None and speaks(other))
    if spacing is not None:
        given = np.ravel(_real(spacing))
        if given.size not in (1, 2) or not (np.isfinite(given) & (given > 0.0)).all():
            raise ScanError("its array 'spacing' is not one or two lengths in mm")
        apart = float(given[0]), float(given[-1])
    known = None if unit is None else length_unit(str(unit.astype(str)))
    return RawScan(_real(arrays[name]), known, apart, Remarks(unclear=strange))


def read_text(path: Path) -> RawScan:
    """A grid of heights in a text, one row for each place along the slide; a head may say unit and spacing.

    Three columns of which the first two are the places of a grid, most of them, are a list, as for `read_points`. A
    first row and a first column that rise in steps are the places of columns and rows (`without_axes`).

    What is known in the head is told by `head`.

    Raises:
        ScanError: rows of different lengths, words in place of heights, a unit that is not known.
        OutputError: it is no text.
    """
    table = read_text_table(path, MOST_BYTES)
    head, corner, rows = _parted(table)
    if not rows:
        raise ScanError("it is no table of heights: it has no row of numbers")
    whole = _whole(table, rows)
    if len(corner) == len(whole[0]) > 2:
        whole.insert(0, corner)
    numbers = np.array(whole, dtype=np.float64)
    if _is_list(numbers):
        return read_points(path)
    heights, places, done = without_axes(numbers)
    if len(corner) == numbers.shape[1] and heights is numbers:
        heights = numbers[1:]  # its name was no corner of a table with places
    said = read_head(head, table.style.decimal, heights.shape)
    spacing, assumed = (said.spacing, "") if places is None else _axes_apart(places, head, said.spacing)
    return RawScan(
        heights, said.unit, spacing, Remarks(done=done, unclear=said.unclear, assumed=assumed, turned=said.turned)
    )


def _parted(table: TextTable) -> tuple[list[tuple[int, str]], list[float], list[tuple[int, str, list[float]]]]:
    """Head and rows of a table; and the last line of the head, where all but its first cell are numbers."""
    head: list[tuple[int, str]] = []
    corner: list[float] = []
    rows: list[tuple[int, str, list[float]]] = []
    for number, line, cells in table.rows():
        values = _values(table, cells)
        if line.startswith("#") or (not rows and None in values):
            head.append((number, line))
            corner = [math.nan, *_numbers(values[1:])] if None not in values[1:] else []
            continue
        row = _numbers(values)
        if len(row) < len(values):
            raise ScanError(f"line {number}: is no row of heights: '{shortened(line[:60])}'")
        rows.append((number, line, row))
    return head, corner, rows


def _whole(table: TextTable, rows: list[tuple[int, str, list[float]]]) -> list[list[float]]:
    """Rows of one length: cells that are empty at the end of a line, or all along it, were not measured.

    Raises:
        ScanError: a row has fewer cells than others.
    """
    width = max(len(row) for _, _, row in rows)
    found: dict[int, list[float]] = {}
    for number, line, row in rows:
        if len(row) < width and table.style.width(line) < width:
            raise ScanError(f"line {number}: has {len(row)} heights, others {width}")
        found[number] = row + [math.nan] * (width - len(row))
    first, last = rows[0][0], rows[-1][0]
    found |= {number: [math.nan] * width for number in table.hollow if first < number < last}
    return [found[number] for number in sorted(found)]


def _axes_apart(
    places: tuple[float, float], head: list[tuple[int, str]], said: tuple[float, float] | None
) -> tuple[tuple[float, float], str]:
    """Spacings [mm] of a table with places of its rows and columns, and what their unit was taken for.

    Raises:
        ScanError: the head says other spacings.
    """
    named = re.findall(r"(?<![^\W\d_])([xy])\s*[\[(]([^\])]+)[\])]", " ".join(line for _, line in head), re.IGNORECASE)
    units = {axis.lower(): length_unit(unit) or 1.0 for axis, unit in named}
    if said is not None and not units:
        unit = said[0] / places[0]
        units = {axis: known for axis in "xy" for known in LENGTHS.values() if math.isclose(known, unit, rel_tol=0.01)}
    found = places[0] * units.get("x", 1.0), places[1] * units.get("y", 1.0)
    if said is not None and not np.allclose(said, found, rtol=0.01):
        raise ScanError(
            f"its rows and columns are {found[0]:g} and {found[1]:g} mm apart by their places, and {said[0]:g} and "
            f"{said[1]:g} mm by its head: take the wrong ones out"
        )
    return found, "" if units else MILLIMETRES


def read_points(path: Path) -> RawScan:
    """A list of points x, y, z in a text, in any order, on a regular grid; x runs along the slide.

    Names and units stand in the head, ``x [mm], y [mm], z [µm]``, and the columns are taken by their names; without
    names they are x, y, z, without units x and y are in mm. Points that are there twice with other heights get their
    mean.

    Raises:
        ScanError: fewer than three columns, or points on no grid.
        OutputError: it is no text.
    """
    table = read_text_table(path, MOST_BYTES)
    points: list[list[float]] = []
    head: list[str] = []
    width = 3
    for number, line, cells in table.rows():
        values = _values(table, cells)
        if line.startswith("#") or (not points and None in values):
            head.append(unmangled(line))
            continue
        if len(values) < width or None in values:
            raise ScanError(f"line {number}: is no point x, y, z: '{shortened(line[:60])}'")
        width = len(values)
        points.append(_numbers(values))
    if not points:
        raise ScanError("it has no points x, y, z")
    if any(len(point) != width for point in points):
        raise ScanError(f"its lines have {width} numbers and others: write a point x, y, z on each")
    columns, units, done = _columns(head, table, width)
    x, y, z = np.array(points, dtype=np.float64).T[columns]
    x, y = (each * (unit or 1.0) for each, unit in zip((x, y), units[:2], strict=True))
    return _gridded(x, y, z, units[2], Remarks(done=done, assumed=MILLIMETRES if None in units[:2] else ""))


_NAMED = re.compile(
    r"(?<![^\W\d_])([xyz])(?![^\W\d_])\s*(?:[\[(]\s*([^\])]+)[\])]|[_/]\s*([^\W\d_]+)|in\s+([^\W\d_]+))?",
    re.IGNORECASE,
)


def _columns(head: list[str], table: TextTable, width: int) -> tuple[list[int], list[float | None], tuple[str, ...]]:
    """Which columns are x, y and z, their units [mm], and what was taken for what."""
    order = [0, 1, 2]
    units: list[float | None] = [None, None, None]
    done: tuple[str, ...] = ()
    for line in head:
        named = _NAMED.findall(line)
        bracketed = re.findall(r"\[([^\]]+)\]", line)
        if sorted(name.lower() for name, *_ in named) == ["x", "y", "z"]:
            order, units = _by_name(line, named, table, width)
            turned = "".join("xyz"[order.index(k)] if k in order else "-" for k in range(width))
            done = () if order == [0, 1, 2] else (f"columns taken by their names: {', '.join(turned)}",)
        elif len(bracketed) == 3:
            units = [length_unit(each) for each in bracketed]
    if width > 3 and not done:
        done = (f"columns {', '.join(str(k + 1) for k in range(width) if k not in order)} not taken",)
    return order, units, done


def _by_name(
    line: str, named: list[tuple[str, ...]], table: TextTable, width: int
) -> tuple[list[int], list[float | None]]:
    """Places of the columns x, y and z that a line names, and their units [mm]."""
    names = [name.lower() for name, *_ in named]
    units = {name.lower(): length_unit("".join(written)) for name, *written in named}
    places = list(range(3))
    if width > 3:
        cells = table.style.cells(re.sub(r"\s*[\[(][^\])]*[\])]", "", line.lstrip("# ")))
        firsts = [re.split(r"[_/ ]", cell.strip().lower())[0] for cell in cells]
        if len(cells) == width and all(name in firsts for name in names):
            places = [firsts.index(name) for name in names]
    by_name = dict(zip(names, places, strict=True))
    return [by_name[axis] for axis in "xyz"], [units[axis] for axis in "xyz"]


def _is_list(numbers: FloatArray) -> bool:
    """Whether rows of three numbers are points x, y, z: x goes with y once, mostly, and few are missing on the grid."""
    if numbers.shape[1] != 3 or len(numbers) < 9:
        return False
    x, y = (len(np.unique(column)) for column in numbers[:, :2].T)
    if min(x, y) <= 2 or (1.0 - MOST_MISSING) * x * y > len(numbers):
        return False
    there = len(np.unique(numbers[:, :2], axis=0))
    return there >= (1.0 - MUCH_MISSING) * len(numbers) and (1.0 - MOST_MISSING) * x * y <= there


NO_GRID = "resample it to one (scipy.interpolate.griddata), or write a table of heights"


def _gridded(x: FloatArray, y: FloatArray, z: FloatArray, unit: float | None, remarks: Remarks) -> RawScan:
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
            raise ScanError(f"its places {name} are no regular grid: {NO_GRID}")
        places.append(place.astype(np.int64))
        apart.append(step)
    shape = int(places[0].max()) + 1, int(places[1].max()) + 1
    if shape[0] * shape[1] > 4 * len(z):
        raise ScanError(
            f"its {len(z)} points fill a grid of {shape[0]} x {shape[1]} to less than a quarter (are they turned, or "
            f"beside their places?): {NO_GRID}"
        )
    heights, doubts = _laid(places[0] * shape[1] + places[1], z, shape)
    return RawScan(heights, unit, (apart[0], apart[1]), remarks._replace(doubts=doubts))


def _laid(places: npt.NDArray[np.int64], z: FloatArray, shape: tuple[int, int]) -> tuple[FloatArray, tuple[str, ...]]:
    """Heights on their places, means where there are several; and in words how many differ.

    Raises:
        ScanError: many places have several heights.
    """
    there = np.isfinite(z)
    places, z = places[there], z[there]
    count, sums = (np.bincount(places, weights, shape[0] * shape[1]) for weights in (None, z))
    with np.errstate(invalid="ignore"):
        heights = sums / count
    if count.max(initial=0) <= 1:
        return heights.reshape(shape), ()
    several = count[places] > 1
    far = np.abs(z[several] - heights[places[several]]) > 1e-9 * np.abs(z[several])
    other = len(np.unique(places[several][far]))
    if other > MUCH_MISSING * len(heights):
        raise ScanError(f"{other} of its places have two heights: are there two scans in it? take one out")
    told = f"{other} of its places have two heights or more, their mean is taken"
    return heights.reshape(shape), (told,) if other else ()


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


def _numbers(values: list[float | None]) -> list[float]:
    """Those that are numbers."""
    return [value for value in values if value is not None]
