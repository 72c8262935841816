"""Texts of heights as strangers write them, from a random stream: heads in any order, decimal commas, names, places."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from macrofit.base.arrays import FloatArray

LENGTHS = {"mm": 1.0, "µm": 1e-3, "um": 1e-3, "nm": 1e-6, "m": 1e3}
SPACINGS = (
    "spacing = {x} {u}", "spacing: {x}{u}", "spacing = {x}, {y} {u}", "spacing = {x} x {y} {u}",
    "spacing = {x};{y} {u}",
    "spacing = {x} {u} x {y} {u}", "spacing = {x} {u}, {y} {u}", "spacing ({u}): {x}", "spacing [{u}] = {x}; {y}",
    "spacing in {u}: {x}", "dx = {x} {u}, dy = {y} {u}", "pixel size: {x} {u}", "Pixel size = {x} {u}/pixel",
    "Abstand = {x} {u}", "Point distance {x} {u}", "spacing_{u} = {x}", "x spacing = {x} {u}; y spacing = {y} {u}",
)  # fmt: skip
"""Ways to write the spacings x and y in the unit u; those without y are for equal ones."""
VAGUE = ("spacing = {x}", "lateral resolution = {x} {u}", "spacing = {x} px", "dx = {x} {u}", "spacing = -{x} {u}")
"""Ways that say no distance that one may rely on."""
HEIGHTS = ("heights [{u}]", "heights in {u}", "z ({u})", "Höhen [{u}]", "Value units: {u}", "Topography [{u}]", "z_{u}")
OTHERS = (
    "Operator: M. Miller", "Date: 2026-03-01", "Sq = 1.2 µm", "Length = 1.2 mm",
    "Objective 50x, working distance 10 mm",
    "vertical resolution: 0.1 nm", "step height = 3 µm", "Sample [A]", "Temperature 21 °C",
)  # fmt: skip
"""Lines of a head that say nothing of these two."""


@dataclass
class OddText:
    """A text of heights, and what is known of it."""

    name: str
    data: bytes
    clear: bool = True
    """Whether it can be told what it means; else it may be refused though nothing is wrong."""
    keys: dict[str, Any] = field(default_factory=dict)
    """What a careful user says of it by name."""
    traits: list[str] = field(default_factory=list)
    """What is odd about it."""


class _Pen:
    """How the numbers and lines of a text are written."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.comma = bool(rng.random() < 0.4)
        self.separator = str(rng.choice([";", "\t"] if self.comma else [",", ";", "\t", " "]))
        self.mark = str(rng.choice(["# ", "#", "% ", ""]))
        self.unit = str(rng.choice(list(LENGTHS)))

    def number(self, value: float) -> str:
        written = f"{value:.9g}"
        return written.replace(".", ",") if self.comma else written

    def rows(self, table: FloatArray) -> list[str]:
        return [self.separator.join("" if v != v and self.separator != " " else self.number(v) for v in row)
                for row in table.tolist()]  # fmt: skip


def odd_text(rng: np.random.Generator, heights: FloatArray, spacing: tuple[float, float]) -> OddText:
    """A text of these heights [mm] with points so far apart [mm], rows along the slide."""
    pen = _Pen(rng)
    found = _points(pen, heights, spacing) if rng.random() < 0.25 else _table(pen, heights, spacing)
    found.traits += ["decimal comma"] * pen.comma
    return found


def _table(pen: _Pen, heights: FloatArray, spacing: tuple[float, float]) -> OddText:
    """Rows of heights below a head, with the places around them or without."""
    rng, found = pen.rng, OddText("a.csv", b"")
    lines = [str(rng.choice(HEIGHTS)).format(u=pen.unit)]
    table = heights / LENGTHS[pen.unit]
    kind = rng.choice(["line", "places", "vague", "key", "nothing"], p=[0.5, 0.2, 0.1, 0.1, 0.1])
    if kind == "line":
        lines.append(_spacing_line(pen, spacing))
    elif kind == "places":
        across, along = (np.arange(n) * d for n, d in zip(heights.shape[::-1], spacing[::-1], strict=True))
        corner = float(rng.choice([0.0, np.nan])) if pen.separator != " " else 0.0
        table = np.block([[np.array([[corner]]), across[None, :]], [along[:, None], table]])
    elif kind == "vague":
        lines.append(str(rng.choice(VAGUE)).format(x=pen.number(spacing[0]), u="mm"))
        found.clear = False
    elif kind == "key":
        found.keys["spacing"] = spacing
    else:
        found.clear = False
    if rng.random() < 0.15:
        found.keys["unit"] = {"µm": "um"}.get(pen.unit, pen.unit)
        del lines[0]
    found.traits = [f"spacing by {kind}"]
    return _headed(pen, lines, pen.rows(table), found)


def _spacing_line(pen: _Pen, spacing: tuple[float, float]) -> str:
    """One of the ways to write the spacing, in a unit that need not be that of the heights."""
    unit = str(pen.rng.choice(list(LENGTHS)))
    x, y = (pen.number(each / LENGTHS[unit]) for each in spacing)
    same = [way for way in SPACINGS if "{y}" in way or spacing[0] == spacing[1]]
    return str(pen.rng.choice(same)).format(x=x, y=y, u=unit)


def _points(pen: _Pen, heights: FloatArray, spacing: tuple[float, float]) -> OddText:
    """A list of points with columns in any order, some of them twice."""
    rng, found = pen.rng, OddText(str(pen.rng.choice(["a.xyz", "a.txt"])), b"", traits=["points"])
    places = np.indices(heights.shape) * np.reshape(spacing, (2, 1, 1))
    columns = dict(zip("xyz", (*places, heights / LENGTHS[pen.unit]), strict=True))
    order = [str(name) for name in rng.permutation(list("xyz"))] if found.name == "a.xyz" else list("xyz")
    table = np.stack([columns[name].ravel() for name in order], axis=1)
    table = table[np.isfinite(table).all(axis=1)]
    if rng.random() < 0.3:
        again = table[rng.integers(0, len(table), 20)]
        again[:, order.index("z")] += 1e-4 / LENGTHS[pen.unit]
        table = np.concatenate([table, again])
    units = {"x": "mm", "y": "mm", "z": pen.unit}
    way = str(rng.choice(["{n} [{u}]", "{n}({u})", "{n}_{u}"]))
    names = (", " if pen.separator == " " else pen.separator).join(way.format(n=n, u=units[n]) for n in order)
    return _headed(pen, [names], pen.rows(table), found, last=True)


def _headed(pen: _Pen, lines: list[str], rows: list[str], found: OddText, last: bool = False) -> OddText:
    """The text with these lines in any order among others; the names of columns stand last."""
    others = [str(each) for each in pen.rng.choice(OTHERS, int(pen.rng.integers(0, 4)), replace=False)]
    head = [str(each) for each in pen.rng.permutation(others if last else [*lines, *others])] + (lines if last else [])
    text = "\n".join([*(pen.mark + line for line in head), *rows, ""])
    code = str(pen.rng.choice(["utf-8", "utf-8-sig", "cp1252", "utf-16"]))
    found.traits.append(code)
    found.data = text.encode(code)
    if "heights" in text and pen.rng.random() < 0.1:
        found.data = text.encode("utf-8").decode("latin-1").encode("utf-8")  # saved once too often
        found.traits[-1] = "broken encoding"
    return found
