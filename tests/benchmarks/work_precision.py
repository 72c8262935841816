"""Which mesh, contact formulation and increment give the press-fit's least error for their time?

    python -m tests.benchmarks work_precision [--quick] [--figure FILE]

Every choice is one run of `wheelset` whose only changes are those named; 2/0.5 mm are facets of 2 mm along the seat
and of 0.5 mm in the arcs of the corners. Errors are differences from an over-resolved run (P2, 0.25/0.125 mm, growth
0.2, short increments where the stress is largest):

- force: at the last displacement; curve: the largest over the fitting curve as it is drawn, linearly between
  increments, at every whole mm, over its peak
- pressure: root mean square along the seat of the profile as it is drawn, linearly between the facets' middles, over
  that of the reference; at the last displacement and at half of it
- von Mises: the largest of each body over the whole run

Cost is the CPU time of `solve` from scene to stresses in a warm process, the median of three rounds over all choices
(one where a run takes more than four seconds). A choice is on the frontier of an error where nothing else is both
cheaper and more exact; of the two bodies the worse counts, and so it does of the two pressures.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.presets import PRESETS
from macrofit.scene import load_scene
from macrofit.scene.keys import MeshKeys
from macrofit.solution import Solution
from macrofit.solve import solve

from ._measure import Cost, Point, cpu, draw_work_precision, frontier, head, lines, row

REFERENCE = ("mesh.seat_facet=0.25", "mesh.corner_facet=0.125", "mesh.growth=0.2")
PEAK = (17.0, 27.0)  # mm, where the corners ride over each other and the stresses are largest
ROUNDS, LONG = 3, 4.0  # a run that takes more CPU s is taken once
KINDS = ("curve", "pressure", "von Mises")
SHORT = ("motion.start=16", "motion.travel=40", "motion.increment=4", "mesh.coarse=40")
PENALTY = "contact.formulation=penalty"
GROWTH = MeshKeys().growth
BARS = ((1e-3, 2e-2, 1.0), (5e-5, math.inf, 3.0))  # errors of force and peak stress, CPU s they may take


@dataclass(frozen=True)
class Choice:
    """One run of `wheelset`: what is varied, what the point is called, and the keys that do it."""

    series: str
    label: str
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class Errors:
    """Relative differences from the reference."""

    force: float
    curve: float
    pressure: tuple[float, float]  # at the end, half way
    von_mises: tuple[float, float]  # axle, wheel

    def of(self, kind: str) -> float:
        """The worse one of a kind."""
        worst = {"curve": self.curve, "pressure": max(self.pressure), "von Mises": max(map(abs, self.von_mises))}
        return worst[kind]


@dataclass(frozen=True)
class Measured:
    """What a choice cost and how far off it was."""

    choice: Choice
    cost: Cost
    errors: Errors
    dofs: int
    counters: dict[str, int]


def choices() -> list[Choice]:
    """All that is tried."""

    def vary(series: str, label: str, key: str, values: Iterable[object], *also: str) -> list[Choice]:
        return [Choice(series, label.format(value), (f"{key}={value}", *also)) for value in values]

    def cornered(facet: float, corner: float, growth: float) -> Choice:
        sizes = (f"mesh.seat_facet={facet}", f"mesh.corner_facet={corner}", f"mesh.growth={growth}")
        graded = "" if growth == GROWTH else f", growth {growth:g}"
        return Choice("P2, finer corners", f"{facet:g}/{corner:g} mm{graded}", sizes)

    found = [Choice("preset", name, (f"preset={name}",)) for name in PRESETS]
    found += vary("P1", "P1 {} mm", "mesh.seat_facet", (4, 2, 1, 0.5), "mesh.order=1")
    found += vary("P2", "P2 {} mm", "mesh.seat_facet", (4, 2, 1, 0.5))
    found += [cornered(*sizes, GROWTH) for sizes in ((4, 1), (4, 0.5), (3, 0.5), (2, 1), (2, 0.5), (1, 0.25))]
    found += [cornered(*sizes, 0.24) for sizes in ((3, 1), (2, 0.5), (1, 0.5))]
    found += vary("bulk", "growth {}", "mesh.growth", (0.15, 0.24, 0.6))
    found += vary("bulk", "coarse {} mm", "mesh.coarse", (10, 40))
    found += vary("contact", "gamma0 {}", "contact.gamma0", (1, 3, 30, 100))
    found += vary("contact", "theta {}", "contact.theta", (-1, 1))
    found += vary("contact", "penalty {:.0e}", "contact.penalty_stiffness", (1e5, 1e6, 1e7, 1e8), PENALTY)
    return found + vary("increment", "increment {} mm", "motion.increment", (0.25, 0.5, 2, 5, 10))


def few() -> list[Choice]:
    """What --quick tries."""
    coarse = "mesh.seat_facet=8"
    return [
        Choice("P1", "P1 8 mm", ("mesh.order=1", coarse)),
        Choice("P2", "P2 8 mm", (coarse,)),
        Choice("P2, finer corners", "8/2 mm", (coarse, "mesh.corner_facet=2")),
        Choice("contact", "penalty", (PENALTY, coarse)),
    ]


def reference(*, quick: bool) -> Solution:
    """The over-resolved run."""
    if quick:
        return solve(load_scene("wheelset", ("mesh.seat_facet=4", *SHORT)))
    whole = load_scene("wheelset").displacements
    places = sorted({*whole, *np.arange(*PEAK, 0.25).tolist()})
    return solve(load_scene("wheelset", (*REFERENCE, f"motion={{displacements={places}}}")))


def profile(solution: Solution, displacement: float, at: FloatArray) -> FloatArray:
    """Pressure [MPa] at the coordinates ``at`` [mm], linearly between the facets' middles."""
    record = solution.increments[int(np.abs(solution.displacement - displacement).argmin())]
    middles = 0.5 * (solution.seat[1:] + solution.seat[:-1])
    return np.asarray(np.interp(at, middles, record.facets.pressure))


