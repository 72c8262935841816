"""Does `macrofit converge` predict the error of a scene, the true one being that against an over-resolved run?

    python -m tests.benchmarks convergence [--quick]

Predicted is what `converge wheelset` says of the scene as it is: three meshes (twice as coarse, its own, twice as
fine) and half steps. True is its difference from an over-resolved run: every size of the mesh a quarter of the scene's,
those in the arcs of the corners an eighth, and steps of 0.25 mm where the largest stresses are. Both in the norms of
the table: relative, of a curve the largest, of a profile along the seat the root mean square. The bar is a factor of
two either way for force, pressure and largest stress.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from functools import partial

import msgspec
import numpy as np
from mpi4py import MPI

from macrofit.converge.estimate import Figures, distance, figures
from macrofit.converge.ladder import given_scene, preset_scene, remeshed
from macrofit.converge.run import Convergence, converge
from macrofit.scene import Scene
from macrofit.scene.keys import Motion
from macrofit.solve import solve

from ._measure import head, lines, row

NAME = "wheelset"
TOY = ("mesh.seat_facet=4", "mesh.coarse=40", "motion.start=16", "motion.travel=40", "motion.increment=4")
PEAK = (17.0, 27.0)  # mm, where the corners ride over each other and the stresses are largest
FACTOR = 2.0
TOLERANCE = 0.05


def over_resolved(scene: Scene, *, quick: bool) -> Figures:
    """The figures of the run that is taken for the truth."""
    fine = remeshed(scene, 0.25)
    places = np.array(scene.displacements)
    if not quick:
        every = tuple(sorted({*scene.displacements, *np.arange(*PEAK, 0.25).tolist()}))
        corner = 0.5 * fine.mesh.seat_facet
        mesh = msgspec.structs.replace(fine.mesh, corner_facet=corner, growth=1.15 * fine.mesh.growth)
        fine = msgspec.structs.replace(fine, mesh=mesh, motion=Motion(displacements=every))
    return figures(solve(fine), places)


def compared(found: Convergence, truth: Figures) -> list[tuple[str, str, float, float]]:
    """Key, label, predicted and true error of every quantity that has a limit."""
    own = found.runs["the scene"]
    return [
        (each.quantity.key, each.quantity.label, each.error, distance(key, own, getattr(truth, key)))
        for each in found.estimates
        if each.error is not None
        for key in [each.quantity.key]
    ]


def table(rows: Sequence[tuple[str, str, float, float]]) -> Iterable[str]:
    """Predicted beside true."""
    yield head("quantity", "predicted error", "true error", "predicted / true")
    for _, label, predicted, true in rows:
        yield row(label, f"{predicted:.2e}", f"{true:.2e}", f"{predicted / true:.2f}" if true > 0.0 else "")


def presets(found: Convergence, truth: Figures) -> Iterable[str]:
    """The same of the presets that were tried."""
    yield head("preset", "quantity", "predicted error", "true error", "predicted / true")
    for name, errors in found.presets.items():
        run = found.runs[f"preset {name}"]
        for key, predicted in errors.items():
            true = distance(key, run, getattr(truth, key))
            yield row(name, key, f"{predicted:.2e}", f"{true:.2e}", f"{predicted / true:.2f}" if true > 0.0 else "")


def outside(rows: Sequence[tuple[str, str, float, float]]) -> list[str]:
    """Quantities whose predicted error is not within the bar; the curve has none."""
    return [
        f"{label}: predicted {predicted:.2e}, found {true:.2e}, beyond a factor of {FACTOR:g}"
        for key, label, predicted, true in rows
        if key != "curve" and not 1.0 / FACTOR <= predicted / true <= FACTOR
    ]


def main(words: Sequence[str]) -> int:
    """Print the tables; 1 where a prediction is beyond the bar."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks convergence", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="A short push on coarse meshes, without a bar.")
    options = parser.parse_args(words)
    overrides = TOY if options.quick else ()
    scene = given_scene(NAME, overrides)
    found = converge(scene, partial(preset_scene, NAME, overrides), MPI.COMM_WORLD, TOLERANCE)
    truth = over_resolved(scene, quick=options.quick)
    rows = compared(found, truth)
    wrong = [] if options.quick else outside(rows)
    lines([*table(rows), "", *presets(found, truth), "", *wrong])
    return int(bool(wrong))
