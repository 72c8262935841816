"""Packings: dense, connected, conforming, independent of the surface, and safe in their cache."""

from __future__ import annotations

import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from meso.errors import PackingError
from meso.packing import kernels as kernels
from meso.packing.cache import flat_packing
from meso.packing.pack import Packing, morph, pack
from meso.surfaces.surface import Surface, diamond_square, generator

SIZE, THICKNESS = (1.0, 1.0), 0.3


@pytest.fixture(scope="module")
def flat() -> Packing:
    return pack(generator("packing", 1), spheres=1000, size=SIZE, thickness=THICKNESS)


def test_packing_is_dense_and_coordinated(flat: Packing) -> None:
    assert 0.61 < flat.solid_fraction < 0.65
    assert 6.1 <= flat.coordination < 6.3
    assert flat.largest_overlap < 0.25
    assert len(flat.radii) > 980  # few are lost that touch nothing
    assert np.ptp(flat.radii) / flat.radii.mean() == pytest.approx(0.5, abs=0.02)  # uniform in 1 -+ 1/4


def test_spheres_stay_in_the_box(flat: Packing) -> None:
    low, high = flat.centres - flat.radii[:, None], flat.centres + flat.radii[:, None]
    slack = 1.5 * flat.largest_overlap * flat.radii.mean()  # a wall is as soft as a sphere
    assert low.min() > -slack
    assert np.all(high.max(axis=0) < np.array([*SIZE, THICKNESS]) + slack)


def test_contacts_are_those_of_brute_force(flat: Packing) -> None:
    distance = np.linalg.norm(flat.centres[:, None] - flat.centres[None], axis=2)
    touching = np.argwhere(np.triu(distance < flat.radii[:, None] + flat.radii[None], 1))
    assert {tuple(pair) for pair in flat.contacts} == {tuple(pair) for pair in touching}
    count = len(flat.radii)
    graph = coo_matrix((np.ones(len(touching)), touching.T), shape=(count, count))
    assert connected_components(graph, directed=False)[0] == 1


def test_morphed_packing_follows_the_surface(flat: Packing) -> None:
    x = np.linspace(0.0, 1.0, 17)
    surface = Surface(0.05 * np.cos(2.0 * np.pi * x)[:, None] * np.cos(np.pi * x)[None, :], SIZE)
    rough = morph(flat, surface)
    mean, scatter = rough.envelope_error()
    smooth_mean, smooth_scatter = flat.envelope_error()
    assert mean == pytest.approx(smooth_mean, rel=0.15)  # as close to its wall as the flat one
    assert scatter == pytest.approx(smooth_scatter, rel=0.15)
    assert -rough.radii.mean() < mean < 0.0  # spheres stay below it
    grid = np.linspace(0.1, 0.9, 40)
    wanted = surface.at(grid[:, None], grid[None, :]).ravel()
    shape = (401, 401)
    near = np.ix_((grid * 400).astype(int), (grid * 400).astype(int))
    assert np.corrcoef(rough.envelope(shape)[near].ravel(), wanted)[0, 1] > 0.6
    assert abs(np.corrcoef(flat.envelope(shape)[near].ravel(), wanted)[0, 1]) < 0.3
    assert 0.61 < rough.solid_fraction < 0.65
    assert rough.coordination >= 6.1


def test_surface_and_packing_seeds_are_independent(flat: Packing) -> None:
    again = pack(generator("packing", 1), spheres=1000, size=SIZE, thickness=THICKNESS)
    other = pack(generator("packing", 2), spheres=1000, size=SIZE, thickness=THICKNESS)
    assert np.array_equal(again.centres, flat.centres)
    assert not np.array_equal(other.radii[:900], flat.radii[:900])
    assert morph(flat, Surface.flat(SIZE)) is flat


def test_morton_order_keeps_neighbours_close(flat: Packing) -> None:
    i, j = flat.contacts.T
    rng = np.random.default_rng(0)
    place = rng.permutation(len(flat.radii))
    assert np.median(j - i) < 0.2 * np.median(np.abs(place[j] - place[i]))


def test_forces_are_the_gradient_of_the_overlap_energy() -> None:
    rng = np.random.default_rng(0)
    radii, size = rng.uniform(0.05, 0.08, 40), np.array([0.3, 0.3])
    heights = rng.uniform(-0.02, 0.02, (3, 3))
    centres = rng.uniform(0.02, 0.28, (40, 3))

    def forces(x: np.ndarray) -> np.ndarray:
        out = np.empty_like(x)
        pairs = kernels.neighbours(x, radii, 0.05)
        kernels._forces(x, radii, pairs, size, 0.3, heights, heights.min(), out)
        return out

    def pair_energy(x: np.ndarray) -> float:
        distance = np.linalg.norm(x[:, None] - x[None], axis=2)
        overlap = np.triu(np.maximum(0.0, radii[:, None] + radii[None] - distance), 1)
        walls = sum(np.sum(np.maximum(0.0, radii - x[:, a]) ** 2) for a in range(3))
        walls += sum(np.sum(np.maximum(0.0, x[:, a] + radii - size[a]) ** 2) for a in range(2))
        face = 0.0
        for k in range(len(radii)):
            h, hx, hy = kernels.wall_height(heights, 0.15, 0.15, x[k, 0], x[k, 1])
            face += max(0.0, radii[k] - (0.3 + h - x[k, 2]) / np.sqrt(1.0 + hx * hx + hy * hy)) ** 2
        return 0.5 * (np.sum(overlap**2) + walls + face)

    direction = rng.normal(size=centres.shape)
    step = 1e-7
    slope = (pair_energy(centres + step * direction) - pair_energy(centres - step * direction)) / (2.0 * step)
    assert slope == pytest.approx(-np.sum(forces(centres) * direction), rel=1e-6)


