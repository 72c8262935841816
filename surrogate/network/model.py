"""The networks: an ensemble on elastic foundations, and the convolutional one of Lalleman et al., alone or several.

Both take the heights of the two faces and micro coefficients, and give the mean and the standard deviation of the meso
coefficient. Heights in mm: wheel (pairs, n + 1, n + 1), axle (pairs, 2 n + 1, n + 1); micro (pairs, k).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import pairwise
from typing import Literal, TypeAlias

import torch
from torch import Tensor, nn

from .foundation import Foundation
from .inference import CONSTANT_UNIT, FLOOR_UNIT, LEAST_SPREAD

Body: TypeAlias = Literal["axle", "wheel"]
"""Name of a body."""
PAIRS_PER_CHUNK = 64
"""Pairs whose foundations are computed together: a reduction always sees this number."""


class FoundationEnsemble(nn.Module):
    """mu_meso = a mu_micro + b, with b from energies of elastic foundations, an ensemble of small networks.

    b = sum over foundations of g_k b_k, a = a_0 + ..., and the spread of the packings, where g, a and the spread follow
    from even features of the two faces by a small perceptron. (Even: they stay the same when the slide is reversed.)
    With its last layer at zero the network is the foundations' linear combination; it cannot invent a slope where no
    energy changes. Plates that swing lose energy to their damping whatever the faces: for them b has a constant
    besides, one output of the perceptron more.

    The features are the roughness and the slope of the upper halves of both faces, and for each foundation the mean
    and the smallest load and the mean depth along the slide. One that is `wide` knows pairs of many loads, at constant
    height or force: both are features too, and its spread is sqrt(s_b^2 + (s_a mu_micro)^2), where s_b and s_a grow
    with the roughness from a floor: packings differ however smooth the faces are.

    The answer for a pair has the same bits whatever other pairs are asked for. The nodes of a face are summed one face
    at a time, those of a pair in chunks of one size; what follows has only operations that are exactly rounded on each
    number by itself (no matrix product, no tanh, whose bits depend on the place in the batch).

    Args:
        stiffness: stiffnesses of the foundations [N/mm3], rising.
        load: normal force at the start of the slide [N].
        members: networks in the ensemble.
        width: hidden units of each perceptron.
        positions: places of the slide at which the foundations are evaluated.
        constant: b has a constant besides.
        wide: the load and what is held while sliding are features, and the spread has a floor.
        trapezoid: nodes on the border of a face stand for half a cell of the grid.
    """

    def __init__(
        self,
        stiffness: list[float],
        load: float,
        members: int = 8,
        width: int = 24,
        positions: int = 5,
        constant: bool = False,
        wide: bool = False,
        trapezoid: bool = False,
    ) -> None:
        super().__init__()
        self.foundation = Foundation(stiffness, load, positions, trapezoid=trapezoid)
        self.constant, self.wide = constant, wide
        features = 2 + 3 * len(stiffness) + 2 * wide
        outputs = len(stiffness) + constant + 2 + 2 * wide  # weights of b, its constant, a, the spread and its floors
        self.register_buffer("centre", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))
        self.register_buffer("widening", torch.ones(()))  # of the spread, from data not trained on
        self.register_buffer("lost", torch.zeros(()))  # smallest load of the stiffest foundation that holds contact
        if wide:
            self.register_buffer("lowest", torch.zeros(features))  # of the pairs learned from
            self.register_buffer("highest", torch.zeros(features))
        self.first = nn.Parameter(torch.empty(members, features, width))
        self.first_bias = nn.Parameter(torch.zeros(members, width))
        self.last = nn.Parameter(torch.zeros(members, width, outputs))
        self.last_bias = nn.Parameter(torch.empty(members, outputs))
        if not self.first.is_meta:  # there arithmetic costs a second of imports, and nothing is kept
            nn.init.normal_(self.first, std=features**-0.5)
            start = [0.9 / len(stiffness)] * len(stiffness) + [0.0] * constant + [1.03, -0.9] + [0.0, 0.0] * wide
            self.last_bias.data.copy_(torch.tensor(start))
        self.centre: Tensor
        self.scale: Tensor
        self.widening: Tensor
        self.lost: Tensor
        self.lowest: Tensor
        self.highest: Tensor

    def prepare(
        self, wheel: Tensor, axle: Tensor, load: Tensor | None = None, constant_force: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Slopes of the foundations (pairs, K) and even features (pairs, F): all that is needed of the faces.

        Args:
            wheel: heights of the wheel's face of each pair [mm], (pairs, n + 1, n + 1).
            axle: heights of the axle's face of each pair [mm], (pairs, 2 n + 1, n + 1).
            load: normal force of each pair before the slide, on steel of `YOUNGS_MODULUS` (pairs,) [N]; left out, that
                of the network.
            constant_force: whether each pair slides at that force, not at its height (pairs,); left out, none does.
        """
        count = len(wheel)
        load = wheel.new_full((count,), self.foundation.load) if load is None else load
        constant_force = torch.zeros_like(load, dtype=torch.bool) if constant_force is None else constant_force
        rough, rougher = (torch.stack([*map(upper_roughness, faces)]) for faces in (wheel, axle))
        both = (rough.square() + rougher.square()).sqrt()
        slopes, features = [], []
        for rows in row_chunks(torch.arange(count, device=wheel.device), PAIRS_PER_CHUNK):
            padded = torch.cat([rows, rows[:1].expand(PAIRS_PER_CHUNK - len(rows))])
            w, x, n, free, r = (part.index_select(0, padded) for part in (wheel, axle, load, constant_force, both))
            slide = self.foundation.slide(w, x, n, free)
            parts = [r, slide.load, slide.depth, slide.least]
            if self.wide:
                parts.insert(1, torch.stack([(n / self.foundation.load).log(), free.to(n.dtype)], dim=1))
            slopes.append(slide.b[: len(rows)])
            features.append(torch.cat(parts, dim=1)[: len(rows)])
        return torch.cat(slopes), torch.cat(features)

    def member_laws(self, slopes: Tensor, features: Tensor) -> tuple[Tensor, ...]:
        """a, b, the spread of b and where it is `wide` that of a, of every member, (members, pairs) each."""
        x = ((features - self.centre) / self.scale).T.contiguous()  # (F, P)
        hidden = self.first_bias[:, :, None]
        for row, value in zip(self.first.unbind(1), x, strict=True):
            hidden = hidden + row[:, :, None] * value  # (M, W, P)
        hidden = nn.functional.softsign(hidden)
        out = self.last_bias[:, :, None]
        for row, unit in zip(self.last.unbind(1), hidden.unbind(1), strict=True):
            out = out + row[:, :, None] * unit[:, None]  # (M, K + 2, P)
        terms = self.slope_terms(slopes).T
        count = len(terms)
        weights, (a, wide, *floors) = out.unbind(1)[:count], out.unbind(1)[count:]
        b = sum_in_order([weight * term for weight, term in zip(weights, terms, strict=True)])
        # the spread grows with the roughness of both faces: it is learned per micrometre of it, in thousandths
        spread = positive(wide) * features[:, 0] + LEAST_SPREAD
        if not floors:
            return a, b, spread
        of_a = positive(floors[1]) * (features[:, 0] + FLOOR_UNIT)
        return a, b, spread + FLOOR_UNIT * positive(floors[0]), of_a

    def slope_terms(self, slopes: Tensor) -> Tensor:
        """What the weights of b multiply: slopes of the foundations, and the unit of the constant if there is one."""
        if not self.constant:
            return slopes
        return torch.cat([slopes, slopes.new_full((len(slopes), 1), CONSTANT_UNIT)], dim=1)

    def member_predictions(self, slopes: Tensor, features: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Means and standard deviations of every member, (members, pairs, k) each."""
        a, b, *spreads = self.member_laws(slopes, features)
        return a[..., None] * micro + b[..., None], spread_at(spreads, micro)

    def forward(
        self,
        wheel: Tensor,
        axle: Tensor,
        micro: Tensor,
        load: Tensor | None = None,
        constant_force: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation of the meso coefficient, (pairs, k) each; see `prepare`."""
        return self.predict_prepared(*self.prepare(wheel, axle, load, constant_force), micro)

    def predict_prepared(self, slopes: Tensor, features: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Mean over the ensemble, and spread of the packings and of the members together, from what `prepare` gives.

        Exactly affine in the micro coefficient, in the precision of `micro`.
        """
        a, b, *apart = self.member_laws(slopes, features)  # (M, P) each
        a_mean, b_mean = mean_in_order(a), mean_in_order(b)  # (P,)
        offset = (a - a_mean)[..., None] * micro + (b - b_mean)[..., None]  # (M, P, k)
        variance = mean_in_order(spread_at(apart, micro).square()) + mean_in_order(offset.square())
        return a_mean[:, None] * micro + b_mean[:, None], self.widening * variance.sqrt()


def positive(values: Tensor) -> Tensor:
    """A positive number from any, exactly rounded on each by itself: half of x + sqrt(x^2 + 1)."""
    return 0.5 * (values + (values.square() + 1.0).sqrt())


def spread_at(spreads: Sequence[Tensor], micro: Tensor) -> Tensor:
    """Standard deviation at micro coefficients (pairs, k), (members, pairs, k), from that of b and that of a if any."""
    of_b, *of_a = spreads
    if not of_a:
        return of_b[..., None].expand(-1, -1, micro.shape[1])
    return (of_b[..., None].square() + (of_a[0][..., None] * micro).square()).sqrt()


def upper_roughness(face: Tensor) -> Tensor:
    """Rms height above the median [mm] and rms step between neighbours [mm] of the upper half of a face; (2,).

    The lower part carries nothing, and the envelope of spheres has deep gaps there.
    """
    upper = (face - face.median()).clamp_min(0.0)
    steps = torch.cat([upper.diff(dim=0).flatten(), upper.diff(dim=1).flatten()])
    return torch.stack([upper.square().mean(), steps.square().mean()]).sqrt()


def row_chunks(values: Tensor, size: int) -> tuple[Tensor, ...]:
    """Split a tensor into parts of `size` rows."""
    parts: tuple[Tensor, ...] = torch.split(values, size)  # type: ignore[no-untyped-call,unused-ignore]
    return parts


def sum_in_order(terms: Sequence[Tensor]) -> Tensor:
    """Sum of the terms, one after the other, so that its bits do not depend on the shape."""
    return reduce(torch.add, terms)


def mean_in_order(members: Tensor) -> Tensor:
    """Mean over the first dimension, summed as in `sum_in_order`."""
    return sum_in_order(members.unbind(0)) / len(members)


class LallemanCNN(nn.Module):
    """The network of Lalleman et al.: a convolutional branch for each face, one for the micro coefficient.

    Five convolutions of 3 x 3 with a decreasing number of filters and relu, flattened; both and the micro coefficient
    concatenated; five dense layers with relu. Heights and micro coefficients are scaled to [0, 1] by the ranges of the
    training set, the meso coefficient too. It states no uncertainty: the spread is one number, from validation.

    Args:
        points: points of a wheel's face along its edge, n + 1.
        filters: number of filters of each convolution.
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
        sizes = (flat + 1, 64, 64, 32, 16, 1)
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
        """The convolutions of one face."""
        layers: list[nn.Module] = []
        for inputs, outputs in zip((1, *filters[:-1]), filters, strict=True):
            layers += [nn.Conv2d(inputs, outputs, 3, padding=1), nn.ReLU()]
        return nn.Sequential(*layers, nn.Flatten())

    def face_part(self, body: Body, face: Tensor) -> Tensor:
        """What a face adds to the first dense layer, (1, units): it is the same in all pairs of that face.

        Args:
            body: whose face it is.
            face: heights [mm], (n + 1, n + 1) of the wheel, (2 n + 1, n + 1) of the axle.
        """
        branch = self.wheel if body == "wheel" else self.axle
        flat: Tensor = branch(((face - self.low[0]) / self.range[0])[None, None])[0]
        weight = self.dense[0].weight
        assert isinstance(weight, Tensor)
        columns = weight[:, : len(flat)] if body == "wheel" else weight[:, -1 - len(flat) : -1]
        return (columns @ flat)[None]

    def join_parts(self, wheel: Tensor, axle: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation for pairs of faces, (pairs, 1) each, as `forward` gives them but for rounding.

        The answer for a pair has the same bits whatever the others are: no matrix product, as in `FoundationEnsemble`.

        Args:
            wheel: `face_part` of the wheel's face of each pair, (pairs, 1, units).
            axle: the same of the axle's, (pairs, 1, units).
            micro: micro coefficients (pairs, 1).
        """
        first, *others = (layer for layer in self.dense if isinstance(layer, nn.Linear))
        scaled = (micro - self.low[1]) / self.range[1]
        hidden = (wheel[:, 0] + axle[:, 0] + scaled * first.weight[:, -1] + first.bias).relu()  # (P, units)
        for layer in others:
            total = layer.bias.expand(len(hidden), -1)
            for column, unit in zip(layer.weight.T, hidden.T, strict=True):
                total = total + unit[:, None] * column
            hidden = total.relu()
        return hidden * self.range[2] + self.low[2], self.widening.expand_as(hidden)

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


class LallemanEnsemble(nn.Module):
    """Networks of Lalleman et al. from several seeds: their mean, and how sure it is.

    The variance is that of the validation pairs about the mean plus that of the members among themselves; the whole is
    scaled on the validation pairs.

    Args:
        points: points of a wheel's face along its edge, n + 1.
        filters: number of filters of each convolution.
        members: number of networks.
    """

    def __init__(self, points: int, filters: tuple[int, ...], members: int) -> None:
        super().__init__()
        self.members = nn.ModuleList([LallemanCNN(points, filters) for _ in range(members)])
        self.register_buffer("residual", torch.zeros(()))
        self.register_buffer("widening", torch.ones(()))
        self.residual: Tensor
        self.widening: Tensor

    def networks(self) -> Iterator[LallemanCNN]:
        """The members, one after the other."""
        for member in self.members:
            assert isinstance(member, LallemanCNN)
            yield member

    def face_part(self, body: Body, face: Tensor) -> Tensor:
        """What a face adds to the first dense layer of each member, (members, units); see `LallemanCNN.face_part`."""
        return torch.cat([member.face_part(body, face) for member in self.networks()])

    def join_parts(self, wheel: Tensor, axle: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation for pairs of faces, (pairs, 1) each, from the parts (pairs, members, units)."""
        each = enumerate(self.networks())
        return self._pooled([member.join_parts(wheel[:, k, None], axle[:, k, None], micro)[0] for k, member in each])

    def forward(self, wheel: Tensor, axle: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation of the meso coefficient, (pairs, k) each."""
        return self._pooled([member(wheel, axle, micro)[0] for member in self.networks()])

    def _pooled(self, means: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation from the answers of the members."""
        each = torch.stack([*means])  # (M, P, k)
        mean = mean_in_order(each)
        return mean, self.widening * (self.residual.square() + mean_in_order((each - mean).square())).sqrt()
