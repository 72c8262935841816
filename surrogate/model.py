"""The networks: one shaped like the physics, one as the paper describes it.

Both take the heights of the two faces and micro coefficients, and give the mean and the standard deviation of the meso
coefficient. Heights in mm: wheel (pairs, n + 1, n + 1), axle (pairs, 2 n + 1, n + 1); micro (pairs, k).
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from .foundation import Foundation, facing

FEATURES = 8
"""Even features: they stay the same when the slide is reversed."""
FLOOR = 1e-5
"""Of a standard deviation [-]."""


class Energy(nn.Module):
    """mu_meso = a mu_micro + b, with b from energies of elastic foundations, an ensemble of small networks.

    b = sum over foundations of g_k b_k, a = a_0 + ..., and the spread of the packings, where g, a and the spread follow
    from even features of the two faces (loads, roughness, share in contact) by a small perceptron. With its last layer
    at zero the network is the foundations' linear combination; it cannot invent a slope where no energy changes.

    Args:
        stiffness: of the foundations [N/mm3].
        load: normal force at the start of the slide [N].
        members: of the ensemble.
        width: of the perceptrons.
    """

    def __init__(
        self, stiffness: list[float], load: float = 170.0, members: int = 8, width: int = 24, positions: int = 5
    ) -> None:
        super().__init__()
        self.foundation = Foundation(stiffness, load, positions)
        self.foundation.log_stiffness.requires_grad_(False)
        outputs = len(stiffness) + 2  # weights of b, then a, then log of the spread
        self.register_buffer("centre", torch.zeros(FEATURES))
        self.register_buffer("scale", torch.ones(FEATURES))
        self.register_buffer("widening", torch.ones(()))  # of the spread, from data not trained on
        self.first = nn.Parameter(torch.randn(members, FEATURES, width) * FEATURES**-0.5)
        self.first_bias = nn.Parameter(torch.zeros(members, width))
        self.last = nn.Parameter(torch.zeros(members, width, outputs))
        start = torch.cat([torch.full((len(stiffness),), 0.9 / len(stiffness)), torch.tensor([1.03, -1.5])])
        self.last_bias = nn.Parameter(start.repeat(members, 1))
        self.centre: Tensor
        self.scale: Tensor
        self.widening: Tensor

    def prepare(self, wheel: Tensor, axle: Tensor) -> tuple[Tensor, Tensor]:
        """Slopes of the foundations (pairs, K) and even features (pairs, FEATURES): all that is needed of the faces."""
        slopes, loads = self.foundation(wheel, axle)
        ends = facing(wheel, axle, self.foundation.positions)[:, [0, -1]].flatten(2)  # (P, 2, G)
        rough = torch.stack(
            [
                wheel.flatten(1).std(1), axle.flatten(1).std(1), ends.std(2).mean(1),
                torch.diff(wheel, dim=1).flatten(1).std(1), torch.diff(axle, dim=1).flatten(1).std(1),
            ],
            dim=1,
        )  # fmt: skip
        features = torch.cat([rough.clamp_min(1e-6).log(), loads.clamp_min(1e-3).log()[:, :3]], dim=1)
        return slopes, nn.functional.pad(features, (0, FEATURES - features.shape[1]))

    def law(self, slopes: Tensor, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """a, b and the spread of b of every member, (members, pairs) each."""
        x = (features - self.centre) / self.scale
        hidden = torch.tanh(torch.einsum("pf,mfw->mpw", x, self.first) + self.first_bias[:, None])
        out = torch.einsum("mpw,mwo->mpo", hidden, self.last) + self.last_bias[:, None]
        k = slopes.shape[1]
        b = (out[..., :k] * slopes).sum(2)
        # the spread grows with the rms height of both faces: it is learned per micrometre of it, in thousandths
        return out[..., k], b, out[..., k + 1].exp() * features[:, 2].exp() + FLOOR

    def members(self, slopes: Tensor, features: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Means and standard deviations of every member, (members, pairs, k) each."""
        a, b, spread = self.law(slopes, features)
        return a[..., None] * micro + b[..., None], spread[..., None].expand(-1, -1, micro.shape[1])

    def forward(self, wheel: Tensor, axle: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation of the meso coefficient, (pairs, k) each."""
        return self.gathered(*self.prepare(wheel, axle), micro)

    def gathered(self, slopes: Tensor, features: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """The same from prepared faces: mean over the ensemble, spread of the packings and of the members together."""
        mean, spread = self.members(slopes, features, micro)
        variance = spread.square().mean(0) + mean.var(0, unbiased=False)
        return mean.mean(0), self.widening * variance.sqrt()


class Paper(nn.Module):
    """The network of Lalleman et al.: a convolutional branch for each face, one for the micro coefficient.

    Five convolutions of 3 x 3 with a decreasing number of filters and relu, flattened; both and the micro coefficient
    concatenated; five dense layers with relu. Heights and micro coefficients are scaled to [0, 1] by the ranges of the
    training set, the meso coefficient too. It states no uncertainty: the spread is one number, from validation.
    """

    def __init__(self, points: int = 33, filters: tuple[int, ...] = (16, 12, 8, 6, 4)) -> None:
        super().__init__()
        self.register_buffer("low", torch.zeros(3))  # heights, micro, meso
        self.register_buffer("range", torch.ones(3))
        self.register_buffer("widening", torch.ones(()))
        self.low: Tensor
        self.range: Tensor
        self.widening: Tensor
        self.wheel, self.axle = self._branch(filters), self._branch(filters)
        flat = filters[-1] * (points * points + (2 * points - 1) * points)
        sizes = (flat + 1, 128, 64, 32, 16, 1)
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            layers += [nn.Linear(inputs, outputs), nn.ReLU()]
        self.dense = nn.Sequential(*layers)
        for module in self.modules():  # He et al. (2015): torch's own start lets narrow layers of relu die
            if isinstance(module, nn.Conv2d | nn.Linear):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
                assert module.bias is not None
                nn.init.zeros_(module.bias)
        last = layers[-2]
        assert isinstance(last, nn.Linear)
        nn.init.normal_(last.weight, std=0.01)
        nn.init.constant_(last.bias, 0.5)  # a last relu that starts dead learns nothing

    @staticmethod
    def _branch(filters: tuple[int, ...]) -> nn.Sequential:
        layers: list[nn.Module] = []
        for inputs, outputs in zip((1, *filters[:-1]), filters, strict=True):
            layers += [nn.Conv2d(inputs, outputs, 3, padding=1), nn.ReLU()]
        return nn.Sequential(*layers, nn.Flatten())

    def forward(self, wheel: Tensor, axle: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation of the meso coefficient, (pairs, k) each."""
        faces = torch.cat(
            [
                branch(((heights - self.low[0]) / self.range[0])[:, None])
                for branch, heights in ((self.wheel, wheel), (self.axle, axle))
            ],
            dim=1,
        )  # (P, flat)
        scaled = (micro - self.low[1]) / self.range[1]
        columns = [self.dense(torch.cat([faces, column[:, None]], dim=1)) for column in scaled.T]
        mean = torch.cat(columns, dim=1) * self.range[2] + self.low[2]
        return mean, self.widening.expand_as(mean)
