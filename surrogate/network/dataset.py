"""Samples as tensors, and splits in which no surface stands on both sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from macrofit.base.arrays import IntArray

from ..data.plates import Faces, Plates
from ..data.samples import Samples
from ..errors import TrainingError

STEEL = Plates()
"""The plates of the default design."""
LOWEST_ENVELOPE = -0.06
"""Lower bound of an envelope [mm]: nodes at the border that no sphere covers lie far below, and carry nothing."""


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Pairs of surfaces with what the plates gave for them."""

    wheel: Tensor
    """Heights (pairs, n + 1, n + 1) [mm]."""
    axle: Tensor
    """Heights (pairs, 2 n + 1, n + 1) [mm]."""
    micro: Tensor
    """Micro coefficients (pairs, k)."""
    meso: Tensor
    """Meso coefficients (pairs, k)."""
    in_contact: Tensor
    """Whether contact was kept along the whole slide, (pairs,)."""
    load: Tensor
    """Normal force before the slide (pairs,) [N]; of plates of another modulus, what does the same to steel."""
    constant_force: Tensor
    """Whether the force was held while sliding, or else the height (pairs,)."""

    def __len__(self) -> int:
        return len(self.micro)

    def take(self, rows: IntArray) -> Pairs:
        """Some of the pairs, in the order of `rows`."""
        index = torch.from_numpy(rows)
        return Pairs(**{part.name: getattr(self, part.name)[index] for part in fields(Pairs)})

    def to(self, device: torch.device | str) -> Pairs:
        """The pairs on a device."""
        return Pairs(**{part.name: getattr(self, part.name).to(device) for part in fields(Pairs)})

    def line(self) -> tuple[Tensor, Tensor]:
        """a and b of mu_meso = a mu_micro + b through the first and the last micro coefficient, (pairs,) each."""
        a = (self.meso[:, -1] - self.meso[:, 0]) / (self.micro[:, -1] - self.micro[:, 0])
        return a, self.meso[:, 0] - a * self.micro[:, 0]


def pair_tensors(
    samples: Samples, faces: Faces = "generated", points: int | None = None, plates: Plates = STEEL
) -> Pairs:
    """The samples as tensors, with the faces as generated or as the envelopes of their spheres.

    Args:
        samples: friction tests of a database or a table.
        faces: which of the two.
        points: points of a wheel's face along its edge; the same steps along the axle's. All by default.
        plates: plates of the tests; their modulus and what they held while sliding is the same for all.

    Raises:
        TrainingError: there are no envelopes, or `points` are not those of every so manyth row.
    """
    wheel, axle = (
        (samples.wheel, samples.axle) if faces == "generated" else (samples.wheel_envelope, samples.axle_envelope)
    )
    if not wheel.shape[1]:
        raise TrainingError("the samples have no envelopes of spheres, a table never has: take the database itself")
    rows = wheel.shape[1] - 1
    if points is not None and (points < 2 or rows % (points - 1)):
        raise TrainingError(f"points = {points} along an edge are no part of the {rows + 1} that the samples have")
    step = 1 if points is None else rows // (points - 1)
    lowest = LOWEST_ENVELOPE if faces == "envelope" else -np.inf
    return Pairs(
        wheel=torch.from_numpy(np.asarray(wheel[:, ::step, ::step], dtype=np.float32)).clamp_min(lowest),
        axle=torch.from_numpy(np.asarray(axle[:, ::step, ::step], dtype=np.float32)).clamp_min(lowest),
        micro=torch.from_numpy(np.asarray(samples.micro_friction, dtype=np.float32)),
        meso=torch.from_numpy(np.asarray(samples.meso_friction, dtype=np.float32)),
        in_contact=torch.from_numpy(np.all(samples.minimum_normal > 0.0, axis=1)),
        load=torch.from_numpy(np.asarray(plates.on_steel(samples.pressure), dtype=np.float32)),
        constant_force=torch.full((len(samples),), plates.control == "force"),
    )


def joined(parts: Sequence[Pairs]) -> Pairs:
    """All pairs of the parts, one part after the other."""
    return Pairs(**{part.name: torch.cat([getattr(one, part.name) for one in parts]) for part in fields(Pairs)})


def seed_families(samples: Samples) -> IntArray:
    """Connected-component label of each sample, (samples,): samples linked, directly or transitively, by a seed."""
    count = len(samples)
    links, nodes = [], count
    for seeds in (samples.wheel_seed, samples.axle_seed, samples.packing_seed):
        distinct, which = np.unique(seeds, return_inverse=True)
        links.append(nodes + which)
        nodes += len(distinct)
    sample = np.tile(np.arange(count), len(links))
    graph = coo_matrix((np.ones(len(sample)), (sample, np.concatenate(links))), shape=(nodes, nodes))
    _, label = connected_components(graph, directed=False)
    _, family = np.unique(label[:count], return_inverse=True)
    return np.asarray(family, dtype=np.int64)


def split_into_folds(samples: Samples, count: int, seed: int = 0) -> list[IntArray]:
    """Divide the samples into `count` parts of about equal size, whole families each."""
    family = seed_families(samples)
    order = np.random.default_rng(seed).permutation(family.max() + 1)
    part = np.empty(len(order), dtype=np.int64)
    part[order] = np.arange(len(order)) % count
    return [np.flatnonzero(part[family] == k) for k in range(count)]


def split_by_family(samples: Samples, validation: float = 0.3, seed: int = 0) -> tuple[IntArray, IntArray]:
    """Rows for training and for validation; no surface and no packing is on both sides."""
    family = seed_families(samples)
    order = np.random.default_rng(seed).permutation(family.max() + 1)
    kept = set(order[round(validation * len(order)) :].tolist())
    training = np.array([label in kept for label in family])
    return np.flatnonzero(training), np.flatnonzero(~training)
