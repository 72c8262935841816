"""What does a wheelset in service cost, and what of that is its journal?

    python -m tests.benchmarks service_cost [--quick]

`wheelset` with a bore of 94.85 mm and corners of 0.5 mm, press and release included, then two revolutions of at least
14 steps with the harmonics of the defaults. Each computation keeps its increments and steps in a folder; the processor
time of keeping them, compression and writing, is taken within that of the whole.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from macrofit.results.journal import Journal
from macrofit.scene import load_scene
from macrofit.service.journal import PRESS, ROTATION, Kept, open_folder
from macrofit.service.run import Course

from ._measure import head, row

SIZES = ("wheel.bore_radius=94.85", "mesh.corner_facet=0.5", "service.steps=14", "service.revolutions=2")
CASES = (
    ("facets of 4 mm, friction 0.2", ("mesh.seat_facet=4", "friction.options.coefficient=0.2")),
    ("facets of 1 mm, friction 0.2", ("mesh.seat_facet=1", "friction.options.coefficient=0.2")),
    ("facets of 1 mm, friction 0.11", ("mesh.seat_facet=1", "friction.options.coefficient=0.11")),
)
QUICK = (("facets of 12 mm, friction 0.2", ("mesh.seat_facet=12", "mesh.coarse=60", "motion.increment=60",
                                            "friction.options.coefficient=0.2", "service.harmonics=1")),)  # fmt: skip


@contextmanager
def timed(owner: type, name: str, taken: list[float]) -> Iterator[None]:
    """The processor time of a method [s], appended call by call."""
    method: Callable[..., Any] = getattr(owner, name)

    def measured(*given: Any) -> Any:
        started = time.process_time()
        try:
            return method(*given)
        finally:
            taken.append(time.process_time() - started)

    with patch.object(owner, name, measured):
        yield


def costs(overrides: Sequence[str]) -> tuple[float, float, int, int]:
    """CPU time of a computation and of its journals [s], how often they were written, and their size [bytes]."""
    scene, taken = load_scene("wheelset", [*SIZES, *overrides]), list[float]()
    with tempfile.TemporaryDirectory() as place, ExitStack() as stack:
        folder = Path(place) / "served"
        for owner in (Journal, Kept):
            stack.enter_context(timed(owner, "append", taken))
        started = time.process_time()
        with open_folder(folder, scene, resume=False) as kept:
            Course(scene, lambda _: None, kept).carry_out()
        whole = time.process_time() - started
        size = sum((folder / name).stat().st_size for name in (PRESS, ROTATION))
    return whole, sum(taken), len(taken), size


def main(words: Sequence[str]) -> int:
    """Print a row of each wheelset."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks service_cost", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh alone")
    options = parser.parse_args(words)
    print(head("wheelset", "CPU [s]", "its journal [s]", "share", "frames", "size [MB]"))
    for name, overrides in QUICK if options.quick else CASES:
        whole, journal, frames, size = costs(overrides)
        print(
            row(name, f"{whole:.1f}", f"{journal:.2f}", f"{journal / whole:.1%}", frames, f"{size / 1e6:.1f}"),
            flush=True,
        )
    return 0
