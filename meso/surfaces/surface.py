"""Rough surfaces: heights on a regular grid, two ways of making them, and the random streams that make them."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from ..errors import SettingsError, SurfaceError

FloatArray = npt.NDArray[np.float64]
Body: TypeAlias = Literal["wheel", "axle"]
LEVELS = range(1, 11)
TILES = 2**16
"""Tiles of one body, and seeds to choose from; both are counted from 0."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Heights of a rough face on a regular grid, linear on triangles between its points.

    Point (i, j) lies at x = i dx, y = j dy. Each cell is cut along the diagonal from (i, j) to (i+1, j+1);
    the hull has the same triangles. The heights are copied, contiguous and read-only.

    Raises:
        SurfaceError: not a finite table of at least 2 x 2 heights, or a size that is not positive.
    """

    heights: FloatArray
    """h [mm], measured outward from the nominal face, shape (nx, ny)."""

    size: tuple[float, float]
    """Length along the slide (x) and width (y) [mm]."""

    def __post_init__(self) -> None:
        try:
            heights = np.array(self.heights, dtype=np.float64, order="C")
        except (TypeError, ValueError) as error:
            raise SurfaceError(f"heights are not a table of numbers: {error}") from None
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise SurfaceError(f"heights have shape {heights.shape}: a surface takes at least 2 x 2 points")
        if not np.isfinite(heights).all():
            i, j = np.argwhere(~np.isfinite(heights))[0]
            raise SurfaceError(f"heights[{i}, {j}] = {heights[i, j]} is not finite: mend or crop the data there")
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "size", _checked(self.size))

    @classmethod
    def flat(cls, size: tuple[float, float], height: float = 0.0) -> Surface:
        """A smooth face at one height [mm], on four points."""
        return cls(np.full((2, 2), height), size)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of points along x and y, (nx, ny)."""
        nx, ny = self.heights.shape
        return nx, ny

    @property
    def spacing(self) -> tuple[float, float]:
        """Distances dx, dy between points [mm]."""
        (nx, ny), (length, width) = self.shape, self.size
        return length / (nx - 1), width / (ny - 1)

    @property
    def x(self) -> FloatArray:
        """Coordinates of the points along the slide [mm], shape (nx,)."""
        return np.linspace(0.0, self.size[0], self.shape[0])

    @property
    def y(self) -> FloatArray:
        """Coordinates of the points across the slide [mm], shape (ny,)."""
        return np.linspace(0.0, self.size[1], self.shape[1])

    @property
    def weights(self) -> tuple[FloatArray, FloatArray]:
        """Shares of the length and of the width that belong to each point [-], shapes (nx,) and (ny,), sums 1."""
        nx, ny = self.shape
        return _shares(nx), _shares(ny)

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """h(x, y) [mm], linear on the triangles, in the shape x and y [mm] broadcast to.

        Points beyond the border take the height of the nearest point of the border.
        """
        return heights_at(self.heights, self.size, x, y)

    def resampled(self, shape: tuple[int, int]) -> Surface:
        """The same face read at another number of points; nothing is smoothed, so fewer points leave peaks out."""
        x, y = (np.linspace(0.0, length, n) for length, n in zip(self.size, shape, strict=True))
        return Surface(self.at(x[:, None], y[None, :]), self.size)

    def levelled(self) -> Surface:
        """Without its mean plane: what is left of h after the area-weighted least-squares fit c + a x + b y."""
        wx, wy = self.weights
        x, y = self.x - 0.5 * self.size[0], self.y - 0.5 * self.size[1]  # centred: 1, x and y are orthogonal
        rest = self.heights - wx @ self.heights @ wy
        along = (wx * x) @ rest @ wy / (wx @ x**2)
        across = wx @ rest @ (wy * y) / (wy @ y**2)
        return Surface(rest - along * x[:, None] - across * y[None, :], self.size)


