"""From a profilometer's files to a fitting curve: is the network right on measured faces, and what does it cost?

    python -m tests.benchmarks measured_press [--quick]

A turned strip of the axle, 190 x 1.1 mm at 5 um in a .sur file, and three patches of 1 mm2 of the bore in .x3p files
are made and written. `wheelset` is run on them with `surrogate` (curve and cost; the time of reading is in it), then
`rough-hub` with `dem` (without its cache) and with `surrogate`: the share of the pairs of tiles whose slide lies inside
the network's stated 90 %, and both forces at the end.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from macrofit.scene import load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

from ..scans import sur, textured, turned, x3p
from ._measure import head, row

PLAIN = ("output.stress=false", "output.fields_at=[]")
FAST = ("motion.travel=4", "motion.increment=1")
QUANTILE_90 = 1.645


def scanned(folder: Path, length: float, step: float) -> str:
    """Write the files; the option of both providers that names them."""
    rng = np.random.default_rng(17)
    shape, apart = (round(length / step), round(1.1 / step)), (step, step)
    (folder / "seat.sur").write_bytes(sur(turned(rng, shape, apart, feed=0.25, depth=0.004), apart))
    side = round(1.0 / step)
    for k in range(3):
        (folder / f"bore{k}.x3p").write_bytes(x3p(textured(rng, (side, side), apart, 1.2e-3), apart))
    bore = ", ".join(f'"{folder}/bore{k}.x3p"' for k in range(3))
    return f'friction.options.surface={{axle = "{folder}/seat.sur", bore = [{bore}]}}'


def pressed(scene: str, provider: str, overrides: Sequence[str]) -> tuple[Solution, float]:
    """The run, and its CPU time [s]."""
    started = time.process_time()
    read = load_scene(scene, [*PLAIN, f"friction.provider={provider}", "friction.options.seed=1", *overrides])
    return solve(read), time.process_time() - started


def main(words: Sequence[str]) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks measured_press", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="A short way, small plates: to see that it runs.")
    quick = parser.parse_args(words).quick
    ways, step = (list(FAST), 0.02) if quick else ([], 0.005)
    plates = ["friction.options.cache=false", *(["friction.options.plates={spheres=600}"] if quick else [])]
    print(head("scene", "provider", "pairs", "coefficient", "F, end [kN]", "inside 90 %", "off by rms", "CPU [s]"))
    with tempfile.TemporaryDirectory() as name:
        files = scanned(Path(name), 30.0 if quick else 190.0, step)
        if not quick:
            solution, cost = pressed("wheelset", "surrogate", [files])
            print(_row("wheelset", "surrogate", solution, "", "", cost), flush=True)
        (truth, slow), (guess, fast) = (
            pressed("rough-hub", "dem", [files, *ways, *plates]),
            pressed("rough-hub", "surrogate", [files, *ways]),
        )
    dem, net = truth.friction, guess.friction
    assert dem is not None
    assert net is not None
    off = (dem.coefficient - net.coefficient) / net.uncertainty
    print(_row("rough-hub", "dem", truth, "", "", slow))
    inside = f"{np.mean(np.abs(off) < QUANTILE_90):.0%}"
    print(_row("rough-hub", "surrogate", guess, inside, f"{np.sqrt(np.mean(off**2)):.2f}", fast))
    mean = np.mean(net.coefficient / dem.coefficient - 1.0)
    print(f"\nThe network's coefficients differ by {mean:+.2%} from the plates' in the mean.")
    return 0


def _row(scene: str, provider: str, solution: Solution, inside: str, off: str, cost: float) -> str:
    """A row of the table."""
    field = solution.friction
    assert field is not None
    mean, spread = field.coefficient.mean(), field.coefficient.std()
    force = 1e-3 * solution.increments[-1].force
    told = f"{mean:.4f} ± {spread:.4f}"
    return row(scene, provider, len(field.coefficient), told, f"{force:.2f}", inside, off, f"{cost:.1f}")
