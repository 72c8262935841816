"""Faces by form and lay: strips that are one roughness wherever they are cut, tiles that stay what they were."""

from __future__ import annotations

import hashlib
import time
from typing import Any

import numpy as np
import pytest
from scipy.signal import fftconvolve

from meso.errors import SettingsError, SurfaceError
from meso.settings import FaceKeys
from meso.surfaces import strip
from meso.surfaces.face import rough_face
from meso.surfaces.roughness import measure
from meso.surfaces.surface import Surface, diamond_square, face_generator, self_affine, subdivide

KINDS: list[dict[str, Any]] = [
    {},
    {"levels": 1},
    {"levels": 5, "hurst_exponent": 0.3},
    {"generator": "self_affine"},
    {"generator": "self_affine", "roll_off": 3.0},
    {"lay": "ground"},
    {"generator": "self_affine", "lay": "ground", "anisotropy": 3.0},
    {"lay": "turned", "levels": 4},
    {"generator": "self_affine", "lay": "turned", "levels": 5, "feed": 0.3},
]
STRIP = 65536 * 11


def forget() -> None:
    for each in (strip._square, strip._draws, strip._convolved, strip._white):
        each.cache_clear()


@pytest.mark.parametrize("edge", [1.0, 0.5])
@pytest.mark.parametrize("kind", KINDS)
def test_neighbours_agree_on_what_they_share(kind: dict[str, Any], edge: float) -> None:
    """Seat tiles [i, i+2] and [i+1, i+3], in any order, and a long piece: to the bit, though a point's neighbours
    beyond the border of one are inside of the other."""
    keys = FaceKeys(**kind)
    whole = rough_face(keys, "axle", STRIP + 5, (8 * edge, edge)).heights
    cells = whole.shape[1] - 1
    assert whole.shape[0] == 8 * cells + 1
    for tile in (3, 0, 6, 4, 1, 5, 2):
        forget()
        face = rough_face(keys, "axle", STRIP + 5 + tile, (2 * edge, edge))
        assert np.array_equal(face.heights, whole[tile * cells : (tile + 2) * cells + 1])
    assert len(np.unique(whole)) > 0.9 * whole.size  # nothing is repeated


@pytest.mark.parametrize("levels", [1, 3, 5])
def test_columns_are_cut_from_one_plane(levels: int) -> None:
    """Diamond-Square on nine columns at once, from the same random numbers: the inner ones to the bit."""
    count, side, R, H = 9, 2**levels, 0.02, 0.4
    near = [strip._draws("axle", 11, levels, 5 + k) for k in range(count + 1)]
    h = np.zeros((count * side + 1, 3 * side + 1))
    h[::side, ::side] = R * (np.stack([each.corners for each in near]) - 0.5)
    for level in range(1, levels + 1):
        step = side >> level
        subdivide(h[::step, ::step], strip._noise(near, level), R * 2.0 ** (-H * level))
    face = rough_face(FaceKeys(levels=levels, max_height=R, hurst_exponent=H), "axle", STRIP + 6, (7.0, 1.0))
    assert np.array_equal(face.heights[:-1], h[side : 8 * side, side : 2 * side + 1])


