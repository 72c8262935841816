"""Damaged and odd files of strangers from a seed: curves, heights, tables of friction, TOML; and what readers make of
them. A file is either refused in one line of the project's errors, or read as what was written into it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from macrofit.base.errors import MacrofitError
from macrofit.base.toml import parse_toml, read_toml
from macrofit.friction import load
from macrofit.identify.measured import read_measured

SLOW = 5.0
"""No file of a few kilobytes takes longer [s]."""


@dataclass
class Counted:
    """What became of the files."""

    read: int = 0
    refused: int = 0
    wrong: list[str] = field(default_factory=list)


@dataclass
class Case:
    """A file, what reads it, and what says that the result is right."""

    data: bytes
    reader: Callable[[Path], Any]
    right: Callable[[Any], bool]
    suffix: str = ".csv"
    sound: bool = False
    """Whether nothing is wrong with it, so that a refusal is a mistake."""
    path: Path | None = None
    """Where it must stand, if not in a file of its kind's name."""


def run(kind: str, seeds: range, folder: Path, make: Callable[[np.random.Generator], Case] | None = None) -> Counted:
    """Read the files of these seeds; ``make`` makes those of a kind that is not in `KINDS`."""
    counted = Counted()
    for seed in seeds:
        case = (KINDS[kind] if make is None else make)(np.random.default_rng([seed, len(kind)]))
        path = folder / f"{kind}{case.suffix}" if case.path is None else case.path
        path.write_bytes(case.data)
        started = time.perf_counter()
        try:
            found = case.reader(path)
        except MacrofitError as error:
            counted.refused += 1
            if case.sound:
                counted.wrong.append(f"seed {seed}: nothing is wrong with it: {error}")
            if "\n" in str(error) or len(str(error)) > 1000:
                counted.wrong.append(f"seed {seed}: no line: {error}")
        except Exception as error:
            counted.wrong.append(f"seed {seed}: {type(error).__name__}: {error}")
        else:
            counted.read += 1
            if not case.right(found):
                counted.wrong.append(f"seed {seed}: read as {found!r:.300}")
        if time.perf_counter() - started > SLOW:
            counted.wrong.append(f"seed {seed}: took {time.perf_counter() - started:.0f} s")
    return counted


UNITS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "in": 25.4}
FORCES = {
    "N": 1.0,
    "daN": 10.0,
    "kN": 1e3,
    "MN": 1e6,
    "kgf": 9.80665,
    "tf": 9806.65,
    "lbf": 4.4482216152605,
    "kip": 4448.2216152605,
}
STRANGE = ("bar", "furlong", "ton", "mN", "psi")
HEADS = ("{name} [{unit}]", "{name} ({unit})", "{name} {unit}", "{name}_{unit}", "{name} in {unit}", "{name}, {unit}")


def odd_curve(rng: np.random.Generator) -> Case:
    """A pressing curve in one of the ways of test rigs, some of them damaged."""
    n = int(rng.integers(6, 40))
    x, f = np.sort(rng.uniform(0.0, 60.0, n)).round(3), np.sort(rng.uniform(1.0, 2e5, n)).round(1)
    x += np.arange(n) * 0.01  # no two alike
    length, force = rng.choice(list(UNITS)), rng.choice(list(FORCES))
    strange = rng.random() < 0.1
    shown = str(rng.choice(STRANGE)) if strange else force
    separator = str(rng.choice([";", "\t", ",", "  ", "|"]))
    decimal = "." if separator == "," and rng.random() < 0.8 else str(rng.choice([".", ","]))
    columns = [(x / UNITS[length], ("Weg", length)), (f / FORCES[force], ("Kraft", shown))]
    if rng.random() < 0.3:
        columns.reverse()
    if rng.random() < 0.3:
        columns.insert(0, (np.arange(n) / 8.0, ("Zeit", "s")))
    quoted = rng.random() < 0.2 or (separator == "," and decimal == "," and rng.random() < 0.5)
    lines = preamble(rng) + header(rng, separator, [about for _, about in columns])
    for row in zip(*(values for values, _ in columns), strict=True):
        cells = [f"{value:.9g}" if abs(value) >= 1e-4 else f"{value:.12f}" for value in row]
        cells = [cell.replace(".", decimal) for cell in cells]
        lines.append(separator.join(f'"{cell}"' if quoted else cell for cell in cells))
    data = encoded(rng, lines)
    damaged = rng.random() < 0.35
    data = damage(rng, data) if damaged else data

    def right(found: Any) -> bool:
        if damaged:  # a digit more or less cannot be seen; what is read must be a curve
            return bool((np.diff(found.displacement) > 0.0).all() and np.isfinite(found.force).all())
        return not strange and close(found.displacement, x) and close(found.force, f)

    told_apart = separator != "," or decimal != "," or quoted
    return Case(data, read_measured, right, sound=not damaged and not strange and told_apart)


def close(found: Any, true: Any) -> bool:
    """Equal but for the digits written."""
    return found.shape == true.shape and bool(np.allclose(found, true, rtol=1e-6, atol=1e-6))


def preamble(rng: np.random.Generator) -> list[str]:
    """Lines that say other things."""
    some = ["Prüfprotokoll Nr. 7", "# machine 3", "", "Prüfer: Müller", "Datum;24.12.2024", "sep=;", '"Einpressen, 2"']
    return [str(line) for line in rng.choice(some, int(rng.integers(0, 4)))]


