"""Evaluation on surfaces never seen: relative errors beside what knows less, and beside what no network can know.

Measured: mu of a pair of surfaces, a micro coefficient and a packing of spheres. An error is |predicted - measured| /
|measured|, "one packing" against each packing, "all packings" against their mean.

The noise floor is the error of someone who knows the mean over infinitely many packings: two packings i, j of the same
pair differ by |mu_i - mu_j|, which for normal scatter is sqrt(2) times as much on average as one differs from the mean;
floor = mean of |mu_i - mu_j| / (sqrt(2) |mean mu|). Against the mean over p packings it is 1/sqrt(p) of that.

Standard errors treat the pairs of surfaces as independent draws.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from macrofit.base.arrays import FloatArray, IntArray
from macrofit.base.files import write_json

from ..data.samples import Samples
from ..data.table import open_samples
from ..errors import EvaluationError
from ..network.checkpoint import Model, Provenance, load
from ..network.dataset import Faces, Pairs, pairs
from ..network.foundation import Foundation
from ..network.train import QUANTILE
from ..network.train import predict as ask

ALONE: dict[Faces, float] = {"generated": 1e5, "envelope": 1.2e6}
"""K of the foundation that stands alone [N/mm3], from a study of other surfaces; the optimum is flat."""


@dataclass(frozen=True)
class Measured:
    """Friction tests of n pairs of surfaces, p packings each, with k micro coefficients."""

    samples: Samples
    """Pair by pair, the packings of each one after the other, (n p,)."""
    micro: FloatArray
    """(k,), the same for all pairs."""
    meso: FloatArray
    """(n, p, k)."""
    held: npt.NDArray[np.bool_]
    """Whether contact was held all along, (n, p)."""

    @property
    def packings(self) -> int:
        """p."""
        return self.meso.shape[1]

    def spread_out(self, answers: FloatArray) -> FloatArray:
        """Answers (n, k) or (n p, k) as (n, p, k)."""
        n, p, k = self.meso.shape
        return np.broadcast_to(answers.reshape(n, -1, k), (n, p, k))

    @property
    def bend(self) -> FloatArray:
        """Largest distance of each test from its own straight line mu = a mu_micro + b [-], (n, p)."""
        rows = self.meso.reshape(-1, len(self.micro)).T
        a, b = np.polyfit(self.micro, rows, 1)
        line = a[:, None] * self.micro + b[:, None]
        return np.asarray(np.abs(rows.T - line).max(1).reshape(self.meso.shape[:2]))

    @property
    def noise_floor(self) -> FloatArray:
        """Mean relative error of the true mean over packings against one packing (k,); nan from one packing."""
        if self.packings < 2:
            return np.full(len(self.micro), np.nan)
        apart = [np.abs(self.meso[:, i] - self.meso[:, j]) for i, j in combinations(range(self.packings), 2)]
        return np.asarray(np.mean(np.mean(apart, axis=0) / np.sqrt(2.0) / np.abs(self.meso.mean(1)), axis=0))


@dataclass(frozen=True)
class Predicted:
    """What a network, or a baseline, says about the same pairs."""

    name: str
    mean: FloatArray
    """(n, p, k); the same for all packings, unless it comes from their envelopes."""
    spread: FloatArray | None = None
    """Standard deviation, (n, p, k); a baseline states none."""


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
    from . import plots

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


def measured(samples: Samples) -> Measured:
    """The samples by pair of surfaces and packing.

    Raises:
        EvaluationError: pairs with different micro coefficients, or different numbers of packings.
    """
    keys = np.stack([samples.wheel_seed, samples.axle_seed], axis=1)
    _, first, pair = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    packings = np.bincount(pair)
    if len(packings) < 2:
        raise EvaluationError("there is one pair of surfaces only: an evaluation takes at least two")
    if np.ptp(packings):
        raise EvaluationError(
            f"pairs have {packings.min()} to {packings.max()} packings: wait for the end of the generation"
        )
    micro = samples.micro_friction
    if np.ptp(micro, axis=0).any():
        raise EvaluationError(
            "pairs have different micro coefficients: generate with --micro-friction 0.03,0.05,0.07,0.09"
        )
    order = np.argsort(pair, kind="stable").reshape(len(first), -1)  # (n, p), by id
    return Measured(
        samples=take(samples, order.ravel()),
        micro=micro[0],
        meso=samples.meso_friction[order],
        held=np.all(samples.minimum_normal > 0.0, axis=1)[order],
    )


def unseen(samples: Samples, provenance: Provenance) -> None:
    """Nothing, where no surface was there in training and, for a network of envelopes, no packing either.

    Raises:
        EvaluationError: naming a seed.
    """
    kinds = [("surface", "--first-surface", provenance.surface_seeds, [samples.wheel_seed, samples.axle_seed])]
    if provenance.faces == "envelope":
        kinds.append(("packing", "--first-packing", provenance.packing_seeds, [samples.packing_seed]))
    for what, option, (low, high), seeds in kinds:
        every = np.concatenate(seeds)
        known = every[(every >= low) & (every <= high)]
        if known.size:
            raise EvaluationError(
                f"{what}s of seed {known[0]} and others ({known.size} of {every.size}) were learned from: "
                f"generate with {option} beyond {high}"
            )


def take(samples: Samples, rows: IntArray) -> Samples:
    """Some of the samples, in the order of `rows`."""
    return Samples(**{name: column[rows] for name, column in vars(samples).items()})


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


def errors(data: Measured, said: Predicted) -> tuple[FloatArray, FloatArray]:
    """Relative errors against each packing (n, p, k), and of the mean over packings against theirs (n, k)."""
    one = np.abs(said.mean - data.meso) / np.abs(data.meso)
    mean = data.meso.mean(1)
    return one, np.abs(said.mean.mean(1) - mean) / np.abs(mean)


def slope_r2(data: Measured, said: Predicted) -> float:
    """R2 of b in mu = a mu_micro + b against each packing; b through the ends of the micro coefficients."""

    def b(mu: FloatArray) -> FloatArray:
        a = (mu[..., -1] - mu[..., 0]) / (data.micro[-1] - data.micro[0])
        return np.asarray(mu[..., 0] - a * data.micro[0])

    true = b(data.meso)
    return float(1.0 - np.sum((b(said.mean) - true) ** 2) / np.sum((true - true.mean()) ** 2))


def coverage(data: Measured, said: Predicted) -> FloatArray:
    """Share of all packings inside the stated 90 % interval, (k,)."""
    assert said.spread is not None
    inside = np.abs(said.mean - data.meso) <= QUANTILE * said.spread
    return np.asarray(inside.mean(axis=(0, 1)))


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
