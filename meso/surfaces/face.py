"""The rough face of a plate, as its keys ask for it: a tile by itself or a piece of a strip, with a lay or without."""

from __future__ import annotations

import numpy as np

from ..settings import FaceKeys
from .measured import measured_face
from .strip import cut, diamond_square_strip, spectral_strip
from .surface import TILES, Body, FloatArray, Surface, diamond_square, face_generator, generator, self_affine


def rough_face(keys: FaceKeys, body: Body, seed: int, size: tuple[float, float]) -> Surface:
    """The surface of this seed on the plate of a body.

    Of a strip, the seed is 65536 strip + place (`tile_seed`), and the face begins at `place` widths along it: the
    seat's tile i is [i, i + 2] tile lengths where the slide is one, the bore's tile j is [j, j + 1].

    Args:
        keys: form, generator and lay with their numbers.
        body: body whose random streams are taken.
        seed: seed of the tile.
        size: length along the slide and width [mm].

    Raises:
        SettingsError: a key that is out of bounds, or grooves and roll-off that the grid cannot hold.
        SurfaceError: a size that is not a row of whole squares, of Diamond-Square; a measured face that cannot be used.
    """
    scan = keys.measured(body)
    if scan is not None:
        face = measured_face(scan, body, seed, size)
        return face.levelled() if keys.form == "levelled" else face
    keys.check(size[1])
    strip, place = divmod(seed, TILES) if keys.form == "strip" else (seed, 0)
    face = _strip(keys, body, strip, place, size) if keys.form == "strip" else _alone(keys, body, seed, size)
    if keys.lay == "turned":
        phase = generator(f"grooves of the {body}", strip).random()
        face = Surface(face.heights + _grooves(keys, face, place, phase)[:, None], face.size)
    return face.levelled() if keys.form == "levelled" else face


def _strip(keys: FaceKeys, body: Body, strip: int, place: int, size: tuple[float, float]) -> Surface:
    """A piece of a strip, before grooves."""
    if keys.generator == "diamond_square":
        columns, cells = diamond_square_strip(
            body, strip, levels=keys.levels, max_height=keys.max_height, hurst_exponent=keys.hurst_exponent, size=size
        )
    else:
        columns, cells = spectral_strip(
            body, strip, levels=keys.levels, rms_height=keys.rms_height, hurst_exponent=keys.hurst_exponent,
            roll_off=keys.roll_off, width=size[1],
        )  # fmt: skip
    face = cut(columns, cells, place, size)
    return Surface(_stretched(face.heights, keys.anisotropy), size) if keys.lay == "ground" else face


def _alone(keys: FaceKeys, body: Body, seed: int, size: tuple[float, float]) -> Surface:
    """A tile by itself, before grooves."""
    rng, ground = face_generator(body, seed), keys.lay == "ground"
    if keys.generator == "diamond_square":
        face = diamond_square(
            rng, levels=keys.levels, max_height=keys.max_height, hurst_exponent=keys.hurst_exponent, size=size
        )
        return Surface(_stretched(face.heights, keys.anisotropy), size) if ground else face
    shape = (round(size[0] * 2**keys.levels) + 1, round(size[1] * 2**keys.levels) + 1)
    face = self_affine(rng, shape=shape, rms_height=keys.rms_height, hurst_exponent=keys.hurst_exponent, size=size)
    if not ground:
        return face
    face = Surface(_stretched(face.heights, keys.anisotropy), size).levelled()
    (wx, wy), h = face.weights, face.heights
    rms = float(np.sqrt(wx @ h**2 @ wy))
    return Surface(h * (keys.rms_height / rms if rms else 0.0), size)  # Sq is what is asked for


def _stretched(heights: FloatArray, anisotropy: float) -> FloatArray:
    """The middle of the width drawn out over all of it: wavelengths across grow by the anisotropy."""
    cells = heights.shape[1] - 1
    y = 0.5 * cells + (np.arange(cells + 1) - 0.5 * cells) / anisotropy
    j = np.minimum(y.astype(np.intp), cells - 1)
    v = y - j
    drawn: FloatArray = heights[:, j] * (1.0 - v) + heights[:, j + 1] * v
    return drawn


def _grooves(keys: FaceKeys, face: Surface, place: int, phase: float) -> FloatArray:
    """Heights of turned grooves along x [mm], (nx,): parabolas that meet in cusps, of mean 0.

    h = depth ((2 u - 1)^2 - 1/3), u = x / feed + phase modulo 1; a nose of radius r leaves a depth of feed^2 / (8 r).
    """
    cells = face.shape[1] - 1
    u = (place * cells + np.arange(face.shape[0])) * (face.size[1] / cells / keys.feed) + phase
    heights: FloatArray = keys.groove_depth * ((2.0 * (u - np.floor(u)) - 1.0) ** 2 - 1.0 / 3.0)
    return heights
