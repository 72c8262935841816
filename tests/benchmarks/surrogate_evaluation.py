"""How exact is the network on surfaces it has never seen?

    python -m tests.benchmarks surrogate_evaluation [--quick]

The shipped networks on the hundred configurations that come with the package, three packings of spheres each; the one
that learned from envelopes on the database of the same configurations, which holds the envelopes and is made where it
is missing (eight minutes). Mean relative errors and their standard errors over the configurations; beside them the
mean ratio of the pairs, the network's foundations alone, the paper's architecture trained on the same pairs, and the
error of someone who knows the mean over all packings of the same faces.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from surrogate.evaluation.run import evaluate_network
from surrogate.network.shipped import ENVELOPE, EVALUATION, NETWORK, PAPER

from ._database import evaluation_database
from ._measure import head, row

KINDS = ("constant ratio", "foundation alone", "paper's architecture", "network", "network, envelopes", "noise floor")


def percent(found: Mapping[str, Any] | None, key: str, error: str | None = None) -> str:
    """A share of `found` in per cent, with its standard error; empty where there is none."""
    if found is None or found.get(key) is None:
        return ""
    spread = f" ± {100 * found[error]:.2f}" if error else ""
    return f"{100 * found[key]:.2f}{spread}"


def cells(one: Mapping[str, Any], beside: Mapping[str, Any], enveloped: Mapping[str, Any] | None) -> list[str]:
    """Errors against a single packing, in the order of the columns."""
    key, spread = "mean_relative_error", "standard_error"
    return [
        percent(one, "baseline_mean_relative_error"), percent(beside["foundation alone"], key),
        percent(beside["paper"], key), percent(one, key, spread), percent(enveloped, key, spread),
        percent(one, "noise_floor"),
    ]  # fmt: skip


def summary(label: str, said: Any, enveloped: Any, key: str, spread: str | None = None, floor: str = "") -> str:
    """A row of what is known over all micro coefficients."""
    beside = [percent(said["beside"][name], key) for name in ("foundation alone", "paper")]
    return row(label, "", *beside, percent(said, key, spread), percent(enveloped, key, spread), floor)


def main(words: Sequence[str]) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_evaluation", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="without the envelopes, whose database takes minutes")
    options = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        said, _ = evaluate_network(EVALUATION, NETWORK, (PAPER,), Path(folder))
        enveloped = None if options.quick else evaluate_network(evaluation_database(), ENVELOPE, (), Path(folder))[0]
    print(head("mean relative error [%], micro coefficient", *KINDS))
    for micro, one in said["by_micro_friction"].items():
        print(row(micro, *cells(one, one, enveloped and enveloped["by_micro_friction"][micro])))
    print(row("all four", *cells(said, said["beside"], enveloped)))
    key, spread = "mean_relative_error_all_packings", "standard_error_all_packings"
    floor = percent(said, "noise_floor_all_packings")
    print(summary("all four, against the mean of the packings", said, enveloped, key, spread, floor))
    print(summary("median", said, enveloped, "median_relative_error"))
    print(summary("R2 of b, in per cent", said, enveloped, "r2_b"))
    print(summary("inside the stated 90 %", said, enveloped, "coverage_90"))
    print(
        f"\n{said['pairs']} pairs of surfaces, {said['packings']} packings each, contact lost in "
        f"{said['lost_contact']} runs. At 0.07 against the mean of the packings "
        f"{percent(said['by_micro_friction']['0.07'], key, spread)} %. mu_meso is a straight line in mu_micro within "
        f"{said['largest_bend']:.1e}, median {said['median_bend']:.1e}."
    )
    return 0
