"""Rough faces from their seeds, as the database has them and the network takes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from macrofit.base.arrayfile import read_npy
from macrofit.base.arrays import FloatArray, HeightArray
from macrofit.base.errors import OutputError
from macrofit.base.textfile import read_text_table
from macrofit.base.units import LENGTHS, read_heading
from meso.errors import MesoError
from meso.settings import FaceKeys
from meso.surfaces.face import rough_face
from meso.surfaces.surface import Body, Surface

from ..errors import PredictionError

MOST_BYTES = 100_000_000
"""Size of a file of heights; 3000 x 3000 points have about as much."""
HIGHEST = 1e3
"""No face rises further from nominal [mm]; the network's numbers end at 3e38."""
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
    size = (1.0, 1.0) if body == "wheel" else (2.0, 1.0)
    try:
        face = rough_face(keys, body, seed, size)
    except MesoError as error:
        raise PredictionError(f"surface of the {body}: {error}") from None
    return sampled_heights(face, points)


def sampled_heights(face: Surface, points: int) -> HeightArray:
    """Sample a face at `points` points across and as many on each square along the slide [mm]."""
    length, width = face.size
    sampled = face.resampled((round(length / width) * (points - 1) + 1, points)).heights
    return np.asarray(sampled, dtype=np.float32)


def read_face(path: Path, body: Body, points: int = POINTS) -> HeightArray:
    """Read a face from a table of heights [mm], one row for each place along the slide (.npy, or text such as .csv).

    It covers the whole face, 1 x 1 mm of the wheel or 2 x 1 mm of the axle, at any number of points. A text may name
    another unit of length before its numbers, ``# heights [µm]``.

    Raises:
        PredictionError: it cannot be read, is no table of finite real numbers, is the same height everywhere, or its
            points are not about as far apart along the slide as across.
    """
    length = 1.0 if body == "wheel" else 2.0
    try:
        table = read_npy(path, MOST_BYTES) if path.suffix == ".npy" else _read_text(path)
        if table.dtype.kind not in "fiu":
            raise OutputError(f"{path}: is no table of heights: its numbers are {table.dtype}, not real ones")
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused
            face = Surface(table, (length, 1.0))
    except OutputError as error:
        raise PredictionError(str(error)) from None
    except MesoError as error:
        raise PredictionError(f"{path}: {error}") from None
    if not 0.5 < face.spacing[0] / face.spacing[1] < 2.0:
        raise PredictionError(
            f"{path}: {face.shape[0]} x {face.shape[1]} points are not those of {length:g} x 1 mm: "
            f"rows run along the slide, and the {body}'s face is {length:g} mm long"
        )
    if float(np.abs(face.heights).max()) > HIGHEST:
        raise PredictionError(f"{path}: holds heights beyond {HIGHEST:g} mm; they are taken for mm")
    return sampled_heights(face, points)


def rms_height(heights: HeightArray, body: Body) -> float:
    """Sq of a face without its mean plane [mm], on the points that the network gets."""
    face = Surface(heights.astype(np.float64), (1.0 if body == "wheel" else 2.0, 1.0)).levelled()
    return float(np.sqrt(np.mean(face.heights**2)))


def _read_text(path: Path) -> FloatArray:
    """The rows of numbers of a text, in mm.

    Raises:
        OutputError: it is no text, a row is no row of numbers or has another length, or the unit is not known.
    """
    table = read_text_table(path, MOST_BYTES)
    rows: list[list[float]] = []
    factor = 1.0
    for number, line, cells in table.rows():
        values = [table.style.number(cell) for cell in cells]
        if line.startswith("#") or (not rows and None in values and len(cells) == 1):
            factor = factor if rows else _factor(path, line.strip("# "), factor)
            continue
        row = [value for value in values if value is not None]
        if len(row) < len(values):
            raise OutputError(f"{path}: line {number}: is no table of heights: '{line[:60]}'; take .npy or .csv")
        if rows and len(row) != len(rows[0]):
            raise OutputError(f"{path}: line {number}: has {len(row)} heights, those before it {len(rows[0])}")
        rows.append(row)
    if not rows:
        raise OutputError(f"{path}: is no table of heights: it has no row of numbers; take .npy or .csv")
    return np.array(rows) * factor


def _factor(path: Path, line: str, before: float) -> float:
    """What brings heights under this heading to mm; as before where it names no unit.

    Raises:
        OutputError: the unit is not one of length.
    """
    heading = read_heading(line)
    strange = heading.strange or (heading.unit if heading.unit not in (None, *LENGTHS) else None)
    if strange is not None:
        raise OutputError(f"{path}: unit '{strange}' before its heights is not known; take one of {', '.join(LENGTHS)}")
    return before if heading.unit is None else LENGTHS[heading.unit]
