"""The ensemble on foundations as it answers, in numpy: a press-fit does not wait for torch.

The formulas of `FoundationEnsemble`, in single precision over the nodes of a face and over the perceptrons.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import BoolArray, FloatArray, HeightArray, IntArray

from .slides import FacePairs, Single, SlideEnds, slide_by_ends, slide_foundations

if TYPE_CHECKING:
    from .checkpoint import EnsembleOptions


NODES_PER_CHUNK = 2**16
"""Nodes of the faces whose foundations are computed together: they stay in the cache."""
LAWS_PER_CHUNK = 512
"""Pairs whose affine laws are computed together."""
LEAST_SPREAD = 1e-5
"""Lower bound of a standard deviation [-]."""
FLOOR_UNIT = 1e-3
"""What the floors of the spreads of b and of a are counted in [-]."""
CONSTANT_FORCE = 3
"""Place of what is held while sliding among the features of a wide ensemble."""
BEYOND = 0.1
"""How far a feature may lie outside those learned from, over their range [-]."""
CONSTANT_UNIT = 0.01
"""What the output for the constant in b is counted in [-], so that it learns at the pace of the others."""
QUANTILE_90 = 1.645
"""Half the width of the interval that holds 90 % of a normal distribution [standard deviations]."""


def check_foundations(stiffness: Sequence[float], positions: int) -> None:
    """Refuse foundations that cannot be.

    Raises:
        ValueError: the stiffnesses do not rise, or there are fewer than two positions.
    """
    if positions < 2 or not stiffness or any(right <= left for left, right in pairwise((0.0, *stiffness))):
        raise ValueError("a foundation needs two positions and stiffnesses that rise from above 0")


def ensemble_shapes(options: EnsembleOptions) -> dict[str, tuple[int, ...]]:
    """Shapes of the tensors of an ensemble, all in single precision.

    Raises:
        ValueError: as `check_foundations`.
    """
    check_foundations(options.stiffness, options.positions)
    members, width, count = options.members, options.width, len(options.stiffness)
    features, outputs = 2 + 3 * count + 2 * options.wide, count + options.constant + 2 + 2 * options.wide
    ranges = {"lowest": (features,), "highest": (features,)} if options.wide else {}
    return {
        "centre": (features,), "scale": (features,), "widening": (), "lost": (), **ranges,
        "first": (members, features, width), "first_bias": (members, width),
        "last": (members, width, outputs), "last_bias": (members, outputs),
    }  # fmt: skip


class TrainedEnsemble:
    """mu_meso = a mu_micro + b of pairs of faces, see `surrogate.network.model.FoundationEnsemble`.

    The answer for a pair has the same bits whatever other pairs are asked for.

    Args:
        options: architecture and its arguments.
        arrays: the weights, as in a checkpoint.
    """

    def __init__(self, options: EnsembleOptions, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        self.options, self.arrays = options, dict(arrays)
        self._first = np.ascontiguousarray(arrays["first"].transpose(1, 2, 0))[..., None]  # (F, W, M, 1)
        self._first_bias = np.ascontiguousarray(arrays["first_bias"].T)[..., None]  # (W, M, 1)
        self._last = np.ascontiguousarray(arrays["last"].transpose(1, 2, 0))[..., None]  # (W, O, M, 1)
        self._last_bias = np.ascontiguousarray(arrays["last_bias"].T)[..., None]  # (O, M, 1)
        self._terms = len(options.stiffness) + options.constant
        self._kept: Single = np.empty(0, dtype=np.float32)

    def prepare(
        self,
        wheels: HeightArray,
        axles: HeightArray,
        wheel: IntArray,
        axle: IntArray,
        *,
        roughness: tuple[Single, Single] | None = None,
        load: Single | None = None,
        constant_force: BoolArray | None = None,
        ends: SlideEnds | None = None,
    ) -> tuple[Single, Single]:
        """Slopes of the foundations (pairs, K) and even features (pairs, F); see `FoundationEnsemble.prepare`.

        Of pairs that all keep their load ``ends`` may name the ends of the slides; known ones are not computed again.
        """
        options, count = self.options, len(wheel)
        loads = np.full(count, options.load, dtype=np.float32) if load is None else load
        free = np.zeros(count, dtype=np.bool_) if constant_force is None else constant_force
        if roughness is None:
            roughness = upper_roughness(wheels), upper_roughness(axles)
        slopes = np.empty((count, len(options.stiffness)), dtype=np.float32)
        features = np.empty((count, len(self.arrays["centre"])), dtype=np.float32)
        both = np.sqrt(np.square(roughness[0][wheel]) + np.square(roughness[1][axle]))
        size = max(1, NODES_PER_CHUNK // (wheels.shape[1] * wheels.shape[2]))
        room = self._room(2 * options.positions * size * wheels.shape[1] * wheels.shape[2])
        for start in range(0, count, size):
            part = slice(start, start + size)
            n, fixed = loads[part], free[part]
            given = options, FacePairs(wheels, axles, wheel[part], axle[part]), n.astype(np.float64)
            if ends is None:
                slide = slide_foundations(*given, fixed, room)
            else:
                slide = slide_by_ends(*given, SlideEnds(ends.kept, ends.first[part], ends.last[part]), room)
            parts = [both[part], slide.load, slide.depth, slide.least]
            if options.wide:
                parts.insert(1, np.column_stack([np.log(n / np.float32(options.load)), fixed.astype(np.float32)]))
            slopes[part], features[part] = slide.b, np.concatenate(parts, axis=1)
        return slopes, features

    def _room(self, size: int) -> Single:
        """Memory for the sums of a chunk at all positions, and as much again; new memory costs as much as sums."""
        if len(self._kept) < size:
            self._kept = np.empty(size, dtype=np.float32)
        return self._kept

    def member_laws(self, slopes: Single, features: Single) -> Single:
        """a, b, the spread of b and where it is wide that of a, of every member, (3 or 4, members, pairs)."""
        weights = self.arrays
        x = np.ascontiguousarray(((features - weights["centre"]) / weights["scale"]).T)  # (F, P)
        units = _added_up(self._first_bias, self._first, x)  # (W, M, P)
        units /= np.float32(1.0) + np.abs(units)
        out = _added_up(self._last_bias, self._last, units)  # (O, M, P)
        terms = [*slopes.T, np.full(len(slopes), CONSTANT_UNIT, dtype=np.float32)][: self._terms]
        b = out[0] * terms[0]
        for weight, term in zip(out[1 : self._terms], terms[1:], strict=True):
            b += weight * term
        a, wide, *floors = out[self._terms :]
        spread = positive(wide) * features[:, 0] + np.float32(LEAST_SPREAD)
        if not floors:
            return np.stack([a, b, spread])
        unit = np.float32(FLOOR_UNIT)
        of_a = positive(floors[1]) * (features[:, 0] + unit)
        return np.stack([a, b, spread + unit * positive(floors[0]), of_a])

    def affine_laws(self, slopes: Single, features: Single) -> Single:
        """What `member_laws` gives, with a row for each pair: (pairs, 3 or 4, members)."""
        parts = [slice(at, at + LAWS_PER_CHUNK) for at in range(0, max(1, len(slopes)), LAWS_PER_CHUNK)]
        return np.concatenate([self.member_laws(slopes[part], features[part]).transpose(2, 0, 1) for part in parts])

    def evaluate_laws(self, laws: Single, micro: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and spread at micro coefficients (pairs,), from `affine_laws`; affine in them, in double precision."""
        a, b, *spreads = np.ascontiguousarray(laws.transpose(1, 2, 0))  # (M, P) each
        a_mean, b_mean = _mean_in_order(a), _mean_in_order(b)  # (P,)
        offset = (a - a_mean) * micro + (b - b_mean)
        squares = np.square(spreads[0])
        if len(spreads) > 1:
            squares = np.square(np.sqrt(np.square(spreads[0]) + np.square(spreads[1] * micro)))
        variance = _mean_in_order(squares) + _mean_in_order(np.square(offset))
        return a_mean * micro + b_mean, self.arrays["widening"] * np.sqrt(variance)

    def keeps_contact(self, features: Single) -> BoolArray:
        """Whether the plates keep in contact all along the slide, (pairs,); at constant force they do."""
        kept = np.asarray(features[:, -1] > self.arrays["lost"])
        return kept | (features[:, CONSTANT_FORCE] > 0.5) if self.options.wide else kept

    def flags(self, features: Single) -> BoolArray:
        """Whether plates keep in contact, and whether the pair is like those learned from, (pairs, 2)."""
        return np.stack([self.keeps_contact(features), self.has_seen(features)], axis=1)

    def has_seen(self, features: Single) -> BoolArray:
        """Whether no feature lies outside those learned from by more than `BEYOND` of their range, (pairs,)."""
        if not self.options.wide:
            return np.ones(len(features), dtype=np.bool_)
        low, high = self.arrays["lowest"], self.arrays["highest"]
        slack = np.float32(BEYOND) * (high - low)
        return np.asarray(((features >= low - slack) & (features <= high + slack)).all(axis=1))