def header(rng: np.random.Generator, separator: str, columns: list[tuple[str, str]]) -> list[str]:
    """A row of names with units, or one of each."""
    if rng.random() < 0.25:
        return [separator.join(name for name, _ in columns), separator.join(f"[{unit}]" for _, unit in columns)]
    form = str(rng.choice(HEADS[:2] if separator in "  ," else HEADS))
    names = [form.format(name=name, unit=unit) for name, unit in columns]
    names = [f'"{name}"' for name in names] if separator in "  ," else names
    return [("# " if rng.random() < 0.1 else "") + separator.join(names)]


def encoded(rng: np.random.Generator, lines: list[str]) -> bytes:
    """Bytes in one of the encodings, with one of the ends of line."""
    end = str(rng.choice(["\n", "\r\n", "\r"]))
    encoding = str(rng.choice(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]))
    return (end.join(lines) + end * int(rng.integers(0, 3))).encode(encoding)


def damage(rng: np.random.Generator, data: bytes) -> bytes:
    """Bits flipped, bytes lost, doubled, cut off or put in."""
    spoilt = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, max(1, len(spoilt))))
        match int(rng.integers(0, 6)):
            case 0:
                spoilt[at : at + 1] = bytes([int(rng.integers(0, 256))])
            case 1:
                del spoilt[at : at + int(rng.integers(1, 30))]
            case 2:
                spoilt[at:at] = spoilt[at : at + int(rng.integers(1, 200))]
            case 3:
                del spoilt[at:]
            case 4:
                spoilt[at:at] = bytes(rng.integers(0, 256, int(rng.integers(1, 20)), dtype=np.uint8))
            case _:
                spoilt[at:at] = str(rng.choice(["nan", "1e999", ",", ";", '"', "\n", "inf", "--", "9" * 5000])).encode()
    return bytes(spoilt)


def odd_heights(rng: np.random.Generator) -> Case:
    """Heights of a wheel's face as text or .npy, some of them damaged or of another type."""
    from surrogate.data.faces import read_face

    heights = rng.normal(0.0, 0.003, (33, 33)).round(6)
    damaged, binary = bool(rng.random() < 0.4), bool(rng.random() < 0.4)
    strange = False
    if binary:
        kind = rng.choice(["<f8", ">f8", "<f4", "<c16", "<U12", "<i2"])
        strange = kind in ("<c16", "<U12", "<i2")
        data = npy((heights * 1e6).astype(kind) if kind == "<i2" else heights.astype(kind), rng)
    else:
        separator, decimal = [(",", "."), (";", ","), (";", "."), ("\t", ","), (" ", ".")][int(rng.integers(0, 5))]
        unit = str(rng.choice(["mm", "µm", "m", "", "bar"]))
        strange = unit == "bar"
        factor = {"µm": 1e3, "m": 1e-3}.get(unit, 1.0)
        rows = [separator.join(f"{factor * v:.12g}".replace(".", decimal) for v in row) for row in heights.tolist()]
        data = encoded(rng, [f"# heights [{unit}]" if unit else "# heights", *rows])
    data = damage(rng, data) if damaged else data

    def right(found: Any) -> bool:
        if damaged or (binary and strange):
            return found.shape == (33, 33) and bool(np.isfinite(found).all())
        return not strange and close(found, heights)

    return Case(data, lambda path: read_face(path, "wheel"), right, ".npy" if binary else ".csv")


def npy(array: Any, rng: np.random.Generator) -> bytes:
    """A .npy file, now and then one whose head lies."""
    import io

    file = io.BytesIO()
    np.save(file, array)
    data = file.getvalue()
    if rng.random() < 0.2:
        data = data.replace(b"(33, 33)", str(rng.choice(["(99, 33)", "(3, 3) ", "(-1, 3)"])).encode())
    return data


def odd_table(rng: np.random.Generator) -> Case:
    """A table of friction along the seat, most of them damaged."""
    n = int(rng.integers(2, 20))
    z, mu = np.cumsum(rng.uniform(1.0, 9.0, n)).round(3), rng.uniform(0.01, 0.5, n).round(4)
    text = "z_mm,coefficient\n" + "".join(f"{a:.10g},{b:.10g}\n" for a, b in zip(z, mu, strict=True))
    damaged = bool(rng.random() < 0.7)
    data = damage(rng, text.encode()) if damaged else text.encode("utf-8-sig" if rng.random() < 0.5 else "utf-8")

    def right(found: Any) -> bool:
        rows = [cells for _, cells in found._read()]
        if damaged:
            return all(0.0 <= cells["coefficient"] < 2.0 for cells in rows)
        return close(np.array([[cells["z_mm"], cells["coefficient"]] for cells in rows]), np.column_stack([z, mu]))

    return Case(data, lambda path: load("table", {"file": str(path)}), right)


def odd_toml(rng: np.random.Generator) -> Case:
    """A scene's TOML, most of them damaged, some with far too much of something."""
    text = (
        'title = "Nabe"\r\n[axle]\nseat_radius = 50.0\nmaterial = { youngs_modulus = 206e3 }\n[motion]\ntravel = 55\n'
    )
    extra = ["", "a = " + "[" * 100_000, f"a = {'1' * 100_000}", "a." * 3000 + "b = 1", f"a = {'[' * 49}{']' * 49}"]
    choice = int(rng.integers(0, len(extra) * 4))
    text += extra[choice] if choice < len(extra) else ""
    damaged = bool(rng.random() < 0.5)
    data = text.encode("utf-8-sig" if rng.random() < 0.5 else "utf-8")
    data = damage(rng, data) if damaged else data
    return Case(data, read_toml, lambda found: damaged or found == parse_toml(text, "text"), ".toml")


KINDS: dict[str, Callable[[np.random.Generator], Case]] = {
    "curve": odd_curve,
    "heights": odd_heights,
    "table": odd_table,
    "toml": odd_toml,
}
"""Kinds of files."""
