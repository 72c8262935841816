"""How exact is the network in each part of its range?

    python -m tests.benchmarks surrogate_range [--quick]

The shipped network on unseen pairs of the wide design that come with the package, and on more pairs of its rough part,
three packings of spheres each. Error: mean relative error against the mean over the packings, micro coefficients from
0.05 on where none is named. Floor: what so few packings leave to chance. Beyond: root of error^2 - floor^2, the
network's own part of the error. Over mean: error of all pairs over their mean coefficient.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from surrogate.evaluation.run import evaluate_network
from surrogate.network.shipped import NETWORK, ROUGH_EVALUATION, WIDE_EVALUATION

from ._measure import head, row

COLUMNS = {
    "error %": "error", "std. err.": "standard_error", "floor %": "floor", "beyond %": "error_beyond_floor",
    "over mean %": "error_over_mean", "inside 90 %": "coverage_90",
}  # fmt: skip


def part(name: str, found: Mapping[str, Any]) -> str:
    """The row of a part."""
    r2 = "-" if found["r2_b"] is None else f"{found['r2_b']:.3f}"
    return row(name, str(found["pairs"]), *(f"{100.0 * found[key]:.2f}" for key in COLUMNS.values()), r2)


def main(words: Sequence[str]) -> int:
    """Print a table of the whole range, and one of its rough part."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_range", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the rough part alone")
    options = parser.parse_args(words)
    for database in [ROUGH_EVALUATION] if options.quick else [WIDE_EVALUATION, ROUGH_EVALUATION]:
        with tempfile.TemporaryDirectory() as folder:
            said, _ = evaluate_network(database, NETWORK, (), Path(folder))
        print(head("part", "pairs", *COLUMNS, "R2 of b"))
        print(*(part(name, found) for name, found in said["parts"].items()), "", sep="\n")
    return 0
