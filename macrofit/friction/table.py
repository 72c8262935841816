"""The friction provider `table`: coefficients from a CSV file, along the seat or for each pair of tiles.

    [friction]
    provider = "table"

    [friction.options]
    file = "measured.csv"

The first line names the columns, in any order; lines that start with # and empty lines are passed over.

    z_mm,coefficient              seat,bore,coefficient,uncertainty
    0,0.09                        0,0,0.104,0.006
    40,0.12                       0,1,0.117,0.005
"""

from __future__ import annotations

import csv
import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, NamedTuple, TypeAlias

import msgspec
import numpy as np

from macrofit.base.files import read_regular
from macrofit.errors import OutputError, ProviderError
from macrofit.friction.contract import LIMIT, BuildContext, FloatArray, IntArray, TilePairs

MOST_BYTES = 20_000_000
"""Size of a table; a thousand tiles have 40 kB, all pairs of them 20 MB."""
VALUES = {"coefficient": LIMIT, "uncertainty": math.inf}
"""Columns of values, and what they must stay below."""

Row: TypeAlias = tuple[int, dict[str, float]]
"""Number of a line and its cells by column."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Coefficients of friction from a CSV file.

    With the columns `z_mm,coefficient` mu is piecewise linear along the seat and taken at the middle of each seat
    tile; beyond the ends it keeps the end values. z is 0 at the entrance of the seat and must grow from row to row.
    With `seat,bore,coefficient` it is that of the pair of tiles; a pair without a row ends the run. A column
    `uncertainty` may be added to either: the standard deviation of the coefficient.

    Raises:
        ProviderError: the file cannot be read or holds something else; the message has the file and the line.
    """

    file: str
    """Path of the file; in a scene it is looked for beside the scene, as mesh files are."""

    def __post_init__(self) -> None:
        self._read()  # a scene is refused when it is read, not when it runs

    def build(self, context: BuildContext) -> Along | ByPair:
        """The provider for tiles of this length."""
        rows = self._read()
        if "z_mm" in rows[0][1]:
            self._check_reach(rows, context)
            return Along(context.seat_origin, context.tile_size, *_columns(rows, "z_mm"))
        return ByPair(self.file, *_columns(rows, "seat", "bore"))

    def _check_reach(self, rows: list[Row], context: BuildContext) -> None:
        """Refuse places in another unit than mm, and warn of ones that leave most of the seat to the end values.

        Raises:
            ProviderError: the places reach over 0.003 of the seat (metres), or over 300 times it (micrometres).
        """
        low, high = rows[0][1]["z_mm"], rows[-1][1]["z_mm"]
        first, last = context.seat_origin, context.seat_origin + context.seat_tiles * context.tile_size
        if len(rows) < 2 or context.seat_tiles < 2:  # a plan tries a provider on a single tile
            return
        told = f"friction.options.file: {self.file}: z_mm reaches from {low:g} to {high:g}, the seat to {last:g} mm"
        if not 0.003 < (high - low) / (last - first) < 300.0:
            raise ProviderError(f"{told}; are they in {'m' if high - low < last - first else 'µm'}? write them in mm")
        if min(high, last) - max(low, first) < 0.5 * (last - first):
            warnings.warn(f"{told}; beyond, the values of the ends are kept", stacklevel=2)

    def _read(self) -> list[Row]:
        try:
            rows = list(_rows(read_regular(Path(self.file), MOST_BYTES).decode("utf-8-sig")))
            _check_places(rows)
        except _Wrong as wrong:
            raise ProviderError(f"friction.options.file: {self.file}{wrong}") from None
        except OutputError as error:
            raise ProviderError(f"friction.options.file: {error}") from None
        except (UnicodeDecodeError, csv.Error) as error:
            raise ProviderError(f"friction.options.file: {self.file} cannot be read: {error}") from None
        return rows