def heights_at(h: FloatArray, size: tuple[float, float], x: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
    """Heights of faces of one size between their points, as `Surface.at` has them.

    Args:
        h: heights of the faces (..., nx, ny) [mm].
        size: length along the slide and width [mm].
        x: along the slide [mm].
        y: across [mm].

    Returns:
        Heights (..., shape that x and y broadcast to) [mm].
    """
    (i, u), (j, v) = (_cell(h.shape[axis - 2] - 1, size[axis], each) for axis, each in enumerate((x, y)))
    row, flat = h.shape[-1], h.reshape(*h.shape[:-2], -1)
    at = i * row + j  # taken by one number, in half of the time that two take
    corner, opposite = flat.take(at, -1), flat.take(at + (row + 1), -1)
    middle = flat.take(at + np.where(u >= v, row, 1), -1)  # the third corner of the point's triangle
    larger, smaller = np.maximum(u, v), np.minimum(u, v)
    return np.asarray(corner + (middle - corner) * larger + (opposite - middle) * smaller)


def _cell(cells: int, length: float, coordinate: npt.ArrayLike) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """The cell of each coordinate [mm] along so many cells, and its place within."""
    s = np.clip(np.asarray(coordinate, dtype=np.float64) * (cells / length), 0.0, cells)
    cell = np.minimum(s.astype(np.intp), cells - 1)
    return cell, s - cell


def generator(purpose: str, *numbers: int) -> np.random.Generator:
    """A random stream of its own for each purpose and numbers, the same on every machine.

    Streams such as ("surface", 3, 0), ("surface", 3, 1) and ("packing", 3) are independent. The seed is
    (crc32(purpose), count of numbers, numbers): without the count, numpy takes (3,) and (3, 0) for the same.

    Raises:
        SettingsError: a number outside 0 ... 2^32 - 1.
    """
    for number in numbers:
        if not 0 <= number < 2**32:
            raise SettingsError(f"seed {number} of the {purpose}: take a whole number from 0 to 4294967295")
    words = [zlib.crc32(purpose.encode()), len(numbers), *(int(number) for number in numbers)]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def face_generator(body: Body, seed: int) -> np.random.Generator:
    """The stream of a body's rough face; those of axle and wheel are independent, whatever their seeds."""
    return generator(f"surface of the {body}", seed)


def tile_seed(seed: int, tile: int) -> int:
    """The surface seed of a tile, 65536 seed + tile: no two tiles of a body share one, whatever the seed.

    Seat tile i has axle_seed = tile_seed(seed, i) and bore tile j has wheel_seed = tile_seed(seed, j). The surfaces
    of axle and wheel are drawn from independent streams, so equal numbers are not equal surfaces. Of a strip, the
    seed names the strip and the tile the place on it: neighbours overlap, and only other seeds are independent.

    Raises:
        SettingsError: a seed or a tile outside 0 ... 65535.
    """
    if not 0 <= seed < TILES:
        raise SettingsError(f"seed = {seed} is out of bounds: take 0 ... {TILES - 1}")
    if not 0 <= tile < TILES:
        raise SettingsError(f"there is no tile {tile}; they are numbered 0 ... {TILES - 1}")
    return TILES * seed + tile


def grid_shape(levels: int, size: tuple[float, float]) -> tuple[int, int]:
    """Points of a Diamond-Square grid: 2^levels + 1 on the shorter side, whole squares along the longer.

    Raises:
        SettingsError: levels outside 1 ... 10.
        SurfaceError: a size that is not a row of whole squares.
    """
    if levels not in LEVELS:
        raise SettingsError(f"levels = {levels}: take a whole number from {LEVELS[0]} to {LEVELS[-1]}")
    length, width = _checked(size)
    side = min(length, width)
    a, b = (round(extent / side) for extent in (length, width))
    if abs(a * side - length) + abs(b * side - width) > 1e-9 * side:
        best = f"{a * side:g} x {b * side:g}"
        raise SurfaceError(f"size {length:g} x {width:g} mm is not a row of whole squares: try {best} mm")
    return a * 2**levels + 1, b * 2**levels + 1


def diamond_square(
    rng: np.random.Generator,
    *,
    levels: int,
    max_height: float,
    hurst_exponent: float = 0.8,
    size: tuple[float, float] = (1.0, 1.0),
) -> Surface:
    """A fractal surface by Diamond-Square subdivision.

    Corner heights are uniform in [-R/2, R/2]. At level k = 1 ... n the centre of each square becomes the mean of
    its four corners (diamond step), then the middle of each edge the mean of its neighbours (square step: two
    points and two centres, one centre on the border); each gains noise uniform in [-R/2, R/2] 2^(-H k).
    A rectangle is a row of squares; an edge between two of them has both centres for neighbours. The stream gives
    the corners first, then per level the centres, the middles along x and those along y, each in C order (the
    last with x running fastest): another level adds points between those of the same seed and leaves them.

    Args:
        rng: the stream the heights are drawn from.
        levels: n, the number of subdivisions; 2^n + 1 points along the shorter side.
        max_height: R, the range of one draw [mm]. Draws add up, so peak to valley may exceed it.
        hurst_exponent: H [-], 0 (rough) to 1 (smooth).
        size: length along the slide and width [mm]; the longer a whole multiple of the shorter.

    Raises:
        SettingsError: levels, max_height or hurst_exponent out of bounds.
        SurfaceError: a size that is not a row of whole squares.

    H rules the noise, not what is measured: with random corners the surface nears a power law only slowly. For
    H = 0.8 the structure function gives 0.55 +- 0.05 at 5 levels and 0.68 +- 0.02 at 9; Sa is 0.063 R.

    Source: Fournier, Fussell, Carpenter, Commun. ACM 25 (1982) 371-384 (doi 10.1145/358523.358553); examined, with
    the creases left along the edges of the first squares, by Miller, The definition and rendering of terrain
    maps, SIGGRAPH 1986, 39-48 (doi 10.1145/15886.15890); used for axle and wheel by Lalleman, Gosselet, Hubert,
    Salengro, Magnier.
    """
    shape = grid_shape(levels, size)
    check_bounds("max_height", max_height)
    check_bounds("hurst_exponent", hurst_exponent, 1.0)
    h = np.zeros(shape)
    step = 2**levels
    corners = h[::step, ::step]
    corners[:] = max_height * (rng.random(corners.shape) - 0.5)
    for level in range(1, levels + 1):
        subdivide(h[:: step // 2, :: step // 2], rng.random, max_height * 2.0 ** (-hurst_exponent * level))
        step //= 2
    return Surface(h, size)


def subdivide(h: FloatArray, draw: Callable[[tuple[int, ...]], FloatArray], noise: float) -> None:
    """One level of Diamond-Square, in place: points with two even indices are known, the others are set.

    Args:
        h: heights [mm], (nx, ny), both odd.
        draw: gives numbers uniform in [0, 1) of a shape: for the centres, the middles along x, those along y.
        noise: range of the random term [mm].
    """
    known, centres = h[::2, ::2], h[1::2, 1::2]
    centres[:] = 0.25 * (known[:-1, :-1] + known[1:, :-1] + known[:-1, 1:] + known[1:, 1:])
    centres += noise * (draw(centres.shape) - 0.5)
    middles, between = h[1::2, ::2], centres
    for _ in range(2):  # the middles along x, then the same with the axes exchanged
        total, count = known[:-1] + known[1:], np.full(middles.shape[1], 4.0)
        total[:, 1:] += between
        total[:, :-1] += between
        count[[0, -1]] = 3.0
        middles[:] = total / count + noise * (draw(middles.shape) - 0.5)
        known, between, middles = known.T, centres.T, h[::2, 1::2].T


def self_affine(
    rng: np.random.Generator,
    *,
    shape: tuple[int, int],
    rms_height: float,
    hurst_exponent: float = 0.8,
    size: tuple[float, float] = (1.0, 1.0),
    long_cutoff: float | None = None,
    short_cutoff: float | None = None,
) -> Surface:
    """A self-affine surface with random phases, isotropic and without the creases of Diamond-Square.

    Its power spectrum is C(q) ~ q^(-2-2H) for wavelengths 2 pi/q between the cut-offs, constant above the long
    one, zero below the short one. It is made on a periodic grid of twice the size and cropped, hence not periodic;
    then levelled and scaled, so that the Sq of `roughness.measure` is rms_height to rounding.

    Args:
        rng: the stream the phases are drawn from.
        shape: number of points along x and y; `grid_shape` gives that of Diamond-Square.
        rms_height: Sq [mm].
        hurst_exponent: H [-], 0 to 1.
        size: length along the slide and width [mm].
        long_cutoff: roll-off wavelength [mm]; none: the power law holds up to twice the size.
        short_cutoff: shortest wavelength [mm]; none: twice the larger spacing, the shortest the grid resolves.

    Raises:
        SettingsError: rms_height, hurst_exponent or a cut-off out of bounds.
        SurfaceError: fewer than 3 points on a side, or a size that is not positive.

    Source: Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001 (doi 10.1088/2051-672X/aa51f8).
    """
    if min(shape) < 3:
        raise SurfaceError(f"a self-affine surface of {shape[0]} x {shape[1]} points: take at least 3 x 3")
    check_bounds("rms_height", rms_height)
    check_bounds("hurst_exponent", hurst_exponent, 1.0)
    (nx, ny), (length, width) = shape, _checked(size)
    dx, dy = length / (nx - 1), width / (ny - 1)
    resolved = 2.0 * max(dx, dy)
    shortest = resolved if short_cutoff is None else short_cutoff
    longest = np.inf if long_cutoff is None else long_cutoff
    if not resolved * (1.0 - 1e-12) <= shortest <= min(length, width):
        limits = f"from {resolved:.4g} (two spacings) to {min(length, width):.4g}"
        raise SettingsError(f"short_cutoff = {shortest:.4g} mm: take {limits} mm, or another number of points")
    if not longest > shortest:
        raise SettingsError(f"long_cutoff = {longest:.4g} mm: take it above the short one, {shortest:.4g} mm")
    cells = 2 * (nx - 1), 2 * (ny - 1)
    # 1 / wavelength, not the angular q: only ratios matter
    frequency = np.hypot(np.fft.fftfreq(cells[0], dx)[:, None], np.fft.rfftfreq(cells[1], dy)[None, :])
    frequency[0, 0] = np.inf  # no mean
    amplitude = np.maximum(frequency, 1.0 / longest) ** (-1.0 - hurst_exponent)
    amplitude[(frequency > (1.0 + 1e-9) / shortest)] = 0.0
    white = np.fft.rfft2(rng.standard_normal(cells))  # its phases are random, and those of a real field
    field = np.fft.irfft2(amplitude * white / np.abs(white), cells)
    rough = Surface(field[:nx, :ny], size).levelled()
    wx, wy = rough.weights
    return Surface(rough.heights * (rms_height / np.sqrt(wx @ rough.heights**2 @ wy)), size)


def _shares(n: int) -> FloatArray:
    shares = np.full(n, 1.0 / (n - 1))
    shares[[0, -1]] *= 0.5
    return shares


def _checked(size: tuple[float, float]) -> tuple[float, float]:
    try:
        length, width = (float(extent) for extent in size)
    except (TypeError, ValueError):
        raise SurfaceError(f"size {size!r}: give the length along the slide and the width, in mm") from None
    if not (length > 0.0 and width > 0.0 and isfinite(length) and isfinite(width)):
        raise SurfaceError(f"size {length:g} x {width:g} mm: both must be positive")
    return length, width


def check_bounds(name: str, value: float, limit: float = np.inf) -> None:
    """Refuse a value outside 0 ... limit.

    Raises:
        SettingsError: naming it.
    """
    if not (0.0 <= value <= limit and isfinite(value)):
        bounds = "0 or more" if limit == np.inf else f"a value from 0 to {limit:g}"
        raise SettingsError(f"{name} = {value:g} is out of bounds: take {bounds}")
