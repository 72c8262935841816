"""By how much plates, packings and network differ in the coefficients of the tiles of a press-fit, and what they share.

Random errors are told in units of the standard deviation that the network states for a pair of tiles, which grows with
the roughness. Which part of them is common to all pairs, to a tile of the seat or to a tile of the bore decides what
is left of them in the force: a part that is a pair's own averages out over thousands of pairs, a common one never.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from macrofit.friction import BuildContext, StatesUncertainty, TilePairs, build
from macrofit.solution import PairFrictionMap, Solution
from surrogate.data.samples import Samples
from surrogate.data.table import read_table
from surrogate.evaluation.measured import arrange_tests
from surrogate.evaluation.predicted import predict_tests
from surrogate.network.checkpoint import load_checkpoint
from surrogate.network.dataset import pair_tensors
from surrogate.network.score import predict_pairs
from surrogate.network.shipped import EVALUATION, NETWORK

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MICRO, SEED = 0.07, 1


class Shares(NamedTuple):
    """Of a variance over pairs of tiles: between the seat's tiles, between the bore's, of each pair by itself."""

    seat: float
    bore: float
    pair: float


class CoefficientErrors(NamedTuple):
    """Random errors in units of the stated standard deviation, others relative to the coefficient [-]."""

    increment: float  # mean change from the plates' fine increment
    bias: float  # mean error of the network
    bias_error: float  # standard error of the mean that `bias` is
    network: float  # standard deviation of the network's error, against the mean over packings
    packing: float  # standard deviation of one packing
    common: float  # standard deviation of what all surfaces on one packing have in common, a part of `packing`
    network_shares: Shares
    packing_shares: Shares  # of the rest of it
    increment_cpu_s: float
    cpu_s: float  # of the rest


class Block:
    """Plates and network for some of the tiles of a run, each asked as a provider."""

    def __init__(self, reference: Solution, spheres: int) -> None:
        assert reference.friction is not None
        tiling, material = reference.friction.tiling, reference.scene.axle.material
        self.context = BuildContext(
            seat_tiles=tiling.seat_tiles,
            bore_tiles=tiling.bore_tiles,
            youngs_modulus=material.youngs_modulus,
            poisson_ratio=material.poisson_ratio,
        )
        self.spheres = spheres

    def plates(self, seat: IntArray, bore: IntArray, packing: int = 0, increment: float = 0.004) -> FloatArray:
        """Coefficients of pairs, computed now."""
        options = {
            "micro_friction": MICRO,
            "seed": SEED,
            "cache": False,
            "plates": {"spheres": self.spheres, "packing_seed": packing},
            "engine": {"increment": increment},
        }
        return build("dem", options, self.context).coefficients(asked(seat, bore))

    def network(self, seat: IntArray, bore: IntArray) -> tuple[FloatArray, FloatArray]:
        """Coefficients of pairs and their stated standard deviations."""
        provider = build("surrogate", {"micro_friction": MICRO, "seed": SEED}, self.context)
        assert isinstance(provider, StatesUncertainty)
        return provider.coefficients(asked(seat, bore)), provider.uncertainty(asked(seat, bore))


def asked(seat: IntArray, bore: IntArray) -> TilePairs:
    """Pairs of tiles at a pressure and a sliding that nobody looks at."""
    return TilePairs(seat, bore, np.zeros(len(seat)), np.zeros(len(seat)))


def examine(
    reference: Solution, samples: Samples | None, shape: tuple[int, int], spheres: int, fine: float
) -> CoefficientErrors:
    """Run the plates of a block of tiles, and take the errors of the network on the evaluation.

    Args:
        reference: a run on the network.
        samples: friction tests whose packings serve several pairs; the evaluation's where they are left out.
        shape: number of the seat's tiles and of the bore's.
        spheres: of the plates.
        fine: increment of the plates that counts as exact [mm].
    """
    met, block = reference.friction, Block(reference, spheres)
    assert met is not None
    seats, bores = (
        np.linspace(tiles.min(), tiles.max(), count).astype(np.int64)
        for tiles, count in zip((met.seat, met.bore), shape, strict=True)
    )
    began = time.process_time()
    seat, bore = (tiles.ravel() for tiles in np.meshgrid(seats, bores, indexing="ij"))
    first, second, said, stated = (
        values.reshape(shape)
        for values in (block.plates(seat, bore), block.plates(seat, bore, packing=1), *block.network(seat, bore))
    )
    bias, bias_error, network, packing = evaluated()
    common = common_to_packing(read_table(EVALUATION).samples if samples is None else samples)
    between = time.process_time()
    few = np.arange(len(seats)), np.arange(len(seats)) % len(bores)
    exact = block.plates(seats[few[0]], bores[few[1]], increment=fine)
    ended = time.process_time()
    return CoefficientErrors(
        increment=float(np.mean(first[few] / exact - 1.0)),
        bias=bias,
        bias_error=bias_error,
        network=network,
        packing=packing,
        common=common,
        network_shares=shares((said - 0.5 * (first + second)) / stated),
        packing_shares=shares((first - second) / stated),
        increment_cpu_s=ended - between,
        cpu_s=between - began,
    )


def evaluated() -> tuple[float, float, float, float]:
    """Of the evaluation at `MICRO`: the network's mean error and its standard error, over the coefficient; standard
    deviations of the network's error against the mean over packings and of one packing, over that stated."""
    data = arrange_tests(read_table(EVALUATION).samples)
    answer = predict_tests(*load_checkpoint(NETWORK), data)
    k = int(np.argmin(np.abs(data.micro - MICRO)))
    meso, said, stated = data.meso[..., k], answer.mean[:, 0, k], answer.spread[:, 0, k]  # (n, p), (n,), (n,)
    off = (said - meso.mean(1)) / meso.mean(1)
    packing = float(np.mean(meso.var(axis=1, ddof=1) / stated**2))
    network = float(np.var((said - meso.mean(1)) / stated, ddof=1)) - packing / data.packings
    return float(off.mean()), float(off.std(ddof=1) / np.sqrt(len(off))), max(0.0, network) ** 0.5, packing**0.5


