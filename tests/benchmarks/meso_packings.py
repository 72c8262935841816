"""How much of a press-fit's force is the draw of the packings: one behind all tiles, sixteen dealt, one behind each?

    python -m tests.benchmarks meso_packings [--tiles 180] [--spheres 3000] [--choices 5] [--dealt HOW ...] [--quick]

A seat of so many tiles that faces its bore half a tile off: mean over the pairs (i, i) and (i, i + 1), as the force
has it under an even pressure. The same surfaces with other packings (`plates.packing_seed`): standard deviation of that
mean over the choices, and of a single pair, over the mean; CPU seconds of a choice, flat packings included. Takes an
hour; one packing behind all tiles is asked for with `--dealt one`.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import warnings
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from macrofit.base.steel import POISSON_RATIO, YOUNGS_MODULUS
from macrofit.friction import BuildContext, TilePairs, build
from meso.packing.cache import flat_packing

from ._measure import head, row

DEALT = (("one", 1), ("16", 16), ("one a tile", None))
FloatArray = npt.NDArray[np.float64]


def seat(tiles: int, spheres: int, packings: int | None, choice: int) -> FloatArray:
    """The coefficients of all pairs of the seat, by another choice of the packings."""
    context = BuildContext(seat_tiles=tiles, bore_tiles=tiles + 1, youngs_modulus=YOUNGS_MODULUS,
                           poisson_ratio=POISSON_RATIO)  # fmt: skip
    options = {"micro_friction": 0.07, "packings": packings, "plates": {"spheres": spheres, "packing_seed": choice}}
    number = np.repeat(np.arange(tiles), 2)
    pairs = TilePairs(number, number + np.tile([0, 1], tiles), np.full(2 * tiles, 100.0), np.zeros(2 * tiles))
    return build("dem", options, context).coefficients(pairs)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tiles", type=int, default=180)
    parser.add_argument("--spheres", type=int, default=3000)
    parser.add_argument("--choices", type=int, default=5)
    names = [name for name, _ in DEALT]
    parser.add_argument("--dealt", nargs="+", choices=names, default=names[1:], help="how the packings are dealt")
    parser.add_argument("--quick", action="store_true", help="toy size")
    asked = parser.parse_args(arguments)
    tiles, spheres, choices = (3, 500, 2) if asked.quick else (asked.tiles, asked.spheres, asked.choices)
    print(head("packings", "tiles", "spheres", "mean", "sd of a pair", "sd of the seat", "CPU s"))
    warnings.simplefilter("ignore")  # doubts of single pairs
    for name, packings in ((name, count) for name, count in DEALT if name in asked.dealt):
        with tempfile.TemporaryDirectory() as folder:
            os.environ["MACROFIT_CACHE"] = folder
            flat_packing.cache_clear()
            started = time.process_time()
            found = np.array([seat(tiles, spheres, packings, choice) for choice in range(choices)])
            taken = (time.process_time() - started) / choices
        mean = found.mean()
        print(row(name, tiles, spheres, f"{mean:.4f}", f"{found.std(axis=0, ddof=1).mean() / mean:.2%}",
                  f"{found.mean(axis=1).std(ddof=1) / mean:.2%}", f"{taken:.1f}"), flush=True)  # fmt: skip
    return 0
