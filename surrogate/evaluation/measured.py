"""Friction tests of surfaces never seen, arranged by pair of surfaces and packing."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import msgspec
import numpy as np

from macrofit.base.arrays import BoolArray, FloatArray

from ..data.design import SEEDS_OF_A_STRIP
from ..data.plates import Plates
from ..data.samples import Samples, select_samples
from ..errors import EvaluationError
from ..network.checkpoint import Provenance
from ..network.dataset import STEEL


@dataclass(frozen=True, kw_only=True)
class MeasuredPairs:
    """Friction tests of n pairs of surfaces, p packings each, with k micro coefficients."""

    samples: Samples
    """Pair by pair, the packings of each one after the other, (n p,)."""
    micro: FloatArray
    """Micro coefficients, (k,), the same for all pairs."""
    meso: FloatArray
    """Meso coefficients, (n, p, k)."""
    in_contact: BoolArray
    """Whether contact was kept along the whole slide, (n, p)."""
    plates: Plates = STEEL
    """What all plates have in common."""

    @property
    def packings(self) -> int:
        """Number of packings of each pair, p."""
        return self.meso.shape[1]

    def spread_out(self, answers: FloatArray) -> FloatArray:
        """Shape answers (n, k) or (n p, k) as (n, p, k)."""
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


def arrange_tests(samples: Samples, plates: Plates = STEEL) -> MeasuredPairs:
    """Arrange the samples by pair of surfaces and packing; `plates` are what all have in common.

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
    return MeasuredPairs(
        samples=select_samples(samples, order.ravel()),
        micro=micro[0],
        meso=samples.meso_friction[order],
        in_contact=np.all(samples.minimum_normal > 0.0, axis=1)[order],
        plates=plates,
    )


def require_unseen(samples: Samples, provenance: Provenance) -> None:
    """Refuse samples whose surfaces, or for a network of envelopes whose packings, were there in training.

    Strips and tiles by themselves have streams of their own; of strips, a whole one was seen or not.

    Args:
        samples: friction tests.
        provenance: what the network learned from.

    Raises:
        EvaluationError: naming a seed.
    """
    seen = provenance.seeds_of_form or {provenance.plates.form: provenance.surface_seeds}
    kinds = []
    for form, (low, high) in seen.items():
        strips = form == "strip"
        per = SEEDS_OF_A_STRIP if strips else 1
        alike = (samples.form == b"strip") == strips  # levelled tiles are tiles
        seeds = np.concatenate([samples.wheel_seed[alike], samples.axle_seed[alike]]) // per
        kinds.append(("strip" if strips else "surface", "--first-surface", (low // per, high // per), seeds))
    if provenance.faces == "envelope":
        kinds.append(("packing", "--first-packing", provenance.packing_seeds, samples.packing_seed))
    for what, option, (low, high), every in kinds:
        known = every[(every >= low) & (every <= high)]
        if known.size:
            raise EvaluationError(
                f"{what}s of seed {known[0]} and others ({known.size} of {every.size}) were learned from: "
                f"generate with {option} beyond {high}"
            )


def require_same_plates(
    database: Path, plates: Plates, provenance: Provenance, pressures: tuple[float, float] | None = None
) -> None:
    """Refuse friction tests of other plates than a network has learned from.

    Args:
        database: where they are from.
        plates: what all have in common.
        provenance: what the network learned from.
        pressures: the smallest and the largest of the tests [MPa], if not that of the plates.

    Raises:
        EvaluationError: naming the keys.
    """
    asked = [msgspec.structs.replace(plates, pressure=pressure) for pressure in pressures or (plates.pressure,)]
    others = list(dict.fromkeys(line for each in asked for line in provenance.unlike(each)))
    if others:
        raise EvaluationError(f"{database}: is of other plates than the network has learned from: {'; '.join(others)}")
