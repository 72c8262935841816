"""Rough faces from their seeds, as the database has them and the network takes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from macrofit.base.arrays import HeightArray
from meso.errors import MesoError
from meso.surfaces.surface import Body, Surface, diamond_square, face_generator

from ..errors import PredictionError

POINTS = 33
"""Points of a face along 1 mm."""


def generated_face(
    body: Body, seed: int, *, levels: int, max_height: float, hurst_exponent: float, points: int = POINTS
) -> HeightArray:
    """Make the Diamond-Square face of a body: the wheel's on 1 x 1 mm, the axle's on 2 x 1 mm.

    Args:
        body: body whose stream of random numbers it is drawn from.
        seed: seed of the surface.
        levels: subdivisions, 2^levels + 1 points along 1 mm.
        max_height: R [mm].
        hurst_exponent: H [-].
        points: points of the face along 1 mm.

    Returns:
        Heights outward from the nominal face [mm], (points, points) or (2 points - 1, points).

    Raises:
        PredictionError: an argument that Diamond-Square refuses.
    """
    size = (1.0, 1.0) if body == "wheel" else (2.0, 1.0)
    try:
        face = diamond_square(
            face_generator(body, seed), levels=levels, max_height=max_height, hurst_exponent=hurst_exponent, size=size
        )
    except MesoError as error:
        raise PredictionError(f"surface of the {body}: {error}") from None
    return sampled_heights(face, points)


def sampled_heights(face: Surface, points: int) -> HeightArray:
    """Sample a face at `points` points across and as many on each square along the slide [mm]."""
    length, width = face.size
    sampled = face.resampled((round(length / width) * (points - 1) + 1, points)).heights
    return np.asarray(sampled, dtype=np.float32)


def read_face(path: Path, body: Body, points: int = POINTS) -> HeightArray:
    """Read a face from a table of heights [mm], one row for each place along the slide (.npy, or .csv with commas).

    It covers the whole face, 1 x 1 mm of the wheel or 2 x 1 mm of the axle, at any number of points.

    Raises:
        PredictionError: it cannot be read, is no table of finite numbers, or its points are not about as far apart
            along the slide as across.
    """
    try:
        table = np.load(path, allow_pickle=False) if path.suffix == ".npy" else np.loadtxt(path, delimiter=",", ndmin=2)
    except OSError as error:
        raise PredictionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise PredictionError(f"{path}: is no table of heights ({error}); take .npy, or .csv with commas") from None
    length = 1.0 if body == "wheel" else 2.0
    try:
        face = Surface(table, (length, 1.0))
    except MesoError as error:
        raise PredictionError(f"{path}: {error}") from None
    if not 0.5 < face.spacing[0] / face.spacing[1] < 2.0:
        raise PredictionError(
            f"{path}: {face.shape[0]} x {face.shape[1]} points are not those of {length:g} x 1 mm: "
            f"rows run along the slide, and the {body}'s face is {length:g} mm long"
        )
    return sampled_heights(face, points)
