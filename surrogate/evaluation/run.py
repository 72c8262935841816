"""One evaluation: a network, and others beside it, judged by a database of surfaces they have never seen."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from macrofit.base.files import write_json

from ..data.table import open_samples
from ..network.checkpoint import load_checkpoint
from ..network.devices import chosen_device
from . import plots
from .errors import coefficient_r2, coverage, relative_errors, slope_r2
from .measured import MeasuredPairs, arrange_tests, require_same_plates, require_unseen
from .parts import parts_report
from .predicted import PredictedPairs, constant_ratio, foundation_alone, mean_line, predict_tests


def evaluate_network(
    database: Path, network: Path, compared: Sequence[Path], folder: Path, device: str = "cpu"
) -> tuple[dict[str, Any], list[Path]]:
    """Judge a network by a database or table, with others beside it; writes evaluation.json and three figures.

    Args:
        database: friction tests that no network here was trained on.
        network: the checkpoint that is judged.
        compared: further checkpoints.
        folder: where the files are written.
        device: device of torch.

    Returns:
        The content of evaluation.json, and the files written.

    Raises:
        DatabaseError: the friction tests cannot be read.
        CheckpointError: a network cannot be read.
        EvaluationError: as `require_unseen`, `require_same_plates` and `arrange_tests`.
        OutputError: the folder cannot be written.
    """
    found = open_samples(database)
    device = chosen_device(device)
    judged = [load_checkpoint(path) for path in (network, *compared)]
    for model, _ in judged:
        model.to(device)
    plates, pressure = found.header.plates, found.samples.pressure
    for _, origin in judged:
        require_unseen(found.samples, origin)
        require_same_plates(database, plates, origin, (float(pressure.min()), float(pressure.max())))
    data = arrange_tests(found.whole_pairs, plates)
    (model, provenance), *more = judged
    predicted = predict_tests(model, provenance, data)
    others = [mean_line(data)] if plates.dynamic else []  # a foundation has no loss
    others = others or [foundation_alone(data, provenance.faces, plates.load)]
    others += [predict_tests(another, origin, data) for another, origin in more]
    others = [dataclasses.replace(one, name=name) for one, name in zip(others, _distinct(others), strict=True)]
    about = {"network": network.name, "architecture": predicted.name, "faces": provenance.faces}
    about |= {"database": database.name, "content_hash": found.content_hash, "device": device}
    result = evaluation_report(data, predicted, others, about)
    target = folder / "evaluation.json"
    write_json(target, result)
    figures = [
        plots.draw_configurations(data, predicted, folder / "configurations.png"),
        plots.draw_scatter(data, predicted, folder / "scatter.png"),
        plots.draw_errors(data, predicted, others, folder / "errors.png"),
    ]
    return result, [target, *figures]


def _distinct(others: Sequence[PredictedPairs]) -> list[str]:
    """Names of the others, the second of the same name with a 2 behind it."""
    names = [one.name for one in others]
    return [f"{name} {names[:i].count(name) + 1}" if name in names[:i] else name for i, name in enumerate(names)]


def evaluation_report(
    data: MeasuredPairs, predicted: PredictedPairs, others: list[PredictedPairs], about: Mapping[str, Any]
) -> dict[str, Any]:
    """Compile the content of evaluation.json."""
    floor, baseline = data.noise_floor, constant_ratio(data)
    whole = _measures(data, predicted) | {
        "baseline_mean_relative_error": float(relative_errors(data, baseline)[0].mean()),
        "noise_floor": _number(floor.mean()),
        "noise_floor_all_packings": _number(floor.mean() / np.sqrt(data.packings)),
    }
    if predicted.spread is not None:
        whole["coverage_90"] = float(coverage(data, predicted).mean())
    by_micro = {}
    for k, micro in enumerate(data.micro):
        row = _measures(data, predicted, k) | {
            "baseline_mean_relative_error": float(relative_errors(data, baseline)[0][..., k].mean()),
            "noise_floor": _number(floor[k]),
        }
        if predicted.spread is not None:
            row["coverage_90"] = float(coverage(data, predicted)[k])
        by_micro[f"{micro:g}"] = row | {other.name: _measures(data, other, k) for other in others}
    return {
        **about,
        "pairs": len(data.meso),
        "packings": data.packings,
        "samples": int(data.meso.size),
        "lost_contact": int((~data.in_contact).sum()),
        "largest_bend": float(data.bend.max()),
        "median_bend": float(np.median(data.bend)),
        **whole,
        "by_micro_friction": by_micro,
        "parts": parts_report(data, predicted),
        "beside": {other.name: _measures(data, other) for other in others},
    }


def _measures(data: MeasuredPairs, predicted: PredictedPairs, k: int | None = None) -> dict[str, float]:
    """Errors with their standard errors at one micro coefficient, or at all of them together."""
    one, all_packings = relative_errors(data, predicted)
    if k is None:
        of_pair, of_mean, r2 = one.mean(axis=(1, 2)), all_packings.mean(1), {"r2_b": slope_r2(data, predicted)}
    else:
        one, all_packings = one[..., k], all_packings[:, k]
        of_pair, of_mean, r2 = one.mean(1), all_packings, {"r2_all_packings": coefficient_r2(data, predicted, k)}
    return {
        "mean_relative_error": float(one.mean()),
        "standard_error": float(of_pair.std(ddof=1) / np.sqrt(len(of_pair))),
        "median_relative_error": float(np.median(one)),
        "mean_relative_error_all_packings": float(of_mean.mean()),
        "standard_error_all_packings": float(of_mean.std(ddof=1) / np.sqrt(len(of_mean))),
        **r2,
    }


def _number(value: float) -> float | None:
    """A number for JSON, which knows no nan."""
    return float(value) if np.isfinite(value) else None
