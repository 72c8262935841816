"""What tests found, and the bar each value is held to: `found` asserts nothing, it says whether the bar is kept.

    assert found("Hertz, contact radius", abs(error), 0.01)

`pytest --figures FILE.json` writes every value; tests/benchmarks/verification.py makes the tables of them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple


class Figure(NamedTuple):
    """One value and its bar."""

    what: str
    value: float
    bar: float
    at_least: bool  # the bar is a lower one
    test: str  # its node id


class Figures:
    """All of a session, in the order of the tests."""

    def __init__(self) -> None:
        self.all: list[Figure] = []

    def of(self, test: str) -> Found:
        """The fixture of one test."""
        return Found(self, test)

    def write(self, target: Path) -> None:
        """As a JSON list of objects."""
        target.write_text(json.dumps([figure._asdict() for figure in self.all], indent=1) + "\n")


class Found:
    """Records what a test found."""

    def __init__(self, figures: Figures, test: str) -> None:
        self._figures, self._test = figures, test

    def __call__(self, what: str, value: float, bar: float, *, at_least: bool = False) -> bool:
        """Record a value; whether it keeps its bar: at most ``bar``, or at least."""
        figure = Figure(what, float(value), float(bar), at_least, self._test)
        self._figures.all.append(figure)
        return figure.value >= figure.bar if at_least else figure.value <= figure.bar
