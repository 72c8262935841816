"""From roughness to the fitting curve: which link makes the largest error?

    python -m tests.benchmarks chain [--quick] [--figure docs/chain.png]

`wheelset` on the network (provider `surrogate`). One link is changed at a time; the rest stays. By link: the relative
error of one pair's coefficient, of the mean coefficient under the hub at the end, of the force at the end, of the curve
(rms along the way over the largest force), of the largest von Mises stress, and the CPU time it took to find out.

- *mesh*: facets of half the length. *increment*: a quarter of the length.
- *increment of the plates*: 4 µm against 0.5 µm; the mean change is taken as common to all pairs.
- *network, common*: its mean error over the evaluation's hundred pairs against the mean of their packings, with the
  standard error of that mean in quadrature. *network, by tile*: what is left, as random numbers.
- *packing*: one packing of spheres for all tiles, as the provider `dem` has it, in place of the mean over packings.
  *common* is what all pairs of surfaces on a packing share (from build/bench/train.h5, made where it is missing),
  *by tile* the rest, as random numbers.
- *surfaces*: standard deviation over seeds. *micro coefficient*: for an error of 0.001.

Which part of the random numbers belongs to a tile of the seat or of the bore is found from plates run for a block of
this seat's own tiles. The sum is in quadrature. The length of a tile, 1 mm, is no option: the network knows no other.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import torch
from mpi4py import MPI

from macrofit.assembly import Assembly, assemble
from macrofit.base.arrays import FloatArray
from macrofit.scene import load_scene
from macrofit.solution import PairFrictionMap, Solution
from macrofit.solve import solve
from surrogate.data.database import read_database

from ._coefficient_errors import MICRO, SEED, CoefficientErrors, Shares, drawn, examine
from ._database import default_database
from ._measure import head, row, save

STEP = 0.001
"""Of the micro coefficient."""
ROUGH = ("friction.provider=surrogate", "output.fields_at=[]", f"friction.options.micro_friction={MICRO}")
SMALL = ("mesh.seat_facet=5", "motion.travel=40", "motion.increment=5")
"""Of the quick one."""
INPUTS = ("surfaces", "micro coefficient")
"""Links that say what is not known of the bodies, not what the computation does to it."""
LEAST = 1e-6
"""Relative errors below it are none."""


@dataclass(frozen=True)
class Sizes:
    """How much is run."""

    overrides: tuple[str, ...] = ()
    seeds: int = 8
    draws: int = 6
    block: tuple[int, int] = (6, 4)
    """Tiles of the seat and of the bore whose plates are run, with two packings each."""
    spheres: int = 3000
    fine: float = 0.0005
    """Increment of the plates that counts as exact [mm]."""


class Effects(NamedTuple):
    """Relative errors that follow from a link."""

    mean: float  # of the coefficient under the hub, at the end
    force: float  # at the end
    curve: float
    stress: float


class Link(NamedTuple):
    """One row of the budget."""

    name: str
    pair: float | None  # error of one pair's coefficient
    effects: Effects
    cpu_s: float


class Chain:
    """The scene, and runs of it with something changed."""

    def __init__(self, overrides: Sequence[str], folder: Path) -> None:
        self.overrides, self.folder = (*ROUGH, *overrides), folder
        self._assembly: Assembly | None = None
        self.reference = self.run(f"friction.options.seed={SEED}")
        assert self.reference.friction is not None
        self.pairs: PairFrictionMap = self.reference.friction

    def run(self, *changes: str) -> Solution:
        """A run on the bodies of the last one, if they are the same."""
        scene = load_scene("wheelset", [*self.overrides, *changes])
        if self._assembly is None or not self._assembly.serves(scene):
            self._assembly = assemble(scene, MPI.COMM_SELF)
        return solve(scene, MPI.COMM_SELF, assembly=self._assembly)

    def with_field(self, coefficient: FloatArray) -> Solution:
        """A run with other coefficients of the same pairs."""
        path = self.folder / "field.csv"
        with path.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["seat", "bore", "coefficient"])
            rows.writerows(zip(self.pairs.seat, self.pairs.bore, coefficient.clip(0.0).tolist(), strict=True))
        plain = [words for words in self.overrides if not words.startswith("friction.")]
        scene = load_scene("wheelset", [*plain, "friction.provider=table", f"friction.options.file={path}"])
        return solve(scene, MPI.COMM_SELF, assembly=self._assembly)


def effects(solutions: Sequence[Solution], reference: Solution | None) -> Effects:
    """Root mean square of the differences from the reference; without one, standard deviation about the mean."""

    def spread(values: FloatArray, exact: FloatArray | None) -> FloatArray:
        if exact is not None:
            return np.asarray(np.sqrt(np.mean((values - exact) ** 2, axis=0)))
        return np.asarray(values.std(axis=0, ddof=1))

    common = (reference or solutions[0]).displacement
    found = [quantities(solution, common) for solution in solutions]
    exact = quantities(reference, common) if reference is not None else None
    sizes = exact or tuple(np.mean(values, axis=0) for values in zip(*found, strict=True))
    mean, curve, stress = (
        spread(np.array(values), exact[k] if exact else None) for k, values in enumerate(zip(*found, strict=True))
    )
    rms = np.sqrt(np.mean(curve**2)) / sizes[1].max()
    return Effects(float(mean / sizes[0]), float(curve[-1] / sizes[1][-1]), float(rms), float(stress / sizes[2]))


def quantities(solution: Solution, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean coefficient at the end, force at these displacements, largest von Mises stress."""
    force = np.interp(at, solution.displacement, solution.force)
    stress = max(extreme.value for extreme in solution.max_von_mises.values())
    return np.array(solution.increments[-1].mean_friction), force, np.array(stress)


