"""Rough surfaces: Diamond-Square against plain loops, the spectrum of the spectral one, reading between points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from macrofit.base.arrays import FloatArray
from meso.errors import SettingsError, SurfaceError
from meso.surfaces.roughness import measure, structure_function
from meso.surfaces.surface import Surface, diamond_square, generator, grid_shape, self_affine


def plain_diamond_square(
    rng: np.random.Generator, levels: int, max_height: float, hurst: float, squares: tuple[int, int]
) -> FloatArray:
    """The algorithm point by point, from its definition."""
    nx, ny = (count * 2**levels + 1 for count in squares)
    h: dict[tuple[int, int], float] = {}

    def rule(points: list[tuple[int, int]], offsets: list[tuple[int, int]], level: int) -> None:
        for i, j in points:
            around = [h[i + a, j + b] for a, b in offsets if (i + a, j + b) in h]
            mean = sum(around) / len(around) if around else 0.0
            new[i, j] = mean + max_height * 2.0 ** (-hurst * level) * (rng.random() - 0.5)

    for level in range(levels + 1):
        new: dict[tuple[int, int], float] = {}
        step = 2 ** (levels - level)
        if level == 0:
            rule([(i, j) for i in range(0, nx, step) for j in range(0, ny, step)], [], 0)
            h.update(new)
            continue
        odd_x, even_x = range(step, nx, 2 * step), range(0, nx, 2 * step)
        odd_y, even_y = range(step, ny, 2 * step), range(0, ny, 2 * step)
        rule([(i, j) for i in odd_x for j in odd_y], [(a, b) for a in (-step, step) for b in (-step, step)], level)
        h.update(new)
        cross = [(-step, 0), (step, 0), (0, -step), (0, step)]
        rule([(i, j) for i in odd_x for j in even_y], cross, level)
        rule([(i, j) for j in odd_y for i in even_x], cross, level)
        h.update(new)
    return np.array([[h[i, j] for j in range(ny)] for i in range(nx)])


@pytest.mark.parametrize("squares", [(1, 1), (2, 1), (1, 3)])
@pytest.mark.parametrize("hurst", [0.0, 0.8, 1.0])
def test_diamond_square_is_its_definition(squares: tuple[int, int], hurst: float) -> None:
    """Vectorised and plain loops agree to rounding: a few sums of four numbers below 1, 5 levels deep."""
    size = (0.5 * squares[0], 0.5 * squares[1])
    for seed in range(3):
        surface = diamond_square(generator("test", seed), levels=4, max_height=1.0, hurst_exponent=hurst, size=size)
        plain = plain_diamond_square(generator("test", seed), 4, 1.0, hurst, squares)
        assert surface.shape == plain.shape == grid_shape(4, size)
        assert surface.heights == pytest.approx(plain, rel=0, abs=2e-15)
        assert surface.size == size


@pytest.mark.parametrize("hurst", [0.3, 0.8])
def test_noise_of_each_level(hurst: float) -> None:
    """Centre minus mean of its corners is uniform in +- R 2^(-H k) / 2.

    Hard bound to rounding; its standard deviation R 2^(-H k) / sqrt(12) within four standard errors, which for
    a uniform draw (kurtosis 1.8) are sqrt(0.2 / count) of it.
    """
    levels, R, seeds = 6, 0.02, 40
    found: dict[int, list[FloatArray]] = {level: [] for level in range(levels + 1)}
    for seed in range(seeds):
        h = diamond_square(generator("test", seed), levels=levels, max_height=R, hurst_exponent=hurst).heights
        found[0].append(h[:: 2**levels, :: 2**levels].ravel())
        for level in range(1, levels + 1):
            grid = h[:: 2 ** (levels - level), :: 2 ** (levels - level)]
            k = grid[::2, ::2]
            mean = 0.25 * (k[1:, 1:] + k[:-1, 1:] + k[1:, :-1] + k[:-1, :-1])
            found[level].append((grid[1::2, 1::2] - mean).ravel())
    for level, parts in found.items():
        noise, extent = np.concatenate(parts), R * 2.0 ** (-hurst * level)
        assert np.abs(noise).max() <= 0.5 * extent * (1 + 1e-12)
        rms = np.sqrt(np.mean(noise**2))
        assert rms == pytest.approx(extent / np.sqrt(12.0), rel=4 * np.sqrt(0.2 / len(noise)))


def test_variogram_follows_the_hurst_exponent() -> None:
    """S(l) ~ l^(2H) over 20 seeds: at H = 0.3 the memory of the corners dies out fast.

    The exponent scatters by 0.02 from seed to seed: 0.02 is four standard errors of the mean.
    """
    total = np.zeros(7)
    for seed in range(20):
        h = diamond_square(generator("test", seed), levels=8, max_height=1.0, hurst_exponent=0.3).heights
        total += structure_function(h)[1] + structure_function(h.T)[1]
    slope = np.polyfit(np.log(2.0 ** np.arange(7)), np.log(total), 1)[0]
    assert slope / 2 == pytest.approx(0.3, abs=0.02)


def test_another_level_keeps_the_points() -> None:
    coarse, fine = (diamond_square(generator("test", 1), levels=n, max_height=1.0, size=(2.0, 1.0)) for n in (3, 5))
    assert np.array_equal(fine.heights[::4, ::4], coarse.heights)


def test_streams() -> None:
    """The same words give the same bits on every machine and in every release; other words another stream."""
    assert generator("axle surface", 3).bit_generator.random_raw(2).tolist() == [
        5576154870413933336,
        10870653356937207089,
    ]
    words = [("a", 3), ("b", 3), ("a", 4), ("a",), ("a", 3, 0), ("a", 0, 3), ("a", 0), ("a", 3, 0, 0)]
    first = {int(generator(*each).integers(2**63)) for each in words}  # type: ignore[arg-type]
    assert len(first) == len(words)
    with pytest.raises(SettingsError, match="seed -1 of the packing"):
        generator("packing", -1)


@pytest.mark.parametrize("hurst", [0.3, 0.8])
def test_spectrum_between_the_cutoffs(hurst: float) -> None:
    """log C over log q has slope -2-2H between the cut-offs, 0 above the long one, and nothing below the short one.

    C is that of the cropped surface under a Hann window, radially averaged over ten seeds. The window smears
    rings by two lines, so fits keep away from the corners; the scatter of the two slopes over sets of ten seeds
    is 0.02 and 0.15, the tolerances are four times that.
    """
    n, total = 257, np.zeros((257, 257))
    window = np.hanning(n)[:, None] * np.hanning(n)[None, :]
    for seed in range(10):
        surface = self_affine(
            generator("test", seed), shape=(n, n), rms_height=1.0, hurst_exponent=hurst,
            long_cutoff=1 / 16, short_cutoff=1 / 96,
        )  # fmt: skip
        total += np.abs(np.fft.fft2(window * surface.heights)) ** 2
    line = np.fft.fftfreq(n, 1 / n)
    ring = np.rint(np.hypot(line[:, None], line[None, :])).astype(int)
    spectrum = np.bincount(ring.ravel(), total.ravel()) / np.bincount(ring.ravel())

    def slope(low: int, high: int) -> float:
        q = np.arange(low, high)
        return float(np.polyfit(np.log(q), np.log(spectrum[q]), 1)[0])

    assert slope(20, 92) == pytest.approx(-2 - 2 * hurst, abs=0.08)
    assert slope(4, 13) == pytest.approx(0.0, abs=0.6)
    assert spectrum[104:120].max() < 1e-3 * spectrum[92]


@pytest.mark.parametrize("size", [(1.0, 1.0), (2.0, 1.0)])
def test_self_affine_height_and_borders(size: tuple[float, float]) -> None:
    """Sq is the height asked for to rounding, the mean plane is gone, and opposite borders differ.

    Not periodic: two heights a whole side apart differ by about sqrt(2) Sq, against 0.12 Sq one spacing apart.
    """
    surface = self_affine(generator("test", 1), shape=grid_shape(6, size), rms_height=0.003, size=size)
    assert measure(surface).Sq == pytest.approx(0.003, rel=1e-13)
    assert surface.levelled().heights == pytest.approx(surface.heights, abs=1e-16)
    h = surface.heights
    assert np.sqrt(np.mean((h[-1] - h[0]) ** 2)) > 3 * np.sqrt(np.mean((h[1] - h[0]) ** 2))


def test_self_affine_is_isotropic() -> None:
    """On a 2 x 1 plate the mean squared slopes along and across agree to 4 %.

    The ratio scatters by 0.028 from seed to seed, so over ten seeds this is four standard errors. With longer
    waves levelling takes more from the short side, which is not the generator's doing.
    """
    ratio = []
    for seed in range(10):
        s = self_affine(generator("test", seed), shape=(129, 65), rms_height=1.0, size=(2.0, 1.0), long_cutoff=0.2)
        ratio.append(np.mean(np.diff(s.heights, axis=0) ** 2) / np.mean(np.diff(s.heights, axis=1) ** 2))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.04)


def test_same_seed_same_bits() -> None:
    settings: tuple[tuple[Any, dict[str, Any]], ...] = (
        (diamond_square, {"levels": 5, "max_height": 0.02}),
        (self_affine, {"shape": (33, 33), "rms_height": 0.002}),
    )
    for make, options in settings:
        again = [make(generator("test", seed), **options).heights for seed in (7, 7, 8)]
        assert np.array_equal(again[0], again[1])
        assert not np.array_equal(again[0], again[2])


def test_nodes_and_triangles() -> None:
    """at() gives the heights at the points and the plane of the right triangle between them.

    One cell with heights 0, 1, 5, 2 around, cut from (0, 0) to (1, 1): h = x + 4 y below, 2 y + 3 x above.
    The coordinates are sums of halves and quarters, exact in binary.
    """
    cell = Surface(np.array([[0.0, 2.0], [1.0, 5.0]]), (1.0, 1.0))
    below, above = np.array([[0.75, 0.25], [0.5, 0.25]]), np.array([[0.25, 0.75], [0.25, 0.5]])
    assert np.array_equal(cell.at(*below.T), below @ [1.0, 4.0])
    assert np.array_equal(cell.at(*above.T), above @ [3.0, 2.0])
    surface = diamond_square(generator("test", 2), levels=4, max_height=1.0, size=(2.0, 1.0))
    assert surface.at(surface.x[:, None], surface.y[None, :]) == pytest.approx(surface.heights, abs=1e-14)
    assert surface.at(-1.0, 2.0) == surface.heights[0, -1]
    assert surface.at(9.0, 0.5) == pytest.approx(surface.heights[-1, 8], abs=1e-15)


def test_resampled() -> None:
    """Half the cells keep every other height; twice the cells describe the same face."""
    surface = diamond_square(generator("test", 2), levels=4, max_height=1.0)
    assert surface.resampled((9, 9)).heights == pytest.approx(surface.heights[::2, ::2], abs=1e-14)
    finer = surface.resampled((33, 33))
    x, y = generator("test", 3).random((2, 500))
    assert finer.at(x, y) == pytest.approx(surface.at(x, y), abs=1e-14)


def test_level() -> None:
    """A plane is taken away whole; what a fit weighted by area leaves is the same for any plane added before."""
    rough = diamond_square(generator("test", 4), levels=4, max_height=1.0, size=(2.0, 1.0))
    tilted = Surface(rough.heights + 3.0 - 0.7 * rough.x[:, None] + 0.2 * rough.y[None, :], rough.size)
    assert tilted.levelled().heights == pytest.approx(rough.levelled().heights, abs=1e-14)
    wx, wy = rough.weights
    h = rough.levelled().heights
    assert [wx @ h @ wy, (wx * rough.x) @ h @ wy, wx @ h @ (wy * rough.y)] == pytest.approx([0.0] * 3, abs=1e-15)


def test_heights_cannot_change() -> None:
    heights = np.zeros((3, 4))
    surface = Surface(heights, (1.0, 2.0))
    heights[0, 0] = 1.0
    assert surface.heights.max() == 0.0
    assert Surface(heights.T, (1.0, 2.0)).heights.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        surface.heights[0, 0] = 1.0


@pytest.mark.parametrize(
    ("heights", "size", "message"),
    [
        (np.zeros(4), (1.0, 1.0), r"shape \(4,\): a surface takes"),
        (np.zeros((1, 4)), (1.0, 1.0), r"shape \(1, 4\)"),
        ([[0.0, 1.0], [0.0, np.inf]], (1.0, 1.0), r"heights\[1, 1\] = inf"),
        ([[0.0, 1.0], [np.nan, np.nan]], (1.0, 1.0), r"heights\[1, 0\] = nan"),
        ([[0.0, 1.0], [0.0]], (1.0, 1.0), "not a table of numbers"),
        (np.zeros((2, 2)), (1.0, 0.0), "size 1 x 0 mm: both must be positive"),
        (np.zeros((2, 2)), (np.inf, 1.0), "both must be positive"),
        (np.zeros((2, 2)), (1.0, 1.0, 1.0), "give the length along the slide and the width"),
    ],
)
def test_surfaces_refused(heights: FloatArray, size: tuple[float, float], message: str) -> None:
    with pytest.raises(SurfaceError, match=message):
        Surface(heights, size)


def test_settings_refused() -> None:
    rng = generator("test")
    with pytest.raises(SurfaceError, match=r"2\.4 x 1 mm is not a row of whole squares: try 2 x 1 mm"):
        diamond_square(rng, levels=3, max_height=1.0, size=(2.4, 1.0))
    for settings, message in (
        ({"levels": 0}, "levels = 0"),
        ({"levels": 11}, "levels = 11: take a whole number from 1 to 10"),
        ({"max_height": -1.0}, "max_height = -1"),
        ({"max_height": np.nan}, "max_height = nan"),
        ({"hurst_exponent": 1.1}, r"hurst_exponent = 1\.1 is out of bounds: take a value from 0 to 1"),
    ):
        with pytest.raises(SettingsError, match=message):
            diamond_square(rng, **({"levels": 3, "max_height": 1.0} | settings))
    for settings, message in (
        ({"short_cutoff": 0.1}, r"short_cutoff = 0\.1 mm: take from 0\.25 \(two spacings\) to 1 mm"),
        ({"short_cutoff": 1.5}, r"short_cutoff = 1\.5"),
        ({"long_cutoff": 0.2}, r"long_cutoff = 0\.2 mm: take it above"),
        ({"rms_height": -1.0}, "rms_height"),
        ({"hurst_exponent": -0.1}, "hurst_exponent"),
    ):
        with pytest.raises(SettingsError, match=message):
            self_affine(rng, **({"shape": (9, 9), "rms_height": 1.0} | settings))  # type: ignore[arg-type]
    with pytest.raises(SurfaceError, match="at least 3 x 3"):
        self_affine(rng, shape=(2, 9), rms_height=1.0)


def test_no_height_is_flat() -> None:
    assert not diamond_square(generator("test"), levels=3, max_height=0.0).heights.any()
    assert not self_affine(generator("test"), shape=(9, 9), rms_height=0.0).heights.any()
    assert np.array_equal(Surface.flat((2.0, 1.0), 0.1).at([0.0, 1.3], [0.2, 0.9]), [0.1, 0.1])
