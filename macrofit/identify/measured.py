"""A measured pressing curve: read from a file of two columns, its units found or assumed, its plausibility checked."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.arrays import FloatArray
from ..errors import OutputError

LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1e3}
FORCES = {"N": 1.0, "kN": 1e3, "MN": 1e6}
UNIT = re.compile(r"(?:[_\[(/\s])\s*(mm|cm|m|N|kN|MN)\s*[\])]?\s*$")
OTHER_UNIT = re.compile(
    r"[\[(]\s*([^\])]+?)\s*[\])]\s*$|_(lbf|kip|daN|kgf|kg|tf?|in|inch|ft|[uµ]m|bar|MPa)$", re.IGNORECASE
)
FEWEST = 5
"""Points that a fit needs at least."""
FAR = 50.0
"""A measured curve this many times larger or smaller than the computed one is taken for one in other units."""


@dataclass(frozen=True)
class Measured:
    """A measured curve; displacements ascend."""

    displacement: FloatArray  # (n,) [mm]
    force: FloatArray  # (n,) [N]


def read_measured(path: Path) -> Measured:
    """Displacement and force, the first two columns of a file; a fitting_curve.csv of macrofit is one.

    Columns are separated by commas, semicolons, tabs or blanks; with semicolons, tabs or blanks a decimal comma is
    understood. A first line that is no numbers is the header; units at the end of its names (displacement_mm,
    "force [kN]") are used, mm and N where there are none. Lines that start with # are left out.

    Raises:
        OutputError: unreadable, not two columns, not a number, not finite, or displacements that do not ascend; the
            message has the line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise OutputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("#")]
    if not lines:
        raise OutputError(f"{path}: is empty")
    separator = next((sign for sign in (";", "\t", ",") if sign in lines[0][1]), None)
    scales = (1.0, 1.0)
    if _number(_cells(lines[0][1], separator)[0], separator) is None:
        scales = _units(_cells(lines[0][1], separator), path)
        lines = lines[1:]
    rows: list[tuple[float, float]] = []
    for number, line in lines:
        cells = _cells(line, separator)
        if len(cells) < 2:
            raise OutputError(f"{path}: line {number}: has no two columns, displacement [mm] and force [N]")
        values = [_number(cell, separator) for cell in cells[:2]]
        if values[0] is None or values[1] is None or not np.isfinite(values[0] + values[1]):
            raise OutputError(f"{path}: line {number}: '{line[:60]}' is not two finite numbers")
        if rows and values[0] <= rows[-1][0]:
            raise OutputError(
                f"{path}: line {number}: displacement {values[0]:g} after {rows[-1][0]:g}; they must ascend, so keep "
                f"the insertion alone and average repeated places"
            )
        rows.append((values[0], values[1]))
    table = np.array(rows).reshape(-1, 2) * scales
    return Measured(table[:, 0], table[:, 1])


def comparable(measured: Measured, computed: FloatArray) -> FloatArray:
    """Which of the points, (n,) of bool, lie within the computed displacements [mm], ascending.

    Raises:
        OutputError: too few do.
    """
    inside = (measured.displacement >= computed[0] - 1e-9) & (measured.displacement <= computed[-1] + 1e-9)
    if inside.sum() < FEWEST:
        low, high = measured.displacement[[0, -1]] if len(measured.displacement) else (np.nan, np.nan)
        hint = "; is the column in m? write displacement_m in its header" if 0.0 < high <= computed[-1] / 500.0 else ""
        raise OutputError(
            f"the measured displacements, {low:g} to {high:g} mm, and those of the scene, {computed[0]:g} to "
            f"{computed[-1]:g} mm, have {inside.sum()} points in common and {FEWEST} are needed{hint}"
        )
    return np.asarray(inside)


def check_scale(measured: FloatArray, computed: FloatArray, displacement: FloatArray) -> None:
    """Refuse measured forces [N] that are far from the computed ones at the same places: other units, or another sign.

    Raises:
        OutputError: they are, or the scene needs no force.
    """
    top, reached = float(np.abs(measured).max()), float(np.abs(computed).max())
    if reached == 0.0:
        raise OutputError("the scene needs no force where the curve was measured; nothing can be found from it")
    if float(measured @ computed) <= 0.0:
        raise OutputError("the measured forces have the other sign than the computed ones; pushing on counts positive")
    if 1.0 / FAR < top / reached < FAR:
        return
    if float(np.ptp(displacement)) > 0.0 and abs(np.log10(reached / top) - 3.0) < 1.0:
        guess = "; is the column in kN? write force_kN in its header"
    else:
        guess = "; is the column in MN? write force_MN in its header" if top < reached else ""
    raise OutputError(f"the measured forces reach {top:g} N, the computed ones {reached:.3g} N{guess}")


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(separator)]


def _number(cell: str, separator: str | None) -> float | None:
    try:
        return float(cell if separator == "," else cell.replace(",", "."))
    except ValueError:
        return None


def _units(names: list[str], path: Path) -> tuple[float, float]:
    """What brings the two columns to mm and N.

    Raises:
        OutputError: a unit that is not known.
    """
    scales = []
    for name, known in zip(names[:2], (LENGTHS, FORCES), strict=False):
        found = UNIT.search(name)
        other = OTHER_UNIT.search(name)
        if found is None and other is not None:
            raise OutputError(
                f"{path}: unit '{other.group(1) or other.group(2)}' in its header is not known; take "
                f"{', '.join(LENGTHS)} and {', '.join(FORCES)}"
            )
        scales.append(known.get(found.group(1), 1.0) if found else 1.0)
    return (scales[0], scales[1]) if len(scales) == 2 else (1.0, 1.0)
