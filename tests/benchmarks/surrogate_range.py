"""How exact is the network in each part of its range?

    python -m tests.benchmarks surrogate_range [--quick]

The shipped network on unseen pairs of the wide design that come with the package, on more pairs of its rough part,
three packings of spheres each, and on nine packings of pairs of its roughest. Error: mean relative error against the
mean over the packings, micro coefficients from 0.05 on where none is named. Floor: what so few packings leave to
chance. Beyond: root of error^2 - floor^2, the network's own part of the error. Over mean: error of all pairs over their
mean coefficient. From few pairs: where the share of all pairs inside the stated 90 % lies (95 %), judged by so few.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from surrogate.evaluation.parts import interval_text
from surrogate.evaluation.run import evaluate_network
from surrogate.network.shipped import NETWORK, ROUGH_EVALUATION, ROUGHEST_EVALUATION, WIDE_EVALUATION

from ._measure import head, row

COLUMNS = {
    "error %": "error", "std. err.": "standard_error", "floor %": "floor", "beyond %": "error_beyond_floor",
    "over mean %": "error_over_mean", "inside 90 %": "coverage_90",
}  # fmt: skip


def part(name: str, found: Mapping[str, Any]) -> str:
    """The row of a part."""
    r2 = "-" if found["r2_b"] is None else f"{found['r2_b']:.3f}"
    shares = (f"{100.0 * found[key]:.2f}" for key in COLUMNS.values())
    return row(name, str(found["pairs"]), *shares, interval_text(found), r2)


def main(words: Sequence[str]) -> int:
    """Print a table of the whole range, one of its rough part, and one of its roughest."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_range", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the roughest part alone")
    options = parser.parse_args(words)
    tables = [WIDE_EVALUATION, ROUGH_EVALUATION, ROUGHEST_EVALUATION]
    for database in tables[-1:] if options.quick else tables:
        with tempfile.TemporaryDirectory() as folder:
            said, _ = evaluate_network(database, NETWORK, (), Path(folder))
        print(head("part", "pairs", *COLUMNS, "from few pairs", "R2 of b"))
        print(*(part(name, found) for name, found in said["parts"].items()), "", sep="\n")
    return 0
