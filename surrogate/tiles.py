"""The tiles of a press-fit: their faces, made once, and what the network needs to know of their pairs.

Only the last step of a prediction depends on the micro coefficient, and it is cheap. What comes before it is kept for
each pair, for as long as a provider of the same surfaces and network lives or is the last one that was built: a study
over micro coefficients prepares its pairs once.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from meso.surface import Body, tile_seed

from .faces import HeightArray, generated
from .model import Energy, roughness
from .predict import Prediction, Predictor

IntArray: TypeAlias = npt.NDArray[np.int64]

AHEAD = 4
"""Bore tiles ahead of a pair that are prepared with it: the wheel moves on, and few pairs at a time are dear."""


class Prepared(NamedTuple):
    """What `Energy.prepare` found for pairs: slopes (pairs, K) and features (pairs, F)."""

    slopes: Tensor
    features: Tensor


class Tiles:
    """Faces of all tiles of both bodies, and their pairs.

    Args:
        predictor: the network.
        seed: chooses all surfaces; see `meso.surface.tile_seed`.
        surface: keys of Diamond-Square.
        counts: number of tiles of the seat and of the bore.
    """

    faces: int
    """Made so far."""
    prepared: int
    """Pairs whose foundations were computed so far, those ahead included."""

    def __init__(
        self, predictor: Predictor, seed: int, surface: tuple[tuple[str, float], ...], counts: tuple[int, int]
    ) -> None:
        self.predictor, self.seed, self.surface, self.counts = predictor, seed, dict(surface), counts
        self.faces = self.prepared = 0
        n = predictor.provenance.points - 1
        self._sides = {
            "axle": _Side(counts[0], (2 * n + 1, n + 1)),
            "wheel": _Side(counts[1], (n + 1, n + 1)),
        }
        self._place = np.full(counts, -1, dtype=np.int64)  # of a pair among the known
        self._known = Prepared(torch.empty(0, 0), torch.empty(0, 0))

    def predict(self, seat: IntArray, bore: IntArray, micro: float) -> Prediction:
        """The coefficients of pairs of tiles.

        Raises:
            SettingsError: there is no such tile.
            PredictionError: surfaces that cannot be made.
        """
        if not isinstance(self.predictor.model, Energy):
            wheels, axles = self._face("wheel", np.unique(bore)), self._face("axle", np.unique(seat))
            return self.predictor(wheels.heights.numpy(), axles.heights.numpy(), bore, seat, micro)
        self._check(seat, bore)
        with torch.inference_mode():
            if bool((self._place[seat, bore] < 0).any()):
                self._prepare(self.predictor.model, seat, bore)
            rows = torch.from_numpy(self._place[seat, bore])
            slopes, features = (part.index_select(0, rows) for part in self._known)
            return self.predictor.answer(slopes, features, np.full(len(seat), micro))

    def heights(self, body: Body, tile: int) -> HeightArray:
        """The rough face of a tile as the network takes it [mm]."""
        which = np.array([tile], dtype=np.int64)
        self._check(which if body == "axle" else which[:0], which if body == "wheel" else which[:0])
        return np.asarray(self._face(body, which).heights[tile].numpy())

    def _prepare(self, model: Energy, seat: IntArray, bore: IntArray) -> None:
        """Add the pairs that are not known yet, and those that will follow them as the wheel moves on."""
        seats = np.repeat(seat, AHEAD + 1)
        bores = (bore[:, None] + np.arange(AHEAD + 1)).ravel()
        there = bores < self.counts[1]
        keys = np.unique(seats[there] * self.counts[1] + bores[there])
        seats, bores = np.divmod(keys, self.counts[1])
        new = self._place[seats, bores] < 0
        seats, bores = seats[new], bores[new]
        wheels, axles = self._face("wheel", np.unique(bores)), self._face("axle", np.unique(seats))
        found = model.prepare(
            wheels.heights, axles.heights, *(torch.from_numpy(of) for of in (bores, seats)),
            uneven=(wheels.roughness, axles.roughness),
        )  # fmt: skip
        self._place[seats, bores] = self.prepared + np.arange(len(seats))
        old = self._known if self.prepared else Prepared(*(part[:0] for part in found))
        self._known = Prepared(*(torch.cat(both) for both in zip(old, found, strict=True)))
        self.prepared += len(seats)

    def _face(self, body: Body, tiles: Iterable[int]) -> _Side:
        """The side of a body, with these of its faces made."""
        side = self._sides[body]
        for tile in np.asarray(tiles)[~side.made[tiles]].tolist():
            face = torch.from_numpy(
                generated(
                    body, tile_seed(self.seed, tile), **self.surface, points=self.predictor.provenance.points
                )  # type: ignore[arg-type]
            )
            side.heights[tile], side.roughness[tile], side.made[tile] = face, roughness(face), True
            self.faces += 1
        return side

    def _check(self, seat: IntArray, bore: IntArray) -> None:
        """A tile beyond the count of its body is an error that names it, and never another tile."""
        for tiles, count in ((seat, self.counts[0]), (bore, self.counts[1])):
            bad = (tiles < 0) | (tiles >= count)
            if bad.any():
                tile_seed(self.seed, int(tiles[bad][0]))  # says it, where no run has such a tile
                raise IndexError(f"there is no tile {int(tiles[bad][0])}; they are numbered 0 ... {count - 1}")


class _Side:
    """Faces of a body, filled as they are needed."""

    def __init__(self, count: int, shape: tuple[int, int]) -> None:
        self.heights = torch.zeros(count, *shape)
        self.roughness = torch.zeros(count, 2)
        self.made = np.zeros(count, dtype=np.bool_)
