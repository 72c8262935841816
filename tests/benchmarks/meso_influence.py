"""How much does each numerical choice move the meso coefficient, and what does it cost?

    python -m tests.benchmarks meso_influence [--pairs 3] [--quick] [--figure docs/meso_influence.png]

For each choice: change of the coefficient against the reference (quasi-static, increments of 0.5 um; the same surfaces
and packings) over the micro coefficient, mean absolute value over pairs of surfaces with n = 3, R = 20 um, at
micro_friction 0.07 and 0.01, and CPU seconds of one slide with its set-up. The first block holds what only the
numerics choose: it should be small. The second holds what belongs to the model: what the model's answer depends on.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from meso.friction_test import run
from meso.settings import load

COEFFICIENTS = (0.07, 0.01)
REFERENCE = ("engine.increment=0.0005", "engine.tolerance=1e-5")
NUMERICS = {
    "increment [um]": [(f"{1e3 * h:g}", [f"engine.increment={h}"]) for h in (0.008, 0.004, 0.002, 0.001)],
    "tolerance": [(f"{t:g}", [f"engine.tolerance={t}"]) for t in (1e-2, 1e-3, 1e-4)],
    "speed, explicit [m/s]": [
        (f"{v:g}", ["engine.name=explicit", f"engine.speed={1e3 * v}"]) for v in (100, 50, 20, 10, 5, 2.5)
    ],
    "damping length at 5 m/s [mm]": [
        (f"{d:g}", ["engine.name=explicit", "engine.speed=5000", f"engine.damping_length={d}"]) for d in (0.01, 0.08, 1)
    ],
    "time step over critical, 5 m/s": [
        (f"{s:g}", ["engine.name=explicit", "engine.speed=5000", f"engine.safety={s}"]) for s in (0.95, 0.45)
    ],
}
MODEL = {
    "packing seed": [(f"{s}", [f"plates.packing_seed={s}"]) for s in (1, 2, 3)],
    "spheres": [(f"{n}", [f"plates.spheres={n}"]) for n in (1500, 6000, 12_000)],
    "thickness [mm]": [
        (f"{h:g}", [f"plates.thickness={h}", f"plates.spheres={round(10_000 * h)}"]) for h in (0.2, 0.4, 0.5)
    ],
    "contact stiffness over E_M r": [(f"{k:g}", [f"contact.normal_stiffness={k}"]) for k in (0.5, 2, 4)],
    "k_t over k_n": [(f"{k:g}", [f"contact.tangential_ratio={k}"]) for k in (0.4, 1)],
    "pressure [MPa]": [(f"{p:g}", [f"load.pressure={p}"]) for p in (85, 340)],
    "control": [("force", ["load.control=force"])],
    "external face": [("beams, as printed", ["plates.external_face=beams", "plates.external_modulus=paper"])],
}


class Row(NamedTuple):
    """One choice: mean absolute change at both micro coefficients, over them and as it is [-], CPU time [s]."""

    choice: str
    value: str
    changes: tuple[float, float]
    absolute: tuple[float, float]
    cpu_s: float


def coefficients(pair: int, overrides: Sequence[str]) -> tuple[list[float], float]:
    """The meso coefficients of one pair of surfaces, and the CPU time of set-up and one slide."""
    base = [f"surface.wheel_seed={51 + pair}", f"surface.axle_seed={71 + pair}", "contact.micro_friction=[0.07, 0.01]"]
    test = run(load(None, [*base, *overrides]))
    cpu = test.setup_cpu_s + statistics.mean(slide.cpu_s for slide in test.slides)
    return [slide.curve.coefficient for slide in test.slides], cpu


def main(words: Sequence[str]) -> int:
    """Print the table, draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_influence", description=__doc__)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="600 spheres, one pair, few choices")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(words)
    pairs = 1 if options.quick else options.pairs
    small = ["plates.spheres=900"] if options.quick else []
    reference = [coefficients(pair, [*small, *REFERENCE])[0] for pair in range(pairs)]
    rows: list[Row] = []
    print("Reference:", ", ".join(f"{np.mean(column):.5f}" for column in zip(*reference, strict=True)), "\n")
    print("| choice | value | change at 0.07 | change at 0.01 | CPU [s] |\n|---|---|---|---|---|")
    for choices in (NUMERICS, MODEL):
        for choice, values in choices.items():
            for value, overrides in values[:1] if options.quick else values:
                if options.quick and choice == "spheres":
                    continue
                found = [coefficients(pair, [*small, *overrides]) for pair in range(pairs)]
                difference = np.abs(np.array([values for values, _ in found]) - np.array(reference))
                relative = np.mean(difference, axis=0) / COEFFICIENTS
                cpu = statistics.median(cpu for _, cpu in found)
                rows.append(Row(choice, value, tuple(relative), tuple(difference.mean(axis=0)), cpu))
                print(
                    f"| {choice} | {value} | {100 * relative[0]:.2f} % | {100 * relative[1]:.2f} % | {cpu:.2f} |",
                    flush=True,
                )
    if options.figure:
        draw(rows, options.figure)
    return 0


def draw(rows: Sequence[Row], target: Path) -> None:
    """Error against run time of both engines, and what the model's choices move."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.2), dpi=150, layout="constrained")
    left, right = figure.subplots(1, 2)
    for choice, colour, label in (
        ("increment [um]", "#0072B2", "quasi-static, increment in µm"),
        ("speed, explicit [m/s]", "#D55E00", "explicit, speed in m/s"),
    ):
        own = [row for row in rows if row.choice == choice]
        left.loglog(
            [row.cpu_s for row in own], [100 * row.changes[0] for row in own], "o-", color=colour, label=label, lw=1.2
        )
        for row in own:
            left.annotate(
                row.value, (row.cpu_s, 100 * row.changes[0]), textcoords="offset points", xytext=(5, 4), fontsize=8
            )
    left.set_xlabel("CPU time of set-up and one slide [s]")
    left.set_ylabel("error of the meso coefficient [%]")
    left.set_title("What the numerics cost (micro coefficient 0.07)", fontsize=10)
    left.legend(frameon=False, fontsize=9)
    model = [row for row in rows if row.choice in MODEL]
    place = np.arange(len(model))[::-1]
    right.barh(place, [row.absolute[0] for row in model], height=0.6, color="#0072B2")
    right.set_yticks(place, [f"{row.choice}: {row.value}" for row in model], fontsize=8)
    right.set_xlabel("mean absolute change of the meso coefficient [-]")
    right.set_title("What the model's choices move", fontsize=10)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target)
