"""A measured pressing curve: read from a file as test rigs write it, its plausibility checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..base.arrays import FloatArray
from ..base.columns import find_start, headings_of, numbers_of
from ..base.textfile import TextTable, read_text_table
from ..base.units import AMBIGUOUS, FORCES, LENGTHS, Heading
from ..errors import OutputError, SceneError

MOST_BYTES = 100_000_000
"""Size of a curve; an hour at 1 kHz has about as much."""
FEWEST = 5
"""Points that a fit needs at least."""
FAR, NEAR = 50.0, 3.0
"""A measured curve this many times larger or smaller than the computed one is taken for one in other units: where a
unit is stated, and where it was only assumed."""
LARGEST = 1e15
"""No displacement [mm] and no force [N] is larger."""
JITTER = 0.005
"""How far a displacement may go back, relative to the whole way [-]: a transducer's noise, not a return."""
SPRING_BACK = 0.01
"""How far a wheel may spring back when the press lets go, relative to the whole way [-]: `wheelset` by 5e-4."""
AT_REST = 1e-3
"""How far it may move on meanwhile, a transducer's noise, relative to the whole way [-]."""
LET_GO = 0.9
"""Share of the last force below which a force at rest is that of a press that lets go [-]."""


@dataclass(frozen=True)
class Measured:
    """A measured curve; displacements ascend."""

    displacement: FloatArray  # (n,) [mm]
    force: FloatArray  # (n,) [N]
    taken: str = ""
    """What of the file was taken for what, in words; empty for a curve that was not read from a file."""
    assumed: tuple[str, ...] = field(default=())
    """Units that the file does not state: mm, N, or both."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What the user says of a file beyond what stands in it."""

    columns: tuple[str, str] | None = None
    """Numbers (from 1) or names of the columns of displacement and force; None: found out."""
    start: float | None = None
    """The record begins where it first reaches this displacement of the file [mm]."""
    end: float | None = None
    """It ends where it first reaches this one [mm]."""
    shift: float = 0.0
    """Is added to the displacements [mm]."""


@dataclass(frozen=True, kw_only=True)
class _Column:
    index: int
    heading: Heading | None
    unit: str
    factor: float
    assumed: bool

    def __str__(self) -> str:
        name = f'"{self.heading.name}"' if self.heading is not None and self.heading.name else "without a name"
        return f"column {self.index + 1} {name} [{self.unit}{', assumed' if self.assumed else ''}]"


def read_measured(path: Path, reading: Reading | None = None) -> Measured:
    """Displacement and force from a text file; a fitting_curve.csv of macrofit is one.

    Encoding, separator, decimal sign, what stands before the numbers, the row of names and that of units are found
    out. Columns are found by their units and names (LENGTHS and FORCES of `units`); two columns without any are
    displacement [mm] and force [N]. Comments start with #. A record sampled in time may rest, and go back by a share
    `JITTER` of its way: the points of a place are averaged.

    Raises:
        OutputError: unreadable, not a number, not finite, a unit that is not known, columns that cannot be told
            apart, or displacements that go back; the message has the line.
    """
    reading = reading or Reading()
    table = read_text_table(path, MOST_BYTES)
    preamble, first = find_start(table, "displacement [mm] and force [N]")
    headings = headings_of(preamble, len(first), {"length", "force"})
    places, forces = _choose(table, headings, first, reading.columns)
    lines, values = numbers_of(table, len(preamble), len(first), (places.index, forces.index))
    along, force = values.T * np.array([[places.factor], [forces.factor]])
    if max(np.abs(along).max(), np.abs(force).max()) > LARGEST:
        raise OutputError(f"{path}: holds numbers beyond {LARGEST:g} mm or N")
    _check_swapped(path, along, force, reading.columns)
    lines, along, force = _cut(lines, along, force, reading, path)
    pressed = len(along) if reading.end is not None else until_let_go(along, force)
    left_out, lines, along, force = len(along) - pressed, lines[:pressed], along[:pressed], force[:pressed]
    rows, low, high = len(along), float(along.min()), float(along.max())
    along, force = ascending(along, force, path, lines)
    said = (
        f"{path}: displacement {places}, force {forces}, {rows} rows from {low:.6g} to {high:.6g} mm, up to "
        f"{np.abs(force).max() / 1e3:.5g} kN ({table.style.in_words()}, {table.encoding})"
    )
    said += f", shifted by {reading.shift:g} mm" if reading.shift else ""
    said += f", averaged to {len(along)} points" if len(along) < rows else ""
    if left_out:
        behind = "row" if left_out == 1 else f"{left_out} rows"
        said += f"; left out: the last {behind}, in which the press lets go"
    assumed = tuple(column.unit for column in (places, forces) if column.assumed)
    return Measured(along + reading.shift, force, said, assumed)