@pytest.mark.parametrize("together", [1, 4, 5])
def test_a_long_piece_is_made_in_blocks(together: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """No block is larger than is allowed, the last only as large as it has to be, and all have the same bits."""
    keys = FaceKeys(levels=2)
    whole, made = rough_face(keys, "axle", STRIP + 5, (10.0, 1.0)).heights, []
    squares = strip._squares

    def counted(*given: Any) -> Any:
        made.append(given[-1])
        return squares(*given)

    monkeypatch.setattr(strip, "_squares", counted)
    monkeypatch.setattr(strip, "TOGETHER", together * 16 + 15)
    assert np.array_equal(rough_face(keys, "axle", STRIP + 5, (10.0, 1.0)).heights, whole)
    assert max(made) == together
    assert sum(made) == 11  # with that of the last row


def test_a_spectral_strip_is_one_convolution() -> None:
    """Its noise under its kernel, on seven columns at once: to the rounding of the transforms."""
    margin, cells = 8, 8
    noise = np.concatenate([strip._white("wheel", 11, cells, margin, column) for column in range(5, 12)])
    shape = (cells + 2 * margin, cells + 1 + 2 * margin)
    kernel = np.roll(np.fft.irfft2(strip._kernel(shape, margin, 0.8, 0.8 * cells), shape), (margin, margin), (0, 1))
    whole = 0.0016 * fftconvolve(noise, kernel[: 2 * margin + 1, : 2 * margin + 1], "valid")
    face = rough_face(FaceKeys(generator="self_affine"), "wheel", STRIP + 6, (5.0, 1.0))
    assert face.heights[:-1] == pytest.approx(whole[: 5 * cells], abs=1e-15)


@pytest.mark.parametrize("generator", ["diamond_square", "self_affine"])
def test_no_seams(generator: Any) -> None:
    """Steps into a column are as large as those out of its first points: 4000 of nine each, to 3 % (standard error)."""
    h = rough_face(FaceKeys(generator=generator), "axle", STRIP, (4000.0, 1.0)).heights
    steps = np.mean(np.diff(h, axis=0) ** 2, axis=1).reshape(4000, 8).mean(axis=0)
    assert steps[-1] == pytest.approx(steps[0], rel=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_bodies_strips_and_places_differ(kind: dict[str, Any]) -> None:
    keys = FaceKeys(**kind)
    faces = [
        rough_face(keys, body, seed, (1.0, 1.0)).heights.tobytes()
        for body in ("axle", "wheel")
        for seed in (STRIP, STRIP + 1, STRIP + 65536, STRIP + 65535)
    ]
    assert len(set(faces)) == len(faces)


def test_a_tile_far_along_costs_what_the_first_does() -> None:
    """Columns made, not seconds alone: one of four neighbours each."""
    for keys, made in ((FaceKeys(), strip._square), (FaceKeys(generator="self_affine"), strip._convolved)):
        counts = []
        for place in (0, 60_000, 65_535):
            forget()
            started = time.process_time()
            rough_face(keys, "axle", STRIP + place, (2.0, 1.0))
            assert time.process_time() - started < 1.0
            counts.append(made.cache_info().misses)
        assert counts == [3, 3, 3]


@pytest.mark.parametrize("generator", ["diamond_square", "self_affine"])
def test_a_strip_is_stationary(generator: str) -> None:
    """Mean 0, and the same variance in three stretches of 2000 tiles, along and across.

    Samples a tile apart are independent but for a share of their neighbours: 2000 of them give a variance to 4 %
    (standard error), four of which are the tolerance. Of Diamond-Square only points of one kind are compared.
    """
    keys = FaceKeys(generator=generator)  # type: ignore[arg-type]
    stretches = [rough_face(keys, "axle", STRIP + first, (2000.0, 1.0)).heights for first in (0, 30_000, 60_000)]
    everywhere = np.mean([h.var() for h in stretches])
    for h in stretches:
        points = h[:-1].reshape(2000, 8, 9)
        assert abs(points.mean()) < 4 * np.sqrt(everywhere / 2000)
        at = points.var(axis=0)  # (8, 9), by place within a square
        whole = np.mean([each[:-1].reshape(2000, 8, 9).var(axis=0) for each in stretches], axis=0)
        assert at == pytest.approx(whole, rel=0.16)
        assert at[1:, 0] == pytest.approx(at[0, 1:8], rel=0.23)  # along an edge in x as along one in y: two such errors
        assert at[:, 0] == pytest.approx(at[:, 8], rel=0.23)  # both borders
    if generator == "self_affine":
        assert everywhere == pytest.approx(keys.rms_height**2, rel=0.03)
        assert np.mean([h.var(axis=0) for h in stretches], axis=0) == pytest.approx(keys.rms_height**2, rel=0.1)


def test_slopes_along_and_across_are_alike() -> None:
    """Mean squared slopes of 3000 tiles: within 4 %, of which 1 % is their scatter; ground ones are steeper along."""
    for kind in ({}, {"generator": "self_affine"}):
        along, across = slopes(FaceKeys(**kind))  # type: ignore[arg-type]
        assert along == pytest.approx(across, rel=0.04)
        along, across = slopes(FaceKeys(lay="ground", **kind))  # type: ignore[arg-type]
        assert along > 20.0 * across


def slopes(keys: FaceKeys) -> tuple[float, float]:
    h = rough_face(keys, "wheel", STRIP, (3000.0, 1.0)).heights
    return float(np.mean(np.diff(h[:, 1:], axis=0) ** 2)), float(np.mean(np.diff(h[:-1], axis=1) ** 2))


def test_the_spectral_strip_has_its_spectrum() -> None:
    """Slope -2-2H below the roll-off wavelength, flat above it: of windowed squares, averaged over rings.

    The scatter of the two slopes over strips is 0.03 and 0.1; the kernel's end bends the first by 0.1 near 0.8 mm.
    """
    keys = FaceKeys(generator="self_affine", levels=5, roll_off=0.8, hurst_exponent=0.6)
    n, total = 128, np.zeros((128, 33))
    h = rough_face(keys, "axle", STRIP, (4000.0, 1.0)).heights
    window = np.hanning(n)[:, None]
    for first in range(0, 4000 * 32 - n, n):  # pieces of 4 mm; across there is 1 mm: take the line q_y = 0 and near it
        total += np.abs(np.fft.fft(window * h[first : first + n], axis=0)) ** 2
    line = total.mean(axis=1)  # one-dimensional: C1(q) ~ q^(-1-2H)
    q = np.arange(n) / 4.0  # 1 / mm
    steep = (q >= 3.0) & (q <= 8.0)
    flat = (q >= 0.5) & (q <= 0.9)
    assert np.polyfit(np.log(q[steep]), np.log(line[steep]), 1)[0] == pytest.approx(-1 - 2 * 0.6, abs=0.25)
    assert line[flat].max() < 1.6 * line[flat].min()


def test_tiles_stay_what_they_were() -> None:
    """The very bits of the generators, and of a seed written down when tiles were all there was."""
    tiles = FaceKeys(form="tiles")
    face = rough_face(tiles, "axle", 65537, (2.0, 1.0))
    plain = diamond_square(face_generator("axle", 65537), levels=3, max_height=0.02, size=(2.0, 1.0))
    assert np.array_equal(face.heights, plain.heights)
    assert hashlib.sha256(face.heights.tobytes()).hexdigest()[:16] == "1eb0fabe3bb2b8fd"
    spectral = rough_face(FaceKeys(form="tiles", generator="self_affine"), "axle", 65537, (2.0, 1.0))
    plain = self_affine(face_generator("axle", 65537), shape=(17, 9), rms_height=0.0016, size=(2.0, 1.0))
    assert np.array_equal(spectral.heights, plain.heights)


@pytest.mark.parametrize("lay", ["isotropic", "ground", "turned"])
@pytest.mark.parametrize("generator", ["diamond_square", "self_affine"])
def test_levelled_tiles_are_tiles_without_their_plane(generator: Any, lay: Any) -> None:
    alone, levelled = (
        rough_face(FaceKeys(form=form, generator=generator, lay=lay, levels=4), "axle", 9, (2.0, 1.0))
        for form in ("tiles", "levelled")
    )
    assert np.array_equal(levelled.heights, alone.levelled().heights)
    (wx, wy), h = levelled.weights, levelled.heights
    for term in (np.ones_like(h), levelled.x[:, None] * np.ones_like(h), levelled.y[None, :] * np.ones_like(h)):
        assert abs(wx @ (h * term) @ wy) < 1e-17


def test_another_level_of_a_strip_keeps_the_points() -> None:
    coarse, fine = (rough_face(FaceKeys(levels=n), "wheel", STRIP + 2, (1.0, 1.0)).heights for n in (3, 5))
    assert np.array_equal(fine[::4, ::4], coarse)


def test_grooves() -> None:
    """Their distance, depth and mean are those asked for, they run around the body, and continue from tile to tile."""
    keys = FaceKeys(lay="turned", levels=6, feed=0.25, groove_depth=0.006, max_height=0.0)
    face = rough_face(keys, "axle", STRIP + 40, (2.0, 1.0))
    h = face.heights
    assert np.array_equal(h, np.repeat(h[:, :1], h.shape[1], axis=1))
    assert h[16:] == pytest.approx(h[:-16], abs=1e-12)  # 16 points of 1/64 mm
    curvature = np.diff(h[:, 0], 2) * (0.25 * 64) ** 2  # 8 depth / feed^2 but at cusps
    assert np.median(curvature) == pytest.approx(8 * 0.006, rel=1e-9)
    assert np.sum(curvature < 0.0) in (7, 8, 9, 15, 16, 17)  # a cusp lies on a point or between two
    assert h[:-1].mean() == pytest.approx(0.0, abs=1e-5)
    rough = rough_face(FaceKeys(lay="turned", levels=6), "axle", STRIP + 40, (2.0, 1.0)).heights
    plain = rough_face(FaceKeys(levels=6), "axle", STRIP + 40, (2.0, 1.0)).heights
    assert np.median(np.diff((rough - plain)[:, 0], 2)) == pytest.approx(8 * 0.008 / 256, rel=1e-9)


def test_ground_tiles_by_themselves_have_their_height() -> None:
    face = rough_face(FaceKeys(form="tiles", generator="self_affine", lay="ground"), "wheel", 3, (1.0, 1.0))
    assert measure(face).Sq == pytest.approx(0.0016, rel=1e-12)
    flat = FaceKeys(form="tiles", generator="self_affine", lay="ground", rms_height=0.0)
    assert not rough_face(flat, "wheel", 3, (1.0, 1.0)).heights.any()


def test_a_spectral_strip_may_end_between_its_points() -> None:
    keys = FaceKeys(generator="self_affine")
    face = rough_face(keys, "axle", STRIP, (1.3, 1.0))
    longer = rough_face(keys, "axle", STRIP, (2.0, 1.0))
    assert face.size == (1.3, 1.0)
    assert face.heights == pytest.approx(longer.at(face.x[:, None], face.y[None, :]), abs=1e-15)
    assert isinstance(face, Surface)


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"lay": "turned"}, r"surface.feed = 0.25 mm is less than 4 spacings of 0.125 mm: take a larger feed or more"),
        (
            {"generator": "self_affine", "levels": 10, "roll_off": 2.1},
            r"surface.roll_off = 2.1 mm is more than 2048 sp",
        ),
        ({"max_height": -1.0}, "max_height = -1 is out of bounds"),
        ({"generator": "self_affine", "hurst_exponent": 2.0}, "hurst_exponent = 2 is out of bounds"),
        ({"levels": 11}, "levels = 11: take a whole number from 1 to 10"),
    ],
)
def test_what_cannot_be_made_is_named(keys: dict[str, Any], told: str) -> None:
    with pytest.raises(SettingsError, match=told):
        rough_face(FaceKeys(**keys), "axle", STRIP, (2.0, 1.0))
    with pytest.raises(SurfaceError, match="not a row of whole squares"):
        rough_face(FaceKeys(), "axle", STRIP, (1.3, 1.0))
