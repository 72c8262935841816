"""Evaluation on surfaces never seen: relative errors beside what knows less, and beside what no network can know.

Measured: mu of a pair of surfaces, a micro coefficient and a packing of spheres. An error is |predicted - measured| /
|measured|, "one packing" against each packing, "all packings" against their mean.

The noise floor is the error of someone who knows the mean over infinitely many packings: two packings i, j of the same
pair differ by |mu_i - mu_j|, which for normal scatter is sqrt(2) times as much on average as one differs from the mean;
floor = mean of |mu_i - mu_j| / (sqrt(2) |mean mu|). Against the mean over p packings it is 1/sqrt(p) of that.

Standard errors treat the pairs of surfaces as independent draws.
"""

from __future__ import annotations

import numpy as np

from macrofit.base.arrays import FloatArray

from ..network.score import QUANTILE_90
from .measured import MeasuredPairs
from .predicted import PredictedPairs

QUANTILE_975 = 1.96
"""Half the width of the interval that holds 95 % of a normal distribution [standard deviations]."""


def relative_errors(data: MeasuredPairs, predicted: PredictedPairs) -> tuple[FloatArray, FloatArray]:
    """Relative errors against each packing (n, p, k), and of the mean over packings against theirs (n, k)."""
    one = np.abs(predicted.mean - data.meso) / np.abs(data.meso)
    mean = data.meso.mean(1)
    return one, np.abs(predicted.mean.mean(1) - mean) / np.abs(mean)


def coefficient_r2(data: MeasuredPairs, predicted: PredictedPairs, k: int) -> float:
    """R2 of the coefficient at the micro coefficient numbered k, against the mean over packings."""
    true, said = data.meso[..., k].mean(1), predicted.mean[..., k].mean(1)
    return float(1.0 - np.sum((said - true) ** 2) / np.sum((true - true.mean()) ** 2))


def slope_r2(data: MeasuredPairs, predicted: PredictedPairs) -> float:
    """R2 of b in mu = a mu_micro + b against each packing; b through the ends of the micro coefficients."""

    def b(mu: FloatArray) -> FloatArray:
        a = (mu[..., -1] - mu[..., 0]) / (data.micro[-1] - data.micro[0])
        return np.asarray(mu[..., 0] - a * data.micro[0])

    true = b(data.meso)
    return float(1.0 - np.sum((b(predicted.mean) - true) ** 2) / np.sum((true - true.mean()) ** 2))


def coverage(data: MeasuredPairs, predicted: PredictedPairs) -> FloatArray:
    """Share of all packings inside the stated 90 % interval, (k,)."""
    assert predicted.spread is not None
    inside = np.abs(predicted.mean - data.meso) <= QUANTILE_90 * predicted.spread
    return np.asarray(inside.mean(axis=(0, 1)))


def coverage_interval(share: float, pairs: int) -> tuple[float, float]:
    """Where the share of all pairs lies (95 %), if this one [-] was found of so many: the interval of Wilson (1927).

    Each pair counts once: its packings share the error of the network, so they are no independent draws.
    """
    z2 = QUANTILE_975**2 / pairs
    middle, half = share + 0.5 * z2, float(np.sqrt(share * (1.0 - share) * z2 + 0.25 * z2**2))
    return (middle - half) / (1.0 + z2), (middle + half) / (1.0 + z2)
