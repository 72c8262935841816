"""What tests found, and the bar each value is held to: `found` asserts nothing, it says whether the bar is kept.

    assert found("Hertz, contact radius", abs(error), 0.01)

`pytest --figures FILE.json` writes every value; tests/benchmarks/verification.py makes the tables of them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

PROPERTY = "figure"


class Figure(NamedTuple):
    """One value and its bar."""

    what: str
    value: float
    bar: float
    at_least: bool  # the bar is a lower one
    test: str  # its node id


class Figures:
    """All of a session, in the order in which the tests ended."""

    def __init__(self) -> None:
        self.all: list[Figure] = []

    def take(self, properties: Sequence[tuple[str, object]]) -> None:
        """Keep the figures among the properties of a test."""
        self.all += [Figure(*value) for name, value in properties if name == PROPERTY and isinstance(value, Sequence)]

    def write(self, target: Path) -> None:
        """As a JSON list of objects."""
        target.write_text(json.dumps([figure._asdict() for figure in self.all], indent=1) + "\n")


class Found:
    """Records what a test found among its properties, which travel with its report."""

    def __init__(self, test: str, properties: list[tuple[str, object]]) -> None:
        self._test, self._properties = test, properties

    def __call__(self, what: str, value: float, bar: float, *, at_least: bool = False) -> bool:
        """Record a value; whether it keeps its bar: at most ``bar``, or at least."""
        figure = Figure(what, float(value), float(bar), at_least, self._test)
        self._properties.append((PROPERTY, tuple(figure)))
        return figure.value >= figure.bar if at_least else figure.value <= figure.bar
