"""Where does the time of the plates go, and how far is each cost from its floor?

    python -m tests.benchmarks meso_profile [--quick]

A warm run of the built-in default (3000 spheres, packings cached), quasi-static and explicit. For each stage: CPU
seconds (median of repeats), operations and bytes counted from the shapes of its arrays (each array once), the floor
max(operations / rate of dgemm, bytes / rate of daxpy) at the rates of this machine measured in this run, and the time
over the floor. Stages without a floor sort, search or allocate. Inside a Newton iteration the kernels are timed one by
one, the loop around them interpreted; "contact law, rest" is what the compiled loop takes more than they do.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
from scipy.linalg import lapack

from meso import kernels, plates
from meso.engines import explicit
from meso.engines.explicit import Explicit
from meso.engines.quasistatic import QuasiStatic
from meso.lattice.cholmod import Factor
from meso.lattice.lattice import Lattice
from meso.plates import Plates, make_plates
from meso.settings import load

from ._measure import head
from ._profile import WORD, Cost, Watch, line, medians, rates

BOND_FLOPS, NODE_FLOPS = 2 * 105.0, 42.0
"""Of `kernels.beam` with the sums, seen from both ends, and of a node's leapfrog step."""
BOND_BYTES, NODE_BYTES = 13 * WORD, 30 * WORD
"""Of a beam and its end, from both ends; of u read and written elsewhere, of v in place, and of two masses."""
COUPLING_FLOPS = 114.0
"""Of `kernels.coupling`, for one plate."""


def preparation(overrides: Sequence[str]) -> list[Cost]:
    """From settings to both plates, the flat packings from memory."""
    settings = load(None, overrides)
    with Watch(plates, "morph") as morphed, Watch(plates, "build") as built:
        started = time.process_time()
        made = make_plates(settings)
        whole = time.process_time() - started
    started = time.process_time()
    made.likely_approach()
    searched = time.process_time() - started
    lattice = made.wheel.beams.nbytes + made.axle.beams.nbytes
    return [
        Cost("plates: packings carried onto the surfaces", morphed.cpu_s),
        Cost("plates: lattices", built.cpu_s, 0.0, lattice),
        Cost("plates: surfaces, rest", whole - morphed.cpu_s - built.cpu_s),
        Cost("plates: first touch, likely approach", searched),
    ]


def condensation(made: Plates) -> list[Cost]:
    """Set-up of the quasi-static engine: factors and dense compliances of both plates."""
    names = ("_order", "_analyse", "_factorize", "trailing_block", "compliance")
    with ExitStack() as stack:
        order, analysis, numeric, trailing, dense = (
            stack.enter_context(Watch(Factor, name, lambda arguments, result: (arguments[0], result))) for name in names
        )
        assembled = stack.enter_context(Watch(Lattice, "stiffness", lambda _, K: K.nnz))
        inverse = stack.enter_context(Watch(lapack, "dpotri"))
        started = time.process_time()
        QuasiStatic(made)
        whole = time.process_time() - started
    factors = [factor for factor, _ in numeric.notes]
    sizes = np.array([len(compliance) for _, compliance in dense.notes], dtype=np.float64)
    triangles = WORD * float(np.sum(sizes**2)) / 2.0
    flops, inverted = sum(f.flops for f in factors), 2.0 / 3.0 * float(np.sum(sizes**3))
    mirrored = dense.cpu_s - trailing.cpu_s - inverse.cpu_s
    parts = assembled.cpu_s + order.cpu_s + analysis.cpu_s + numeric.cpu_s + dense.cpu_s
    return [
        Cost("set-up: stiffness matrices", assembled.cpu_s, 0.0, 1.5 * WORD * sum(assembled.notes)),
        Cost("set-up: AMD's order", order.cpu_s),
        Cost("set-up: symbolic factors", analysis.cpu_s),
        Cost("set-up: numeric factors", numeric.cpu_s, flops, WORD * sum(f.entries for f in factors)),
        Cost("set-up: candidates' block copied", trailing.cpu_s, 0.0, 2.0 * triangles),
        Cost("set-up: dense compliances (dpotri)", inverse.cpu_s, inverted, 2.0 * triangles),
        Cost("set-up: compliances mirrored", mirrored, 0.0, 2.0 * triangles),
        Cost("set-up: candidates, rest", whole - parts),
    ]  # fmt: skip


def newton_slide(engine: QuasiStatic) -> list[Cost]:
    """A second slide of the same plates."""
    with Watch(kernels, "solve_increment") as settled:
        started = time.process_time()
        engine.slide(0.07)
        whole = time.process_time() - started
    loads, load_s, sizes, step_s = replayed(engine, recorded(engine))
    solved = solutions(sizes)
    touching = np.array(sizes, dtype=np.float64)
    square, cube = float(np.sum(touching**2)), float(np.sum(touching**3))
    matrices = (COUPLING_FLOPS + 54.0) * square  # of both plates, half of the contacts with each other
    return [
        Cost("slide: displacements of both plates", load_s, 72.0 * loads, 36 * WORD * loads),
        Cost("slide: matrices of the Newton steps", step_s - solved, matrices, 36 * WORD * square),
        Cost("slide: solutions of the Newton steps", solved, 18.0 * cube, 9 * WORD * square),
        Cost("slide: contact law, rest", settled.cpu_s - load_s - step_s),
        Cost("slide: Python around it", whole - settled.cpu_s),
    ]  # fmt: skip


