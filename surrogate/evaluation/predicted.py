"""What a network says about the friction tests, and what baselines say that know less."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from macrofit.base.arrays import FloatArray

from ..data.plates import Faces
from ..network.checkpoint import Model, Provenance
from ..network.dataset import Pairs, pair_tensors
from ..network.foundation import Foundation
from ..network.score import predict_pairs
from .measured import MeasuredPairs

BASELINE_STIFFNESS: dict[Faces, float] = {"generated": 1e5, "envelope": 1.2e6}
"""K of the foundation that stands alone [N/mm3], from a study of other surfaces; the optimum is flat."""


@dataclass(frozen=True)
class PredictedPairs:
    """What a network, or a baseline, says about the same pairs."""

    name: str
    """Name in the report and the figures."""
    mean: FloatArray
    """Mean coefficient, (n, p, k); the same for all packings, unless it comes from their envelopes."""
    spread: FloatArray | None = None
    """Standard deviation, (n, p, k); a baseline states none."""


def predict_tests(model: Model, provenance: Provenance, data: MeasuredPairs, name: str | None = None) -> PredictedPairs:
    """Ask a network about the pairs.

    Raises:
        TrainingError: the samples lack the faces it needs.
    """
    tensors = _faces(data, provenance.faces, provenance.points)
    device = next(model.parameters()).device
    answer = predict_pairs(model, tensors.to(device))
    mean, spread = (data.spread_out(part.double().cpu().numpy()) for part in answer)
    return PredictedPairs(name or provenance.architecture, mean, spread)


def _faces(data: MeasuredPairs, faces: Faces, points: int | None = None) -> Pairs:
    """Each pair of generated faces once; envelopes of all packings."""
    tensors = pair_tensors(data.samples, faces, points, data.plates)
    return tensors if faces == "envelope" else tensors.take(np.arange(0, len(tensors), data.packings))


def constant_ratio(data: MeasuredPairs) -> PredictedPairs:
    """Predict c mu_micro with the c that suits these very pairs best: the smallest error of any constant ratio."""
    flat = data.meso.reshape(-1, len(data.micro))
    ratio, weight = (flat / data.micro).ravel(), np.abs(data.micro / flat).ravel()
    order = np.argsort(ratio)  # sum of w |r - c| is smallest at the weighted median
    total = np.cumsum(weight[order])
    c = ratio[order][np.searchsorted(total, 0.5 * total[-1])]
    return PredictedPairs("constant ratio", np.broadcast_to(c * data.micro, data.meso.shape))


def mean_line(data: MeasuredPairs) -> PredictedPairs:
    """Predict for all pairs the straight line that fits these very pairs best in the mean square."""
    a, b = np.polyfit(data.micro, data.meso.mean(axis=(0, 1)), 1)
    return PredictedPairs("mean line", np.broadcast_to(a * data.micro + b, data.meso.shape))


def foundation_alone(data: MeasuredPairs, faces: Faces, load: float) -> PredictedPairs:
    """Predict mu_micro + b with b of an elastic foundation: nothing is learned."""
    tensors = _faces(data, faces)
    with torch.inference_mode():
        slide = Foundation([BASELINE_STIFFNESS[faces]], load).slide(
            tensors.wheel, tensors.axle, tensors.load, tensors.constant_force
        )
    meso = tensors.micro.double().numpy() + slide.b.double().numpy()
    return PredictedPairs("foundation alone", data.spread_out(meso))
