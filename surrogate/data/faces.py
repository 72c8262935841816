"""Rough faces from their seeds or files, as the database has them and the network takes them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from macrofit.base.arrays import HeightArray
from meso.errors import MesoError
from meso.measured.keys import ScanKeys
from meso.settings import FaceKeys
from meso.surfaces.face import rough_face
from meso.surfaces.measured import covering, pieces_of, place_doubts, scan_of
from meso.surfaces.surface import Body, Surface, heights_at

from ..errors import PredictionError

Form: TypeAlias = Literal["strip", "tiles", "levelled"]

POINTS = 33
"""Points of a face along 1 mm."""


def generated_face(body: Body, seed: int, keys: FaceKeys, points: int = POINTS) -> HeightArray:
    """Make the rough face of a body, that of its plate: the wheel's on 1 x 1 mm, the axle's on 2 x 1 mm.

    Args:
        body: body whose stream of random numbers it is drawn from.
        seed: seed of the surface; of a strip, 65536 times its number plus the place on it.
        keys: how it is made.
        points: points of the face along 1 mm.

    Returns:
        Heights outward from the nominal face [mm], (points, points) or (2 points - 1, points).

    Raises:
        PredictionError: a key that its generator refuses.
    """
    face: HeightArray = generated_faces(body, seed, 1, keys, points)[0]
    return face


def generated_faces(body: Body, seed: int, count: int, keys: FaceKeys, points: int = POINTS) -> HeightArray:
    """Make the faces of seeds that follow each other, to the bits of `generated_face`.

    Those of a strip overlap: they are cut from one piece of it, which is made in a fraction of their time.

    Args:
        body: body whose faces they are.
        seed: seed of the first; of a strip, all of them lie on it.
        count: how many, 1 or more.
        keys: how they are made.
        points: points of a face along 1 mm.

    Returns:
        Heights outward from the nominal face [mm], (count, points, points) or (count, 2 points - 1, points).

    Raises:
        PredictionError: a key that its generator refuses.
    """
    length = 1 if body == "wheel" else 2
    size = float(length), 1.0
    try:
        if not in_one_piece(keys, body):
            faces = np.stack([rough_face(keys, body, each, size).heights for each in range(seed, seed + count)])
        else:
            long = rough_face(keys, body, seed, (size[0] + count - 1, 1.0)).heights
            cells = long.shape[1] - 1
            faces = np.stack([long[at * cells : (at + length) * cells + 1] for at in range(count)])
    except MesoError as error:
        raise PredictionError(f"surface of the {body}: {error}") from None
    shape = length * (points - 1) + 1, points
    x, y = (np.linspace(0.0, extent, n) for extent, n in zip(size, shape, strict=True))
    return np.asarray(heights_at(faces, size, x[:, None], y[None, :]), dtype=np.float32)


def in_one_piece(keys: FaceKeys, body: Body) -> bool:
    """Whether faces that follow each other are pieces of one that is made at once, and need not be levelled."""
    return keys.form == "strip" and keys.measured(body) is None


def sampled_heights(face: Surface, points: int) -> HeightArray:
    """Sample a face at `points` points across and as many on each square along the slide [mm]."""
    length, width = face.size
    sampled = face.resampled((round(length / width) * (points - 1) + 1, points)).heights
    return np.asarray(sampled, dtype=np.float32)


def read_face(path: Path, body: Body, points: int = POINTS) -> HeightArray:
    """Read a face as it stands in a file that covers it all: nothing is levelled.

    Raises:
        PredictionError: as `measured_face`.
    """
    keys = ScanKeys(files=(str(path),), use="face", remove="none", levels=max(1, round(np.log2(points - 1))))
    return measured_face(keys, body, 0, points)[0]


def measured_face(
    keys: ScanKeys, body: Body, seed: int, points: int = POINTS, form: Form = "strip"
) -> tuple[HeightArray, tuple[str, ...], tuple[str, ...]]:
    """Make the face of a body out of its files.

    Args:
        keys: files, and what is done with them.
        body: body whose face it is.
        seed: seed of the tile, where the file is a strip or patches.
        points: points of the face along 1 mm.
        form: "levelled" takes the mean plane away.

    Returns:
        Heights as `generated_face`, what was done to the file, and what may be wrong with it, in words.

    Raises:
        PredictionError: a file that cannot be used, and why.
    """
    size = (1.0, 1.0) if body == "wheel" else (2.0, 1.0)
    try:
        keys, assumed = covering(keys, size) if keys.use == "face" else (keys, ())
        face = rough_face(FaceKeys(form=form, axle=keys, bore=keys), body, seed, size)
        scans = [scan_of(keys, which) for which in range(len(keys.files))]
        doubts = (*assumed, *place_doubts(keys, seed, size), *(line for scan in scans for line in scan.doubts))
    except MesoError as error:
        raise PredictionError(str(error)) from None
    done = (*(line for scan in scans for line in scan.done), *pieces_of(keys, body, seed, size))
    return sampled_heights(face, points), done, doubts


def rms_height(heights: HeightArray, body: Body) -> float:
    """Sq of a face without its mean plane [mm], on the points that the network gets."""
    face = Surface(heights.astype(np.float64), (1.0 if body == "wheel" else 2.0, 1.0)).levelled()
    return float(np.sqrt(np.mean(face.heights**2)))
