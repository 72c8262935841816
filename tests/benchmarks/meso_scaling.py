"""How do time and memory of the plates grow with the spheres?

    python -m tests.benchmarks meso_scaling [--quick] [--figure FILE]

The plates stay as large as the default's (wheel 1 x 1 x 0.3 mm, axle 2 x 1 x 0.3 mm, both together hold the spheres);
the spheres become finer, so that the faces hold n^(2/3) of them and a slide takes n^(1/3) more time steps. Every size
runs in a process of its own, warmed by a toy: CPU seconds of each stage (once), the peak of the process's memory after
it, and counts that do not depend on the machine. An exponent k stands for cost ~ n^k, fitted from 3000 spheres on.
In three dimensions one expects 1 of lattices, a single step and candidates; 4/3 of packing, of an explicit slide and
of a factor's entries; 2 of the operations of a factor and of its dense compliance. The quasi-static engine is asked for
by name; left to itself a run takes the explicit one above 14,000 spheres.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from meso import plates
from meso.engines.explicit import Explicit
from meso.engines.linear import Linear
from meso.engines.quasistatic import QuasiStatic
from meso.lattice.cholmod import Factor
from meso.packing import kernels as packing_kernels
from meso.plates import Plates, make_plates
from meso.settings import load

from ._measure import alone, draw_growth, growth, head, peak_memory, row
from ._plates import newton_iterations
from ._profile import Watch

SIZES = {"explicit": (1000, 3000, 10_000, 30_000, 100_000), "quasi-static": (1000, 3000, 10_000, 30_000)}
"""Spheres; the dense compliances and the factors take over 8 GiB at 100,000."""
QUICK = {"explicit": (900, 1500), "quasi-static": (900, 1500)}
FITTED = 3000
"""Spheres from which the exponents are fitted."""
STEPS = 100
"""Time steps of the explicit engine that are measured."""
TOY = 800
Measured = dict[str, tuple[float, float]]
"""By stage the CPU time [s] and the peak of memory after it [MiB]; by count its value."""


def explicit(made: Plates) -> Measured:
    """Set-up of the explicit engine and some of its steps."""
    found: Measured = {}
    _ = made.lattice, made.faces
    timed(found, "first touch", lambda: made.first_touch)
    approach = made.likely_approach()
    low = made.first_touch - 1.4 * approach - 0.002
    timed(found, "candidates", lambda: made.candidates(low, made.first_touch, 0.003))
    engine = timed(found, "explicit set-up", lambda: Explicit(made))
    body = Linear(made.lattice, dt=engine.time_step, micro_friction=0.07, candidates=engine.candidates)
    body.drive[2] = made.first_touch - approach
    speed, damping = made.settings.engine.speed, made.settings.engine.squeeze_damping
    timed(found, "explicit step", lambda: body.advance(STEPS, (speed, 0.0, 0.0), damping=damping), 1.0 / STEPS)
    steps = np.ceil(made.settings.load.slide / speed / engine.time_step)
    found["explicit slide"] = (steps * found["explicit step"][0], found["explicit step"][1])
    return found | {"candidates, count": (len(engine.candidates.pair), 0.0), "time steps of a slide": (steps, 0.0)}


def quasi_static(made: Plates) -> Measured:
    """Condensation of both plates, and a slide."""
    found: Measured = {}
    made.likely_approach()
    with (
        Watch(Factor, "_factorize", lambda arguments, _: (arguments[0].entries, arguments[0].flops)) as factors,
        Watch(Factor, "compliance", lambda _, result: len(result)) as dense,
    ):
        engine = timed(found, "condensation", lambda: QuasiStatic(made))
    with newton_iterations() as newton:
        timed(found, "quasi-static slide", lambda: engine.slide(0.07))
    found |= {"factorisation": (factors.cpu_s, 0.0), "dense compliance": (dense.cpu_s, 0.0)}
    entries, operations = np.sum(factors.notes, axis=0)
    return found | {
        "candidates": (sum(dense.notes) / 6, 0.0),
        "entries of the factors": (entries, 0.0),
        "operations of the factors": (operations, 0.0),
        "Newton iterations": (sum(newton.notes), 0.0),
    }


def timed(found: Measured, stage: str, work: Callable[[], object], scale: float = 1.0):  # type: ignore[no-untyped-def]
    """The result of some work; its cost goes to `found`."""
    started = time.process_time()
    result = work()
    found[stage] = (scale * (time.process_time() - started), peak_memory())
    return result


def stages(engine: str, spheres: int) -> None:
    """Print what one size costs: name = CPU time and memory, spaces as underscores."""
    measure = {"explicit": explicit, "quasi-static": quasi_static}[engine]
    measure(make_plates(load(None, [f"plates.spheres={TOY}", "load.pressure=100"])))
    settings = load(None, [f"plates.spheres={spheres}"])
    found: Measured = {}
    with (
        Watch(plates, "flat_packing") as flat,
        Watch(plates, "morph") as morphed,
        Watch(plates, "build") as built,
        Watch(packing_kernels, "quench", lambda _, iterations: iterations) as quench,
    ):
        made = timed(found, "plates", lambda: make_plates(settings))
    peak = found.pop("plates")[1]
    if engine == "explicit":  # the other one finds the packings in the cache
        found = {"packing": (flat.cpu_s, peak), "morphing": (morphed.cpu_s, peak), "lattices": (built.cpu_s, peak)}
        beams = len(made.wheel.cols) + len(made.axle.cols)
        found |= {"beams": (beams, 0.0), "relaxations": (sum(quench.notes), 0.0)}
    for name, (value, memory) in (found | measure(made)).items():
        print(name.replace(" ", "_"), value, memory)


def table(engine: str, sizes: Sequence[int]) -> dict[str, tuple[list[float], list[float]]]:
    """Values and memory of each stage and count, over the sizes."""
    found: dict[str, tuple[list[float], list[float]]] = {}
    for spheres in sizes:
        words = alone(f"from tests.benchmarks.meso_scaling import stages; stages({engine!r}, {spheres})")[:-1]
        for name, value, memory in zip(words[::3], words[1::3], words[2::3], strict=True):
            values, peaks = found.setdefault(name.replace("_", " "), ([], []))
            values.append(float(value))
            peaks.append(float(memory))
    return found


def exponent(sizes: Sequence[int], values: Sequence[float]) -> str:
    """Of the growth over the sizes that are not toys."""
    kept = [k for k, size in enumerate(sizes) if size >= FITTED and values[k] > 0.0]
    return f"{growth([sizes[k] for k in kept], [values[k] for k in kept]):.2f}" if len(kept) > 1 else "-"


def main(words: Sequence[str]) -> int:
    """Print the tables, draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_scaling", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two toys")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(words)
    drawn = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MACROFIT_CACHE"] = folder
        for engine, sizes in (QUICK if options.quick else SIZES).items():
            found = table(engine, sizes)
            columns = [f"{size}" for size in sizes]
            print(f"\n{engine}: CPU seconds, and counts\n")
            print(head("spheres", *columns, "exponent"))
            for name, (values, _) in found.items():
                print(row(name, *(f"{value:.3g}" for value in values), exponent(sizes, values)), flush=True)
            print(f"\n{engine}: peak of memory after the stage [MiB]\n")
            print(head("spheres", *columns))
            for name, (_, peaks) in found.items():
                if all(peaks):
                    print(row(name, *(f"{peak:.0f}" for peak in peaks)))
            first = 0 if options.quick else sum(size < FITTED for size in sizes)
            drawn |= {name: (sizes[first:], found[name][0][first:]) for name in found}
    if options.figure:
        draw(drawn, options.figure)
    return 0


def draw(found: dict[str, tuple[Sequence[float], Sequence[float]]], target: Path) -> None:
    """CPU time of the dearer stages against the spheres."""
    shown = ("packing", "morphing", "lattices", "candidates", "explicit slide", "condensation", "quasi-static slide")
    draw_growth({name: found[name] for name in shown}, target, "spheres of both plates", "CPU time [s]")
