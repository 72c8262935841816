"""Units in the header of a measured table: found by their kind, and named where they are not known."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

Kind = Literal["length", "force", "time"]

GRAVITY = 9.80665
"""Standard acceleration of free fall, which makes kgf and tf forces [m/s2]."""
LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "in": 25.4, "µm": 1e-3}
"""Units of length [mm]."""
FORCES = {
    "N": 1.0, "daN": 10.0, "kN": 1e3, "MN": 1e6,
    "kgf": GRAVITY, "tf": 1e3 * GRAVITY, "lbf": 4.4482216152605, "kip": 4448.2216152605,
}  # fmt: skip
"""Units of force [N]; tf is the force of a metric tonne."""
TIMES = ("s", "ms", "min", "h", "sec")
SPELLED = {
    "millimetre": "mm", "millimeter": "mm", "centimetre": "cm", "centimeter": "cm", "metre": "m", "meter": "m",
    "inch": "in", "inches": "in", "zoll": "in", "um": "µm", "μm": "µm", "micron": "µm",
    "newton": "N", "dekanewton": "daN", "decanewton": "daN", "kilonewton": "kN", "meganewton": "MN",
    "kp": "kgf", "kg": "kgf", "kilopond": "kgf", "kilogram-force": "kgf", "kgs": "kgf",
    "t": "tf", "tonne": "tf", "tonne-force": "tf", "tonnes-force": "tf", "tons-force-metric": "tf",
    "lb": "lbf", "lbs": "lbf", "pound": "lbf", "pound-force": "lbf", "pounds-force": "lbf", "klbf": "kip",
    "seconds": "s", "second": "s", "sekunden": "s", "minutes": "min",
}  # fmt: skip
"""Other ways to write them, in small letters; a plural s may follow."""
AMBIGUOUS = {
    "ton": "tf (1000 kg) or kip (its half, for the short ton)",
    "tonf": "tf (1000 kg) or kip (its half, for the short ton)",
    "mn": "MN or N",
}
"""What is written for more than one unit, and what to write."""
OTHERS = (
    "dm", "km", "nm", "yd", "ft", "feet", "foot", "thou", "mil", "mils", "fuss", "pa", "kpa", "mpa", "gpa", "bar",
    "psi", "ksi", "ozf", "dyn", "dyne", "gf", "g", "mg", "kj", "j", "knm", "v", "mv", "ma", "%", "deg", "rad", "hz",
    "rpm", "°c", "k", "mm/s", "mm/min", "m/s", "kn/mm", "n/mm", "n/mm2", "n/mm²", "grad",
)  # fmt: skip
"""Units of other kinds, or ones that are not read, in small letters."""
WORDS: dict[Kind, str] = {
    "time": r"time|zeit|temps|tiempo|tempo|uhrzeit|timestamp|datum|date|index|nr|no|sample|point|punkt|seconds|t",
    "length": r"displacement|displ?|travel|stroke|path|position|weg|hub|weg|einpressweg|verschiebung|distance|"
    r"d[ée]placement|course|spostamento|corsa|desplazamiento|length|x|s|u",
    "force": r"force|load|kraft|einpresskraft|last|effort|charge|forza|fuerza|carga|f|p",
}
"""Names of columns by their kind, whole words in small letters."""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """What the head of a column says."""

    name: str
    unit: str | None = None
    """As in `LENGTHS`, `FORCES` or `TIMES`; None where none is named."""
    kind: Kind | None = None
    """By the unit, or else by the name."""
    strange: str | None = None
    """A unit that is not known, or may be more than one."""
    last: str | None = None
    """A last word that may be such a unit, or a part of the name."""


def read_heading(name: str, unit: str | None = None) -> Heading:
    """Find the unit of a column in its name, ``force [kN]``, or in the cell below it.

    A last word that contradicts the others, the symbol in ``travel s``, belongs to the name.
    """
    found = None if unit is not None else _BRACKETED.search(name) or _LAST_WORD.search(name)
    written = unit if unit is not None else found.group(1) if found is not None else ""
    written = written.strip("\"'[]() ")
    said = kind_by_name(name if found is None else name[: found.start()])
    certain = unit is not None or (found is not None and found.re is _BRACKETED)
    known = known_unit(written)
    if known is not None and said in (None, kind_of(known)):
        return Heading(name=name, unit=known, kind=kind_of(known))
    strange = (certain and written not in ("", "-")) or (known is None and written.lower() in (*OTHERS, *AMBIGUOUS))
    last = written if found is not None and known is None and kind_by_name(written) is None else None
    return Heading(name=name, kind=said or kind_by_name(name), strange=written if strange else None, last=last)


_BRACKETED = re.compile(r"[\[(]\s*([^\[\]()]+?)\s*[\])]\s*$")
_LAST_WORD = re.compile(r"[\s_/,:]\s*([^\s_,:\[\]()]+)\s*$")


def known_unit(written: str) -> str | None:
    """The unit that is written so, by its own letters or else by its small ones; None where it is not known."""
    if written in (*LENGTHS, *FORCES, *TIMES):
        return written
    if written in ("mN", "Mm", "T", "S", "H"):
        return None  # millinewton, megametre, tesla, siemens, henry
    small = written.lower()
    for each in (small, small.removesuffix("s")):
        if each in SPELLED:
            return SPELLED[each]
    alike = [unit for unit in (*LENGTHS, *FORCES) if unit.lower() in (small, small.removesuffix("s"))]
    return alike[0] if len(alike) == 1 and small != "mn" else None


def is_other_unit(written: str) -> bool:
    """Whether a cell in a row of units is none of those above: one of another kind, a quotient, or nothing."""
    plain = written.strip("[]()- ").lower()
    return not plain or plain in OTHERS or re.fullmatch(r"[a-zµ°%1]+/[a-z]+[²2³3]?", plain) is not None


def kind_of(unit: str) -> Kind:
    """Whether a known unit is one of length, of force or of time."""
    return "length" if unit in LENGTHS else "force" if unit in FORCES else "time"


def kind_by_name(name: str) -> Kind | None:
    """What the words of a name say; None where they say nothing, or two things."""
    words = re.split(r"[^\w%°]+|_", name.lower())
    kinds: list[Kind] = [kind for kind, known in WORDS.items() if any(re.fullmatch(known, word) for word in words)]
    return kinds[0] if len(kinds) == 1 else None
