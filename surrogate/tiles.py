"""The tiles of a press-fit: their faces, made once, and what the network makes of their pairs.

Only the last step of a prediction depends on the micro coefficient, and it is cheap. What comes before it is kept for
each pair, for as long as a provider of the same surfaces and network lives or is the last one that was built: a study
over micro coefficients prepares its pairs once.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import BoolArray, HeightArray, IntArray
from meso.settings import FaceKeys
from meso.surfaces.surface import TILES, Body, tile_seed

from .data.faces import generated_face
from .errors import PredictionError
from .network.inference import PAIRS_PER_CHUNK, Single, TrainedEnsemble, upper_roughness
from .network.predict import Prediction, Predictor
from .network.shipped import NETWORK

T = TypeVar("T", bound=np.generic)
TILES_AHEAD = 4
"""Tiles ahead of a pair that are looked at for more pairs."""


class Tiles:
    """Faces of all tiles of both bodies, and their pairs.

    Foundations are computed `PAIRS_PER_CHUNK` pairs at a time, however few are asked for. Places that are left in the
    last chunk go to the pairs that will follow as the wheel moves on, nearest first; so they cost nothing if they do
    not.

    Args:
        predictor: the network.
        seed: chooses all surfaces; see `meso.surfaces.surface.tile_seed`.
        surface: how the faces are made.
        counts: number of tiles of the seat and of the bore.
    """

    faces: int
    """Faces made so far."""
    prepared: int
    """Pairs whose foundations were computed so far, those ahead included."""

    def __init__(self, predictor: Predictor, seed: int, surface: FaceKeys, counts: tuple[int, int]) -> None:
        self.predictor, self.seed, self.surface = predictor, seed, surface
        self.counts = min(counts[0], TILES), min(counts[1], TILES)
        self.faces = self.prepared = 0
        n = predictor.provenance.points - 1
        self._sides: dict[Body, _Side] = {
            "axle": _Side(self.counts[0], (2 * n + 1, n + 1)),
            "wheel": _Side(self.counts[1], (n + 1, n + 1)),
        }
        self._row = np.full(self.counts, -1, dtype=np.int32)  # of a pair, below
        self._laws: Single | None = None  # with room for more pairs
        self._in_contact: BoolArray = np.empty(0, dtype=np.bool_)

    def predict(self, seat: IntArray, bore: IntArray, micro: float) -> Prediction:
        """The coefficients of pairs of tiles, as the network gives them for their faces, to the bit.

        Raises:
            PredictionError: there is no such tile, its surface cannot be made, or a micro coefficient is not finite.
        """
        self._check("axle", seat)
        self._check("wheel", bore)
        model = self.predictor.model
        if not isinstance(model, TrainedEnsemble):
            return self._whole(seat, bore, micro)
        rows = self._row[seat, bore]
        if rows.min(initial=0) < 0 or self._laws is None:
            self._prepare(model, *self._wanted(seat, bore, rows < 0))
            rows = self._row[seat, bore]
        assert self._laws is not None
        return self.predictor.answer(self._laws[rows], self._in_contact[rows], micro)

    def heights(self, body: Body, tile: int) -> HeightArray:
        """The rough face of a tile as the network takes it [mm], read-only.

        Raises:
            PredictionError: as `predict`.
        """
        which = np.array([tile], dtype=np.int64)
        self._check(body, which)
        face: HeightArray = self._side(body, which).heights[tile].view()
        face.setflags(write=False)
        return face

    def _whole(self, seat: IntArray, bore: IntArray, micro: float) -> Prediction:
        """Predict from what the paper's network makes of each face by itself."""
        wheels, axles = self._side("wheel", bore), self._side("axle", seat)
        return self.predictor.join(wheels.parts[bore], axles.parts[seat], micro)

    def _wanted(self, seat: IntArray, bore: IntArray, new: BoolArray) -> tuple[IntArray, IntArray]:
        """The pairs that are not known, each once, and those ahead that have room in the last chunk."""
        keys = np.unique(seat[new] * self.counts[1] + bore[new])
        for step in range(1, TILES_AHEAD + 1):
            room = -len(keys) % PAIRS_PER_CHUNK
            if not room:
                break
            # the bore comes on by a tile, and its end reaches another tile of the seat
            seats, bores = np.concatenate([seat, seat + step]), np.concatenate([bore + step, bore])
            there = (seats < self.counts[0]) & (bores < self.counts[1])
            seats, bores = seats[there], bores[there]
            unknown = self._row[seats, bores] < 0
            more = np.setdiff1d(seats[unknown] * self.counts[1] + bores[unknown], keys)
            keys = np.concatenate([keys, more[:room]])
        seats, bores = np.divmod(keys, self.counts[1])
        return seats, bores

    def _prepare(self, model: TrainedEnsemble, seat: IntArray, bore: IntArray) -> None:
        """Add pairs to those whose laws are known."""
        wheels, axles = self._side("wheel", bore), self._side("axle", seat)
        slopes, features = model.prepare(
            wheels.heights,
            axles.heights,
            bore,
            seat,
            roughness=(wheels.roughness, axles.roughness),
        )
        old, new = self.prepared, self.prepared + len(seat)
        laws = model.affine_laws(slopes, features)
        self._laws = _with_room(laws[:0] if self._laws is None else self._laws, old, new)
        self._in_contact = _with_room(self._in_contact, old, new)
        self._laws[old:new], self._in_contact[old:new] = laws, model.keeps_contact(features)
        self._row[seat, bore] = np.arange(old, new)
        self.prepared = new

    def _side(self, body: Body, tiles: IntArray) -> _Side:
        """The faces of a body, with these tiles made."""
        side = self._sides[body]
        for tile in np.unique(tiles[~side.made[tiles]]).tolist():
            points = self.predictor.provenance.points
            side.heights[tile] = generated_face(body, tile_seed(self.seed, tile), self.surface, points)
            if isinstance(self.predictor.model, TrainedEnsemble):
                side.roughness[tile] = upper_roughness(side.heights[tile])
            else:
                part = self.predictor.face_part(body, side.heights[tile])
                side.parts = side.parts if len(side.parts) else np.zeros((len(side.made), *part.shape), np.float32)
                side.parts[tile] = part
            side.made[tile] = True
            self.faces += 1
        return side

    def _check(self, body: Body, tiles: IntArray) -> None:
        """Refuse a tile beyond those of its body by its number; never take another tile."""
        count = self.counts[0 if body == "axle" else 1]
        if len(tiles) and not 0 <= tiles.min() <= tiles.max() < count:
            wrong = tiles[(tiles < 0) | (tiles >= count)][0]
            raise PredictionError(f"there is no tile {wrong} of the {body}; they are numbered 0 ... {count - 1}")