def until_let_go(along: FloatArray, force: FloatArray) -> int:
    """How many points of a record are of the pressing: behind them the press lets go where it stands.

    Its force falls then at rest, or while the wheel springs back a little; averaged with the end of the pressing it
    would pass for a force of half as much. A return by more than `SPRING_BACK` of the way is left in, and refused.
    """
    way = float(np.ptp(along))
    reached = int(np.argmax(along >= along.max() - JITTER * way))
    last = reached + int(np.argmax(force[reached:]))
    moved, left = along[last + 1 :] - along[last], force[last + 1 :]
    rests = len(left) and -SPRING_BACK * way <= float(moved.min()) and float(moved.max()) <= AT_REST * way
    return last + 1 if rests and float(left.min()) < LET_GO * float(force[last]) else len(along)


def ascending(along: FloatArray, force: FloatArray, path: Path, lines: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Displacements made ascending by averaging the points of places where they rest or go back a little.

    Neighbours that do not ascend are pooled, as in isotonic regression (Barlow et al. 1972).

    Raises:
        OutputError: they go back by more than noise.
    """
    highest = np.maximum.accumulate(along)
    back = highest - along
    worst = int(np.argmax(back))
    if back[worst] > JITTER * max(float(np.ptp(along)), 1e-300):
        least = float(along[-1]) < float(along[0])
        remedy = (
            "they descend: turn their sign" if least else f"end the record before it with --to {highest[worst]:.6g}"
        )
        raise OutputError(
            f"{path}: line {lines[worst]}: displacement {along[worst]:.6g} after {highest[worst]:.6g} mm; they must "
            f"ascend, for a curve of insertion alone: {remedy}"
        )
    if (np.diff(along) > 0.0).all():
        return along, force
    pools: list[tuple[float, float, int]] = []  # sums of both, and how many
    for x, f in zip(along.tolist(), force.tolist(), strict=True):
        pools.append((x, f, 1))
        while len(pools) > 1 and pools[-2][0] * pools[-1][2] >= pools[-1][0] * pools[-2][2]:
            last, before = pools.pop(), pools.pop()
            pools.append((before[0] + last[0], before[1] + last[1], before[2] + last[2]))
    sums = np.array(pools)
    return sums[:, 0] / sums[:, 2], sums[:, 1] / sums[:, 2]


def comparable(measured: Measured, computed: FloatArray) -> FloatArray:
    """Which of the points, (n,) of bool, lie within the computed displacements [mm], ascending.

    Raises:
        OutputError: too few do.
    """
    inside = (measured.displacement >= computed[0] - 1e-9) & (measured.displacement <= computed[-1] + 1e-9)
    if inside.sum() < FEWEST:
        low, high = measured.displacement[[0, -1]] if len(measured.displacement) else (np.nan, np.nan)
        hint = "; is the column in m? write displacement_m in its header" if 0.0 < high <= computed[-1] / 500.0 else ""
        hint = hint or "; --shift moves them"
        raise OutputError(
            f"the measured displacements, {low:g} to {high:g} mm, and those of the scene, {computed[0]:g} to "
            f"{computed[-1]:g} mm, have {inside.sum()} points in common and {FEWEST} are needed{hint}"
        )
    return np.asarray(inside)


def check_scale(measured: FloatArray, computed: FloatArray, assumed: Sequence[str] = ()) -> None:
    """Refuse measured forces [N] that are far from the computed ones at the same places: other units, or another sign.

    Args:
        measured: forces [N].
        computed: forces of the first trial [N].
        assumed: units that the file does not state; forces that may not be in N are held to a narrower range.

    Raises:
        OutputError: they are far, or the scene needs no force.
    """
    top, reached = float(np.abs(measured).max()), float(np.abs(computed).max())
    if reached == 0.0:
        hint = ": are its displacements in mm? name their unit in the header" if "mm" in assumed else ""
        raise OutputError(f"the scene needs no force where the curve was measured; nothing can be found from it{hint}")
    bound = NEAR if "N" in assumed else FAR
    if top > 0.0 and 1.0 / bound < top / reached < bound:
        if float(measured @ computed) <= 0.0:
            raise OutputError("the measured forces have the other sign than the computed ones; pushing on is positive")
        return
    near = [unit for unit, factor in FORCES.items() if 0.4 < factor * top / reached < 2.5 and unit != "N"]
    guess = f"; is the column in {' or '.join(near)}? write force_{near[0]} in its header" if near else ""
    if "N" in assumed:
        guess = (guess or "; does the scene have the right interference?") + " (write force_N there if it is in N)"
    raise OutputError(f"the measured forces reach {top:g} N, the computed ones {reached:.3g} N{guess}")


def _choose(
    table: TextTable, headings: list[Heading] | None, first: list[str], asked: tuple[str, str] | None
) -> tuple[_Column, _Column]:
    """The columns of displacement and force.

    Raises:
        OutputError: they cannot be told from the others.
    """
    width = len(first)
    commas = table.style.separator == "," and not any("." in line or '"' in line for _, line in table.lines[-3:])
    if headings is None and commas and width > 2:
        raise OutputError(
            f"{table.path}: commas may be decimal signs and separators at once; write decimal points, another "
            f"separator, or a header with the names of all {width} columns"
        )
    found = (
        _by_kind(table, headings, first) if asked is None else [_asked(table.path, n, headings, width) for n in asked]
    )
    chosen = (found[0], found[1])
    return (
        _column(table.path, chosen, 0, headings, LENGTHS, "mm"),
        _column(table.path, chosen, 1, headings, FORCES, "N"),
    )


def _asked(path: Path, name: str, headings: list[Heading] | None, width: int) -> int:
    """Index of a column that the user names."""
    names = [] if headings is None else [heading.name for heading in headings]
    same = [i for i, each in enumerate(names) if name in (each, each.split(" [")[0])]
    if len(same) == 1:
        return same[0]
    if name.isascii() and name.isdigit() and 1 <= int(name) <= width:
        return int(name) - 1
    raise OutputError(f"{path}: --columns: no column {name!r}; take numbers from 1 to {width}, or names: {names}")


def _by_kind(table: TextTable, headings: list[Heading] | None, first: list[str]) -> list[int]:
    """The columns of displacement and force, by units and names; of two that say nothing, in this order."""
    numeric = [i for i, cell in enumerate(first) if table.style.number(cell) is not None]
    kinds = {i: None if headings is None else headings[i].kind for i in numeric}
    chosen: list[list[int]] = [[i for i in numeric if kinds[i] == kind] for kind in ("length", "force")]
    if headings is not None:
        chosen = [_with_units(columns, headings) for columns in chosen]
    silent = [i for i in numeric if kinds[i] is None]
    if len(numeric) == 2 and len(silent) == 2:
        return numeric
    if len(numeric) == 2 and len(silent) == 1:  # one says what it is, so that the other is known too
        chosen = [columns or silent for columns in chosen]
    if len(chosen[0]) == 1 and len(chosen[1]) == 1 and chosen[0] != chosen[1]:
        return [chosen[0][0], chosen[1][0]]
    if chosen[0][:1] == [0] and chosen[1][:1] == [1] and headings is not None and _ours(headings):
        return [0, 1]
    names = "" if headings is None else f": {', '.join(heading.name or '-' for heading in headings)}"
    raise OutputError(
        f"{table.path}: has {len(first)} columns{names[:200]}; which is the displacement, and which the force? Write "
        f"--columns with their numbers or names, for example --columns 2,3, or units in the header, [mm] and [kN]"
    )


def _with_units(columns: list[int], headings: list[Heading]) -> list[int]:
    """Those that name a unit, where some do."""
    return [i for i in columns if headings[i].unit is not None] or columns


def _ours(headings: list[Heading]) -> bool:
    """Whether these are the columns of a fitting_curve.csv."""
    return [heading.name for heading in headings[:3]] == ["displacement_mm", "force_N", "normal_force_N"]


def _column(
    path: Path,
    chosen: tuple[int, int],
    which: int,
    headings: list[Heading] | None,
    known: dict[str, float],
    default: str,
) -> _Column:
    """One of the two columns with its unit.

    Raises:
        OutputError: the unit is not known, or not of this kind.
    """
    if headings is None:
        return _Column(index=chosen[which], heading=None, unit=default, factor=1.0, assumed=True)
    heading, other = headings[chosen[which]], headings[chosen[1 - which]]
    strange, unit = heading.strange, heading.unit
    if strange is None and unit is None and other.unit is not None:  # where one names its unit, so may the other
        strange = heading.last
    if strange is None and unit is not None and unit not in known:
        strange = unit
    if strange is not None:
        meant = AMBIGUOUS.get(strange.lower())
        remedy = f": write {meant}" if meant else f"; take one of {', '.join(known)}"
        raise OutputError(f"{path}: unit '{strange}' in its header is not known{remedy}")
    factor = known[unit or default]
    return _Column(index=chosen[which], heading=heading, unit=unit or default, factor=factor, assumed=unit is None)


def _check_swapped(path: Path, along: FloatArray, force: FloatArray, asked: tuple[str, str] | None) -> None:
    """Refuse two columns in the wrong order: what was taken for the force ascends, the displacement does not."""
    steps, other = np.diff(along), np.diff(force)
    if asked is None and len(steps) > 1 and (other > 0.0).all() and not (steps >= 0.0).all():
        raise OutputError(
            f"{path}: the column taken for the displacement does not ascend, and that of the force does: are they "
            f"swapped? Write --columns 2,1, or 1,2 if they are not"
        )


def _cut(
    lines: list[int], along: FloatArray, force: FloatArray, reading: Reading, path: Path
) -> tuple[list[int], FloatArray, FloatArray]:
    """The record from where it first reaches `start` to where it first reaches `end`.

    Raises:
        OutputError: nothing is left.
    """
    first, last = 0, len(along)
    if reading.start is not None:
        reached = np.flatnonzero(along >= reading.start)
        first = int(reached[0]) if len(reached) else last
    if reading.end is not None:
        passed = np.flatnonzero(along[first:] >= reading.end)
        last = first + int(passed[0]) + int(along[first + passed[0]] == reading.end) if len(passed) else last
    if last - first < 1:
        low, high = float(along.min()), float(along.max())
        raise OutputError(f"{path}: nothing lies between --from and --to; the displacements are {low:g} to {high:g} mm")
    return lines[first:last], along[first:last], force[first:last]


def interval(text: str | None) -> tuple[float, float] | None:
    """LOW,HIGH as numbers. Raises SceneError."""
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        raise SceneError(f"--bounds '{text}': write low,high, for example 0.01,0.1") from None
    return low, high


def two_columns(text: str | None) -> tuple[str, str] | None:
    """D,F as two names or numbers. Raises SceneError."""
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2 or not all(parts) or parts[0] == parts[1]:
        raise SceneError(f"--columns '{text}': write the numbers or names of two columns, for example 2,3")
    return parts[0], parts[1]
