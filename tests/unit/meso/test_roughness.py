"""Measures of roughness on surfaces whose measures are known."""

from __future__ import annotations

import numpy as np
import pytest

from meso.surfaces.roughness import measure, structure_function
from meso.surfaces.surface import Surface, diamond_square, generator, self_affine


def wave(amplitude: float, periods: int, shape: tuple[int, int], size: tuple[float, float]) -> Surface:
    """A cosine along x: even about the middle, so its mean plane is zero."""
    x = np.linspace(0.0, 1.0, shape[0])
    return Surface(np.tile(amplitude * np.cos(2 * np.pi * periods * x)[:, None], (1, shape[1])), size)


def test_wave() -> None:
    """Sa = 2A/pi, Sq = A/sqrt 2, Sz = 2A, Sdq = sqrt 2 A sin(pi k / N) / dx for k periods on N cells.

    Sq, Sz and Sdq are sums of sampled sines, exact to rounding. Sa is the mean of |cos| by the trapezoidal rule,
    whose kinks cost at most (pi/2) (2 pi k / N)^2 / 12 of it: 7.2e-5 here.
    """
    A, k, N, length = 0.004, 3, 1000, 2.0
    found = measure(wave(A, k, (N + 1, 11), (length, 1.0)))
    assert found.Sq == pytest.approx(A / np.sqrt(2), rel=1e-12)
    assert found.Sz == pytest.approx(2 * A, rel=1e-12)
    assert found.Sa == pytest.approx(2 * A / np.pi, rel=7.2e-5)
    assert found.Sdq == pytest.approx(np.sqrt(2) * A * np.sin(np.pi * k / N) / (length / N), rel=1e-12)
    assert found.Sdq == pytest.approx(A / np.sqrt(2) * 2 * np.pi * k / length, rel=(np.pi * k / N) ** 2)


def test_plane_is_smooth() -> None:
    """A tilted plane is levelled away, to rounding of heights near 1; its exponent cannot be told."""
    x, y = np.linspace(0.0, 2.0, 33)[:, None], np.linspace(0.0, 1.0, 17)[None, :]
    found = measure(Surface(0.5 + 0.3 * x - 0.2 * y, (2.0, 1.0)))
    assert [found.Sa, found.Sq, found.Sz] == pytest.approx([0.0] * 3, abs=1e-15)
    assert found.Sdq == pytest.approx(0.0, abs=1e-13)
    assert np.isnan(found.hurst_exponent)


def test_tilt_and_unit_do_not_matter() -> None:
    """A plane added changes nothing, twice the heights double all but the exponent, axes exchanged change nothing."""
    rough = diamond_square(generator("test", 1), levels=5, max_height=0.02, size=(2.0, 1.0))
    expected = measure(rough)
    tilted = Surface(rough.heights + 0.1 * rough.x[:, None] - 0.3 * rough.y[None, :], rough.size)
    turned = Surface(rough.heights.T, (1.0, 2.0))
    for same in (measure(tilted), measure(turned)):
        assert vars(same) == pytest.approx(vars(expected), rel=1e-10)
    double = measure(Surface(2.0 * rough.heights, rough.size))
    for name in ("Sa", "Sq", "Sz", "Sdq"):
        assert getattr(double, name) == pytest.approx(2 * getattr(expected, name), rel=1e-12)
    assert double.hurst_exponent == pytest.approx(expected.hurst_exponent, abs=1e-12)


def test_slope_is_that_of_the_triangles() -> None:
    """Sdq^2 is the mean of |grad h|^2 over the triangles, gradients from their normals."""
    fractal = diamond_square(generator("test", 2), levels=3, max_height=0.3, size=(2.0, 1.0))
    rough = Surface(fractal.heights, (2.0, 0.7)).levelled()  # dx and dy differ
    dx, dy = rough.spacing
    squares = []
    for i in range(rough.shape[0] - 1):
        for j in range(rough.shape[1] - 1):
            a, b, c, d = (
                np.array([(i + p) * dx, (j + q) * dy, rough.heights[i + p, j + q]])
                for p, q in ((0, 0), (1, 0), (1, 1), (0, 1))
            )
            for corner, second, third in ((a, b, c), (a, c, d)):
                normal = np.cross(second - corner, third - corner)
                squares.append((normal[0] ** 2 + normal[1] ** 2) / normal[2] ** 2)
    assert measure(rough).Sdq == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-12)


def test_structure_function() -> None:
    """On h = i every lag l gives l^2; on a random walk S(l) = l, here over 2000 walks of 65 points.

    Successive lags of 2000 independent walks: the standard error at the longest, 16 of 64 steps, is below
    sqrt(2 / 2000 / 3) = 1.8 %; four of them are allowed.
    """
    lags, values = structure_function(np.arange(65.0)[:, None] * np.ones(3))
    assert lags.tolist() == [1, 2, 4, 8, 16]
    assert values == pytest.approx(lags**2, rel=1e-14)
    walks = np.cumsum(generator("test").standard_normal((65, 2000)), axis=0)
    assert structure_function(walks)[1] == pytest.approx(lags, rel=0.073)


@pytest.mark.parametrize("hurst", [0.3, 0.5, 0.8])
def test_hurst_exponent_of_spectral_surfaces(hurst: float) -> None:
    """H is recovered within 0.1 in the mean of 20 seeds (scatter of one 0.03), the bias the docstring admits."""
    found = [
        measure(self_affine(generator("test", k), shape=(129, 129), rms_height=0.01, hurst_exponent=hurst))
        for k in range(20)
    ]
    assert np.mean([each.hurst_exponent for each in found]) == pytest.approx(hurst, abs=0.1)


def test_hurst_exponent_of_noise_and_of_smooth_waves() -> None:
    """Noise without memory has H = 0 (S is flat within 1/129 per lag), a wave longer than all lags nearly 1."""
    noise = Surface(generator("test").standard_normal((129, 129)), (1.0, 1.0))
    assert measure(noise).hurst_exponent == pytest.approx(0.0, abs=0.02)
    assert measure(wave(1.0, 1, (129, 129), (1.0, 1.0))).hurst_exponent == pytest.approx(1.0, abs=0.1)


def test_hurst_exponent_across_a_grain() -> None:
    """One direction a hundred times rougher: the level of S differs, not its slope, so H stays that of both.

    h = walk(x) + 100 walk(y) with H = 1/2; the mean of 40 levelled walks of 129 points lies 0.06 low, as the
    spectral surfaces do, with a standard error of 0.01.
    """
    found = []
    for seed in range(40):
        along, across = np.cumsum(generator("grain", seed).standard_normal((2, 129)), axis=1)
        found.append(measure(Surface(along[:, None] + 100.0 * across[None, :], (1.0, 1.0))).hurst_exponent)
    assert np.mean(found) == pytest.approx(0.5, abs=0.1)


def test_too_few_points_for_an_exponent() -> None:
    rough = generator("test").random((8, 8))
    assert np.isnan(measure(Surface(rough, (1.0, 1.0))).hurst_exponent)
    assert measure(Surface(rough, (1.0, 1.0))).Sq > 0
