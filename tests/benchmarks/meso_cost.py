"""How fast are the plates: the force kernel, two runs at once, a complete run, a cold start?

    python -m tests.benchmarks meso_cost [--quick]

Prints Markdown tables. Kernel: lattice of 10,000 spheres, million bond-steps per CPU second on one thread, median and
range of repeats. Complete run: built-in default (n = 3, 3000 spheres), packing to coefficient, with the flat packings
cached and without. Cold: a new process with an empty numba cache, to the first coefficient.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from meso import kernels
from meso.engines.time_step import critical_time_step
from meso.friction_test import run
from meso.lattice.calibration import steel
from meso.lattice.lattice import Lattice, build
from meso.material import Material
from meso.packing.cache import flat_packing
from meso.packing.pack import pack
from meso.settings import load
from meso.surfaces.surface import generator

KERNEL = "from tests.benchmarks.meso_cost import kernel; print(kernel({spheres}, {steps}, 3)[0])"
COLD = "from meso.settings import load; from meso.friction_test import run; run(load())"


def free_plate(spheres: int) -> Lattice:
    """A plate of this many spheres without external face, as dense in spheres as the default's."""
    width = (spheres / 1000.0) ** 0.5
    packing = pack(generator("cost", spheres), spheres=spheres, size=(width, width), thickness=0.3)
    return build(packing, Material(), steel())


def kernel(spheres: int, steps: int, repeats: int) -> tuple[float, float, float]:
    """Median, least and greatest speed of the leapfrog over a lattice [million bond-steps per CPU second]."""
    plate = free_plate(spheres)
    u, f = np.zeros((plate.nodes, 6)), np.zeros((plate.nodes, 6))
    v = generator("cost").normal(size=(plate.nodes, 6))
    dt = 0.9 * critical_time_step(plate)
    speeds = []
    for repeat in range(repeats + 1):
        started = time.process_time()
        for _ in range(steps):
            kernels.leapfrog_step(
                u, v, f, plate.rows, plate.cols, plate.beams, plate.anchored, plate.anchors, plate.twist,
                plate.inverse, dt, 0.0,
            )  # fmt: skip
        if repeat:
            speeds.append(steps * len(plate.cols) / (time.process_time() - started) / 1e6)
    return statistics.median(speeds), min(speeds), max(speeds)


def two_at_once(spheres: int, steps: int) -> float:
    """Sum of the speeds of two processes running together over that of one alone (medians of three in each) [-]."""
    command = [sys.executable, "-c", KERNEL.format(spheres=spheres, steps=steps)]

    def start() -> subprocess.Popen[str]:
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    alone = float(start().communicate()[0])
    both = [start(), start()]
    return sum(float(process.communicate()[0]) for process in both) / alone


def complete(engine: str, spheres: int, repeats: int, cached: bool) -> tuple[float, float, float]:
    """CPU seconds of plates, set-up and one slide of a complete run: medians."""
    settings = load(None, [f"engine.name={engine}", f"plates.spheres={spheres}"])
    rows = []
    for _ in range(repeats + 1):
        if not cached:
            flat_packing.cache_clear()
        test = run(settings)
        rows.append((test.packing_cpu_s, test.setup_cpu_s, test.slides[0].cpu_s))
    packing, setup, slide = (statistics.median(column) for column in zip(*rows[1:], strict=True))
    return packing, setup, slide


def cold() -> float:
    """Wall seconds of a new process with empty caches, from the start to the first coefficient."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/numba", "MACROFIT_CACHE": f"{folder}/macrofit"}
        started = time.perf_counter()
        subprocess.run([sys.executable, "-c", COLD], check=True, env=environment)
        return time.perf_counter() - started


def main(words: Sequence[str]) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_cost", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small plates, two repeats, no cold start")
    quick = parser.parse_args(words).quick
    counts, steps, repeats = ((300, 1000), 50, 2) if quick else ((3000, 10_000, 30_000), 500, 7)
    print("| spheres | million bond-steps/s | range |\n|---|---|---|")
    for spheres in counts:
        median, least, most = kernel(spheres, steps, repeats)
        print(f"| {spheres} | {median:.0f} | {least:.0f}-{most:.0f} |", flush=True)
    print(f"\nTwo processes at once over one alone: {two_at_once(counts[-2], 4 * steps):.2f}\n")
    print("| engine | flat packings | plates [s] | set-up [s] | slide [s] | sum [s] |\n|---|---|---|---|---|---|")
    spheres = 1200 if quick else 3000
    with tempfile.TemporaryDirectory() as empty:
        for cached in (True, False):
            for engine in ("quasi-static", "explicit"):
                os.environ["MACROFIT_CACHE"] = str(Path(empty) / "kept") if cached else os.devnull
                import warnings

                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    times = complete(engine, spheres, repeats, cached)
                row = " | ".join(f"{value:.2f}" for value in (*times, sum(times)))
                print(f"| {engine} | {'cached' if cached else 'made'} | {row} |", flush=True)
    if not quick:
        print(f"\nCold start to the first coefficient, empty caches: {cold():.1f} s wall")
    return 0
