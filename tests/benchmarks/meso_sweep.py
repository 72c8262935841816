"""Does every slide find its equilibria, whatever the surfaces, their height and the friction?

    python -m tests.benchmarks meso_sweep [--slides 200] [--spheres 3000] [--quick]

Random slides: n = 3, 4, 5 in turn, R log-uniform in 5-40 um, micro_friction uniform in 0.01-0.09, new surfaces each
time. Prints a Markdown table; ends with 1 where a slide has no answer or an increment above its tolerance.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import numpy as np

from meso.errors import MesoError
from meso.friction_test import run
from meso.settings import load
from meso.surfaces.surface import TILES, generator


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_sweep", description=__doc__)
    parser.add_argument("--slides", type=int, default=200)
    parser.add_argument("--spheres", type=int, default=3000)
    parser.add_argument("--quick", action="store_true", help="3 slides of 900 spheres")
    options = parser.parse_args(words)
    if options.quick:
        options.slides, options.spheres = 3, 900
    rng = generator("sweep")
    fallen_back, failed, halved, worst = 0, 0, 0, 0.0
    spent = []
    for k in range(options.slides):
        levels, height = 3 + k % 3, float(np.exp(rng.uniform(np.log(0.005), np.log(0.04))))
        settings = load(
            None,
            [
                f"surface.levels={levels}", f"surface.max_height={height}",
                f"surface.wheel_seed={TILES * (1000 + k)}", f"surface.axle_seed={TILES * (5000 + k)}",
                f"plates.packing_seed={k % 10}", f"plates.spheres={options.spheres}",
                f"contact.micro_friction={float(rng.uniform(0.01, 0.09))}",
            ],
        )  # fmt: skip
        started = time.process_time()
        try:
            slide = run(settings).slides[0]
        except MesoError as error:
            failed += 1
            print(f"slide {k}: {error}", flush=True)
            continue
        spent.append(time.process_time() - started)
        halved += slide.steps > 8 + int(np.ceil(settings.load.slide / settings.engine.increment))
        if slide.engine == "explicit":
            fallen_back += 1
        elif not np.isfinite(slide.curve.coefficient):
            print(f"slide {k}: contact is lost all along", flush=True)
            failed += 1
        else:
            worst = max(worst, slide.largest_residual)
    print("| slides | with halved increments | explicit took over | without an answer | largest residual | CPU [s] |")
    print("|---|---|---|---|---|---|")
    print(f"| {options.slides} | {halved} | {fallen_back} | {failed} | {worst:.1e} | {np.median(spent):.2f} each |")
    return int(failed > 0 or worst > 1e-3)
