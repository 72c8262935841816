"""Tables in text files of strangers: the encoding, the separator and the decimal sign are found out, then all is read.

Lines are split by the csv module. What cannot be told apart is refused, never guessed.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .errors import OutputError
from .files import read_regular

SEPARATORS = (";", "\t", ",", "|", " ")
"""Signs between cells, those that are nothing else first; a blank stands for any number of blanks."""
SIGNS = ((".", ""), (",", ""), (".", ","), (",", "."), (".", " '"), (",", " '"))
"""Decimal sign, and the signs that may stand between groups of three digits; those without groups first."""
SAMPLE = 400
"""Lines from which separator and decimal sign are found out."""
LONGEST_LINE = 1_000_000
"""A longer line is no line of a table [characters]."""
MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
"""Byte-order marks."""
NO_TEXT = (
    (b"PK\x03\x04", "a spreadsheet or an archive"), (b"\xd0\xcf\x11\xe0", "a spreadsheet"), (b"%PDF", "a PDF"),
    (b"\x89HDF", "an HDF5 file"), (b"\x93NUMPY", "an array of numpy"), (b"\x1f\x8b", "compressed"),
)  # fmt: skip
"""How files start that are no text."""


@dataclass(frozen=True)
class Style:
    """How the cells of a table are written."""

    separator: str
    decimal: str
    groups: str  # signs between groups of three digits

    def cells(self, line: str) -> list[str]:
        """The cells of a line without blanks and quotes around them; empty ones at its end are left out."""
        if self.separator == " ":
            line = " ".join(line.split())
        try:
            found = [cell.strip() for cell in next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))]
        except (csv.Error, StopIteration):
            return []
        while found and not found[-1]:
            found.pop()
        return found

    def width(self, line: str) -> int:
        """How many cells a line has, empty ones at its end too."""
        return len(self.cells(line)) if self.separator == " " else len(self.cells(line + "0"))

    def number(self, cell: str) -> float | None:
        """The number in a cell; None where it is none."""
        if not _pattern(self.decimal, self.groups).fullmatch(cell):
            return None
        for sign in (*self.groups, "\u00a0", "\u202f"):
            cell = cell.replace(sign, "")
        return float(cell.replace(self.decimal, ".").replace("D", "e").replace("d", "e").replace("\u2212", "-"))

    def in_words(self) -> str:
        """Name the separator and the decimal sign."""
        separator = {"\t": "tab", " ": "blank"}.get(self.separator, f"'{self.separator}'")
        return f"separator {separator}, decimal sign '{self.decimal}'"


@dataclass(frozen=True, kw_only=True)
class TextTable:
    """The lines of a table, none of them empty, and how their cells are written."""

    path: Path
    encoding: str
    style: Style
    lines: tuple[tuple[int, str], ...]  # number and text; comments keep their sign
    hollow: tuple[int, ...] = ()  # numbers of lines with separators alone, which are not among these

    def rows(self) -> Iterator[tuple[int, str, list[str]]]:
        """Number, text and cells of each line."""
        for number, line in self.lines:
            yield number, line, self.style.cells(line)


def read_text_table(path: Path, most_bytes: int) -> TextTable:
    """Read the lines of a text file, and find out how they are written.

    Raises:
        OutputError: it cannot be read, is no text, is empty, or commas are separators and decimal signs at once.
    """
    text, encoding = decode_text(read_regular(path, most_bytes), path)
    numbered = [(number, line.strip(" \f\v")) for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1)]
    lines = tuple((number, line) for number, line in numbered if line.strip(" \t\f\v;,|"))
    hollow = tuple(number for number, line in numbered if line and not line.strip(" \t\f\v;,|"))
    plain = [line for _, line in lines if not line.startswith("#")]
    if not plain:
        raise OutputError(f"{path}: is empty")
    if max(map(len, plain)) > LONGEST_LINE:
        raise OutputError(f"{path}: has a line of more than {LONGEST_LINE} characters; is it a table?")
    return TextTable(path=path, encoding=encoding, style=find_style(plain), lines=lines, hollow=hollow)


def decode_text(data: bytes, path: Path) -> tuple[str, str]:
    """Text in UTF-8 or UTF-16, with or without a byte-order mark, or else in Windows' cp1252; and which it was.

    Raises:
        OutputError: it is no text.
    """
    for start, what in NO_TEXT:
        if data.startswith(start):
            raise OutputError(f"{path}: is no text but {what}; save it as CSV")
    for encoding in _encodings(data):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not re.search(r"[\x00-\x08\x0e-\x1b\ufffe]", text):
            return text, encoding
    raise OutputError(f"{path}: cannot be read: is no text in UTF-8, UTF-16 or cp1252")


def find_style(lines: list[str]) -> Style:
    """The way of writing in which most lines are rows of numbers, two at least; the plainest of equal ones."""
    sample = [
        line[:LONGEST_LINE] for line in (lines[:SAMPLE] + lines[-SAMPLE // 4 :] if len(lines) > SAMPLE else lines)
    ]
    best, most = Style(",", ".", ""), (0, 0)
    for decimal, groups in SIGNS:
        for separator in SEPARATORS:
            if separator in (groups + decimal) and not (separator == "," and any('"' in line for line in sample)):
                continue
            style = Style(separator, decimal, groups)
            score = _score(style, sample)
            if separator == " " and 0 < score[0] <= most[0]:
                continue  # a blank parts what another sign parts too; sentences in the head do not decide
            if score > most:
                best, most = style, score
    return best


def _encodings(data: bytes) -> Iterator[str]:
    for mark, encoding in MARKS:
        if data.startswith(mark):
            yield encoding
            return
    start = data[:1000]
    if start[1::2].count(0) > len(start) // 4:
        yield "utf-16-le"
    elif start[::2].count(0) > len(start) // 4:
        yield "utf-16-be"
    yield from ("utf-8", "cp1252")


def _score(style: Style, lines: list[str]) -> tuple[int, int]:
    """How many lines are numbers alone, two at least, and how many have two numbers."""
    whole = some = 0
    for line in lines:
        cells = style.cells(line)
        numbers = sum(style.number(cell) is not None for cell in cells)
        some += numbers >= 2
        whole += numbers >= 2 and numbers == sum(bool(cell) for cell in cells)
    return whole, some


_patterns: dict[tuple[str, str], re.Pattern[str]] = {}


def _pattern(decimal: str, groups: str) -> re.Pattern[str]:
    """A number with this decimal sign, groups of three digits parted by one of the signs where there are any."""
    if (decimal, groups) not in _patterns:
        point = re.escape(decimal)
        between = f"[{re.escape(groups)}\u00a0\u202f]" if groups else "[\u00a0\u202f]"
        whole = rf"(\d{{1,3}}(?:{between}\d{{3}})+|\d+)"
        text = rf"[+\-\u2212]?({whole}({point}\d*)?|{point}\d+)([eEdD][+-]?\d{{1,4}})?"
        _patterns[decimal, groups] = re.compile(text, re.ASCII)
    return _patterns[decimal, groups]
