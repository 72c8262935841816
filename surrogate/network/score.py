"""What a network makes of pairs with known answers: errors, R2 of b, and the width of the stated interval."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from .checkpoint import Model
from .dataset import Pairs
from .inference import QUANTILE_90 as QUANTILE_90
from .model import FoundationEnsemble, LallemanEnsemble

REPORTED = (0.03, 0.05, 0.07, 0.09)
"""Micro coefficients of the report [-]."""
BINS = (0.01, 0.03, 0.05, 0.07, 0.09, 0.15, 0.3)
"""Edges of the bins of micro coefficients of the report [-]."""
PAIRS_AT_ONCE = 64
"""Pairs that are predicted together; bounds the memory."""


@dataclass(frozen=True)
class Scores:
    """How right a network is about pairs with known answers."""

    error: dict[str, float]
    """Mean relative error [-] at each of `REPORTED`, against the straight line through what was measured."""
    r2: float
    """Coefficient of determination of b [-]."""
    by_bin: list[tuple[float, float, int, float]]
    """Micro coefficient from, to, samples, and their mean error over their mean coefficient [-].

    (Not the mean of the relative errors: rough pairs of little friction have coefficients near zero.)
    """
    coverage: float
    """Share inside the stated 90 % interval [-]."""


def predict_pairs(model: Model, data: Pairs) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (pairs, k) each, some pairs at a time."""
    inputs = [data.wheel, data.axle, data.micro]
    if isinstance(model, FoundationEnsemble):
        inputs += [data.load, data.constant_force]
    with torch.inference_mode():
        parts = [
            model(*(part[start : start + PAIRS_AT_ONCE] for part in inputs))
            for start in range(0, len(data), PAIRS_AT_ONCE)
        ]
    return torch.cat([mean for mean, _ in parts]), torch.cat([spread for _, spread in parts])


def score_network(model: Model, data: Pairs) -> Scores:
    """Errors, R2 of b, and coverage on pairs with known answers."""
    mean, spread = predict_pairs(model, data)
    a, b = data.line()
    span = data.micro[:, -1] - data.micro[:, 0]
    slope = (mean[:, -1] - mean[:, 0]) / span
    intercept = mean[:, 0] - slope * data.micro[:, 0]
    error = {}
    for micro in REPORTED:
        measured = a * micro + b
        error[f"{micro:g}"] = float(((slope * micro + intercept - measured) / measured).abs().mean())
    wrong = (mean - data.meso).abs()
    by_bin = []
    for low, high in pairwise(BINS):
        inside = (data.micro >= low) & (data.micro < high)
        if bool(inside.any()):
            by_bin.append((low, high, int(inside.sum()), float(wrong[inside].sum() / data.meso[inside].abs().sum())))
    return Scores(
        error=error,
        r2=float(1.0 - (b - intercept).square().sum() / (b - b.mean()).square().sum()),
        by_bin=by_bin,
        coverage=float((wrong <= QUANTILE_90 * spread).float().mean()),
    )


def measure_residual(model: LallemanEnsemble, validation: Pairs) -> None:
    """Set the residual of an ensemble to the rms error of its mean on pairs it has not learned from."""
    mean, _ = predict_pairs(model, validation)
    model.residual.fill_(float((mean - validation.meso).square().mean().sqrt()))


def calibrate_spread(model: Model, validation: Pairs) -> None:
    """Scale the stated spread so that 90 % of the pairs lie within, with the correction for a finite number."""
    model.widening.fill_(1.0)
    mean, spread = predict_pairs(model, validation)
    ratio = ((mean - validation.meso).abs() / spread).flatten()
    level = min(0.9 * (1.0 + 1.0 / len(validation)), 1.0)
    model.widening.fill_(float(torch.quantile(ratio, level)) / QUANTILE_90)
