"""How do time and memory of the press-fit grow with mesh, seat, increments, runs and ranks?

    python -m tests.benchmarks scaling [--quick] [--facets] [--figure FILE]

`wheelset`, order 2, each size in a process of its own:

- bulk: elements shrink everywhere but on the contact lines, whose facets stay at 1 mm; 40 increments at 90 mm
- facets: those of both contact lines shrink, and the bulk with them; 20 increments at 90 mm
- seat: seat and a plain ring of the same length, facets of 2 mm; 20 increments, the ring half way
- increments: the whole push in more and more of them, facets of 4 mm
- study: runs with different friction, a short push, facets of 5 mm, files and figures included
- ranks: the whole push on 1, 2 and 4 processes (more than there may be cores): do they agree?

Times are CPU times of a warm process, memory is the largest of the process. Set-up: meshes are kept, stiffnesses are
assembled; the median of three in one process, the first of which takes memory from the system, at a price that varies
tenfold on virtual machines. Condensing is of the second power of the contact line's nodes where they rule, for pieces
of the body are condensed one by one, and of the bulk's unknowns to about 1.2 where these do. An increment is of the
second power of the moments in contact to fill its matrix, and of the third to factor it. Facets below 0.25 mm are left
out: the compliance between all nodes and moments of the contact lines is dense.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

from tests.launcher import launcher_environment

from ._measure import Cost, alone, draw_growth, growth, head, lines, row

ROOT = Path(__file__).parents[2]
SMALL = ("mesh.seat_facet=5", "motion.start=15", "motion.travel=60", "motion.increment=5")
PROGRAM = """
import sys, time
import numpy as np
from mpi4py import MPI
from macrofit.scene import load_scene
from macrofit.solve import solve
scene = load_scene("wheelset", sys.argv[2:])
solve(scene)
MPI.COMM_WORLD.Barrier()
started = time.process_time()
solution = solve(scene)
taken = MPI.COMM_WORLD.gather(time.process_time() - started)
if MPI.COMM_WORLD.rank == 0:
    stress = [extreme.value for extreme in solution.max_von_mises.values()]
    np.savez(sys.argv[1], force=solution.force, stress=stress, taken=taken)