class _Side:
    """Faces of a body, filled as they are needed."""

    def __init__(self, count: int, shape: tuple[int, int]) -> None:
        self.heights: HeightArray = np.zeros((count, *shape), dtype=np.float32)
        self.roughness: Single = np.zeros((count, 2), dtype=np.float32)
        self.parts: Single = np.zeros(0, dtype=np.float32)  # of the paper's network, once a face is made
        self.made = np.zeros(count, dtype=np.bool_)


def _with_room(rows: npt.NDArray[T], old: int, new: int) -> npt.NDArray[T]:
    """The first `old` rows, in a table for `new` of them; it doubles, so that few rows are moved."""
    if new <= len(rows):
        return rows
    larger = np.empty((max(new, 2 * len(rows)), *rows.shape[1:]), dtype=rows.dtype)
    larger[:old] = rows[:old]
    return larger


def load_predictor(path: Path | None) -> Predictor:
    """The network of a file, or the shipped one; read again only if it is another file than last time.

    Raises:
        CheckpointError: as `Predictor`.
    """
    path = NETWORK if path is None else path
    try:
        about = path.stat()
    except OSError:
        return Predictor(path)  # says it
    return _cached_predictor(path, (about.st_dev, about.st_ino, about.st_mtime_ns, about.st_size))


@functools.lru_cache(maxsize=1)
def _cached_predictor(path: Path, about: tuple[int, ...]) -> Predictor:
    """The network of a file, kept as long as the file is the same."""
    return Predictor(path)


@functools.lru_cache(maxsize=1)
def shared_tiles(predictor: Predictor, seed: int, surface: FaceKeys, counts: tuple[int, int]) -> Tiles:
    """Tiles of these arguments: the same object as last time if the arguments are the same."""
    return Tiles(predictor, seed, surface, counts)
