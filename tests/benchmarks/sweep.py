"""Does every increment of every built-in scene converge, whatever the friction and the Nitsche parameter?

    python -m tests.benchmarks sweep [SCENE ...] [--set key=value ...]

Prints a Markdown table and ends with 1 where a run failed or an increment did not converge. Cutbacks are no failure
but are shown. ``--set mesh.seat_facet=4`` makes a quick one.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from macrofit.errors import MacrofitError
from macrofit.scene import load_scene, scene_names
from macrofit.solve import solve

FRICTION = (0.0, 0.01, 0.11, 0.6)
GAMMA0 = (1.0, 10.0, 100.0, 1000.0)
NO_FIELDS = ("output.stress=false", "output.fields_at=[]", "output.frames=0")


@dataclass(frozen=True)
class Case:
    """One run of the sweep; ``trouble`` is empty where every increment converged."""

    scene: str
    friction: float
    gamma0: float
    increments: int
    newton_iterations: int
    most_iterations: int  # in one increment
    cutbacks: int
    peak_force: float  # N
    cpu_s: float
    trouble: str

    @property
    def row(self) -> str:
        """The case as a row of the table."""
        return (
            f"| {self.scene} | {self.friction:g} | {self.gamma0:g} | {self.increments} "
            f"| {self.newton_iterations} | {self.most_iterations} | {self.cutbacks} | {self.peak_force:.6g} "
            f"| {self.cpu_s:.1f} | {self.trouble or 'no'} |"
        )


HEADER = (
    "| scene | friction | gamma0 | increments | Newton iterations | most in one | cutbacks | peak force [N] "
    "| CPU [s] | trouble |\n|---|---|---|---|---|---|---|---|---|---|"
)


def run(scene: str, friction: float, gamma0: float, overrides: Sequence[str] = ()) -> Case:
    """Solve one scene; an error of the solver becomes the case's trouble."""
    uniform = ("friction.provider=uniform", f"friction.options={{coefficient = {friction}}}")
    changes = [*NO_FIELDS, *uniform, f"contact.gamma0={gamma0}", *overrides]
    started = time.process_time()
    try:
        records = solve(load_scene(scene, changes)).increments
    except MacrofitError as error:
        cpu = time.process_time() - started
        return Case(scene, friction, gamma0, 0, 0, 0, 0, float("nan"), cpu, f"{type(error).__name__}: {error}")
    loose = [record.displacement for record in records if not record.converged]
    iterations = [record.newton_iterations for record in records]
    return Case(
        scene,
        friction,
        gamma0,
        len(records),
        sum(iterations),
        max(iterations),
        sum(record.cutbacks for record in records),
        max(abs(record.force) for record in records),
        time.process_time() - started,
        f"not converged at {loose}" if loose else "",
    )


def sweep(scenes: Sequence[str], overrides: Sequence[str] = ()) -> Iterator[Case]:
    """Every scene with every friction and every gamma0."""
    for scene, friction, gamma0 in product(scenes, FRICTION, GAMMA0):
        yield run(scene, friction, gamma0, overrides)


def main(words: Sequence[str]) -> int:
    """Run the sweep and print its table; 1 where anything failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="built-in scenes; all of them by default")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--quick", action="store_true", help="contact-patch alone, with elements of order 1")
    arguments = parser.parse_args(words)
    if arguments.quick:
        arguments.scenes, arguments.overrides = ["contact-patch"], [*arguments.overrides, "mesh.order=1"]
    print(HEADER)
    failed = 0
    for case in sweep(arguments.scenes or scene_names(), arguments.overrides):
        print(case.row, flush=True)
        failed += bool(case.trouble)
    print(f"\n{failed} runs in trouble")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