class Along:
    """mu(z) piecewise linear, at the middle of the seat tile: z = seat_origin + (k + 1/2) tile_size.

    Args:
        seat_origin: where seat tile 0 starts [mm].
        tile_size: length of a tile [mm].
        z: ascending coordinates [mm], shape (m,).
        coefficient: mu there [-], shape (m,).
        stated: its standard deviation [-], shape (m,), NaN where none is stated; linear between the rows too.
    """

    depends_on: ClassVar[frozenset[str]] = frozenset({"tiles"})

    def __init__(
        self, seat_origin: float, tile_size: float, z: FloatArray, coefficient: FloatArray, stated: FloatArray
    ) -> None:
        self.z, self.coefficient, self.stated = z, coefficient, stated
        self.seat_origin, self.tile_size = seat_origin, tile_size

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu of each pair [-], shape (n,)."""
        return np.interp(self._middle(pairs), self.z, self.coefficient)

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        """Standard deviation of mu of each pair [-], shape (n,)."""
        return np.interp(self._middle(pairs), self.z, self.stated)

    def _middle(self, pairs: TilePairs) -> FloatArray:
        return self.seat_origin + (pairs.seat + 0.5) * self.tile_size


class ByPair:
    """mu of listed pairs of tiles.

    Args:
        file: where they stand, for messages.
        seat: seat tile of each row, shape (m,).
        bore: bore tile of each row, shape (m,).
        coefficient: mu [-], shape (m,).
        stated: its standard deviation [-], shape (m,), NaN where none is stated.
    """

    depends_on: ClassVar[frozenset[str]] = frozenset({"tiles"})

    def __init__(
        self, file: str, seat: FloatArray, bore: FloatArray, coefficient: FloatArray, stated: FloatArray
    ) -> None:
        self.file, self.coefficient, self.stated = file, coefficient, stated
        listed = zip(seat.astype(np.int64).tolist(), bore.astype(np.int64).tolist(), strict=True)
        self.row = {pair: i for i, pair in enumerate(listed)}

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu of each pair [-], shape (n,).

        Raises:
            ProviderError: a pair that is not listed.
        """
        return self.coefficient[self._rows(pairs)]

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        """Standard deviation of mu of each pair [-], shape (n,).

        Raises:
            ProviderError: a pair that is not listed.
        """
        return self.stated[self._rows(pairs)]

    def _rows(self, pairs: TilePairs) -> IntArray:
        asked = list(zip(pairs.seat.tolist(), pairs.bore.tolist(), strict=True))
        for seat, bore in asked:
            if (seat, bore) not in self.row:
                raise ProviderError(
                    f"friction provider 'table': {self.file} has no row for seat tile {seat} and bore tile {bore}"
                )
        return np.array([self.row[pair] for pair in asked], dtype=np.int64)


class _Wrong(Exception):
    """Where in the file, and what is wrong there."""


class _Columns(NamedTuple):
    place: tuple[str, ...]  # those that say where
    given: list[str]  # all, in the order of the file


def _rows(text: str) -> Iterator[Row]:
    """The rows of numbers, each seen to be complete and within bounds."""
    columns: _Columns | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if columns is None:
            columns = _header(number, cells)
        elif len(cells) != len(columns.given):
            raise _Wrong(f", line {number}: has {len(cells)} cells, not {len(columns.given)}: {line.strip()[:60]!r}")
        else:
            yield number, {name: _number(number, name, cell) for name, cell in zip(columns.given, cells, strict=True)}
    if columns is None:
        raise _Wrong(": is empty; its first line names the columns, z_mm,coefficient or seat,bore,coefficient")


def _header(number: int, cells: list[str]) -> _Columns:
    for place in (("z_mm",), ("seat", "bore")):
        for more in ((), ("uncertainty",)):
            if sorted(cells) == sorted([*place, "coefficient", *more]):
                return _Columns(place, cells)
    raise _Wrong(
        f", line {number}: the columns are {','.join(cells)[:60]!r}; "
        "take z_mm,coefficient or seat,bore,coefficient, and perhaps uncertainty"
    )


def _number(line: int, column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise _Wrong(f", line {line}: {column} is {cell[:40]!r}, not a number") from None
    if not math.isfinite(value):
        raise _Wrong(f", line {line}: {column} is {cell[:40]}, not a finite number")
    if column in VALUES and not 0.0 <= value < VALUES[column]:
        raise _Wrong(f", line {line}: {column} is {cell[:40]}; take 0 <= {column} < {VALUES[column]:g}")
    if column in ("seat", "bore") and not (value.is_integer() and 0 <= value < 2**31):
        raise _Wrong(f", line {line}: {column} is {cell[:40]}, not the number of a tile, 0, 1, 2, ...")
    return value


def _check_places(rows: list[Row]) -> None:
    """There are rows; z grows from one to the next; no pair comes twice."""
    if not rows:
        raise _Wrong(": has no rows below the names of the columns")
    before: dict[tuple[float, ...], int] = {}
    last = -math.inf
    for number, cells in rows:
        place = tuple(cells[name] for name in ("z_mm", "seat", "bore") if name in cells)
        told = f"z_mm = {place[0]:g}" if "z_mm" in cells else f"seat tile {place[0]:g} and bore tile {place[1]:g}"
        if place in before:
            raise _Wrong(f", line {number}: {told} already stands in line {before[place]}")
        if "z_mm" in cells and place[0] < last:
            raise _Wrong(f", line {number}: {told} follows {last:g}; sort the rows by z_mm")
        before[place], last = number, place[0]


def _columns(rows: list[Row], *place: str) -> list[FloatArray]:
    """The columns that say where, the coefficients and their standard deviations."""
    return [
        np.array([cells.get(name, math.nan) for _, cells in rows]) for name in (*place, "coefficient", "uncertainty")
    ]
