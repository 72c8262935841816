"""How much does each numerical choice move the meso coefficient, and what does it cost?

    python -m tests.benchmarks meso_influence [--pairs 3] [--quick] [--figure FILE]

First table, for each choice: change of the coefficient against the reference (quasi-static, increments of 0.5 um; the
same surfaces and packings) over the micro coefficient, mean absolute value over pairs of surfaces with n = 3,
R = 20 um, at micro_friction 0.07 and 0.01; CPU seconds of one slide with its set-up (packings made before), and its
Newton iterations or time steps. The choices down to the time step are of the numerics alone and should move little;
those below belong to the model. The explicit engine slides the first two pairs only.
Second table: the number of spheres, over packings of the same surfaces (two pairs): distance of the mean over the
packings from that of the largest plates with its standard error, scatter of a single packing, and root mean square
error of a single run against that mean, all over 0.07.
Third table: the length of the slide. One slide of 2 mm per pair and packing, cut: distance from the whole of it, over
0.07 and over the scatter of packings; CPU seconds are those of plates made for that length.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from meso.friction_test import run
from meso.records import Curve
from meso.settings import load
from meso.surfaces.surface import TILES

from ._measure import Point, draw_work_precision, head, row
from ._plates import newton_iterations

COEFFICIENTS = (0.07, 0.01)
REFERENCE = ("engine.increment=0.0005", "engine.tolerance=1e-5")
DYNAMIC = ("engine.name=explicit", "engine.speed=20000")
NUMERICS = {
    "increment [um]": [(f"{1e3 * h:g}", [f"engine.increment={h}"]) for h in (0.016, 0.008, 0.004, 0.002, 0.001)],
    "tolerance": [(f"{t:g}", [f"engine.tolerance={t}"]) for t in (1e-2, 1e-3, 1e-4)],
    "speed, explicit [m/s]": [
        (f"{v:g}", ["engine.name=explicit", f"engine.speed={1e3 * v}"]) for v in (100, 50, 20, 10, 5)
    ],
    "damping length at 20 m/s [mm]": [(f"{d:g}", [*DYNAMIC, f"engine.damping_length={d}"]) for d in (0.01, 1)],
    "time step over critical, 20 m/s": [(f"{s:g}", [*DYNAMIC, f"engine.safety={s}"]) for s in (0.95, 0.45)],
}
MODEL = {
    "packing seed": [(f"{s}", [f"plates.packing_seed={s}"]) for s in (1, 2, 3)],
    "spheres": [(f"{n}", [f"plates.spheres={n}"]) for n in (1500, 6000)],
    "thickness [mm]": [
        (f"{h:g}", [f"plates.thickness={h}", f"plates.spheres={round(10_000 * h)}"]) for h in (0.2, 0.4, 0.5)
    ],
    "contact stiffness over E_M r": [(f"{k:g}", [f"contact.normal_stiffness={k}"]) for k in (0.5, 2, 4)],
    "k_t over k_n": [(f"{k:g}", [f"contact.tangential_ratio={k}"]) for k in (0.4, 1)],
    "pressure [MPa]": [(f"{p:g}", [f"load.pressure={p}"]) for p in (85, 340)],
    "control": [("force", ["load.control=force"])],
    "external face": [
        (
            "beams, as printed, at 0.75 f d",
            ["plates.external_face=beams", "plates.external_modulus=paper", "engine.resonance=0.75"],
        )
    ],
}
SPHERES, PACKINGS = (1000, 1500, 3000, 6000, 12_000), 3
DENSITY = 1000
"""Spheres per mm2 of both plates in the study of the slide's length: 3000 with a slide of 1 mm."""
SLIDES = (0.25, 0.5, 1.0, 2.0)
SLIDE = "slide [mm]"
FINE = 0.001
"""Increment of the slides that are cut [mm]: their mean T comes from the rows, not from energies."""
FloatArray = npt.NDArray[np.float64]


class Outcome(NamedTuple):
    """The meso coefficients, CPU time of set-up and one slide [s], Newton iterations or time steps of one slide."""

    values: tuple[float, ...]
    cpu_s: float
    count: float


