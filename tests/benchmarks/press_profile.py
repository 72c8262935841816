"""Where does the time of a press-fit go, and how far is each cost from its floor?

    python -m tests.benchmarks press_profile [--quick] [--preset NAME] [--figure FILE]

A warm run of `wheelset` on uniform friction, with the mesh of a preset if one is named. For each stage: CPU seconds
(median of repeats), its share, operations and bytes counted from the shapes of its arrays, the floor
max(operations / rate of dgemm, bytes / rate of daxpy) at the rates of this machine measured in this run, and the time
over the floor. Below one: the arrays stay in the cache, where daxpy's do not. Stages without a floor sort, search,
mesh or are Python itself.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg as sla

from macrofit import assembly, press, stress
from macrofit.bodies import body, pieces
from macrofit.bodies.body import Body
from macrofit.bodies.stress import StressEvaluator
from macrofit.contact import condensed
from macrofit.contact.condensed import Condensed, CondensedProblem
from macrofit.contact.interface import Band
from macrofit.presets import PRESETS
from macrofit.press import Press
from macrofit.scene import Scene, load_scene
from macrofit.solve import solve

from ._measure import head, save
from ._profile import WORD, Cost, Watch, line, medians, rates


def product(arguments: Any, _: Any) -> tuple[float, float]:
    """Operations and bytes of a band times a matrix: its blocks where the scale is not zero."""
    band, out, scale, dense = arguments
    rows, width = out.shape
    worked = sum((a.stop - a.start) * (b.stop - b.start) for a, b, _ in band.blocks if scale[a].any())
    return 2.0 * worked * width, WORD * (rows + dense.shape[0]) * width


def stages(scene: Scene) -> list[Cost]:
    """One run, watched."""

    def size(arguments: Any, _: Any) -> float:
        return float(len(arguments[0]))

    def vector(arguments: Any, _: Any) -> float:  # entries of the compliance that a product reads
        return float(arguments[1].size * np.count_nonzero(arguments[1]))

    def moments(arguments: Any, _: Any) -> tuple[float, float]:
        contact = arguments[0].contact
        span = contact.coupling.bore.span
        return float(contact.moments), float(span.stop - span.start)

    watched = {
        "mesh": (body, "mesh_drawing"), "assemble": (body, "elastic_space"),
        "piece": (pieces, "_piece"), "cuts": (pieces, "_between"),
        "condense": (assembly, "condense_bodies"),
        "engine": (assembly, "engine_of"), "assembly": (assembly, "discretise_bodies"),
        "pair": (press, "couple_lines"), "influence": (Condensed, "influence"), "band": (Band, "add_product", product),
        "respond": (CondensedProblem, "respond", moments), "lu": (sla.lapack, "dgetrf", size),
        "matrix": (CondensedProblem, "matrix"), "vector": (condensed, "_product", vector),
        "newton": (press, "newton"), "trial": (Press, "trial"),
        "back": (Body, "back_substitute"),
        "stress": (StressEvaluator, "stress", lambda arguments, _: arguments[0]._operator.size * arguments[1].shape[1]),
        "von_mises": (stress, "von_mises", lambda arguments, _: arguments[0].size),
        "stresses": (stress, "_evaluate"),
    }  # fmt: skip
    with ExitStack() as stack:
        w = {name: stack.enter_context(Watch(*what)) for name, what in watched.items()}
        started = time.process_time()
        solution = solve(scene)
        whole = time.process_time() - started
    lu3, lu2 = sum(n**3 for n in w["lu"].notes), sum(n**2 for n in w["lu"].notes)
    flops, moved = (sum(note[k] for note in w["band"].notes) for k in (0, 1))
    pairs = 4.0 * sum(n**2 + m**2 for n, m in w["respond"].notes)  # entries of the axle's and the wheel's compliance
    entries, equivalent, read = (sum(w[name].notes) for name in ("stress", "von_mises", "vector"))
    t = {name: watch.cpu_s for name, watch in w.items()}
    out = [
        Cost("set-up: meshes (gmsh)", t["mesh"]),
        Cost("set-up: spaces and matrices (dolfinx, or as kept)", t["assembly"] - t["mesh"]),
        Cost("set-up: pieces of the bodies (CHOLMOD)", t["piece"]),
        Cost("set-up: compliance between their cuts", t["cuts"]),
        Cost("set-up: condensing, rest", t["condense"] - t["piece"] - t["cuts"]),
        Cost("set-up: influence of whole facets", t["engine"]),
        Cost("increments: pairing of the lines", t["pair"]),
        Cost("increments: wheel's influence, products", t["band"], flops, moved),
        Cost("increments: influence, rest", t["influence"] - t["band"]),
        Cost("increments: matrices from it", t["matrix"] - t["influence"]),
        Cost("increments: LU factors", t["lu"], 2.0 / 3.0 * lu3, WORD * lu2),
        Cost("increments: responses", t["respond"], 2.0 * pairs, WORD * pairs),
        Cost("increments: Newton's steps, rest", t["newton"] - t["matrix"] - t["lu"] - t["respond"]),
        Cost("increments: displacements", t["vector"], 2.0 * read, WORD * read),
        Cost("increments: trials, rest", t["trial"] - t["pair"] - t["newton"] - t["vector"]),
        Cost("stresses: factors and solutions (CHOLMOD)", t["back"]),
        Cost("stresses: from displacements", t["stress"], 2.0 * entries),
        Cost("stresses: von Mises", t["von_mises"], 3.0 * equivalent, WORD * equivalent),
        Cost("stresses: rest", t["stresses"] - t["back"] - t["stress"] - t["von_mises"]),
    ]
    assert len(solution.increments) == len(scene.displacements)
    return [*out, Cost("rest", whole - sum(cost.seconds for cost in out))]


def main(words: Sequence[str]) -> int:
    """Print the table, draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks press_profile", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, few increments, once")
    parser.add_argument("--preset", choices=list(PRESETS), help="mesh of this preset")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(words)
    small = ["mesh.seat_facet=5", "motion.travel=40", "motion.increment=5"] if options.quick else []
    scene = load_scene("wheelset", [*small, *([f"preset={options.preset}"] if options.preset else [])])
    machine = rates(400 if options.quick else 2000, 2**20 if options.quick else 2**25)
    costs = medians(1 if options.quick else 5, lambda: stages(scene))
    whole = sum(cost.seconds for cost in costs)
    print(f"{machine}; the whole run takes {whole:.2f} CPU s.\n")
    print(head("stage", "CPU [ms]", "share", "Mflop", "MB", "floor [ms]", "time over floor"))
    for cost in costs:
        print(line(cost, machine, whole))
    if options.figure:
        draw(costs, options.figure)
    return 0


def draw(costs: Sequence[Cost], target: Path) -> None:
    """Milliseconds of each stage, set-up, increments and stresses in colours."""
    from matplotlib.figure import Figure

    colours = {"set-up": "#0072B2", "increments": "#D55E00", "stresses": "#009E73"}
    figure = Figure(figsize=(7.0, 5.0), dpi=150, layout="constrained")
    axes = figure.subplots()
    place = np.arange(len(costs))[::-1]
    axes.barh(
        place, [1e3 * cost.seconds for cost in costs],
        color=[colours.get(cost.stage.partition(":")[0], "0.6") for cost in costs], height=0.7,
    )  # fmt: skip
    axes.set_yticks(place, [cost.stage for cost in costs], fontsize=8)
    axes.set_xlabel("CPU time of a warm run of wheelset [ms]")
    axes.spines[["top", "right"]].set_visible(False)
    save(figure, target)
