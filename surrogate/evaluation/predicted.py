"""What a network says about the friction tests, and what baselines say that know less."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from macrofit.base.arrays import FloatArray

from ..network.checkpoint import Model, Provenance
from ..network.dataset import Faces, Pairs, pairs
from ..network.foundation import Foundation
from ..network.train import predict as ask
from .measured import Measured

ALONE: dict[Faces, float] = {"generated": 1e5, "envelope": 1.2e6}
"""K of the foundation that stands alone [N/mm3], from a study of other surfaces; the optimum is flat."""


@dataclass(frozen=True)
class Predicted:
    """What a network, or a baseline, says about the same pairs."""

    name: str
    mean: FloatArray
    """(n, p, k); the same for all packings, unless it comes from their envelopes."""
    spread: FloatArray | None = None
    """Standard deviation, (n, p, k); a baseline states none."""


def predicted(model: Model, provenance: Provenance, data: Measured, name: str | None = None) -> Predicted:
    """What a network says.

    Raises:
        TrainingError: the samples lack the faces it needs.
    """
    told = _faces(data, provenance.faces, provenance.points)
    mean, spread = (
        data.spread_out(answer.double().numpy()) for answer in ask(model, told.wheel, told.axle, told.micro)
    )
    return Predicted(name or provenance.architecture, mean, spread)


def _faces(data: Measured, faces: Faces, points: int | None = None) -> Pairs:
    """Each pair of generated faces once; envelopes of all packings."""
    told = pairs(data.samples, faces, points)
    return told if faces == "envelope" else told.take(np.arange(0, len(told), data.packings))


def constant_ratio(data: Measured) -> Predicted:
    """c mu_micro with the c that suits these very pairs best: the smallest error a constant ratio can have here."""
    flat = data.meso.reshape(-1, len(data.micro))
    ratio, weight = (flat / data.micro).ravel(), np.abs(data.micro / flat).ravel()
    order = np.argsort(ratio)  # sum of w |r - c| is smallest at the weighted median
    total = np.cumsum(weight[order])
    c = ratio[order][np.searchsorted(total, 0.5 * total[-1])]
    return Predicted("constant ratio", np.broadcast_to(c * data.micro, data.meso.shape))


def foundation_alone(data: Measured, faces: Faces, load: float) -> Predicted:
    """mu_micro + b with b of an elastic foundation: nothing is learned."""
    told = _faces(data, faces)
    with torch.inference_mode():
        slope, _ = Foundation([ALONE[faces]], load)(told.wheel, told.axle)
    return Predicted("foundation alone", data.spread_out(told.micro.double().numpy() + slope.double().numpy()))