"""


@dataclass(frozen=True)
class Press:
    """What a press-fit of one size cost."""

    dofs: int
    moments: int  # of the seat
    setup: float  # CPU s
    increment: float  # CPU ms
    stress: float  # CPU s, of all increments
    total: float  # CPU s
    newton: int  # steps
    memory: float  # MiB


def press(*overrides: str) -> None:
    """Print what one size costs; the increments are the median of three passes on one assembly."""
    from mpi4py import MPI

    from macrofit.assembly import assemble
    from macrofit.bodies import stiffness
    from macrofit.scene import load_scene
    from macrofit.solve import solve

    stiffness.cache_folder = lambda: None  # what is kept is not read
    solve(load_scene("wheelset", SMALL))  # warm
    scene, setups = load_scene("wheelset", overrides), []
    for _ in range(3):
        assembly = None  # two of them would not share the memory
        started = time.process_time()
        assembly = assemble(scene, MPI.COMM_WORLD)
        setups.append(time.process_time() - started)
    setup = median(setups)
    first = solve(scene, assembly=assembly)
    passes = [first]
    if len(first.increments) < 100:  # stresses are taken once: their factors are kept
        without = load_scene("wheelset", [*overrides, "output.stress=false", "output.fields=[]"])
        passes += [solve(without, assembly=assembly) for _ in range(2)]
    increments = median(solution.increments_cpu_s for solution in passes)
    print(assembly.dofs, assembly.seat.size, setup, 1e3 * increments / len(first.increments), first.stress_cpu_s)
    print(setup + increments + first.stress_cpu_s, first.counters["newton_iterations"])


def against(small: Sequence[str], large: Sequence[str], passes: int) -> None:
    """Print the ratios of increments' CPU times on two assemblies, taken in turn: a machine's mood cancels out."""
    from mpi4py import MPI

    from macrofit.assembly import assemble
    from macrofit.scene import load_scene
    from macrofit.solve import solve

    without = ("output.stress=false", "output.fields=[]")
    scenes = [load_scene("wheelset", [*overrides, *without]) for overrides in (small, large)]
    made = [(scene, assemble(scene, MPI.COMM_WORLD)) for scene in scenes]
    for _ in range(passes):
        few, many = (solve(scene, assembly=assembly).increments_cpu_s for scene, assembly in made)
        print(many / few)


def study(runs: int) -> None:
    """Print what a study of so many runs costs, and its factorisations."""
    from mpi4py import MPI

    from macrofit.study.plan import plan_study
    from macrofit.study.run import carry_out_study

    values = ",".join(f"{0.05 + 0.1 * k / runs:.6f}" for k in range(runs))
    with TemporaryDirectory() as folder:
        for name, count in (("warm", "0.11,0.12"), ("study", values)):
            started = time.process_time()
            plan = plan_study("wheelset", [f"friction.options.coefficient={count}"], SMALL)
            carry_out_study(plan, MPI.COMM_WORLD, Path(folder) / name, resume=False, keep=False, quiet=True)
            taken = time.process_time() - started
    print(taken)


def of_size(*overrides: str) -> Press:
    """What one size costs, in a process of its own."""
    found = alone(f"from tests.benchmarks.scaling import press; press(*{overrides!r})")
    dofs, moments, setup, increment, stress, total, newton, memory = map(float, found)
    return Press(int(dofs), int(moments), setup, increment, stress, total, int(newton), memory)


def around(middle: float, steps: int, *more: str) -> tuple[str, ...]:
    """The keys of ``steps`` increments of 1 mm that end at ``middle`` [mm]."""
    return (f"motion.start={middle - steps}", f"motion.travel={middle}", "motion.increment=1", *more)


def bulk(*, quick: bool) -> tuple[dict[float, Press], Cost]:
    """By unknowns, with the contact lines as they are; and the increment on the most of them over that on the least."""
    sizes = (40.0, 20.0) if quick else (20.0, 4.0, 2.4, 1.6, 1.05)
    fixed = "mesh.seat_facet=8" if quick else "mesh.growth=0.24"
    keys = [around(90.0, 4 if quick else 40, f"mesh.coarse={size}", fixed) for size in sizes]
    found = [of_size(*each) for each in keys]
    call = f"against({keys[0]!r}, {keys[-1]!r}, {1 if quick else 9})"
    ratios = alone(f"from tests.benchmarks.scaling import against; {call}")[:-1]
    return {each.dofs: each for each in found}, Cost(tuple(map(float, ratios)))


def facets(*, quick: bool) -> dict[float, Press]:
    """By unknowns, the facets shrinking."""
    sizes = (8.0,) if quick else (4.0, 2.0, 1.0, 0.5, 0.25)
    found = [of_size(*around(90.0, 4 if quick else 20, f"mesh.seat_facet={size}")) for size in sizes]
    return {each.dofs: each for each in found}


def seats(*, quick: bool) -> dict[float, Press]:
    """By the seat's length [mm]."""
    found = {}
    for length in (50.0,) if quick else (50.0, 100.0, 200.0, 500.0, 1000.0):
        shape = (f"axle.seat_length={length}", f"wheel.hub_length={length}", "wheel.web_thickness=0")
        facet = f"mesh.seat_facet={8.0 if quick else 2.0}"
        found[length] = of_size(*around(0.5 * length, 4 if quick else 20, *shape, facet))
    return found


def pushes(*, quick: bool) -> dict[float, Press]:
    """By the number of increments."""
    numbers, facet = ((10,), 8.0) if quick else ((125, 250, 500, 1000, 2000), 4.0)
    return {n: of_size(f"motion.increment={180.0 / n}", f"mesh.seat_facet={facet}") for n in numbers}


def studies(*, quick: bool) -> dict[float, tuple[float, float]]:
    """CPU seconds and memory [MiB] by the number of runs."""
    found = {}
    for runs in (2,) if quick else (1, 5, 20, 80, 200):
        taken, memory = alone(f"from tests.benchmarks.scaling import study; study({runs})")
        found[runs] = float(taken), float(memory)
    return found


