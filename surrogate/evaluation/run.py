"""One evaluation: a network, and others beside it, judged by a database of surfaces they have never seen."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from macrofit.base.files import write_json

from ..data.table import open_samples
from ..network.checkpoint import load
from . import plots
from .errors import coverage, errors, slope_r2
from .measured import Measured, measured, unseen
from .predicted import Predicted, constant_ratio, foundation_alone, predicted


def evaluation(
    database: Path, network: Path, beside: Sequence[Path], folder: Path
) -> tuple[dict[str, Any], list[Path]]:
    """Judge a network by a database or table, with others beside it; writes evaluation.json and three figures.

    Returns:
        The content of evaluation.json, and the files written.

    Raises:
        DatabaseError, CheckpointError: a file that cannot be read.
        EvaluationError: as `unseen` and `measured`; or the folder cannot be written.
    """
    found = open_samples(database)
    judged = [load(path) for path in (network, *beside)]
    for _, origin in judged:
        unseen(found.samples, origin)
    data = measured(found.samples)
    (model, provenance), *more = judged
    said = predicted(model, provenance, data)
    others = [foundation_alone(data, provenance.faces, found.header.plates.load)]
    others += [predicted(another, origin, data) for another, origin in more]
    others = [dataclasses.replace(one, name=name) for one, name in zip(others, _distinct(others), strict=True)]
    about = {"network": network.name, "architecture": said.name, "faces": provenance.faces}
    about |= {"database": database.name, "content_hash": found.content_hash}
    result = report(data, said, others, about)
    target = folder / "evaluation.json"
    write_json(target, result)
    figures = [
        plots.configurations(data, said, folder / "configurations.png"),
        plots.scatter(data, said, folder / "scatter.png"),
        plots.by_micro_friction(data, said, others, folder / "errors.png"),
    ]
    return result, [target, *figures]


def _distinct(others: Sequence[Predicted]) -> list[str]:
    names = [one.name for one in others]
    return [f"{name} {names[:i].count(name) + 1}" if name in names[:i] else name for i, name in enumerate(names)]


def report(data: Measured, said: Predicted, others: list[Predicted], about: Mapping[str, Any]) -> dict[str, Any]:
    """The content of evaluation.json."""
    floor, baseline = data.noise_floor, constant_ratio(data)
    whole = _measures(data, said) | {
        "baseline_mean_relative_error": float(errors(data, baseline)[0].mean()),
        "noise_floor": _number(floor.mean()),
        "noise_floor_all_packings": _number(floor.mean() / np.sqrt(data.packings)),
    }
    if said.spread is not None:
        whole["coverage_90"] = float(coverage(data, said).mean())
    by_micro = {}
    for k, micro in enumerate(data.micro):
        row = _measures(data, said, k) | {
            "baseline_mean_relative_error": float(errors(data, baseline)[0][..., k].mean()),
            "noise_floor": _number(floor[k]),
        }
        if said.spread is not None:
            row["coverage_90"] = float(coverage(data, said)[k])
        by_micro[f"{micro:g}"] = row | {other.name: _measures(data, other, k) for other in others}
    return {
        **about,
        "pairs": len(data.meso),
        "packings": data.packings,
        "samples": int(data.meso.size),
        "lost_contact": int((~data.held).sum()),
        "largest_bend": float(data.bend.max()),
        "median_bend": float(np.median(data.bend)),
        **whole,
        "by_micro_friction": by_micro,
        "beside": {other.name: _measures(data, other) for other in others},
    }


def _measures(data: Measured, said: Predicted, k: int | None = None) -> dict[str, float]:
    one, all_packings = errors(data, said)
    if k is None:
        of_pair, of_mean, r2 = one.mean(axis=(1, 2)), all_packings.mean(1), {"r2_b": slope_r2(data, said)}
    else:
        one, all_packings = one[..., k], all_packings[:, k]
        of_pair, of_mean, r2 = one.mean(1), all_packings, {}
    return {
        "mean_relative_error": float(one.mean()),
        "standard_error": float(of_pair.std(ddof=1) / np.sqrt(len(of_pair))),
        "median_relative_error": float(np.median(one)),
        "mean_relative_error_all_packings": float(of_mean.mean()),
        "standard_error_all_packings": float(of_mean.std(ddof=1) / np.sqrt(len(of_mean))),
        **r2,
    }


def _number(value: float) -> float | None:
    """JSON knows no nan."""
    return float(value) if np.isfinite(value) else None