def errors(found: Solution, exact: Solution) -> Errors:
    """Relative differences of a run from the reference."""
    last = float(exact.displacement[-1])
    whole = np.unique(np.append(np.ceil(exact.displacement), last))  # the reference has short increments too
    curve, true = (np.interp(whole, run.displacement, run.force) for run in (found, exact))
    at = np.linspace(exact.seat[0], exact.seat[-1], 8001)
    halves = []
    for place in (last, 0.5 * last):
        fine = profile(exact, place, at)
        halves.append(float(np.linalg.norm(profile(found, place, at) - fine) / np.linalg.norm(fine)))
    axle, wheel = (found.max_von_mises[b].value / exact.max_von_mises[b].value - 1.0 for b in ("axle", "wheel"))
    return Errors(
        float(found.force[-1] / exact.force[-1] - 1.0),
        float(np.abs(curve - true).max() / true.max()),
        (halves[0], halves[1]),
        (axle, wheel),
    )


def measure(tried: Sequence[Choice], exact: Solution, also: Sequence[str], rounds: int) -> list[Measured]:
    """Cost and errors of all choices, taken in turn so that a machine whose speed wanders treats them alike."""
    scenes = [load_scene("wheelset", (*also, *choice.overrides)) for choice in tried]
    seconds: list[list[float]] = [[] for _ in tried]
    found: list[tuple[Errors, int, dict[str, int]]] = []
    for turn in range(rounds):
        for scene, taken in zip(scenes, seconds, strict=True):
            if turn == 0 or taken[0] < LONG:
                cost, solution = cpu(partial(solve, scene), repeats=1, warm=0)
                taken += cost.seconds
                if turn == 0:
                    found.append((errors(solution, exact), solution.dofs, solution.counters))
    costs = [Cost(tuple(taken)) for taken in seconds]
    return [Measured(choice, cost, *rest) for choice, cost, rest in zip(tried, costs, found, strict=True)]


def on_frontier(found: Sequence[Measured]) -> list[str]:
    """For each, the errors on whose frontier it is."""
    costs = [each.cost.median for each in found]
    best = {kind: set(frontier(costs, [each.errors.of(kind) for each in found])) for kind in KINDS}
    return [", ".join(kind for kind in KINDS if k in best[kind]) for k in range(len(found))]


