"""Columns of a stranger's table of numbers: where the numbers start, what the head says of them, and all their rows."""

from __future__ import annotations

import numpy as np

from .arrays import FloatArray
from .errors import OutputError
from .textfile import TextTable
from .units import Heading, Kind, is_other_unit, kind_of, known_unit, read_heading


def find_start(table: TextTable, wanted: str) -> tuple[list[list[str]], list[str]]:
    """The cells of each line before the first row of numbers, and those of that row.

    Args:
        table: the text.
        wanted: what its two columns are to hold, for the message.

    Raises:
        OutputError: no line has two numbers, or the line before them may be a damaged row.
    """
    preamble: list[list[str]] = []
    number, line, numeric = 0, "", False
    for place, text, cells in table.rows():
        if text.startswith("#"):
            preamble.append(table.style.cells(text.lstrip("# ")))
            numeric = numeric and table.style.number(table.style.cells(line)[0]) is not None
            continue
        numbers = sum(table.style.number(cell) is not None for cell in cells)
        if numbers >= 2 and not numeric:
            return preamble, cells
        if numbers >= 2:
            raise OutputError(
                f"{table.path}: line {number}: '{line[:60]}' is not two finite numbers; if it is no row of the curve, "
                f"write # before it"
            )
        number, line, numeric = place, text, numbers == 1
        preamble.append(cells)
    first, text = next((place, text) for place, text in table.lines if not text.startswith("#"))
    raise OutputError(
        f"{table.path}: line {first}: '{text[:60]}' has no two columns of numbers, {wanted}, and neither "
        f"has any line below it"
    )


def headings_of(preamble: list[list[str]], width: int, wanted: set[Kind]) -> list[Heading] | None:
    """What the last rows before the numbers, those of names and of units, say of the columns; None for nothing.

    A row of units has those of all ``wanted`` kinds and nothing but units, or each in brackets.
    """
    rows = [cells for cells in preamble if any(cells)]
    if not rows:
        return None
    last = rows[-1] + [""] * (width - len(rows[-1]))  # empty cells at the end of a line are left out
    known = [known_unit(cell.strip("[]() ")) for cell in last]
    kinds = {kind_of(unit) for unit in known if unit is not None}
    named = wanted <= kinds and all(unit or is_other_unit(cell) for unit, cell in zip(known, last, strict=True))
    if len(last) != width or not (named or len(rows[-1]) == width):
        return None
    if not named and not all(cell in ("", "-") or (cell[0] in "[(" and cell[-1] in "])") for cell in last):
        return [read_heading(name) for name in last]
    names = rows[-2][:width] if len(rows) > 1 and len(rows[-2]) >= width else [""] * width
    return [read_heading(name, unit) for name, unit in zip(names, last, strict=True)]


def numbers_of(table: TextTable, skip: int, width: int, chosen: tuple[int, int]) -> tuple[list[int], FloatArray]:
    """Line numbers and values (n, 2) of the chosen columns, all that follow the first row of numbers.

    Raises:
        OutputError: a line that is no row of numbers.
    """
    numbers: list[int] = []
    rows: list[tuple[float, float]] = []
    for number, line, cells in list(table.rows())[skip:]:
        if line.startswith("#"):
            continue
        pair = [table.style.number(cells[i]) if i < len(cells) else None for i in chosen]
        if pair[0] is None or pair[1] is None or not np.isfinite(pair[0] + pair[1]):
            raise OutputError(f"{table.path}: line {number}: '{line[:60]}' is not two finite numbers")
        if len(cells) > width:
            raise OutputError(f"{table.path}: line {number}: has {len(cells)} cells, those before it {width}")
        numbers.append(number)
        rows.append((pair[0], pair[1]))
    return numbers, np.array(rows).reshape(-1, 2)
