"""How does the friction of the plates as published depend on the speed of the slide, over that of their resonance?

    python -m tests.benchmarks resonance [--quick]

The plate on its beams sways at a frequency f, and the spheres, of diameter d, make a washboard: at the speed f d they
meet. The same pairs of tiles are slid at several multiples of f d, with several numbers of spheres, at a micro
coefficient of 0.07; the ratio is the meso coefficient over it. Slow plates, on faces as stiff as the solid, are beside.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence

import numpy as np

from macrofit.base.arrays import FloatArray
from meso.friction_test import run
from meso.plates import make_plates
from meso.settings import Settings, load

from ._measure import head, lines, row

MICRO = 0.07
MULTIPLES = (0.25, 0.5, 0.76, 1.0, 1.5, 3.0)
SPHERES = (500, 1000, 2000, 3000)
FIRST = 30_000
"""Number of the first pair of tiles."""


def settings(spheres: int, pair: int, multiple: float | None, samples: int) -> Settings:
    """A friction test of a pair of tiles; without a multiple of f d of the slow plates."""
    keys = [
        f"plates.spheres={spheres}", f"surface.axle_seed={FIRST + pair}", f"surface.wheel_seed={FIRST + pair}",
        f"plates.packing_seed={pair}", f"contact.micro_friction={MICRO}", f"engine.samples={samples}",
    ]  # fmt: skip
    if multiple is None:
        return load(None, [*keys, "surface.form=tiles", "surface.max_height=0.04"])
    return load(None, [*keys, f"engine.resonance={multiple}"], "as-published")


def ratios(spheres: int, pairs: int, multiple: float | None, samples: int) -> FloatArray:
    """Meso over micro coefficient of each pair (pairs,)."""
    found = [run(settings(spheres, pair, multiple, samples)).slides[0].curve.coefficient for pair in range(pairs)]
    return np.array(found) / MICRO


def rows(pairs: int, spheres: Sequence[int], multiples: Sequence[float], samples: int) -> Iterator[str]:
    """The table, and how flat it is near the resonance."""
    yield head("spheres", "f d [m/s]", *(f"{multiple:g} f d" for multiple in multiples), "slow", "CPU s")
    for count in spheres:
        started = time.process_time()
        speed = make_plates(settings(count, 0, 1.0, samples)).resonance * 1e-3
        found = [ratios(count, pairs, multiple, samples) for multiple in multiples]
        slow = ratios(count, pairs, None, samples)
        cells = [f"{each.mean():.3f} ± {each.std(ddof=1) / np.sqrt(pairs):.3f}" for each in (*found, slow)]
        yield row(count, f"{speed:.1f}", *cells, f"{time.process_time() - started:.0f}")
        near = [each.mean() for each, m in zip(found, multiples, strict=True) if 0.5 <= m <= 1.5]
        if len(near) > 1:
            spread = (max(near) - min(near)) / np.mean(near)
            yield row(count, "", f"between 0.5 and 1.5 f d within {spread:.1%}", *[""] * len(multiples), "")


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks resonance", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two pairs of 500 spheres at two speeds")
    parser.add_argument("-n", "--pairs", type=int, default=10)
    options = parser.parse_args(words)
    if options.quick:
        lines(rows(2, (500,), (1.0, 3.0), 20))
    else:
        lines(rows(options.pairs, SPHERES, MULTIPLES, 100))
    return 0
