"""What does the enriched fit find beside the numbers of the paper it follows?

    python -m tests.benchmarks paper [--quick]

`wheelset` with uniform friction of 0.11, with the network at five micro coefficients, on five surfaces at 0.07, the
micro coefficient for which its fitting curve matches the uniform one, and two hundred surfaces (`macrofit study` under
`mpirun -n 2`). The paper: Lalleman, Gosselet, Hubert, Salengro and Magnier, section 4.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from macrofit.assembly import Assembly, assemble
from macrofit.identify.fit import fit_parameter
from macrofit.scene import load_scene
from macrofit.solution import Solution
from macrofit.solve import solve
from tests.launcher import launcher_environment

from ._measure import head, lines, row

MICRO = (0.01, 0.03, 0.05, 0.07, 0.09)
NETWORK = ("friction.provider=surrogate", "friction.options.fallback=warning")
TINY = ("mesh.seat_facet=5", "motion.travel=40", "motion.increment=5")
BODIES = ("axle", "wheel")


def run(assembly: Assembly, changes: Sequence[str]) -> Solution:
    """`wheelset` with changes, on bodies made before."""
    return solve(load_scene("wheelset", changes), MPI.COMM_SELF, assembly=assembly)


def force_at(assembly: Assembly, small: Sequence[str], micro: float) -> np.ndarray:
    """Forces [N] with the network at a micro coefficient."""
    changes = [*small, *NETWORK, f"friction.options.micro_friction={float(micro)!r}", "output.stress=false"]
    return run(assembly, [*changes, "output.fields_at=[]"]).force


def surfaces(count: int, small: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of the study of so many seeds, on two ranks."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["study", "wheelset", "--set", NETWORK[0], "--vary", f"friction.options.seed=1:{count}", "--quiet"]
        words += [word for change in small for word in ("--set", change)] + ["-o", f"{folder}/seeds"]
        subprocess.run(
            ["mpirun", "-n", "2", sys.executable, "-m", "macrofit", *words],
            stdin=subprocess.DEVNULL, stdout=sys.stderr, check=True, env=launcher_environment(),
        )  # fmt: skip
        with (Path(folder) / "seeds" / "study.csv").open() as file:
            rows = list(csv.DictReader(file))
    names = ("final_force_N", "axle_max_von_mises_MPa", "wheel_max_von_mises_MPa")
    return {name: np.array([float(one[name]) for one in rows]) for name in names}


def explained(solution: Solution) -> tuple[float, float, float]:
    """Shares of a pair's variance that its seat tile and its bore tile explain, and the scatter of the seat tiles."""
    pairs = solution.friction
    assert pairs is not None
    shares, scatter = [], 0.0
    for tile in (pairs.seat, pairs.bore):
        count = np.bincount(tile)
        mean = np.bincount(tile, pairs.coefficient) / np.maximum(count, 1)
        shares.append(float(np.average((mean[tile] - pairs.coefficient.mean()) ** 2) / pairs.coefficient.var()))
        if not scatter:
            scatter = float(mean[count > 0].std(ddof=1) / mean[count > 0].mean())
    return shares[0], shares[1], scatter


def stresses(solution: Solution, at: float | None = None) -> list[float]:
    """Largest von Mises stress of axle and wheel [MPa], over the run or in the field at a displacement."""
    if at is None:
        return [solution.max_von_mises[body].value for body in BODIES]
    return [float(solution.fields[at][body].von_mises.max()) for body in BODIES]


def span(values: Sequence[float], digits: int, scale: float = 1.0) -> str:
    """Least to greatest."""
    return f"{min(values) * scale:.{digits}f} to {max(values) * scale:.{digits}f}"


