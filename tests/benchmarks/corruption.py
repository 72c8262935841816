"""Is a flipped bit or a cut in a file that is read back ever taken for what was written?

    python -m tests.benchmarks corruption [--flips 280] [--cuts 40] [--seed 1] [--quick]

Each kind of file that the software writes and reads back, with one bit flipped (half of the places anywhere, half near
the ends, where heads are) or cut short. What is read must be what was written; otherwise one line refuses the file, or
a warning says that what it held is made anew. A journal that is cut is what a kill leaves: its whole frames are read.
Ends with 1 where anything else came of one. Each is read in a process of its own.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from macrofit.base.errors import MacrofitError

from ._alone import WELL, alone
from ._kept_files import KINDS, Content, Kind
from ._measure import head, row

QUICK = 6
NEAR = 1000
"""Bytes at the ends that are hit more often."""
MOST_BYTES = 8 * 10**9
"""Of the address space: torch alone takes several GB of it."""
SAME, REFUSED, ANEW, SHORTER = "read the same", "refused in a line", "made anew, warned", "cut as by a kill"
LOST, CHANGED, TRACEBACK = "silent losses", "changed numbers", "tracebacks, aborts, hangs"
GOOD, BAD = (SAME, REFUSED, ANEW, SHORTER), (LOST, CHANGED, TRACEBACK)


def main(words: Sequence[str]) -> int:
    """Print a row of each kind of file."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks corruption", description=__doc__.splitlines()[0])
    parser.add_argument("--flips", type=int, default=280, help="of each kind")
    parser.add_argument("--cuts", type=int, default=40, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} flips and cuts of each kind")
    options = parser.parse_args(words)
    flips, cuts = (QUICK, QUICK) if options.quick else (options.flips, options.cuts)
    print(head("file", "kB", "flips", "cuts", *GOOD, *BAD))
    wrong = []
    for number, (name, kind) in enumerate(KINDS.items()):
        with tempfile.TemporaryDirectory() as folder:
            path = kind.make(Path(folder))
            whole, counts = path.read_bytes(), Counter[str]()
            true = kind.read(path)
            rng = np.random.default_rng([options.seed, number])
            for what, data in damaged(whole, rng, flips, cuts):
                path.write_bytes(data)
                said, why = bounded(kind, path, true, cut=len(data) < len(whole))
                counts[said] += 1
                wrong += [f"{name}, {what}: {said}: {why}"] if said in BAD else []
        print(row(name, f"{len(whole) / 1e3:.3g}", flips, cuts, *(counts[said] for said in (*GOOD, *BAD))), flush=True)
    print(f"\nSeed {options.seed}.")
    print("".join(f"\n- {line.splitlines()[0]}" for line in wrong))
    print("\n".join(wrong), file=sys.stderr)
    return int(bool(wrong))


def damaged(whole: bytes, rng: np.random.Generator, flips: int, cuts: int) -> Iterator[tuple[str, bytes]]:
    """What was done to a file, and the file."""
    near = np.concatenate([np.arange(min(NEAR, len(whole))), np.arange(max(0, len(whole) - NEAR), len(whole))])
    for k in range(flips):
        place = int(rng.choice(near)) if k % 2 else int(rng.integers(len(whole)))
        bit, spoilt = int(rng.integers(8)), bytearray(whole)
        spoilt[place] ^= 1 << bit
        yield f"bit {bit} of byte {place}", bytes(spoilt)
    for k in range(cuts):
        length = (0, 1, len(whole) - 1)[k] if k < 3 else int(rng.integers(len(whole)))
        yield f"cut to {length} bytes", whole[:length]


def bounded(kind: Kind, path: Path, true: Content, *, cut: bool) -> tuple[str, str]:
    """What became of a damaged file in a process of its own, and why."""
    told, how = alone(
        lambda: "\n".join(judged(kind, path, true, cut=cut)), most_cpu_s=20, most_wall_s=30.0, most_bytes=MOST_BYTES
    )
    if how != WELL:
        return TRACEBACK, f"{how}: {told}"
    said, _, why = told.partition("\n")
    return said, why


def judged(kind: Kind, path: Path, true: Content, *, cut: bool) -> tuple[str, str]:
    """What the reader makes of a damaged file, and what it says."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            found = kind.read(path)
        except MacrofitError as error:
            line = str(error)
            return (REFUSED, line) if line.strip() and "\n" not in line else (TRACEBACK, f"no line: {line}")
        except Exception:
            return TRACEBACK, traceback.format_exc()
    assert true is not None
    if said:
        warned = str(said[0].message)
        return (ANEW, warned) if found is None or found == true else (CHANGED, warned)
    if found == true:
        return SAME, ""
    if found is None or all(piece in true for piece in found):
        return (SHORTER, "") if cut and kind.grows and found == true[: len(found or [])] else (LOST, "")
    return CHANGED, ""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
