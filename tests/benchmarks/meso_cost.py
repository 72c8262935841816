"""How fast are the plates: the bond kernels, two runs at once, a complete run, a cold start?

    python -m tests.benchmarks meso_cost [--quick] [--against FOLDER]

Prints Markdown tables. Kernels: plates squeezed and sliding, with contacts and external faces, linear and with beams
that may break; million bond-steps per CPU second on one thread, median and range of repeats. With --against, the tree
of another commit in FOLDER takes turns with this one, each in a process of its own, and the ratio of the medians is
shown too. Complete run: built-in default (n = 3, 3000 spheres), packing to coefficient, with the flat packings cached
and without. Cold: a new process with an empty numba cache, to the first coefficient.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from meso.engines.explicit import Explicit
from meso.engines.fracture import Breaking
from meso.engines.linear import Linear
from meso.friction_test import run
from meso.packing.cache import flat_packing
from meso.plates import make_plates
from meso.settings import load

ROOT = Path(__file__).parents[2]
LATTICES = ("linear", "breakable")
STRONG = ("engine.breakage.tensile_strength=1e9", "engine.breakage.shear_strength=1e9")
"""Strengths that no beam reaches [MPa]."""
TURNS = """
import sys
sys.path[:0] = [{tree!r}]
import meso
sys.path[:0] = [{root!r}]
from tests.benchmarks.meso_cost import measured
speed = measured({lattice!r}, {spheres}, {steps})
for _ in sys.stdin:
    print(speed(), flush=True)
"""
"""A process that measures the tree of a commit once for every line it reads."""
COLD = "from meso.settings import load; from meso.friction_test import run; run(load())"


def measured(lattice: str, spheres: int, steps: int) -> Callable[[], float]:
    """Plates that slide; a call takes some steps and returns their speed [million bond-steps per CPU second]."""
    settings = load(None, ["engine.name=explicit", f"plates.spheres={spheres}", *STRONG])
    made = make_plates(settings)
    engine, keys, breakage = Explicit(made), settings.engine, settings.engine.breakage
    assert breakage is not None
    body: Linear | Breaking
    if lattice == "linear":
        body = Linear(made.lattice, dt=engine.time_step, micro_friction=0.07, candidates=engine.candidates)
    else:
        body = Breaking(
            made.lattice,
            breakage,
            dt=engine.time_step,
            contact_modulus=settings.material.youngs_modulus,
            micro_friction=0.07,
            candidates=engine.candidates,
            wheel_nodes=made.wheel.nodes,
        )
    body.drive[2] = made.first_touch - made.likely_approach()
    body.advance(2 * steps, (0.0, 0.0, 0.0), damping=keys.squeeze_damping)

    def speed() -> float:
        started = time.process_time()
        body.advance(steps, (keys.speed, 0.0, 0.0), damping=keys.speed / keys.damping_length)
        return steps * len(made.lattice.cols) / (time.process_time() - started) / 1e6

    return speed


def started(tree: Path, lattice: str, spheres: int, steps: int) -> subprocess.Popen[str]:
    """A process that measures a tree."""
    code = TURNS.format(tree=str(tree), root=str(ROOT), lattice=lattice, spheres=spheres, steps=steps)
    command = [sys.executable, "-P", "-c", code]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def asked(processes: Sequence[subprocess.Popen[str]]) -> list[float]:
    """One measurement of each process, at the same time where there are several."""
    for process in processes:
        assert process.stdin is not None
        print(file=process.stdin, flush=True)
    return [float(process.stdout.readline()) for process in processes if process.stdout is not None]


def kernels(trees: Sequence[Path], lattice: str, spheres: int, steps: int, repeats: int) -> list[list[float]]:
    """Speeds of each tree, which take turns [million bond-steps per CPU second]."""
    processes = [started(tree, lattice, spheres, steps) for tree in trees]
    turns = [[asked([process])[0] for process in processes] for _ in range(repeats + 1)]
    for process in processes:
        process.communicate()
    return [list(column) for column in zip(*turns[1:], strict=True)]


def two_at_once(spheres: int, steps: int) -> float:
    """Sum of the speeds of two processes running together over that of one alone (medians of three in each) [-]."""
    processes = [started(ROOT, "linear", spheres, steps) for _ in range(2)]
    asked(processes)
    alone = statistics.median(asked(processes[:1])[0] for _ in range(3))
    both = statistics.median(sum(asked(processes)) for _ in range(3))
    for process in processes:
        process.communicate()
    return both / alone


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
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="the tree of another commit, to compare with")
    arguments = parser.parse_args(words)
    quick, trees = arguments.quick, [ROOT, *filter(None, [arguments.against])]
    counts, steps, repeats = ((900, 1500), 50, 2) if quick else ((3000, 10_000, 30_000), 200, 7)
    print("| lattice | spheres | million bond-steps/s | range | other tree | ratio |\n|---|---|---|---|---|---|")
    for lattice in LATTICES:
        for spheres in counts:
            speeds, *others = kernels(trees, lattice, spheres, steps, repeats)
            median = statistics.median(speeds)
            other = [statistics.median(column) for column in others]
            compared = f"{other[0]:.0f} | {median / other[0]:.2f}" if other else "- | -"
            print(
                f"| {lattice} | {spheres} | {median:.0f} | {min(speeds):.0f}-{max(speeds):.0f} | {compared} |",
                flush=True,
            )
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
