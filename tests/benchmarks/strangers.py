"""Is a damaged or odd file ever read as something else than what was written into it?

    python -m tests.benchmarks strangers [--cases 1000] [--first 0] [--quick]

Curves, heights, tables of friction and TOML as other programs write them, and all files that the software reads back
(networks, databases, journals, caches), with bits flipped, bytes lost, doubled, cut off or put in, from seeds; and such
as another version might write, whose check sums fit (`tests/fuzz.py`, `_odd_files.py`). A file is read right or refused
in one line; sound ones are never refused. Ends with 1 where anything else came of one.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import msgspec
import numpy as np

from .. import fuzz
from ._alone import WELL, alone
from ._kept_files import KINDS
from ._measure import head, row
from ._odd_files import kept_cases

QUICK = 60
BATCH = 100
"""Files that are read in one process, whose memory is bounded."""
MOST_BYTES = 8 * 10**9
Make = Callable[[np.random.Generator], fuzz.Case]


def main(arguments: Sequence[str]) -> int:
    """Print a row of each kind of file."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks strangers", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} of each kind")
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + (QUICK if given.quick else given.cases))
    print(f"Seeds {seeds.start} to {seeds.stop - 1}.\n")
    print(head("files", "cases", "read right", "refused in a line", "anything else", "time [ms each]"))
    wrong = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        makers: dict[str, Make | None] = dict.fromkeys(fuzz.KINDS)
        makers |= {kind: kept_cases(kind, folder) for kind in KINDS}
        for kind, make in makers.items():
            started = time.perf_counter()
            counted = in_batches(kind, seeds, folder, make)
            each = 1e3 * (time.perf_counter() - started) / len(seeds)
            wrong += [f"{kind}, {line}" for line in counted.wrong]
            right = counted.read + counted.refused - len(counted.wrong)
            print(row(kind, len(seeds), counted.read, counted.refused, len(seeds) - right, f"{each:.1f}"), flush=True)
    print("".join(f"\n- {line}" for line in wrong))
    return 1 if wrong else 0


def in_batches(kind: str, seeds: range, folder: Path, make: Make | None) -> fuzz.Counted:
    """Read the files of these seeds, so many at a time in a process of its own."""
    total = fuzz.Counted()
    for first in range(seeds.start, seeds.stop, BATCH):
        batch = range(first, min(first + BATCH, seeds.stop))
        told, how = alone(
            lambda batch=batch: msgspec.json.encode(asdict(fuzz.run(kind, batch, folder, make))).decode(),  # type: ignore[misc]
            most_cpu_s=300, most_wall_s=300.0, most_bytes=MOST_BYTES,
        )  # fmt: skip
        if how == WELL:
            part = msgspec.json.decode(told, type=fuzz.Counted)
            total.read, total.refused = total.read + part.read, total.refused + part.refused
            total.wrong += part.wrong
        else:
            total.wrong.append(f"seeds {batch.start} to {batch.stop - 1}: the process {how}: {told}")
    return total
