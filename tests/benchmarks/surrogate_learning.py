"""How many pairs does a network need, and how sure is its error?

    python -m tests.benchmarks surrogate_learning [DB.h5] [--quick] [--figure docs/surrogate_learning.png] [--paper]

Block cross-validation: the pairs are dealt into ten folds, whole families of surfaces each. For each fold a network
learns from the first n pairs of the others (of which it holds 30 % back itself) and is judged on the fold. Mean over
the folds and its standard error, at micro 0.07 and over 0.03, 0.05, 0.07, 0.09. --paper adds the paper's architecture
on three folds (half an hour). The database is build/bench/train.h5 where none is named, and made where it is missing.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from surrogate.data.database import Samples, read_database
from surrogate.evaluation.measured import select_samples
from surrogate.network.dataset import pair_tensors, split_into_folds
from surrogate.network.score import Scores, score_network
from surrogate.network.train import train_network

from ._database import default_database, made_up

SIZES = (32, 64, 128, 256, 512, 900)


def judged(samples: Samples, size: int, parts: int, **options: Any) -> list[Scores]:
    """Scores on each of the first `parts` of ten folds, of networks that learned from `size` pairs of the others."""
    dealt, scores = split_into_folds(samples, 10), []
    for held in dealt[:parts]:
        others = np.setdiff1d(np.arange(len(samples)), held)
        chosen = np.sort(np.random.default_rng(0).permutation(others)[:size])
        trained = train_network(select_samples(samples, chosen), **options)
        scores.append(score_network(trained.model, pair_tensors(select_samples(samples, held), options["faces"])))
    return scores


def main(words: Sequence[str]) -> int:
    """Print the table, and draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_learning", description=__doc__)
    parser.add_argument("database", type=Path, nargs="?", help="build/bench/train.h5 by default")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--paper", action="store_true")
    parser.add_argument("--quick", action="store_true", help="A small one with made-up answers: to see that it runs.")
    options = parser.parse_args(words)
    torch.set_num_threads(1)
    quick: bool = options.quick
    samples = made_up(60) if quick else read_database(options.database or default_database()).samples
    sizes = (24, 48) if quick else tuple(n for n in SIZES if n <= 0.9 * len(samples))
    kinds: list[tuple[str, int, dict[str, Any]]] = [
        ("energy, generated faces", 2 if quick else 10, {"faces": "generated"}),
        ("energy, envelopes", 2 if quick else 10, {"faces": "envelope"}),
    ]
    if quick:
        kinds = [(name, parts, one | {"epochs": 3}) for name, parts, one in kinds[:1]]
    if options.paper:
        kinds.append(("paper, generated faces", 3, {"faces": "generated", "architecture": "paper"}))
    print("| network | pairs | error at 0.07 [%] | mean over 0.03 ... 0.09 [%] | R2(b) |")
    print("|---|---|---|---|---|")
    drawn: dict[str, list[tuple[int, float, float]]] = {}
    for name, parts, one in kinds:
        for size in sizes if parts != 3 else sizes[1::2]:
            scores = judged(samples, size, parts, **one)
            at, mean = 100.0 * np.array([[s.error["0.07"], np.mean(list(s.error.values()))] for s in scores]).T
            r2 = np.array([s.r2 for s in scores])
            wide = 1.0 / np.sqrt(len(scores))
            cells = [f"{values.mean():.3g} ± {values.std(ddof=1) * wide:.1g}" for values in (at, mean, r2)]
            print(f"| {name} | {size} | {' | '.join(cells)} |", flush=True)
            drawn.setdefault(name, []).append((size, float(mean.mean()), float(mean.std(ddof=1) * wide)))
    if options.figure:
        draw(drawn, options.figure)
    return 0


def draw(curves: dict[str, list[tuple[int, float, float]]], target: Path) -> None:
    """Error over the number of pairs."""
    from macrofit.base.figure import BLUE, GREEN, ORANGE, save, sheet

    figure, (axes,) = sheet(6.0, 3.8)
    for (name, rows), colour in zip(curves.items(), (BLUE, GREEN, ORANGE), strict=False):
        size, mean, wide = np.array(rows).T
        axes.errorbar(size, mean, wide, fmt="o-", ms=4, lw=1.4, capsize=2, color=colour, label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(sizes := [size for size, *_ in max(curves.values(), key=len)], labels=[str(n) for n in sizes])
    axes.set_yticks([1, 2, 3, 5], labels=["1", "2", "3", "5"])
    axes.minorticks_off()
    axes.set_xlabel("pairs of surfaces to learn from")
    axes.set_ylabel("mean relative error, 0.03 ... 0.09 [%]")
    axes.legend(frameon=False, fontsize=9)
    save(figure, target)
