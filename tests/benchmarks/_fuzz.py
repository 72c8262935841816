"""Drawn cases, each judged in a process of its own: a row of each kind, and the wrong ones told by seed and number."""

from __future__ import annotations

import argparse
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from macrofit.errors import MacrofitError

from ._alone import ABORTED, UNFINISHED, alone
from ._measure import head, row

COMPUTED, DOUBTED, REFUSED = "computed", "computed, doubted", "refused in a line"
TRACEBACK, ABORT, SILENT = "tracebacks", "aborts", "wrong without a doubt"
MOST_BYTES = 3 * 10**9

Judged: TypeAlias = tuple[str, str]
"""What became of a case, and why."""


@dataclass(frozen=True, kw_only=True)
class DrawnCase:
    """A case that was drawn."""

    kind: str
    said: str  # for people
    judge: Callable[[], Judged]


@dataclass(frozen=True, kw_only=True)
class Fuzz:
    """How many cases are drawn, of which kinds, and how long one may take."""

    name: str  # of the benchmark
    about: str
    count: int
    quick: int
    column: str  # name of the kinds in the table
    kinds: Sequence[str]
    good: tuple[str, ...] = (COMPUTED, DOUBTED, REFUSED)
    most_cpu_s: int
    most_wall_s: float

    def options(self, words: Sequence[str]) -> argparse.Namespace:
        """What the words ask for."""
        parser = argparse.ArgumentParser(
            prog=f"python -m tests.benchmarks {self.name}", description=self.about.splitlines()[0]
        )
        parser.add_argument("-n", type=int, default=self.count, help="how many")
        parser.add_argument("--seed", type=int, default=1)
        parser.add_argument("--first", type=int, default=0, help="number of the first case")
        parser.add_argument("--told", action="store_true", help="say what became of each, on stderr")
        parser.add_argument("--quick", action="store_true", help=f"{self.quick} cases")
        return parser.parse_args(words)

    def run(self, options: argparse.Namespace, drawn: Callable[[int, int], DrawnCase]) -> int:
        """Judge the cases that ``drawn`` gives of a seed and a number, print their rows; 1 where any was wrong."""
        numbers = range(options.first, options.first + (self.quick if options.quick else options.n))
        counted: dict[str, Counter[str]] = {kind: Counter() for kind in self.kinds}
        wrong: list[str] = []
        for number in numbers:
            case = drawn(options.seed, number)
            said, why = self.bounded(case)
            counted[case.kind][said] += 1
            line = f"{said}: {number} of seed {options.seed}: {case.said}: {why}"
            wrong += [] if said in self.good else [line]
            if options.told or said not in self.good:
                print(line, file=sys.stderr, flush=True)
        words = (*self.good, TRACEBACK, ABORT, self._late, SILENT)
        print(head(self.column, "cases", *words))
        for kind, counts in [*counted.items(), ("all", sum(counted.values(), Counter()))]:
            print(row(kind, counts.total(), *(counts[said] for said in words)))
        print(f"\nSeed {options.seed}, numbers {numbers.start} to {numbers.stop - 1}.")
        print("".join(f"\n- {line.splitlines()[0]}" for line in wrong))
        return int(bool(wrong))

    @property
    def _late(self) -> str:
        return f"unfinished in {self.most_cpu_s} s"

    def bounded(self, case: DrawnCase) -> Judged:
        """What became of a case in a process of its own, and why."""
        told, how = alone(
            lambda: "\n".join(judged(case.judge)),
            most_cpu_s=self.most_cpu_s,
            most_wall_s=self.most_wall_s,
            most_bytes=MOST_BYTES,
        )
        if how in (ABORTED, UNFINISHED):
            return ABORT if how == ABORTED else self._late, told
        said, _, why = told.partition("\n")
        return said, why


def judged(work: Callable[[], Judged]) -> Judged:
    """What ``work`` says; a mistake must be refused in one line, and anything else that it raises is told."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            return work()
    except MacrofitError as error:
        line = str(error)
        return (REFUSED, line) if line.strip() and "\n" not in line else (TRACEBACK, f"no line: {error}")
    except (Exception, SystemExit):
        return TRACEBACK, traceback.format_exc()
