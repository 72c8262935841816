"""The head of a table of heights: what its lines say of the unit of the heights, and of the spacing of the points.

These are two statements, each with a unit of its own, in any order and also on one line. A line that speaks of the
spacing and is not understood is kept in its own words: it is refused unless the spacing is given as a key, and never
dropped.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import NamedTuple

from macrofit.base.errors import shortened
from macrofit.base.units import LENGTHS, OTHERS, read_heading

from .raw import ScanError, length_unit, unmangled

_EXTENT = re.compile(r"rows along x = 0 \.\.\. ([\d.e+-]+) mm, \d+ columns along y = 0 \.\.\. ([\d.e+-]+) mm")
"""What `macrofit-meso surface` writes."""
_START, _END = r"(?<![^\W\d_])", r"(?![^\W\d_])"  # no letter before, none behind
_SPEAKS = re.compile(
    rf"spac|pixel|{_START}(?:d|delta[ _]?|Δ)[xy]{_END}|step|pitch|increment|sampling|interval|resol|cell[ _]?size|"
    r"(?:point|sample)s?[ _-]?distance|distance (?:of|between)|abstand|schrittweite|raster|auflösung|"
    rf"{_START}(?:pas|paso|passo){_END}|espac",
    re.IGNORECASE,
)
"""Words by which a line speaks of the spacing."""
_STATES = re.compile(rf"spac|pixel ?size|{_START}d[xy]{_END}|abstand", re.IGNORECASE)
"""Those of them that mean nothing else, so that a line without a number is not understood."""
_VAGUE = re.compile(r"resol|auflösung|rate|filter|lens|camera|mean|average", re.IGNORECASE)
"""Words that may mean something else: that of the optics, or of the time."""
_ROUGHNESS = re.compile(
    r"\bR?Sm\b|profile elements?|peaks?\b|groove|feed|sampling length|evaluation length|\bl[rn]\b|cut[ -]?off|"
    r"wave|lambda|\u03bb",
    re.IGNORECASE,
)
"""Words of measures of roughness: their lengths are no distances of points."""
_TURNED = re.compile(r"\bdepths?\b|\btiefen?\b|profondeur|invert|negativ|replica|\bcasts?\b|abdruck", re.IGNORECASE)
"""Words by which heights may be positive into the metal."""
_UPWARD = re.compile(
    rf"{_START}d?z{_END}[ _-]*\w*(?:spac|step|pitch|increment|resol|interval)|vertical|axial|{_START}dz{_END}|"
    r"step[ _-]?height",
    re.IGNORECASE,
)
_HEIGHTS = re.compile(
    rf"heights?|{_START}z{_END}|h[öo]hen?|hauteur|altezz|altur|depths?|tiefen?|values?|data|units?|einheit|unité|"
    r"topogra|amplitude|werte?",
    re.IGNORECASE,
)
"""Words by which a line speaks of the heights."""
_SIDEWAYS = re.compile(rf"{_START}(?:x|y|xy){_END}|lateral|width|length|breite|länge", re.IGNORECASE)
"""Words by which a line speaks of places, unless of heights too by the name of z."""
_UP = re.compile(rf"{_START}z{_END}", re.IGNORECASE)
_BRACKETS = re.compile(r"[\[(]([^\[\]()]*)[\])]")
_DIGITS = r"[+\-−]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"(?<![\w.,]){_DIGITS}")
_ITEM = re.compile(rf"\s*(?:({_DIGITS})|([^\W\d_]+|[?\ufffd]m)|([×*;,/&+\[\]()|\t]))")
_CLAUSES = re.compile(
    r"[,;|\t]\s*(?=[^\W\d_])(?!(?:[µμunm]?m|in|inch(?:es)?|micron?s?|mi[ck]romet(?:er|re)s?)\b)(?![^\[(]*[\])]\s*[:=\d])"
)
"""Where a line falls into parts: before a word that is no unit, not within brackets."""
_EACH = re.compile(
    r"\s*(?:/|\bper\b|\bpro\b|\bpar\b)\s*(?:px|pixels?|points?|pts?|samples?|steps?|punkte?)\b", re.IGNORECASE
)
BETWEEN = ("x", "by", "and", "und", "et", "y")
"""Words between two spacings."""
HINT = (
    "write '# spacing = 5 µm' or '# spacing = 5, 10 µm' (between rows, between columns), or give the key spacing [mm]"
)


_SIZE = re.compile(rf"\W*(width|height)\s*[:=]\s*({_DIGITS})\s*([^\W\d_]+)\W*", re.IGNORECASE)
"""Size of an image, as Gwyddion writes it."""


class Head(NamedTuple):
    """What the head of a table says."""

    unit: float | None
    """Unit of the heights [mm]."""
    spacing: tuple[float, float] | None
    """Distance of the rows and of the columns [mm]."""
    unclear: tuple[str, ...]
    """Lines that speak of the spacing and were not taken, each with the reason."""
    turned: tuple[str, ...] = ()
    """Lines by which the heights may be positive into the metal, as a doubt."""


class _Unclear(Exception):
    """Why a statement of the spacing is not understood."""


def speaks(name: str) -> bool:
    """Whether a name is that of a spacing."""
    return _SPEAKS.search(name) is not None


def read_head(lines: Iterable[tuple[int, str]], decimal: str, shape: tuple[int, ...]) -> Head:
    """What the lines of a head say together.

    Args:
        lines: their numbers and texts.
        decimal: decimal sign of the table's numbers.
        shape: rows and columns of the table.

    Raises:
        ScanError: two lines contradict each other, or the heights have a unit that is none of length.
    """
    lines = list(lines)
    units: dict[float, str] = {}
    spacings: dict[str, dict[float, str]] = {"x": {}, "y": {}}
    unclear: list[str] = []
    for number, written in lines:
        line = unmangled(written)
        where = f"line {number}: '{shortened(line.strip())}'"
        try:
            for axis, apart in _spacings(line, decimal, shape).items():
                spacings[axis].setdefault(apart, where)
        except _Unclear as error:
            unclear.append(f"{where} {error}")
        for unit in map(_unit, _parts(line)):
            if unit is not None:
                units.setdefault(unit, where)
    for what, said in (("the unit of the heights", units), *(("the spacing", each) for each in spacings.values())):
        _agree(what, said)
    x, y = ([*each] for each in spacings.values())
    turned = tuple(
        f"line {number}: '{shortened(line.strip())}': are its heights positive out of the metal? If not, take invert"
        for number, line in lines
        if _TURNED.search(line)
    )
    if not (x or y or unclear) and (found := _from_size(lines, decimal, shape)) is not None:
        return Head(next(iter(units), None), found, (), turned)
    if bool(x) != bool(y):
        unclear.append(f"{next(iter((spacings['x'] or spacings['y']).values()))} says it along one axis alone")
    return Head(next(iter(units), None), (x[0], y[0]) if x and y else None, tuple(unclear), turned)


def _agree(what: str, said: dict[float, str]) -> None:
    """Refuse statements that differ."""
    values = list(said)
    if any(not math.isclose(value, values[0], rel_tol=1e-3) for value in values):
        first, other = list(said.values())[:2]
        raise ScanError(f"its head says two things of {what}, {first} and {other}: take the wrong one out")


def _parts(line: str) -> list[str]:
    return _CLAUSES.split(re.sub(r"(?<=\S)\s+#.*", "", line).strip("#%!/ \t\"';,|"))


def _unit(clause: str) -> float | None:
    """Unit of the heights that a part of a line says [mm]; None where it says none.

    Raises:
        ScanError: it says one that is none of length.
    """
    clause = re.sub(r"[|\t]", ",", clause.partition(";")[0])
    heights, bracketed = _HEIGHTS.search(clause) is not None, _BRACKETS.search(clause) is not None
    numbered = _NUMBER.search(clause) is not None and not (heights and bracketed and not re.search("[=:]", clause))
    sideways = _SIDEWAYS.search(clause) is not None and _UP.search(clause) is None
    if numbered or sideways or (_SPEAKS.search(clause) and not _UPWARD.search(clause)):
        return None  # a unit behind a number is that of the number
    if re.fullmatch(r"\W*[^\W\d_]*[a-z]\W*", clause) and (alone := _length(clause)) is not None:
        return alone
    heading = read_heading(clause)
    if heading.unit in LENGTHS and (heights or bracketed):
        return LENGTHS[str(heading.unit)]
    strange = heading.strange or (heading.unit if bracketed and heading.unit not in (None, *LENGTHS) else None)
    if strange is not None and (heights or (bracketed and strange.lower() in OTHERS)):
        return length_unit(strange)
    return None


def _spacings(line: str, decimal: str, shape: tuple[int, ...]) -> dict[str, float]:
    """Distances that a line says [mm], by the axis; none where it does not speak of them.

    Raises:
        _Unclear: it speaks of them, and is not understood.
    """
    extent = _EXTENT.search(line)
    if extent is not None and min(shape) > 1:
        return {axis: float(extent.group(k + 1)) / (shape[k] - 1) for k, axis in enumerate("xy")}
    found: dict[str, float] = {}
    for clause in _parts(line):
        if _SPEAKS.search(clause) and not _UPWARD.search(clause) and not _ROUGHNESS.search(clause):
            found |= _stated(clause, decimal, shape)
    return found


def _stated(clause: str, decimal: str, shape: tuple[int, ...]) -> dict[str, float]:
    """Distances that a part of a line says [mm], by the axis.

    Raises:
        _Unclear: it is not understood.
    """
    first = _NUMBER.search(clause)
    if first is None:
        if _STATES.search(clause) and re.search(r"[\d=:]", clause):
            raise _Unclear("has no number that is understood")
        return {}
    before, after = clause[: first.start()], _EACH.sub("", clause[first.start() :])
    if not _SPEAKS.search(before):
        raise _Unclear("has its number before the word")
    given = _lengths(after, decimal, _unit_before(before))
    if all(unit is None for _, unit in given) and _counts([value for value, _ in given], before, shape):
        return {}
    if any(unit is None for _, unit in given):
        raise _Unclear("has no unit")
    if _VAGUE.search(before):
        raise _Unclear("may be another length than the distance of the points")
    apart = [value * (unit or 1.0) for value, unit in given]
    axis = _axis(before)
    if not all(0.0 < each < math.inf for each in apart) or len(apart) > (2 if axis is None else 1):
        raise _Unclear("is not one or two positive lengths")
    return {"x": apart[0], "y": apart[-1]} if axis is None else {axis: apart[0]}


def _from_size(lines: list[tuple[int, str]], decimal: str, shape: tuple[int, ...]) -> tuple[float, float] | None:
    """Spacings [mm] by the lines that say how wide and how high an image is; None where they are none of its points."""
    said = [_SIZE.fullmatch(unmangled(line)) for _, line in lines]
    sizes = {each.group(1).lower(): each.groups()[1:] for each in said if each is not None}
    if len(sizes) < 2:
        return None
    try:
        high, wide = (_number(number, decimal) * _known(unit) for number, unit in (sizes["height"], sizes["width"]))
    except _Unclear:
        return None
    apart = high / shape[0], wide / shape[1]
    return apart if 0.5 * apart[1] < apart[0] < 2.0 * apart[1] else None


def _axis(before: str) -> str | None:
    """The one axis that is named; None where none is, or both."""
    named = set(re.findall(rf"{_START}(?:d|delta[ _]?|Δ)?([xy]){_END}", before.lower()))
    named |= {
        axis for axis, word in (("x", r"\brows?\b|zeile"), ("y", r"\bcol|spalte")) if re.search(word, before.lower())
    }
    return named.pop() if len(named) == 1 else None


def _unit_before(before: str) -> float | None:
    """The unit that stands before the numbers [mm], in brackets or behind "in"."""
    found = [text for text in _BRACKETS.findall(before) if not re.fullmatch(r"\s*x\s*[,/;x]?\s*y\s*", text.lower())]
    found += re.findall(r"(?:\bin\s+|_|/)([^\W\d_]{1,12})\s*[:=;,\t]*\s*$", before)
    if len(found) > 1:
        raise _Unclear("has two units")
    return _known(found[0]) if found else None


def _length(written: str) -> float | None:
    try:
        return length_unit(written)
    except ScanError:
        return None


def _known(written: str) -> float:
    unit = _length(written)
    if unit is None:
        raise _Unclear(f"has '{shortened(written)}' for a unit of length")
    return unit


def _counts(values: list[float], before: str, shape: tuple[int, ...]) -> bool:
    """Whether bare numbers are those of the points, not their distances."""
    whole = all(value == int(value) for value in values)
    counted = re.search(r"number|count|anzahl|nombre|num|points per|\bn_?[xy]?\b", before, re.IGNORECASE) is not None
    return whole and (counted or all(value in (*shape, math.prod(shape)) for value in values))


def _lengths(text: str, decimal: str, before: float | None) -> list[tuple[float, float | None]]:
    """Numbers in the text behind the words, each with its unit [mm]: its own, the next one's, or the one before them.

    Raises:
        _Unclear: anything else is there too.
    """
    found: list[tuple[float, float | None]] = []
    place = 0
    while text[place:].strip():
        item = _ITEM.match(text, place)
        if item is None:
            raise _Unclear(f"goes on with '{shortened(text[place:].strip())}'")
        place = item.end()
        number, word, _ = item.groups()
        if number is not None:
            found.append((_number(number, decimal), None))
        elif word is not None and not (word.lower() in BETWEEN and len(found) == 1):
            if not found or found[-1][1] is not None:
                raise _Unclear(f"goes on with '{shortened(word)}'")
            found[-1] = found[-1][0], _known(word)
    own = [unit for _, unit in found if unit is not None]
    if own and before is not None and any(not math.isclose(unit, before) for unit in own):
        raise _Unclear("has two units")
    later = before
    for k, (value, unit) in reversed(list(enumerate(found))):
        later = unit if unit is not None else later
        found[k] = value, later
    return found


def _number(written: str, decimal: str) -> float:
    """A number whose decimal sign is the table's, or can be no other.

    Raises:
        _Unclear: a comma or a point that may part thousands, or two numbers.
    """
    written = written.replace("−", "-")
    mark = "," if "," in written else "."
    whole, _, part = written.partition(mark)
    digits = re.match(r"\d*", part)
    short = digits.group() if digits else ""
    zero = whole.strip("+-") == "0"
    thousands = len(short) == 3 and not zero and len(whole.strip("+-")) <= 3
    if part and mark != decimal and (thousands or (mark == "," and not zero and not short.startswith("0"))):
        raise _Unclear(f"has '{written}', whose '{mark}' is not the decimal sign of the table")
    return float(written.replace(",", "."))
