"""What each architecture minimises, from which start, and with which optimiser.

The ensemble of foundations starts at its baseline: the weights of b are those of a ridge regression on the foundations'
slopes, weighted by one over the squared roughness of both faces. From there Adam lowers the negative log-likelihood of
all members at once, each with its own weights of the pairs (a Bayesian bootstrap). The convolutional network lowers the
mean squared error.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from .checkpoint import Architecture
from .dataset import Pairs
from .descent import Descent
from .model import FoundationEnsemble, LallemanCNN, row_chunks
from .score import predict_pairs

LEARNING_RATE: dict[Architecture, float] = {"energy": 6e-3, "paper": 1e-3}
"""Learning rate of Adam."""
WEIGHT_DECAY = 3e-3
"""Weight decay of the perceptrons of the ensemble, towards the baseline."""
RIDGE = 1e-3
"""Ridge of the regression, as a share of the mean diagonal of the normal equations [-]."""
SMOOTH = 1e-3
"""Roughness [mm] below which packings, and not faces, make pairs differ: `wide` ensembles weight them no further."""
CAUGHT_SHARE = 0.9
"""Share of the pairs that lose contact which the flag is to catch [-]."""
CNN_BATCH = 32
"""Pairs in one step of the convolutional network."""


def ensemble_descent(model: FoundationEnsemble, fit: Pairs, validation: Pairs) -> Descent:
    """Descent from the baseline down the negative log-likelihood, all pairs in each step."""
    slopes, features = foundation_inputs(model, fit)
    checked = foundation_inputs(model, validation)
    model.centre.copy_(features.mean(0))
    model.scale.copy_(features.std(0).clamp_min(1e-3))
    model.lost.copy_(contact_threshold(features[:, -1], fit.in_contact))
    floor = 0.0
    if model.wide:
        model.lowest.copy_(torch.minimum(features.amin(0), checked[1].amin(0)))
        model.highest.copy_(torch.maximum(features.amax(0), checked[1].amax(0)))
        floor = SMOOTH
    weight = torch.empty(len(model.first), len(fit)).exponential_().to(slopes.device)  # (M, P)
    weight /= weight.mean(1, keepdim=True)
    if len(weight) == 1:
        weight.fill_(1.0)
    terms = model.slope_terms(slopes)
    with torch.no_grad():
        model.last_bias[:, : terms.shape[1]] = ridge_weights(
            terms, fit.line()[1], weight / (features[:, 0] + floor).square()
        )
    optimiser = torch.optim.AdamW(
        [
            {
                "params": [model.first, model.first_bias, model.last],
                "weight_decay": WEIGHT_DECAY / LEARNING_RATE["energy"],
            },
            {"params": [model.last_bias], "weight_decay": 0.0},
        ],
        lr=LEARNING_RATE["energy"],
    )

    def steps() -> Iterator[float]:
        mean, spread = model.member_predictions(slopes, features, fit.micro)  # (M, P, k)
        loss = (weight * negative_log_likelihood(mean, spread, fit.meso).mean(2)).mean()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call,unused-ignore]
        optimiser.step()
        yield float(loss.detach())

    def validate() -> float:
        with torch.no_grad():
            mean, spread = model.predict_prepared(*checked, validation.micro)
            return float(negative_log_likelihood(mean, spread, validation.meso).mean())

    return Descent(optimiser, steps, validate)


def cnn_descent(model: LallemanCNN, fit: Pairs, validation: Pairs) -> Descent:
    """Descent down the mean squared error of scaled coefficients, in batches."""
    heights = torch.cat([fit.wheel.flatten(), fit.axle.flatten()])
    low = torch.stack([heights.min(), fit.micro.min(), fit.meso.min()])
    high = torch.stack([heights.max(), fit.micro.max(), fit.meso.max()])
    model.low.copy_(low)
    model.range.copy_((high - low).clamp_min(1e-9))
    optimiser = torch.optim.Adam(model.parameters(), lr=LEARNING_RATE["paper"])

    def steps() -> Iterator[float]:
        order = torch.randperm(len(fit)).to(fit.micro.device)
        for rows in row_chunks(order, CNN_BATCH):
            mean, _ = model(fit.wheel[rows], fit.axle[rows], fit.micro[rows])
            loss = ((mean - fit.meso[rows]) / model.range[2]).square().mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            yield float(loss.detach())

    def validate() -> float:
        mean, _ = predict_pairs(model, validation)
        return float(((mean - validation.meso) / model.range[2]).square().mean())

    return Descent(optimiser, steps, validate)


def foundation_inputs(model: FoundationEnsemble, data: Pairs) -> tuple[Tensor, Tensor]:
    """Slopes and features of all pairs, which training does not change."""
    with torch.no_grad():
        return model.prepare(data.wheel, data.axle, data.load, data.constant_force)


def ridge_weights(slopes: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """Weights g of b = sum over k of g_k b_k for every member, (members, K); weight (members, pairs)."""
    X, w = slopes.double(), weight.double()
    normal = torch.einsum("pk,mp,pl->mkl", X, w, X)
    size = normal.shape[1]
    mean = normal.diagonal(dim1=1, dim2=2).mean(1).clamp_min(torch.finfo(torch.float64).tiny)
    normal = normal + RIDGE * size * mean[:, None, None] * torch.eye(size, dtype=torch.float64, device=X.device)
    solution: Tensor = torch.linalg.solve(normal, torch.einsum("pk,mp,p->mk", X, w, b.double()))
    return solution.to(slopes.dtype)


def contact_threshold(least: Tensor, in_contact: Tensor) -> Tensor:
    """Smallest load [-], (), above which contact counts as kept; `CAUGHT_SHARE` of the pairs that lose it have less."""
    return torch.quantile(least[~in_contact], CAUGHT_SHARE) if not bool(in_contact.all()) else least.new_zeros(())


def negative_log_likelihood(mean: Tensor, spread: Tensor, measured: Tensor) -> Tensor:
    """Negative logarithm of the normal density, but for a constant."""
    return 0.5 * ((mean - measured) / spread).square() + spread.log()