def test_wall_height_is_that_of_the_surface() -> None:
    surface = diamond_square(generator("surface", 4), levels=3, max_height=0.05, size=(2.0, 1.0))
    rng = np.random.default_rng(0)
    for x, y in rng.uniform([-0.1, -0.1], [2.1, 1.1], (200, 2)):
        h, _, _ = kernels.wall_height(surface.heights, *surface.spacing, x, y)
        assert h == pytest.approx(float(surface.at(x, y)), abs=1e-15)


@pytest.mark.parametrize(
    ("spheres", "size", "thickness", "says"),
    [
        (0, SIZE, 0.3, "spheres = 0"),
        (1000, (1.0, -1.0), 0.3, "every edge"),
        (1000, (1.0, float("nan")), 0.3, "every edge"),
        (20, SIZE, 0.05, "at least"),
    ],
)
def test_impossible_boxes_are_refused(spheres: int, size: tuple[float, float], thickness: float, says: str) -> None:
    with pytest.raises(PackingError, match=says):
        pack(generator("packing", 1), spheres=spheres, size=size, thickness=thickness)


def test_surface_deeper_than_the_plate_is_refused(flat: Packing) -> None:
    with pytest.raises(PackingError, match="max_height"):
        morph(flat, diamond_square(generator("surface", 1), levels=3, max_height=0.6, size=SIZE))
    with pytest.raises(PackingError, match="does not fit"):
        morph(flat, Surface.flat((2.0, 1.0)))


BOX = (120, (0.5, 0.5), 0.3, 4)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MACROFIT_CACHE", str(tmp_path))
    flat_packing.cache_clear()
    return tmp_path


def test_cached_packing_is_the_same_to_the_bit(cache: Path) -> None:
    first = flat_packing(*BOX)
    flat_packing.cache_clear()
    (file,) = (cache / "packings").glob("*.npz")
    written = file.stat().st_mtime_ns
    second = flat_packing(*BOX)
    assert np.array_equal(first.centres, second.centres)
    assert np.array_equal(first.radii, second.radii)
    assert file.stat().st_mtime_ns == written
    assert flat_packing(*BOX) is second  # and from memory


@pytest.mark.parametrize("damage", ["cut", "garbage", "empty", "flipped"])
def test_damaged_cache_is_made_again(cache: Path, damage: str) -> None:
    first = flat_packing(*BOX)
    (file,) = (cache / "packings").glob("*.npz")
    data = file.read_bytes()
    spoilt = {
        "cut": data[: len(data) // 2],
        "garbage": b"not a packing",
        "empty": b"",
        "flipped": data[:400] + bytes([data[400] ^ 0xFF]) + data[401:],
    }
    file.write_bytes(spoilt[damage])
    flat_packing.cache_clear()
    with pytest.warns(UserWarning, match="damaged and is made again"):
        again = flat_packing(*BOX)
    assert np.array_equal(again.centres, first.centres)
    flat_packing.cache_clear()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flat_packing(*BOX)


def test_unwritable_cache_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MACROFIT_CACHE", "/dev/null")
    flat_packing.cache_clear()
    with pytest.warns(UserWarning, match="not kept"):
        assert len(flat_packing(*BOX).radii) > 100


def test_two_processes_may_write_the_same_packing(cache: Path) -> None:
    code = (
        f"from meso.packing.cache import flat_packing as f; import zlib; print(zlib.crc32(f(*{BOX}).centres.tobytes()))"
    )
    both = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) for _ in range(2)]
    answers = {process.communicate(timeout=100)[0] for process in both}
    assert [process.returncode for process in both] == [0, 0]
    assert len(answers) == 1
    assert len(list((cache / "packings").iterdir())) == 1


def test_a_finer_surface_costs_no_more() -> None:
    """The least height was looked for at every sphere in every iteration: 50 times as long at n = 6."""
    flat = flat_packing(400, (1.0, 1.0), 0.3, 0)

    def taken(levels: int) -> float:
        rough = diamond_square(generator("fine", levels), levels=levels, max_height=0.02, hurst_exponent=0.8)
        times = []
        for _ in range(3):
            started = time.process_time()
            morph(flat, rough)
            times.append(time.process_time() - started)
        return min(times)

    assert taken(7) < 4.0 * taken(3)
