"""Does a press-fit on the network agree with one that runs the plates for every pair of tiles?

    python -m tests.benchmarks dem_press [--quick] [--seeds 2]

`rough-hub` with the provider `dem` (without its cache, some two minutes on one core) and with `surrogate`, the same
surfaces. Prints the pairs, how many standard deviations the network is off, the share inside its stated 90 %
interval, both forces at the end, and what the seat's and the bore's tile each explain of the variance.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import numpy as np

from macrofit.scene import load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

PLAIN = ("output.stress=false", "output.fields_at=[]")


def pressed(provider: str, seed: int, overrides: Sequence[str]) -> tuple[Solution, float]:
    """The run, and its CPU time [s]."""
    started = time.process_time()
    scene = load_scene(
        "rough-hub", [*PLAIN, f"friction.provider={provider}", f"friction.options.seed={seed}", *overrides]
    )
    return solve(scene), time.process_time() - started


def explained(tile: np.ndarray, values: np.ndarray) -> float:
    """Share of the variance of `values` between the groups of equal `tile`."""
    _, group = np.unique(tile, return_inverse=True)
    mean = np.bincount(group, values) / np.bincount(group)
    return float(np.var(mean[group]) / np.var(values))


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks dem_press", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="A short way, small plates: to see that it runs.")
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args(words)
    overrides = ["motion.travel=4", "motion.increment=1"] if options.quick else []
    plates = ["friction.options.cache=false", *(["friction.options.plates={spheres=600}"] if options.quick else [])]
    print("| seed | pairs | off by rms | inside 90 % | F plates [kN] | F network [kN] | seat, bore tile explain "
          "(plates) | (network) | CPU s plates, network |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for seed in range(1, options.seeds + 1):
        (truth, slow), (guess, fast) = (
            pressed("dem", seed, [*overrides, *plates]),
            pressed("surrogate", seed, overrides),
        )
        dem, net = truth.friction, guess.friction
        assert dem is not None
        assert net is not None
        assert np.array_equal(dem.seat, net.seat)
        assert np.array_equal(dem.bore, net.bore)
        off = (net.coefficient - dem.coefficient) / net.uncertainty
        shares = [
            f"{explained(field.seat, field.coefficient):.2f}, {explained(field.bore, field.coefficient):.2f}"
            for field in (dem, net)
        ]
        print(
            f"| {seed} | {off.size} | {np.sqrt(np.mean(off**2)):.2f} | {100.0 * np.mean(np.abs(off) < 1.645):.0f} % "
            f"| {truth.force[-1] / 1e3:.3f} | {guess.force[-1] / 1e3:.3f} | {shares[0]} | {shares[1]} "
            f"| {slow:.0f}, {fast:.1f} |",
            flush=True,
        )
    return 0