def table(found: Sequence[Measured]) -> Iterable[str]:
    """All choices by rising cost."""
    yield head(
        "choice", "CPU s", "dofs", "Newton steps", "factorisations: bodies, interface", "force", "curve",
        "pressure: end, half way", "von Mises: axle, wheel", "on the frontier of",
    )  # fmt: skip
    for each, best in sorted(zip(found, on_frontier(found), strict=True), key=lambda pair: pair[0].cost.median):
        e, counts = each.errors, each.counters
        name = f"**{each.choice.label}**" if each.choice.series == "preset" else each.choice.label
        yield row(
            name, each.cost, f"{each.dofs / 1000:.1f}k", counts["newton_iterations"],
            f"{counts['factorisations']}, {counts['interface_factorisations']}", f"{e.force:+.1e}", f"{e.curve:.1e}",
            f"{e.pressure[0]:.2%}, {e.pressure[1]:.2%}", f"{e.von_mises[0]:+.1%}, {e.von_mises[1]:+.1%}", best,
        )  # fmt: skip


def presets(found: Sequence[Measured]) -> Iterable[str]:
    """What the presets do and cost, for the README."""
    yield head("preset", "facets along the seat, in the corners; growth", *KINDS, "CPU s")
    for each in found:
        if each.choice.series == "preset":
            mesh, errors = load_scene("wheelset", each.choice.overrides).mesh, each.errors
            corner = mesh.seat_facet if mesh.corner_facet is None else mesh.corner_facet
            yield row(
                f"`{each.choice.label}`", f"{mesh.seat_facet:g} mm, {corner:g} mm; {mesh.growth:g}",
                f"{errors.curve:.1e}", *(f"{errors.of(kind):.1%}" for kind in KINDS[1:]), each.cost,
            )  # fmt: skip


def bars(found: Sequence[Measured]) -> Iterable[str]:
    """The cheapest choices within given errors."""
    for force, stress, seconds in BARS:
        for along, error in (("all along the curve", lambda e: e.curve), ("at the end", lambda e: abs(e.force))):
            tried = [e for e in found if e.choice.series != "increment"]  # whose curve means something
            within = [e for e in tried if error(e.errors) <= force and e.errors.of("von Mises") <= stress]
            wanted = f"{force:.0e} of the force {along}" + (f", {stress:.0%} of the stress" if stress < 1.0 else "")
            best = min(within, key=lambda e: e.cost.median, default=None)
            found_at = "nothing that was tried" if best is None else f"{best.cost.median:.2g} s ({best.choice.label})"
            yield f"- {wanted}: {found_at}; the bar is {seconds:g} CPU s"


def misstated(found: Sequence[Measured]) -> list[str]:
    """Presets whose errors are larger than those that `macrofit.presets` states, or less than half of them."""
    wrong = []
    for each in found:
        if each.choice.series == "preset":
            preset = PRESETS[each.choice.label]
            pairs = ((preset.force_error, each.errors.curve), (preset.stress_error, each.errors.of("von Mises")))
            wrong += [
                f"Preset {each.choice.label}: macrofit/presets.py says {said:.2g}, found {is_now:.2g}."
                for said, is_now in pairs
                if not 0.5 * said <= is_now <= said
            ]
    return wrong


def draw(found: Sequence[Measured], target: Path) -> None:
    """A panel for each kind of error."""
    titles = {
        "curve": "largest error of the fitting curve [-]", "pressure": "error of the pressure profile, L2 [-]",
        "von Mises": "error of the largest von Mises stress [-]",
    }  # fmt: skip
    panels = {
        title: [Point(e.choice.series, e.choice.label, e.cost.median, e.errors.of(kind)) for e in found]
        for kind, title in titles.items()
    }
    draw_work_precision(panels, target)


def main(words: Sequence[str]) -> int:
    """Print the table and the cheapest choices; 1 where a preset does not do what it states."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks work_precision", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="Four choices over a short push.")
    parser.add_argument("--figure", type=Path, help="File of the figure.")
    options = parser.parse_args(words)
    also = SHORT if options.quick else ()
    for order in () if options.quick else (1, 2):
        solve(load_scene("wheelset", (*SHORT, f"mesh.order={order}")))  # warm
    exact = reference(quick=options.quick)
    found = measure(few() if options.quick else choices(), exact, also, 1 if options.quick else ROUNDS)
    wrong = misstated(found)
    lines(table(found))
    if not options.quick:
        lines(["", *presets(found), "", *bars(found), "", *wrong])
    if options.figure:
        draw(found, options.figure)
    return int(bool(wrong))