class Row(NamedTuple):
    """One choice: mean absolute change at both micro coefficients over them [-], CPU time [s], count of work."""

    choice: str
    value: str
    changes: tuple[float, float]
    cpu_s: float
    count: float


@cache
def outcome(pair: int, *overrides: str) -> Outcome:
    """One pair of surfaces at both micro coefficients."""
    with newton_iterations() as newton:
        test = run(load(None, [*surfaces(pair), *overrides]))
    slides = test.slides
    cpu_s = test.setup_cpu_s + statistics.mean(slide.cpu_s for slide in slides)
    work = sum(newton.notes) or sum(slide.steps for slide in slides)
    return Outcome(tuple(slide.curve.coefficient for slide in slides), cpu_s, work / len(slides))


def surfaces(pair: int) -> list[str]:
    """The settings that every run of a pair shares."""
    micro = ", ".join(f"{value:g}" for value in COEFFICIENTS)
    seeds = [f"surface.wheel_seed={TILES * (51 + pair)}", f"surface.axle_seed={TILES * (71 + pair)}"]  # strips apart
    return [*seeds, f"contact.micro_friction=[{micro}]"]


def choices(pairs: int, small: Sequence[str], quick: bool) -> list[Row]:
    """Print the table of choices."""
    reference = np.array([outcome(pair, *small, *REFERENCE).values for pair in range(pairs)])
    rows: list[Row] = []
    print("Reference:", ", ".join(f"{mean:.5f}" for mean in reference.mean(axis=0)), "\n")
    print(head("choice", "value", "change at 0.07", "change at 0.01", "CPU [s]", "iterations or steps"))
    for choice, values in (NUMERICS | MODEL).items():
        if quick and choice == "spheres":
            continue
        for value, overrides in values[:1] if quick else values:
            own = min(pairs, 2) if "engine.name=explicit" in overrides else pairs
            found = [outcome(pair, *small, *overrides) for pair in range(own)]
            change = np.mean(np.abs([one.values for one in found] - reference[:own]), axis=0) / COEFFICIENTS
            cpu_s, count = (statistics.median(one[k] for one in found) for k in (1, 2))
            rows.append(Row(choice, value, (float(change[0]), float(change[1])), cpu_s, count))
            print(
                row(choice, value, *(f"{100 * part:.2f} %" for part in change), f"{cpu_s:.2f}", f"{count:.0f}"),
                flush=True,
            )
    return rows


def packed(pairs: int, packings: int, spheres: int) -> tuple[FloatArray, float]:
    """Coefficients at 0.07, pairs by packings, and the median CPU time."""
    found = [
        [
            outcome(pair, f"plates.spheres={spheres}", *([f"plates.packing_seed={seed}"] if seed else []))
            for seed in range(packings)
        ]
        for pair in range(pairs)
    ]
    return np.array([[one.values[0] for one in line] for line in found]), statistics.median(
        one.cpu_s for line in found for one in line
    )


def sizes(pairs: int, packings: int, counts: Sequence[int]) -> list[Point]:
    """Print the table of sphere counts; the points are the errors of single runs, and of means over packings."""
    finest, _ = packed(pairs, packings, counts[-1])
    truth, points = finest.mean(axis=1, keepdims=True), []
    print(head("spheres", "mean, off by", "scatter of a packing", "error of a single run", "CPU [s]"))
    for spheres in counts:
        values, cpu_s = packed(pairs, packings, spheres)
        scatter = float(np.sqrt(np.mean(values.var(axis=1, ddof=1))))
        off = values.mean(axis=1) - truth[:, 0]
        noise = float(np.hypot(scatter, np.sqrt(np.mean(finest.var(axis=1, ddof=1))))) / np.sqrt(packings * pairs)
        # of the distance from a mean that has noise of its own, which is taken out
        square = max(float(np.mean(off**2)) - noise**2 * pairs, 0.0)
        single = float(np.sqrt(square + scatter**2))
        moved = "-" if spheres == counts[-1] else f"{off.mean() / 0.07:+.2%} ± {noise / 0.07:.2%}"
        print(row(spheres, moved, f"{scatter / 0.07:.2%}", f"{single / 0.07:.2%}", f"{cpu_s:.2f}"), flush=True)
        points.append(Point("spheres", f"{spheres}", cpu_s, single / 0.07))
        if spheres == 3000:
            for several in (2, 4, 8):
                error = float(np.sqrt(square + scatter**2 / several)) / 0.07
                points.append(Point("mean of packings, 3000 spheres", f"{several}", several * cpu_s, error))
    return points


