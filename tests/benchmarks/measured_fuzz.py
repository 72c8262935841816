"""Is a faulty scan ever taken for a sound one without a word?

    python -m tests.benchmarks measured_fuzz [--cases 500] [--first 0] [--quick]

Turned and isotropic surfaces in all formats (`tests/scans.py`), tilted, with offset, curved, with holes and spikes,
transposed, in another unit, too small, constant, cut off, all from seeds. Every second one is a text as strangers write
it (`tests/odd_scans.py`): lines of the head in any order and wording, the spacing in another unit than the heights,
none at all, decimal commas, places in the first row and column, points with columns in any order, broken encodings.

What the loader makes of one is *right* where Sq is within 3 % and Sdq within 10 % of the sound scan's and the lay is
where it was; else it is *warned* of or *refused* in one line, or it is *silent*. Sound scans must be right, but texts
that do not say what they mean may be refused. Ends with 1 where one is silent, or anything else came of one.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.base.errors import MacrofitError
from meso.measured.clean import Scan, lay, slope
from meso.measured.keys import ScanKeys
from meso.surfaces.measured import covering, measured_face, scan_of

from ..odd_scans import OddText, odd_text
from ..scans import WRITERS, textured, turned
from ._measure import head, row

QUICK = 36
Sound = tuple[FloatArray, tuple[float, float]]
Fault = Callable[[np.random.Generator, FloatArray, tuple[float, float]], Sound]


def _tilted(rng: np.random.Generator, h: FloatArray, d: tuple[float, float]) -> Sound:
    x, y = (np.arange(n) * step for n, step in zip(h.shape, d, strict=True))
    return h + rng.normal(0.0, 0.02) * x[:, None] + rng.normal(0.0, 0.02) * y, d


def _curved(rng: np.random.Generator, h: FloatArray, d: tuple[float, float]) -> Sound:
    y = np.arange(h.shape[1]) * d[1]
    return h + (y - y.mean()) ** 2 / rng.uniform(30.0, 200.0), d


def _holes(rng: np.random.Generator, h: FloatArray, d: tuple[float, float]) -> Sound:
    for _ in range(int(rng.integers(1, 30))):
        i, j, size = (int(rng.integers(0, n)) for n in (*h.shape, 9))
        h[i : i + size + 1, j : j + size + 1] = np.nan
    return h, d


def _spikes(rng: np.random.Generator, h: FloatArray, d: tuple[float, float]) -> Sound:
    count = int(rng.integers(1, 80))
    i, j = (rng.integers(0, n, count) for n in h.shape)
    h[i, j] += rng.choice([-1.0, 1.0], count) * np.nanstd(h) * 10.0 ** rng.uniform(1.0, 4.0, count)
    return h, d


def _constant(rng: np.random.Generator, h: FloatArray, d: tuple[float, float]) -> Sound:
    return np.full(h.shape, rng.normal()), d


FAULTS: dict[str, Fault] = {
    "none": lambda rng, h, d: (h, d),
    "tilted": _tilted,
    "offset": lambda rng, h, d: (h + rng.normal(0.0, 1.0), d),
    "curved": _curved,
    "holes": _holes,
    "border missing": lambda rng, h, d: (
        np.pad(h, int(rng.integers(1, 9)), constant_values=np.nan), d
    ),
    "spikes": _spikes,
    "transposed": lambda rng, h, d: (h.T, (d[1], d[0])),
    "heights x 1000": lambda rng, h, d: (1e3 * h, d),
    "heights / 1000": lambda rng, h, d: (1e-3 * h, d),
    "spacing x 1000": lambda rng, h, d: (h, (1e3 * d[0], 1e3 * d[1])),
    "spacing / 1000": lambda rng, h, d: (h, (1e-3 * d[0], 1e-3 * d[1])),
    "all in metres": lambda rng, h, d: (1e-3 * h, (1e-3 * d[0], 1e-3 * d[1])),
    "too small": lambda rng, h, d: (h[: int(rng.integers(3, 0.9 / d[0]))], d),
    "constant": _constant,
    "cut off": lambda rng, h, d: (h, d),
}  # fmt: skip
"""What is done to a sound scan; "cut off" is done to its file."""


def sound(rng: np.random.Generator) -> Sound:
    """A scan of 1.1 to 1.4 mm along and across, square in a third of the cases."""
    step = float(rng.uniform(0.006, 0.014))
    d = (step, step if rng.random() < 0.5 else step * float(rng.uniform(0.7, 1.4)))
    size = rng.uniform(1.1, 1.4, 2)
    shape = (int(size[0] / d[0]), int(size[0 if rng.random() < 0.33 else 1] / d[1]))
    if rng.random() < 0.5:
        return turned(rng, shape, d, float(rng.uniform(0.12, 0.3)), float(rng.uniform(0.001, 0.008))), d
    return textured(rng, shape, d, float(rng.uniform(3e-4, 4e-3))), d


def written(folder: Path, rng: np.random.Generator, sound: Sound, cut: float = 1.0) -> tuple[ScanKeys, OddText]:
    """Write a scan, the first part of it where it is cut off; what a careful user says of it; and the text."""
    if rng.random() < 0.5:
        odd = odd_text(rng, *sound)
    else:
        name = str(rng.choice(list(WRITERS)))
        given = {"spacing": sound[1]} if name.endswith(".npy") else {}
        odd = OddText(name, WRITERS[name](*sound), keys=given, traits=["as instruments write it"])
    path = folder / odd.name
    path.write_bytes(odd.data[: int(cut * len(odd.data))])
    return ScanKeys(files=(str(path),), use="face", **odd.keys), odd


def agree(found: Scan, true: Scan) -> bool:
    """Whether two scans are as rough, as steep, and have the same lay."""
    rough = float(found.heights.std() / true.heights.std())
    steep = slope(found) / slope(true)
    (angle, strength), (other, stronger) = lay(found), lay(true)
    same_lay = abs(angle - other) < 10.0 or max(strength, stronger) < 0.3
    return abs(rough - 1.0) < 0.03 and abs(steep - 1.0) < 0.1 and same_lay


def outcome(seed: int, folder: Path) -> tuple[str, str, str]:
    """What became of the case of a seed: its fault, the outcome, and what was said."""
    rng = np.random.default_rng([seed, 17])
    fault = list(FAULTS)[seed % len(FAULTS)]
    heights, spacing = sound(rng)
    first = folder / "true.npy"
    np.save(first, heights)
    true = scan_of(ScanKeys(files=(str(first),), use="face", spacing=spacing), 0)
    spoilt = FAULTS[fault](rng, heights.copy(), spacing)
    keys, odd = written(folder, rng, spoilt, float(rng.uniform(0.0, 0.999)) if fault == "cut off" else 1.0)
    about = f"{odd.name} ({', '.join(odd.traits)})"
    try:
        keys, assumed = covering(keys, (1.0, 1.0))
        measured_face(keys, "wheel", 0, (1.0, 1.0))
        found = scan_of(keys, 0)
    except MacrofitError as error:
        told = str(error)
        wrong = not told.isprintable() or len(told) > 1000 or (fault == "none" and odd.clear)
        return fault, "wrong" if wrong else "refused", f"{about}: {told}"
    except Exception as error:
        return fault, "wrong", f"{about}: {type(error).__name__}: {error}"
    if agree(found, true):
        return fault, "right", f"{about}: {'; '.join(found.done)}"
    doubts = (*assumed, *found.doubts)
    return fault, "warned" if doubts else "silent", f"{about}: {'; '.join((*found.done, *doubts))}"


def main(arguments: Sequence[str]) -> int:
    """Print a row of each fault."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks measured_fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} cases")
    given = parser.parse_args(arguments)
    counted: dict[str, Counter[str]] = {fault: Counter() for fault in FAULTS}
    bad = []
    with tempfile.TemporaryDirectory() as name:
        for seed in range(given.first, given.first + (QUICK if given.quick else given.cases)):
            fault, what, told = outcome(seed, Path(name))
            counted[fault][what] += 1
            if what in ("silent", "wrong"):
                bad.append(f"seed {seed}, {fault}: {what}: {told}")
    outcomes = ("right", "warned", "refused", "silent", "wrong")
    print(head("fault", "cases", *outcomes))
    for fault, counts in counted.items():
        print(row(fault, counts.total(), *(counts[what] for what in outcomes)))
    total = sum(counted.values(), Counter())
    print(row("all", total.total(), *(total[what] for what in outcomes)))
    print("".join(f"\n- {line}" for line in bad))
    return 1 if bad else 0
