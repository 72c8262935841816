"""One continuous roughness along a body, made a column of squares at a time from random numbers of its own neighbours.

A strip runs along the slide and is as wide as a plate. It is cut into columns, as long as the strip is wide; column k
covers k ... k + 1 widths, and takes random numbers of streams (body, strip, column) nearby. So a column far along costs
as much as the first, and two faces that share a column share its bits. The nominal face is the strip's mean plane:
all heights have the expectation 0.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from math import ceil
from typing import NamedTuple, TypeAlias

import numpy as np

from .surface import TILES, Body, FloatArray, Surface, check_bounds, generator, grid_shape, subdivide

Column: TypeAlias = Callable[[int], FloatArray]
"""Heights of a column by its number, (m, m + 1): its right edge belongs to the next."""

Columns: TypeAlias = Callable[[int, int], FloatArray]
"""Heights of columns by the number of the first and how many, (count m, m + 1)."""

KEPT = 3
"""Most columns that are made one by one, and kept for their neighbours: those of a tile."""
TOGETHER = 2**18
"""Points of a row of squares that are made together, at most."""

REACH = 1.25
"""Support of the spectral kernel on each side, over the roll-off wavelength [-]."""


def cut(columns: Columns, cells: int, place: int, size: tuple[float, float]) -> Surface:
    """The face that lies at `place` widths along a strip.

    Args:
        columns: heights of the strip's columns.
        cells: cells along a column, m.
        place: where the face begins, in widths.
        size: length along the slide and width [mm].
    """
    length, width = size
    points = length / width * cells
    whole = abs(points - round(points)) < 1e-9 * points
    rows = (round(points) if whole else ceil(points)) + 1
    heights = columns(place, ceil(rows / cells))[:rows]
    if whole:
        return Surface(heights, size)
    longer = Surface(heights, ((rows - 1) * width / cells, width))
    x = np.linspace(0.0, length, max(3, round(points) + 1))
    return Surface(longer.at(x[:, None], longer.y[None, :]), size)


def diamond_square_strip(
    body: Body, strip: int, *, levels: int, max_height: float, hurst_exponent: float, size: tuple[float, float]
) -> tuple[Columns, int]:
    """Columns of a Diamond-Square surface without end, in both directions.

    As `diamond_square`, on a plane of squares of which the strip is one row: all edges have squares on both sides.
    A point depends on the random numbers of its own square and of those next door, to the bit.

    Args:
        body: whose streams are taken.
        strip: which of its strips.
        levels: n, the number of subdivisions of a square.
        max_height: R, the range of one draw [mm].
        hurst_exponent: H [-].
        size: a face that will be cut; its width is that of the strip [mm].

    Returns:
        The columns, and the cells along one.

    Raises:
        SettingsError: levels, max_height or hurst_exponent out of bounds.
        SurfaceError: a size that is not a row of whole squares.
    """
    grid_shape(levels, size)
    check_bounds("max_height", max_height)
    check_bounds("hurst_exponent", hurst_exponent, 1.0)
    how = body, strip, levels, max_height, hurst_exponent
    most = max(1, TOGETHER >> 2 * levels)

    def columns(first: int, count: int) -> FloatArray:
        if count <= KEPT:
            return _joined(functools.partial(_square, *how), first, count)
        end = first + count
        return np.concatenate([_squares(*how, at, min(most, end - at)) for at in range(first, end, most)])

    return columns, 2**levels


def _joined(column: Column, first: int, count: int) -> FloatArray:
    """Columns one after the other."""
    return np.concatenate([column(first + k) for k in range(count)])


@functools.lru_cache(maxsize=12)
def _square(body: Body, strip: int, levels: int, max_height: float, hurst_exponent: float, column: int) -> FloatArray:
    """Heights of one column."""
    return _fixed(_squares(body, strip, levels, max_height, hurst_exponent, column, 1))


def _squares(
    body: Body, strip: int, levels: int, max_height: float, hurst_exponent: float, first: int, count: int
) -> FloatArray:
    """The middle ones of three rows of squares, with one more at each end."""
    side = 2**levels
    near = [_draws(body, strip, levels, first + k) for k in range(-1, count + 2)]
    h = np.zeros(((count + 2) * side + 1, 3 * side + 1))
    h[::side, ::side] = max_height * (np.stack([each.corners for each in near]) - 0.5)
    for level in range(1, levels + 1):
        step = side >> level
        subdivide(h[::step, ::step], _noise(near, level), max_height * 2.0 ** (-hurst_exponent * level))
    return h[side : (count + 1) * side, side : 2 * side + 1]


class _Level(NamedTuple):
    """Random numbers of a column of three squares at one level, each square cut into c by c cells of two spacings."""

    centres: FloatArray  # (c, 3 c)
    along: FloatArray  # middles along x, (c, 3 c + 1)
    across: FloatArray  # middles along y, (3 c, c): those of the left edge and within


class _Draws(NamedTuple):
    corners: FloatArray  # of the left edge, (4,)
    levels: list[_Level]


@functools.lru_cache(maxsize=16)  # four for a column of each body, in turn
def _draws(body: Body, strip: int, levels: int, column: int) -> _Draws:
    """Uniform numbers of a column; those of more levels have the same beginning."""
    cells = 2 ** np.arange(levels)
    numbers = _stream(body, strip, column).random(int(4 + np.sum(9 * cells**2 + cells)))
    found, start = [], 4
    for c in cells.tolist():
        parts = []
        for shape in ((c, 3 * c), (c, 3 * c + 1), (3 * c, c)):
            parts.append(numbers[start : start + shape[0] * shape[1]].reshape(shape))
            start += shape[0] * shape[1]
        found.append(_Level(*parts))
    return _Draws(numbers[:4], found)


def _noise(near: list[_Draws], level: int) -> Callable[[tuple[int, ...]], FloatArray]:
    """Random numbers of columns and of the edge behind them, in the order that `subdivide` draws them."""
    *these, behind = (each.levels[level - 1] for each in near)
    parts = iter(
        [
            np.concatenate([each.centres for each in these]),
            np.concatenate([each.along for each in these]),
            np.concatenate([each.across for each in these] + [behind.across[:, :1]], axis=1),
        ]
    )
    return lambda _: next(parts)


def spectral_strip(
    body: Body,
    strip: int,
    *,
    levels: int,
    rms_height: float,
    hurst_exponent: float,
    roll_off: float,
    width: float,
) -> tuple[Columns, int]:
    """Columns of a stationary, isotropic Gaussian surface: white noise under a kernel of finite support.

    The kernel's transform is the root of the spectrum of `self_affine`, C(q) ~ q^(-2-2H), constant above the roll-off
    wavelength; it ends smoothly at `REACH` times that wavelength. The sum of its squares is Sq^2: the variance of
    every point, over strips, is rms_height^2. A face cut from it has less, for its mean plane is a part of it.

    Args:
        body: whose streams are taken.
        strip: which of its strips.
        levels: about 2^n points to a millimetre.
        rms_height: Sq of the strip [mm].
        hurst_exponent: H [-].
        roll_off: wavelength above which the spectrum is flat [mm].
        width: of the strip [mm].

    Returns:
        The columns, and the cells along one.

    Raises:
        SettingsError: rms_height or hurst_exponent out of bounds.
    """
    check_bounds("rms_height", rms_height)
    check_bounds("hurst_exponent", hurst_exponent, 1.0)
    cells = max(2, round(width * 2**levels))
    margin = ceil(REACH * roll_off / width * cells - 1e-9)
    how = body, strip, cells, margin, rms_height, hurst_exponent, roll_off, width
    return functools.partial(_joined, functools.partial(_convolved, *how)), cells


@functools.lru_cache(maxsize=12)
def _convolved(
    body: Body,
    strip: int,
    cells: int,
    margin: int,
    rms: float,
    hurst: float,
    roll_off: float,
    width: float,
    column: int,
) -> FloatArray:
    beside = ceil(margin / cells)
    noise = np.concatenate([_white(body, strip, cells, margin, column + k) for k in range(-beside, beside + 1)])
    noise = noise[beside * cells - margin : (beside + 1) * cells + margin]
    transform = _kernel(noise.shape, margin, hurst, roll_off * cells / width)
    field = np.fft.irfft2(np.fft.rfft2(noise) * transform, noise.shape)
    return _fixed(rms * field[margin : margin + cells, margin : margin + cells + 1])


@functools.lru_cache(maxsize=24)
def _white(body: Body, strip: int, cells: int, margin: int, column: int) -> FloatArray:
    return _stream(body, strip, column).standard_normal((cells, cells + 1 + 2 * margin))


@functools.lru_cache(maxsize=2)
def _kernel(shape: tuple[int, int], margin: int, hurst_exponent: float, roll_off: float) -> FloatArray:
    """Transform of the kernel on a periodic grid of this shape; lengths in spacings."""
    n = 2 * (2 * margin + 1)
    frequency = np.hypot(np.fft.fftfreq(n, 1.0)[:, None], np.fft.rfftfreq(n, 1.0)[None, :])
    amplitude = np.maximum(frequency, 1.0 / roll_off) ** (-1.0 - hurst_exponent)
    amplitude[frequency > 0.5 * (1.0 + 1e-9)] = 0.0  # waves of two spacings are the shortest
    lags = np.arange(-margin, margin + 1)
    kernel = np.fft.irfft2(amplitude, (n, n))[np.ix_(lags, lags)]
    distance = np.minimum(np.hypot(lags[:, None], lags[None, :]) / (margin + 1), 1.0)
    kernel *= np.cos(0.5 * np.pi * distance) ** 2
    placed = np.zeros(shape)
    placed[np.ix_(lags, lags)] = kernel / np.sqrt(np.sum(kernel**2))
    transform: FloatArray = np.fft.rfft2(placed).real  # the kernel is even
    return transform


def _stream(body: Body, strip: int, column: int) -> np.random.Generator:
    return generator(f"strip of the {body}", strip, TILES + column)


def _fixed(heights: FloatArray) -> FloatArray:
    """A copy that no holder can change."""
    heights = heights.copy()
    heights.setflags(write=False)
    return heights