def on_ranks(ranks: int, folder: Path, overrides: Sequence[str]) -> dict[str, np.ndarray]:
    """Forces, stresses and the CPU seconds of each rank."""
    out = folder / f"{ranks}.npz"
    command = ["mpirun", "-n", str(ranks), sys.executable, "-c", PROGRAM, str(out), *overrides]
    done = subprocess.run(
        command, cwd=ROOT, env=launcher_environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True,
        timeout=600, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(done.stderr)
    with np.load(out) as arrays:
        return dict(arrays)


def ranks_table(*, quick: bool) -> tuple[list[str], bool]:
    """The table of ranks, and whether they agree: to the bit on two, to 1e-12 on four."""
    overrides = SMALL if quick else ("mesh.seat_facet=2",)
    with TemporaryDirectory() as folder:
        found = {ranks: on_ranks(ranks, Path(folder), overrides) for ranks in ((1, 2) if quick else (1, 2, 4))}
    rows, agree = [head("ranks", "CPU s of each", "same bits as one", "largest difference of forces, stresses")], True
    for ranks, each in found.items():
        off = [float(np.abs(each[key] - found[1][key]).max() / found[1][key].max()) for key in ("force", "stress")]
        same = all((each[key] == found[1][key]).all() for key in ("force", "stress"))
        agree &= same if ranks <= 2 else max(off) <= 1e-12
        taken = ", ".join(f"{seconds:.2f}" for seconds in each["taken"])
        rows.append(row(ranks, taken, "yes" if same else "no", f"{off[0]:.0e}, {off[1]:.0e}"))
    return rows, agree


COSTS: dict[str, Callable[[Press], float]] = {
    "set-up CPU s": lambda p: p.setup,
    "increment CPU ms": lambda p: p.increment,
    "stresses CPU s": lambda p: p.stress,
    "memory MiB": lambda p: p.memory,
}


def presses_table(title: str, found: dict[float, Press]) -> list[str]:
    """A line for each size, and the exponents."""
    by_dofs = all(size == p.dofs for size, p in found.items())
    between = ["moments of the seat", "Newton steps"] if by_dofs else ["dofs", "moments of the seat", "Newton steps"]
    rows = [head(title, *between, *COSTS)]
    for size, p in found.items():
        counts = [p.moments, p.newton] if by_dofs else [f"{p.dofs:,}", p.moments, p.newton]
        costs = (f"{cost:.3g}" if (cost := of(p)) < 1000.0 else f"{cost:,.0f}" for of in COSTS.values())
        rows.append(row(f"{size:,.0f}", *counts, *costs))
    exponents = (f"{growth(list(found), [of(p) for p in found.values()]):.2f}" for of in COSTS.values())
    return [*rows, row("exponent", *[""] * len(between), *exponents), ""]


def studies_table(found: dict[float, tuple[float, float]]) -> list[str]:
    """A line for each number of runs."""
    rows = [head("runs of a study", "CPU s", "CPU ms of another run", "memory MiB")]
    before = (0.0, 0.0)
    for runs, (taken, memory) in found.items():
        another = f"{1e3 * (taken - before[1]) / (runs - before[0]):.0f}" if before[0] else ""
        rows.append(row(runs, f"{taken:.3g}", another, f"{memory:.0f}"))
        before = (runs, taken)
    return [*rows, ""]


def draw(series: dict[str, tuple[Sequence[float], Sequence[float]]], target: Path) -> None:
    """Every cost over that of the smallest size, against the size over the smallest."""
    relative = {
        name: ([size / sizes[0] for size in sizes], [cost / costs[0] for cost in costs])
        for name, (sizes, costs) in series.items()
    }
    draw_growth(relative, target, "size over the smallest", "CPU time over that of the smallest")


def main(words: Sequence[str]) -> int:
    """Print the tables and what follows from them; 1 where the ranks disagree."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks scaling", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="Toy sizes.")
    parser.add_argument("--figure", type=Path, help="File of the figure.")
    parser.add_argument("--facets", action="store_true", help="The shrinking facets alone.")
    options = parser.parse_args(words)
    quick = options.quick
    if options.facets:
        lines(presses_table("dofs, facets shrinking", facets(quick=quick)))
        return 0
    series: dict[str, tuple[Sequence[float], Sequence[float]]] = {}

    def keep(name: str, found: dict[float, Press], cost: Callable[[Press], float]) -> None:
        series[name] = list(found), [cost(p) for p in found.values()]

    inside, ratio = bulk(quick=quick)
    lines(presses_table("dofs, facets of one length", inside))
    for name in ("set-up CPU s", "increment CPU ms", "stresses CPU s"):
        keep(f"bulk: {name.rpartition(' CPU')[0]}", inside, COSTS[name])
    dofs = list(inside)
    print(
        f"An increment on {dofs[-1]:,.0f} dofs takes {ratio} times as long as on {dofs[0]:,.0f} behind the same "
        f"contact lines, the two taken in turn in one process.\n",
        flush=True,
    )
    shorter = facets(quick=quick)
    lines(presses_table("dofs, facets shrinking", shorter))
    for name in ("set-up CPU s", "increment CPU ms"):
        keep(f"facets: {name.rpartition(' CPU')[0]}", shorter, COSTS[name])
    longer = seats(quick=quick)
    lines(presses_table("seat mm", longer))
    keep("seat: increment", longer, COSTS["increment CPU ms"])
    pushed = pushes(quick=quick)
    lines(presses_table("increments", pushed))
    keep("increments: run", pushed, lambda p: p.total)
    many = studies(quick=quick)
    lines(studies_table(many))
    series["study: runs"] = list(many), [taken for taken, _ in many.values()]
    rows, agree = ranks_table(quick=quick)
    bars = "to the bit" if quick else "to the bit, four to 1e-12"
    lines([*rows, "", f"Two ranks agree with one {bars}." if agree else "The ranks do not agree."])
    if options.figure:
        draw(series, options.figure)
    return int(not agree)