def cut(curve: Curve, length: float) -> float:
    """The coefficient of the first part of a slide [mm]."""
    rows = int(np.searchsorted(curve.displacement, length + 1e-9))
    step = np.diff(curve.displacement[:rows])
    T, N = (step @ (force[1:rows] + force[: rows - 1]) for force in (curve.tangential, curve.normal))
    return float(T / N)


def lengths(pairs: int, packings: int, slides: Sequence[float], density: int) -> list[Point]:
    """Print the table of slides; the points are their errors against the longest."""
    whole = slides[-1]
    keys = [f"load.slide={whole}", f"plates.spheres={round(density * (2.0 + whole))}", f"engine.increment={FINE}"]
    found = np.empty((pairs, packings, len(slides)))
    for pair in range(pairs):
        for seed in range(packings):
            test = run(
                load(None, [*surfaces(pair), *keys, f"plates.packing_seed={seed}", "contact.micro_friction=0.07"])
            )
            found[pair, seed] = [cut(test.slides[0].curve, length) for length in slides]
    means = found.mean(axis=1)
    scatter = np.sqrt(np.mean(found.var(axis=1, ddof=1), axis=0)) if packings > 1 else np.full(len(slides), np.nan)
    points = []
    print(head("slide [mm]", "off the longest", "scatter of a packing", "off over scatter", "CPU [s]", "increments"))
    for k, length in enumerate(slides):
        timed = run(
            load(None, ["surface.generator=self_affine", f"load.slide={length}",
                        f"plates.spheres={round(density * (2.0 + length))}"])
        )  # fmt: skip
        cpu_s = timed.setup_cpu_s + timed.slides[0].cpu_s
        off = float(np.sqrt(np.mean((means[:, k] - means[:, -1]) ** 2)))
        print(row(f"{length:g}", f"{off / 0.07:.2%}", f"{scatter[k] / 0.07:.2%}", f"{off / scatter[k]:.1f}",
                  f"{cpu_s:.2f}", timed.slides[0].steps), flush=True)  # fmt: skip
        if off:
            points.append(Point(SLIDE, f"{length:g}", cpu_s, off / 0.07))
    return points


def main(words: Sequence[str]) -> int:
    """Print the tables, draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_influence", description=__doc__)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="900 spheres, one pair, few choices")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(words)
    quick: bool = options.quick
    rows = choices(1 if quick else options.pairs, ["plates.spheres=900"] if quick else [], quick)
    print("\nSpheres, over packings of the same surfaces:\n")
    model = sizes(1, 2, (800, 1000)) if quick else sizes(2, PACKINGS, SPHERES)
    print("\nLength of the slide:\n")
    model += lengths(1, 2, (0.5, 1.0), 300) if quick else lengths(2, PACKINGS, SLIDES, DENSITY)
    if options.figure:
        draw(rows, model, options.figure)
    return 0


def draw(rows: Sequence[Row], model: Sequence[Point], target: Path) -> None:
    """Error against CPU time of one slide with its set-up: of the numerics at both coefficients, and of the model."""
    numerics = [row for row in rows if row.choice in NUMERICS]
    panels: dict[str, Sequence[Point]] = {
        f"error of the numerics over {micro:g}": [
            Point(row.choice, row.value, row.cpu_s, row.changes[k]) for row in numerics
        ]
        for k, micro in enumerate(COEFFICIENTS)
    }
    panels["error of a single run over 0.07"] = [point for point in model if point.series != SLIDE]
    panels["error of a cut slide over 0.07"] = [point for point in model if point.series == SLIDE]
    draw_work_precision(panels, target, "CPU time of set-up and one slide [s]")