def _added_up(bias: Single, weights: Single, inputs: Single) -> Single:
    """bias (n, M, 1) + sum over i of weights[i] (n, M, 1) * inputs[i] (P,) or (M, P), one by one; (n, M, P)."""
    found = bias + np.zeros(inputs.shape[-1], dtype=np.float32)
    part = np.empty_like(found)
    for weight, value in zip(weights, inputs, strict=True):
        np.multiply(weight, value, out=part)
        found += part
    return found


def positive(values: Single) -> Single:
    """A positive number from any: half of x + sqrt(x^2 + 1)."""
    return np.asarray(np.float32(0.5) * (values + np.sqrt(np.square(values) + np.float32(1.0))))


def upper_roughness(faces: HeightArray) -> Single:
    """Rms height above the median [mm] and rms step between neighbours [mm] of the upper half of faces; (faces, 2)."""
    count, flat = len(faces), faces.reshape(len(faces), -1)
    half = (flat.shape[1] - 1) // 2
    middle = np.partition(flat, half, axis=1)[:, half] if count else np.zeros(0, dtype=np.float32)
    upper = np.maximum(faces - middle[:, None, None], np.float32(0.0))
    along, across = np.square(np.diff(upper, axis=1)), np.square(np.diff(upper, axis=2))
    each = [part.reshape(count, -1).astype(np.float64) for part in (np.square(upper), along, across)]
    steps = (each[1].sum(axis=1) + each[2].sum(axis=1)) / (each[1].shape[1] + each[2].shape[1])
    return np.asarray(np.sqrt(np.column_stack([each[0].mean(axis=1), steps])), dtype=np.float32)


def _mean_in_order(members: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Mean over the first dimension, summed one after the other: numpy takes another order for a single pair."""
    total = np.add.reduce(members, axis=0) if members.shape[1] > 1 else reduce(np.add, members)
    return np.asarray(total / len(members))