def recorded(engine: QuasiStatic) -> list[tuple[Any, ...]]:
    """What the kernels inside of the Newton iterations of a slide are called with, in order, of the rows they read."""
    calls: list[tuple[Any, ...]] = []

    def load(arguments: Any, _: Any) -> None:
        near, forces, normal = arguments[2], arguments[5], arguments[6]
        calls.append((near.copy(), forces[near], normal[near]))

    def step(arguments: Any, _: Any) -> None:
        touching, (normal, tangent, answer, forces) = arguments[2], arguments[5:9]
        calls.append((touching.copy(), forces[touching], normal[touching], tangent[touching], answer[touching]))

    compiled = kernels.solve_increment
    kernels.solve_increment = compiled.py_func
    try:
        with Watch(kernels, "load_plates", load), Watch(kernels, "newton_step", step):
            engine.slide(0.07)
    finally:
        kernels.solve_increment = compiled
    return calls


def replayed(engine: QuasiStatic, calls: Sequence[tuple[Any, ...]]) -> tuple[int, float, list[int], float]:
    """Blocks of compliance that displacements read, and their CPU time; contacts of the Newton steps, and theirs."""
    count = len(engine.pair)
    wheel, axle = engine.compliances
    uw, ua = np.zeros((len(wheel) // 6, 6)), np.zeros((len(axle) // 6, 6))
    forces, normal, answer, change = (np.zeros((count, 3)) for _ in range(4))
    tangent, law = np.zeros((count, 3, 3)), engine.candidates.parameters
    blocks, load_s, sizes, step_s = 0, 0.0, [], 0.0
    for contacts, force, direction, *more in calls:
        forces[contacts], normal[contacts] = force, direction
        if more:
            tangent[contacts], answer[contacts] = more
            started = time.process_time()
            kernels.newton_step(wheel, axle, contacts, engine.pair, law, normal, tangent, answer, forces, 0.0, change)
            step_s += time.process_time() - started
            sizes.append(len(contacts))
        else:
            started = time.process_time()
            kernels.load_plates(wheel, axle, contacts, engine.pair, law, forces, normal, uw, ua)
            load_s += time.process_time() - started
            nodes = sum(len(np.unique(engine.pair[contacts, side])) for side in (0, 1))
            blocks += np.count_nonzero(force.any(axis=1)) * nodes
    return blocks, load_s, sizes, step_s


def solutions(sizes: Sequence[int]) -> float:
    """CPU time of dense solutions with three unknowns for each of so many contacts."""
    taken = 0.0
    for size in sizes:
        a, b = np.asfortranarray(np.eye(3 * size) + 1e-3), np.ones(3 * size)
        started = time.process_time()
        lapack.dgesv(a, b, overwrite_a=1, overwrite_b=1)
        taken += time.process_time() - started
    return taken


def dynamic_run(made: Plates, steps: int) -> list[Cost]:
    """Set-up and slide of the explicit engine; the beams' share by marching the same lattice without contact."""
    with (
        Watch(explicit, "critical_time_step") as limit,
        Watch(kernels, "run_leapfrog", lambda arguments, _: arguments[-2]) as run_leapfrog,
    ):
        started = time.process_time()
        engine = Explicit(made)
        prepared = time.process_time() - started
        slide = engine.slide(0.07)
    lattice = made.lattice
    u, v = np.zeros((lattice.nodes, 6)), np.random.default_rng(0).normal(size=(lattice.nodes, 6))
    started = time.process_time()
    kernels.leapfrog(u, v, lattice.blocks, lattice.twist, engine.time_step, 0.0, steps)
    beams = (time.process_time() - started) / steps * slide.steps
    bonds, nodes = len(lattice.cols) * slide.steps, lattice.nodes * slide.steps
    flops, moved = BOND_FLOPS * bonds + NODE_FLOPS * nodes, BOND_BYTES * bonds + NODE_BYTES * nodes
    return [
        Cost("explicit: critical time step", limit.cpu_s),
        Cost("explicit: candidates, rest of the set-up", prepared - limit.cpu_s),
        Cost("explicit: beams and leapfrog", beams, flops, moved),
        Cost("explicit: contacts", run_leapfrog.cpu_s - beams),
        Cost("explicit: Python around it", slide.cpu_s - run_leapfrog.cpu_s),
    ]  # fmt: skip


def main(words: Sequence[str]) -> int:
    """Print the rates and the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_profile", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="900 spheres, one repeat")
    quick = parser.parse_args(words).quick
    repeats = 1 if quick else 5
    overrides = ["plates.spheres=900", "engine.speed=100000"] if quick else []
    machine = rates(400 if quick else 2000, 2**20 if quick else 2**25)
    made = make_plates(load(None, overrides))
    costs = medians(repeats, lambda: preparation(overrides))
    costs += medians(repeats, lambda: condensation(made))
    engine = QuasiStatic(made)
    costs += medians(repeats, lambda: newton_slide(engine))
    costs += medians(1 if quick else 3, lambda: dynamic_run(made, 200 if quick else 4000))
    print(f"{machine}.\n")
    print(head("stage", "CPU [ms]", "Mflop", "MB", "floor [ms]", "time over floor"))
    for cost in costs:
        print(line(cost, machine))
    return 0