def common_to_packing(samples: Samples) -> float:
    """Standard deviation of what pairs of surfaces on the same packing have in common, over that stated.

    From the variance between packings in a one-way analysis of plates less network, at least 0 (Searle et al. 1992).
    """
    model, about = load_checkpoint(NETWORK)
    data = pair_tensors(samples, points=about.points)
    mean, spread = predict_pairs(model, data)
    off = ((data.meso - mean) / spread).double().mean(1).numpy()  # the same at all micro coefficients but for a
    _, group = np.unique(samples.packing_seed, return_inverse=True)
    size = np.bincount(group)
    centre = np.bincount(group, off) / size
    between = float(np.sum(size * (centre - off.mean()) ** 2)) / (len(size) - 1)
    within = float(np.sum((off - centre[group]) ** 2)) / (len(off) - len(size))
    typical = (len(off) - float(np.sum(size**2)) / len(off)) / (len(size) - 1)
    return max(0.0, (between - within) / typical) ** 0.5


def shares(values: FloatArray) -> Shares:
    """Components of the variance of a two-way table without replication, over their sum (Searle et al. 1992)."""
    rows, columns = values.shape
    by_row, by_column = values.mean(1), values.mean(0)
    rest = values - by_row[:, None] - by_column[None, :] + values.mean()
    pair = float(np.sum(rest**2) / ((rows - 1) * (columns - 1)))
    seat = max(0.0, float(by_row.var(ddof=1)) - pair / columns)
    bore = max(0.0, float(by_column.var(ddof=1)) - pair / rows)
    whole = seat + bore + pair
    return Shares(seat / whole, bore / whole, pair / whole)


def drawn(met: PairFrictionMap, size: float, parts: Shares, rng: np.random.Generator) -> FloatArray:
    """Coefficients with random errors of `size` times the stated standard deviation."""
    seat = rng.standard_normal(met.seat.max() + 1)[met.seat]
    bore = rng.standard_normal(met.bore.max() + 1)[met.bore]
    own = rng.standard_normal(len(met.seat))
    error = np.sqrt(parts.seat) * seat + np.sqrt(parts.bore) * bore + np.sqrt(parts.pair) * own
    return np.asarray(met.coefficient + size * met.uncertainty * error)
