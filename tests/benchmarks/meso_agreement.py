"""Do the two engines agree, and is the law affine in the micro coefficient?

    python -m tests.benchmarks meso_agreement [--pairs 5] [--spheres 3000] [--quick]

Pairs of new surfaces (n = 3, R = 20 um), each at the interference that gives 170 MPa; quasi-static against explicit at
5 m/s, for micro_friction 0.07 and 0.01: difference of the coefficient over the micro coefficient, and rms of the
difference of N(t) over its mean, where the explicit N is the mean over the micrometre around each increment. Then
mu_meso = a mu_micro + b over five micro coefficients.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from meso.engines.explicit import Explicit
from meso.engines.quasistatic import QuasiStatic
from meso.plates import make_plates
from meso.records import Slide
from meso.settings import load
from meso.surfaces.surface import TILES

COEFFICIENTS = (0.01, 0.03, 0.05, 0.07, 0.09)


def normal_difference(static: Slide, dynamic: Slide) -> float:
    """Rms of the difference of N over its mean; the dynamic rows are means over the stretch before each."""
    rows = dynamic.curve
    middle = rows.displacement - 0.5 * np.diff(rows.displacement, prepend=0.0)
    inside = static.curve.displacement[1:-1]
    seen = np.interp(inside, middle, rows.normal)
    return float(np.sqrt(np.mean((seen - static.curve.normal[1:-1]) ** 2)) / static.curve.mean_normal)


def main(words: Sequence[str]) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_agreement", description=__doc__)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--spheres", type=int, default=3000)
    parser.add_argument("--quick", action="store_true", help="1 pair of 600 spheres")
    options = parser.parse_args(words)
    if options.quick:
        options.pairs, options.spheres = 1, 600
    print("| pair | mu_micro | quasi-static | explicit, 5 m/s | difference | N rms |\n|---|---|---|---|---|---|")
    lines = []
    for pair in range(options.pairs):
        keys = [
            f"surface.wheel_seed={TILES * (11 + pair)}",
            f"surface.axle_seed={TILES * (31 + pair)}",
            f"plates.spheres={options.spheres}",
            "engine.speed=5000",
            "engine.samples=1000",
        ]
        squeezed = make_plates(load(None, keys))
        approach = squeezed.first_touch - float(QuasiStatic(squeezed).slide(0.07).squeeze.height[-1])
        plates = make_plates(load(None, [*keys, f"load.interference={approach}"]))
        static, dynamic = QuasiStatic(plates), Explicit(plates)
        values = {mu: static.slide(mu) for mu in COEFFICIENTS}
        for mu in (0.07, 0.01):
            slow, fast = values[mu], dynamic.slide(mu)
            difference = (slow.curve.coefficient - fast.curve.coefficient) / mu
            print(
                f"| {pair} | {mu} | {slow.curve.coefficient:.6f} | {fast.curve.coefficient:.6f} "
                f"| {100 * difference:+.2f} % | {100 * normal_difference(slow, fast):.2f} % |",
                flush=True,
            )
        coefficients = np.array([values[mu].curve.coefficient for mu in COEFFICIENTS])
        a, b = np.polyfit(COEFFICIENTS, coefficients, 1)
        lines.append((pair, a, b, np.abs(coefficients - np.polyval((a, b), COEFFICIENTS)).max()))
    print("\n| pair | a | b | largest residual over five mu_micro |\n|---|---|---|---|")
    for pair, a, b, residual in lines:
        print(f"| {pair} | {a:.4f} | {b:+.5f} | {residual:.1e} |")
    return 0
