"""The tiles of a press-fit: their faces, made once, and what the network makes of their pairs.

Only the last step of a prediction depends on the micro coefficient, and it is cheap. What comes before it is kept for
each pair, for as long as a provider of the same surfaces and network lives or is among the last that were built: a
study over micro coefficients, meshes or motions prepares its pairs once, those of all its runs in lockstep together.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TypeVar

import numpy as np

from macrofit.base.arrays import BoolArray, FloatArray, HeightArray, IntArray
from meso.settings import FaceKeys
from meso.surfaces.surface import TILES, Body, tile_seed

from .data.faces import generated_faces, in_one_piece
from .errors import PredictionError
from .levels import PressureLevels
from .network.checkpoint import Control
from .network.inference import TrainedEnsemble, upper_roughness
from .network.predict import Prediction, Predictor
from .network.shipped import NETWORK
from .network.slides import KeptEnds, Single, SlideEnds, with_room

T = TypeVar("T", bound=np.generic)
FACES_TOGETHER = 16
"""Faces of a strip that are made at once: neighbours share what they overlap."""

KEPT = 8
"""Tiles of different surfaces that are kept, as many as runs go in lockstep: some 5 MB each."""


class Tiles:
    """Faces of all tiles of both bodies, and their pairs.

    Args:
        predictor: the network.
        seed: chooses all surfaces; see `meso.surfaces.surface.tile_seed`.
        surface: how the faces are made.
        counts: number of tiles of the seat and of the bore.
        pressures: levels of pressure [MPa], at the modulus of the network's plates; None: theirs alone.
        control: what is held while sliding; None: what these plates hold.
    """

    faces: int
    """Faces made so far."""
    prepared: int
    """Pairs whose foundations were computed so far; again for each level of pressure."""

    def __init__(
        self,
        predictor: Predictor,
        seed: int,
        surface: FaceKeys,
        counts: tuple[int, int],
        pressures: PressureLevels | None = None,
        control: Control | None = None,
    ) -> None:
        self.predictor, self.seed, self.surface = predictor, seed, surface
        self.pressures, self.control = pressures, control
        self.counts = min(counts[0], TILES), min(counts[1], TILES)
        self.faces = self.prepared = 0
        n = predictor.provenance.points - 1
        self._sides: dict[Body, _Side] = {
            "axle": _Side(self.counts[0], (2 * n + 1, n + 1)),
            "wheel": _Side(self.counts[1], (n + 1, n + 1)),
        }
        levels = 1 if pressures is None else pressures.count
        self._row = np.full((*self.counts, levels), -1, dtype=np.int32)  # of a pair at a level, below
        pieces = in_one_piece(surface, "axle")
        self._ends = KeptEnds((self.counts[0] + 1) * self.counts[1] * levels) if pieces else None
        self._expected: list[IntArray] = []  # numbers of pairs at a level, to be prepared with the next ones
        self._laws: Single = np.empty(0, dtype=np.float32)  # with room for more pairs
        self._flags: BoolArray = np.empty(0, dtype=np.bool_)

    def levels(self, pressure: FloatArray) -> IntArray:
        """The level that serves each pressure [MPa], given at the modulus of the network's plates."""
        return np.zeros(len(pressure), dtype=np.int64) if self.pressures is None else self.pressures.of(pressure)

    def predict(self, seat: IntArray, bore: IntArray, micro: float, level: IntArray | None = None) -> Prediction:
        """The coefficients of pairs of tiles, as the network gives them for their faces, to the bit.

        Args:
            seat: tile of the seat of each pair, (pairs,).
            bore: tile of the bore of each pair, (pairs,).
            micro: micro coefficient [-].
            level: from `levels`, (pairs,); left out, the first.

        Raises:
            PredictionError: there is no such tile, its surface cannot be made, or a micro coefficient is not finite.
        """
        self._check("axle", seat)
        self._check("wheel", bore)
        model = self.predictor.model
        if not isinstance(model, TrainedEnsemble):
            return self._whole(seat, bore, micro)
        level = np.zeros_like(seat) if level is None else level
        rows = self._row[seat, bore, level]
        if rows.min(initial=0) < 0:
            self.expect(seat, bore, level)
            self._prepare(model, *self._not_prepared())
            rows = self._row[seat, bore, level]
        if not len(rows):
            return self.predictor.nothing()
        return self.predictor.answer(self._laws[rows], self._flags[rows], micro)

    def expect(self, seat: IntArray, bore: IntArray, level: IntArray) -> None:
        """Prepare these pairs with the next ones that are not prepared yet: many at once take less time.

        Args:
            seat: as in `predict`; pairs of tiles that are not there are left out.
            bore: as in `predict`.
            level: as in `predict`.
        """
        if not isinstance(self.predictor.model, TrainedEnsemble):
            return  # the paper's network looks at each face once, and at pairs when they are asked
        there = (seat >= 0) & (seat < self.counts[0]) & (bore >= 0) & (bore < self.counts[1])
        asked = np.ravel_multi_index((seat[there], bore[there], level[there]), self._row.shape)
        new = asked[self._row.ravel()[asked] < 0]
        if len(new):
            self._expected.append(new)

    def _not_prepared(self) -> tuple[IntArray, ...]:
        """The pairs that were expected and are not prepared, each once; none is expected any longer."""
        expected, self._expected = np.concatenate(self._expected), []
        new = np.unique(expected[self._row.ravel()[expected] < 0])
        return np.unravel_index(new, self._row.shape)

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

    def _prepare(self, model: TrainedEnsemble, seat: IntArray, bore: IntArray, level: IntArray) -> None:
        """Add pairs to those whose laws are known."""
        wheels, axles = self._side("wheel", bore), self._side("axle", seat)
        pressure = None if self.pressures is None else self.pressures.pressure(level)
        load, free = self.predictor.conditions(len(seat), pressure, self.control)
        slopes, features = model.prepare(
            wheels.heights,
            axles.heights,
            bore,
            seat,
            roughness=(wheels.roughness, axles.roughness),
            load=load,
            constant_force=free,
            ends=self._slide_ends(seat, bore, level) if free.all() else None,
        )
        old, new = self.prepared, self.prepared + len(seat)
        laws = model.affine_laws(slopes, features)
        self._laws, self._flags = with_room(self._laws, laws, old), with_room(self._flags, model.flags(features), old)
        self._row[seat, bore, level] = np.arange(old, new)
        self.prepared = new

    def _slide_ends(self, seat: IntArray, bore: IntArray, level: IntArray) -> SlideEnds | None:
        """The ends of the slides of pairs, where a slide over a tile of the seat ends as that over the next begins."""
        if self._ends is None:
            return None
        shape = self.counts[0] + 1, *self._row.shape[1:]
        return SlideEnds(self._ends, *(np.ravel_multi_index((at, bore, level), shape) for at in (seat, seat + 1)))

    def _side(self, body: Body, tiles: IntArray) -> _Side:
        """The faces of a body, with these tiles made."""
        side, missing = self._sides[body], tiles[~self._sides[body].made[tiles]]
        together = isinstance(self.predictor.model, TrainedEnsemble) and in_one_piece(self.surface, body)
        block = FACES_TOGETHER if together else 1
        for first in np.unique(missing - missing % block).tolist():
            part = slice(first, min(first + block, len(side.made)))
            self._make(side, body, part)
            side.made[part] = True
            if body == "axle" and not side.goes_on(part):
                self._ends = None
            self.faces += part.stop - part.start
        return side

    def _make(self, side: _Side, body: Body, part: slice) -> None:
        """The faces of tiles that follow each other, and what is needed of them in any pair."""
        points, count = self.predictor.provenance.points, part.stop - part.start
        faces = generated_faces(body, tile_seed(self.seed, part.start), count, self.surface, points)
        side.heights[part] = faces
        if isinstance(self.predictor.model, TrainedEnsemble):
            side.roughness[part] = upper_roughness(faces)
        else:
            parts = np.stack([self.predictor.face_part(body, face) for face in faces])
            side.parts = side.parts if len(side.parts) else np.zeros((len(side.made), *parts.shape[1:]), np.float32)
            side.parts[part] = parts

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

    def goes_on(self, part: slice) -> bool:
        """Whether these faces and their neighbours go on in those that follow: a second half is the next first one."""
        near = slice(max(0, part.start - 1), part.stop + 1)
        faces, made, half = self.heights[near], self.made[near], self.heights.shape[1] // 2
        both = np.flatnonzero(made[:-1] & made[1:])
        return np.array_equal(faces[both, half:], faces[both + 1, : half + 1])


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


shared_tiles = functools.lru_cache(maxsize=KEPT)(Tiles)
"""Tiles of these arguments: the same object as before if it is among the last that were asked for."""