def rows(small: Sequence[str], count: int) -> Iterator[str]:
    """The table, line by line."""
    assembly = assemble(load_scene("wheelset", small), MPI.COMM_SELF)
    uniform = run(assembly, small)
    end = uniform.increments[-1].displacement
    yield head("", "Lalleman et al.", "here")
    micro = {mu: force_at(assembly, small, mu) for mu in MICRO}
    found = fit_parameter(partial(force_at, assembly, small), uniform.force, 0.07, (0.0, 0.5))
    residual = float(np.sqrt(np.mean(found.residual**2)) / uniform.force.max())
    matched = f"{found.value:.4f} ({len(found.trials)} runs, residual {residual:.2%} of the peak)"
    yield row("micro coefficient that matches uniform 0.11", "0.07", matched)
    yield row("force at the end, uniform 0.11", "", f"{uniform.force[-1] / 1e6:.3f} MN")
    ends = ", ".join(f"{force[-1] / 1e6:.3f}" for force in micro.values())
    yield row(f"force at the end, micro {', '.join(map(str, MICRO))}", "", f"{ends} MN")
    rough = [run(assembly, [*small, *NETWORK, f"friction.options.seed={seed}"]) for seed in range(1, 6)]
    forces = [one.force[-1] for one in rough]
    width = (max(forces) - min(forces)) / np.mean(forces)
    yield row(
        "force at the end, 0.07, five surfaces", "2.678 to 2.908 MN (8 %)", f"{span(forces, 3, 1e-6)} MN ({width:.1%})"
    )
    many = surfaces(count, small)
    force = many["final_force_N"]
    said = f"{force.mean() / 1e6:.3f} ± {force.std(ddof=1) / 1e6:.3f} MN ({force.std(ddof=1) / force.mean():.2%})"
    yield row(f"the same, {count} surfaces, mean and standard deviation", "", said)
    first = rough[0]
    places = " and ".join(f"{uniform.max_von_mises[body].displacement_mm:g}" for body in BODIES)
    over, last = stresses(uniform), stresses(uniform, end)
    told = f"axle {over[0]:.0f}, wheel {over[1]:.0f} at {places} mm; at {end:g} mm {last[0]:.0f} and {last[1]:.0f}"
    yield row("largest von Mises stress, uniform 0.11 [MPa]", "676.4, at the entrance", told)
    enriched = [*stresses(first), *stresses(first, end)]
    a, w, c, d = (f"{e:.0f} ({e / u - 1:+.1%})" for e, u in zip(enriched, [*over, *last], strict=True))
    yield row("the same, enriched, 0.07", "512.9 (-25 %)", f"axle {a}, wheel {w}; at {end:g} mm {c} and {d}")
    both = [span([stresses(one)[k] for one in rough], 1) for k in (0, 1)]
    yield row("the same over five surfaces", "493.7 to 512.9", f"axle {both[0]}, wheel {both[1]}")
    seat, bore, scatter = explained(first)
    tiles = len(np.unique(first.friction.seat))  # type: ignore[union-attr]
    yield row(
        "variance of a pair's coefficient that its seat tile and its bore tile explain", "", f"{seat:.0%}, {bore:.0%}"
    )
    told = f"{scatter:.1%}; over the root of {tiles} tiles {scatter / np.sqrt(tiles):.2%}"
    yield row("scatter of the seat tiles' mean coefficients", "", told)
    yield from yielding(small, float(uniform.force[-1]))


STEELS = {
    "both of 420 MPa, kinematic hardening of 5 GPa": {
        "yield_stress": "420",
        "hardening": "{law='linear', kinematic=5000}",
    },
    "axle EA4T, wheel ER8": {"grade": "EA4T", "wheel": "ER8"},
}
"""Steels that yield: keys of the material of both bodies, and the wheel's own grade."""


def yielding(small: Sequence[str], elastic: float) -> Iterator[str]:
    """Force and largest stress where the steel yields, on uniform 0.11 and on plates as published at 0.07."""
    published = (*NETWORK, "friction.options.plates='as-published'")
    for told, keys in STEELS.items():
        grades = [f"wheel.material.grade={keys['wheel']}"] if "wheel" in keys else []
        both = [f"{body}.material.{key}={value}" for body in BODIES for key, value in keys.items() if key != "wheel"]
        for what, friction in (("uniform 0.11", ()), ("as published, 0.07", published)):
            found = solve(load_scene("wheelset", [*small, *both, *grades, *friction]), MPI.COMM_SELF)
            axle, wheel = (f"{value:.0f}" for value in stresses(found))
            force = f"{found.force[-1] / 1e6:.3f} MN ({found.force[-1] / elastic - 1:+.1%} of elastic, uniform)"
            paper = "676.4" if not friction else "512.9"
            flowed = ", ".join(f"{found.flowed[body].value:.2%}" for body in BODIES if body in found.flowed)
            yield row(
                f"{told}, {what}: force at the end; largest von Mises stress [MPa], plastic strain", paper,
                f"{force}; axle {axle}, wheel {wheel}; {flowed}",
            )  # fmt: skip


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks paper", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, a short way, four surfaces")
    parser.add_argument("--surfaces", type=int, default=200)
    options = parser.parse_args(words)
    lines(rows(TINY if options.quick else (), 4 if options.quick else options.surfaces))
    return 0