def budget(chain: Chain, plates: CoefficientErrors, sizes: Sizes) -> list[Link]:
    """All links, the largest error of the force first."""
    pairs, reference, rng = chain.pairs, chain.reference, np.random.default_rng(0)
    stated = float(np.sqrt(np.mean(pairs.uncertainty**2)) / pairs.coefficient.mean())
    bias = float(np.hypot(plates.bias, plates.bias_error))
    links: list[Link] = []

    def add(name: str, pair: float | None, work: Callable[[], Effects], before: float = 0.0) -> None:
        began = time.process_time()
        found = work()
        links.append(Link(name, pair, found, before + time.process_time() - began))

    def shifted(by: float) -> Effects:
        return effects([chain.with_field(pairs.coefficient * (1.0 + by))], reference)

    def scattered(size: float, parts: Shares) -> Effects:
        return effects([chain.with_field(drawn(pairs, size, parts, rng)) for _ in range(sizes.draws)], reference)

    common, own = plates.common, max(0.0, plates.packing**2 - plates.common**2) ** 0.5
    add("increment of the plates", abs(plates.increment), lambda: shifted(plates.increment), plates.increment_cpu_s)
    add("network, common", bias, lambda: shifted(bias), plates.cpu_s / 2.0)
    add("network, by tile", plates.network * stated, lambda: scattered(plates.network, plates.network_shares))
    add("packing, common", common * stated, lambda: shifted(common * stated), plates.cpu_s / 2.0)
    add("packing, by tile", own * stated, lambda: scattered(own, plates.packing_shares))
    ends = [f"friction.options.micro_friction={MICRO + step:g}" for step in (-STEP, STEP)]
    add(
        "micro coefficient",
        STEP / MICRO,
        lambda: effects([chain.run(f"friction.options.seed={SEED}", end) for end in ends], reference),
    )
    facet, increment = reference.scene.mesh.seat_facet, float(np.diff(reference.displacement)[0])
    shorter = f"friction.options.seed={SEED}", f"motion.increment={increment / 4.0}"
    add("increment", None, lambda: effects([chain.run(*shorter)], reference))
    several = [f"friction.options.seed={seed}" for seed in range(SEED, SEED + sizes.seeds)]
    runs: list[Solution] = []

    def surfaces() -> Effects:
        runs.extend(chain.run(seed) for seed in several)
        return effects(runs, None)

    add("surfaces", None, surfaces)
    fields = [run.friction.coefficient for run in runs if run.friction is not None]
    spread = float(np.sqrt(np.mean([field.var() for field in fields])) / np.mean(np.concatenate(fields)))
    links[-1] = links[-1]._replace(pair=spread)
    finer = f"friction.options.seed={SEED}", f"mesh.seat_facet={facet / 2.0}"
    add("mesh", None, lambda: effects([chain.run(*finer)], reference))  # last: it takes the assembly
    return sorted(links, key=lambda link: -link.effects.force)


