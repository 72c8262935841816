"""How do seats of tiles, of levelled tiles and of strips scatter, by tile and as a whole?

    python -m tests.benchmarks surfaces [--pairs 30] [--packings 2] [--seeds 200] [--quick]

Slow plates of the default settings on four kinds of seats: tiles by themselves, those without their mean plane, a strip
of Diamond-Square cut into tiles, and a spectral one (R = 20 um; Sq 1.6 um). Seat tile i slides on bore tile i, as where
a wheel is pressed home.

First table, by the plates: meso over micro coefficient with the standard error of its mean, between pairs that are
taken for independent; the standard deviation over pairs of surfaces, without what packings add; that over packings;
and that of means over five neighbours. Second table, by the network: 180 pairs of each of the seeds, as `wheelset` has
at its end. *Seat* is the standard deviation over seeds of their mean, the force under an even pressure; *travel* that
of the mean over all pairs that met on the way. *Independent* is what the scatter by tile would leave over 180.
*Second neighbours*: correlation of the coefficients of tiles i and i + 2.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from macrofit.base.arrays import FloatArray, IntArray
from meso.errors import MesoError
from meso.friction_test import prepared, slid
from meso.plates import face_to_face, make_plate
from meso.settings import FaceKeys, Settings, SurfaceKeys
from meso.surfaces.filtered import measured_length, profile
from meso.surfaces.roughness import measure
from meso.surfaces.surface import tile_seed

from ._measure import head, row

MICRO = 0.07
TILES = 180
"""Tiles in contact where `wheelset` ends."""
GROUP = 5
SEATS: dict[str, dict[str, Any]] = {
    "tiles": {"form": "tiles"},
    "levelled tiles": {"form": "levelled"},
    "Diamond-Square strip": {"form": "strip"},
    "spectral strip": {"form": "strip", "generator": "self_affine"},
}


def main(words: Sequence[str]) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surfaces", description=__doc__)
    parser.add_argument("--pairs", type=int, default=30)
    parser.add_argument("--packings", type=int, default=2)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--quick", action="store_true", help="Six pairs of 600 spheres, three seeds: to see it runs.")
    options = parser.parse_args(words)
    spheres = 600 if options.quick else 3000
    if options.quick:
        options.pairs, options.packings, options.seeds = 6, 2, 3
    by_plates(options.pairs, options.packings, spheres)
    print()
    by_network(options.seeds)
    return 0


def by_plates(pairs: int, packings: int, spheres: int) -> None:
    """Print the table of friction tests."""
    print(head("plates, seat", "Sq, Ra [um]", "ratio", "surfaces", "packing", f"means of {GROUP}", "second neighbours"))
    for name, keys in SEATS.items():
        mu = np.array([[slide(keys, tile, packing, spheres) for packing in range(packings)] for tile in range(pairs)])
        means = mu.mean(axis=1)  # by pair of surfaces
        center = float(means.mean())
        noise = float(np.mean(mu.var(axis=1, ddof=1))) if packings > 1 else 0.0
        surfaces = max(0.0, float(means.var(ddof=1)) - noise / packings) ** 0.5
        groups = means[: pairs - pairs % GROUP].reshape(-1, GROUP).mean(axis=1)
        spread = percent(groups.std(ddof=1) / center) if len(groups) > 1 else "-"
        error = means.std(ddof=1) / np.sqrt(pairs)
        ratio = f"{center / MICRO:.3f} ± {error / MICRO:.3f}"
        alike = neighbours(means) if pairs > 5 else float("nan")
        print(
            row(name, roughness(keys), ratio, percent(surfaces / center), percent(noise**0.5 / center), spread,
                f"{alike:+.2f}"), flush=True,
        )  # fmt: skip


def slide(keys: dict[str, Any], tile: int, packing: int, spheres: int) -> float:
    """Meso coefficient of seat tile and bore tile `tile` of seed 1 [-]."""
    seed = tile_seed(1, tile)
    plain = Settings(surface=SurfaceKeys(**keys, wheel_seed=seed, axle_seed=seed))
    own = msgspec.structs.replace(plain.plates, spheres=spheres, packing_seed=packing)
    settings = msgspec.structs.replace(plain, plates=own).check()
    plates = face_to_face(settings, make_plate(settings, "wheel"), make_plate(settings, "axle"))
    try:
        return float(next(slid(plates, prepared(plates), (MICRO,))).curve.coefficient)
    except MesoError as error:
        raise SystemExit(f"tile {tile} of {keys}: {error}") from None


def by_network(seeds: int) -> None:
    """Print the table of seats, as the network sees them."""
    print(head("network, seat", "ratio", "tile", f"means of {GROUP}", "seat", "travel", "independent"))
    for name, keys in SEATS.items():
        ends, ways = zip(*(seat_coefficients(FaceKeys(**keys), seed) for seed in range(1, seeds + 1)), strict=True)
        mu = np.array(ends)  # (seeds, TILES)
        center = float(mu.mean())
        groups = mu.reshape(seeds, -1, GROUP).mean(axis=2)
        tile = mu.std() / center
        cells = (tile, groups.std() / center, mu.mean(axis=1).std(ddof=1) / center, np.std(ways, ddof=1) / center)
        ratio = f"{center / MICRO:.3f}"
        print(row(name, ratio, *map(percent, cells), percent(float(tile / np.sqrt(TILES)))), flush=True)


def seat_coefficients(keys: FaceKeys, seed: int) -> tuple[FloatArray, float]:
    """Coefficients of the pairs (i, i) of a seed, and the mean over pairs that meet on the way, every ninth place."""
    from surrogate.tiles import Tiles, load_predictor

    tiles = Tiles(load_predictor(None), seed, keys, (TILES, TILES))
    seat, bore = met()
    mu = tiles.predict(seat, bore, MICRO).mean
    return mu[:TILES], float(mu.mean())


def met() -> tuple[IntArray, IntArray]:
    """Pairs of tiles: those of the end first, then those of shorter ways."""
    places = [np.arange(TILES - shift) for shift in range(0, TILES, 9)]
    seats = np.concatenate(places)
    bores = np.concatenate([place + 9 * k for k, place in enumerate(places)])
    return seats, bores


def neighbours(values: FloatArray) -> float:
    """Correlation of second neighbours [-]."""
    rest = values - values.mean()
    return float(np.mean(rest[2:] * rest[:-2]) / np.mean(rest**2))


def roughness(keys: dict[str, Any]) -> str:
    """Mean Sq about the mean plane of ten faces of the axle, and Ra behind the filter [um]."""
    from meso.surfaces.face import rough_face

    asked = FaceKeys(**keys)
    seeds = [tile_seed(1, tile) for tile in range(10)]
    faces = [rough_face(asked, "axle", seed, (2.0, 1.0)) for seed in seeds]
    ra = np.mean(
        [profile(measured_length(asked, "axle", seed, face)).Ra for seed, face in zip(seeds, faces, strict=True)]
    )
    return f"{1e3 * np.mean([measure(face).Sq for face in faces]):.2g}, {1e3 * ra:.2g}"


def percent(share: float) -> str:
    """A share as text, with two digits after the point."""
    return f"{100.0 * share:.2f} %"