def quadrature(links: Sequence[Link]) -> Effects:
    """Root of the sum of squares."""
    return Effects(*np.sqrt(np.sum(np.square([link.effects for link in links]), axis=0)).tolist())


def percent(value: float | None) -> str:
    """With two significant digits."""
    if value is None:
        return ""
    return f"{100.0 * value:.2g} %" if value >= LEAST else f"< {100.0 * LEAST:g} %"


def main(words: Sequence[str]) -> int:
    """Print the budget, draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks chain", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="A coarse mesh, few and small plates.")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(words)
    torch.set_num_threads(1)
    sizes = Sizes(SMALL, 2, 2, (2, 2), 600, 0.002) if options.quick else Sizes()
    with TemporaryDirectory() as name:
        chain = Chain(sizes.overrides, Path(name))
        samples = None if options.quick else read_database(default_database()).samples
        plates = examine(chain.reference, samples, sizes.block, sizes.spheres, sizes.fine)
        links = budget(chain, plates, sizes)
    last = chain.reference.increments[-1]
    print(
        f"Reference: {last.force / 1e6:.4f} MN at {last.displacement:g} mm, mean coefficient {last.mean_friction:.5f}, "
        f"{len(chain.pairs.seat)} pairs of tiles.\n"
    )
    print(head("link", "coefficient of a pair", "mean at the end", "force at the end", "curve", "peak stress", "CPU s"))
    for link in links:
        print(row(link.name, percent(link.pair), *map(percent, link.effects), f"{link.cpu_s:.1f}"))
    computed = [link for link in links if link.name not in INPUTS]
    for what, some in (("all", links), (f"all but {' and '.join(INPUTS)}", computed)):
        print(row(f"sum: {what}", "", *map(percent, quadrature(some)), ""))
    print("\n" + conclusion(links, plates))
    if options.figure:
        draw(links, options.figure)
    return 0


def conclusion(links: Sequence[Link], plates: CoefficientErrors) -> str:
    """Which links dominate."""
    computed = [link for link in links if link.name not in INPUTS]
    said = []
    for what, some in (("all links", links), ("those that the computation adds", computed)):
        whole, largest = quadrature(some).force, max(some, key=lambda link: link.effects.force)
        part = (largest.effects.force / whole) ** 2
        said.append(f"Of {what} '{largest.name}' dominates the force at the end: {part:.0%} of the sum of squares.")
    stress = max(links, key=lambda link: link.effects.stress)
    said.append(f"The largest error of the peak stress comes from '{stress.name}', {percent(stress.effects.stress)}.")
    parts = [
        f"{name} {share.seat:.0%}, {share.bore:.0%}, {share.pair:.0%}"
        for name, share in (("the network's error", plates.network_shares), ("packing, by tile", plates.packing_shares))
    ]
    said.append(f"Seat's tile, bore's tile and pair have of the variance of {'; of that of the '.join(parts)}.")
    said.append(f"All surfaces on one packing share {(plates.common / plates.packing) ** 2:.0%} of its variance.")
    said.append(f"The network's mean error is {100.0 * plates.bias:+.2f} ± {100.0 * plates.bias_error:.2f} %.")
    return " ".join(said)


def draw(links: Sequence[Link], target: Path) -> None:
    """Errors by link as bars."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.6), dpi=150, layout="constrained")
    axes = figure.subplots()
    place = np.arange(len(links))[::-1]
    kinds = (
        ("force at the end", "force", "#0072B2"),
        ("curve", "curve", "#56B4E9"),
        ("peak stress", "stress", "#D55E00"),
    )
    for k, (label, name, colour) in enumerate(kinds):
        values = [100.0 * getattr(link.effects, name) for link in links]
        axes.barh(place + 0.25 * (1 - k), values, height=0.23, color=colour, label=label)
    axes.set_xscale("log")
    axes.set_xlim(left=100.0 * LEAST)
    axes.set_yticks(place, [link.name for link in links], fontsize=9)
    axes.set_xlabel("relative error [%]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="lower right")
    save(figure, target)
