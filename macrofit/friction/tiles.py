"""Which pairs of tiles a seat facet faces at a given travel, and over what length; pure geometry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from macrofit.friction.contract import FloatArray, IntArray

SLIVER = 1e-9
"""Overlaps shorter than this share of a tile are rounding, not contact [-]."""


class TileOverlaps(NamedTuple):
    """n overlaps of seat facets with pairs of facing tiles: four arrays of shape (n,)."""

    facet: IntArray
    """Facet number on the seat."""
    seat: IntArray
    """Tile number on the seat, >= 0."""
    bore: IntArray
    """Tile number on the bore, >= 0."""
    weight: FloatArray
    """Length (or area) of the overlap, > 0."""

    def take(self, index: IntArray) -> TileOverlaps:
        """The overlaps numbered `index`, in that order."""
        return TileOverlaps(self.facet[index], self.seat[index], self.bore[index], self.weight[index])


_NONE = np.empty(0, dtype=np.int64)
NO_OVERLAPS = TileOverlaps(_NONE, _NONE, _NONE, np.empty(0))
"""Those of a provider that does not tell pairs apart."""


@dataclass(frozen=True)
class FacingPairs:
    """The overlaps of facets with pairs of tiles, and each of these pairs once; several runs may share it."""

    overlaps: TileOverlaps
    """Those of a weight above 0."""

    @classmethod
    def of(cls, overlaps: TileOverlaps) -> FacingPairs:
        """The pairs of these overlaps, in any order; those of no weight are left out."""
        return cls(overlaps.take(np.flatnonzero(overlaps.weight > 0.0)))

    @cached_property
    def keys(self) -> IntArray:
        """One sortable number for each overlap's pair of tiles, see `pair_key`."""
        return pair_key(self.overlaps.seat, self.overlaps.bore)

    @cached_property
    def distinct(self) -> tuple[IntArray, IntArray]:
        """The key of each pair once, sorted, and the number of each overlap's pair among them."""
        pairs, which = np.unique(self.keys, return_inverse=True)
        return pairs, which

    @cached_property
    def _pair_weight(self) -> FloatArray:
        return np.asarray(np.bincount(self.distinct[1], self.overlaps.weight), dtype=np.float64)

    def pair_mean(self, values: FloatArray) -> FloatArray:
        """The mean of values of facets over each pair, by weight, (pairs,)."""
        shares = self.overlaps.weight * values[self.overlaps.facet]
        return np.asarray(np.bincount(self.distinct[1], shares) / self._pair_weight)


def pair_key(seat: IntArray, bore: IntArray) -> IntArray:
    """One sortable number for each pair of tiles; both tile numbers are below 2**31."""
    return (seat << 32) | bore


def tiles_of(key: IntArray) -> tuple[IntArray, IntArray]:
    """Seat and bore tile of each `pair_key`."""
    return key >> 32, key & 0xFFFFFFFF


def tile_overlaps(
    facet_start: FloatArray,
    facet_end: FloatArray,
    travel: float,
    tile_size: float,
    seat_tiles: int,
    bore_tiles: int,
    *,
    seat_origin: float = 0.0,
    bore_origin: float = 0.0,
) -> TileOverlaps:
    """The overlaps of seat facets with pairs of tiles when the wheel's leading edge is at z = travel.

    Seat tile k covers [seat_origin + k s, seat_origin + (k + 1) s] and bore tile j covers
    [travel - bore_origin - (j + 1) s, travel - bore_origin - j s], with s the tile size. A part of a facet
    outside the seat tiles or the bore tiles has no overlap; so has one shorter than 1e-9 s.

    Args:
        facet_start: lower end of each facet on the seat's coordinate z [mm], shape (n_facets,).
        facet_end: its upper end [mm], shape (n_facets,); the facets may come in any order.
        travel: z of the bore's leading edge [mm].
        tile_size: s, axial length of a tile [mm].
        seat_tiles: number of tiles on the seat.
        bore_tiles: number of tiles on the bore.
        seat_origin: z where seat tile 0 starts [mm]; negative to let the tiles reach over the taper.
        bore_origin: distance behind the leading edge where bore tile 0 starts [mm].

    Raises:
        ValueError: a facet that ends before it starts, or a tile size that is not positive.
    """
    if tile_size <= 0.0:
        raise ValueError(f"tile_size = {tile_size} mm: it must be positive")
    if np.any(facet_end < facet_start):
        raise ValueError(f"facet {int(np.argmax(facet_end < facet_start))} ends before it starts")
    start, end = facet_start - seat_origin, facet_end - seat_origin
    facet, seat, start, end = _split(start, end, tile_size, seat_tiles)
    nose = travel - bore_origin - seat_origin  # the bore counts its tiles against z
    piece, bore, near, far = _split(nose - end, nose - start, tile_size, bore_tiles)
    return TileOverlaps(facet[piece], seat[piece], bore, far - near)


def _split(
    start: FloatArray, end: FloatArray, size: float, tiles: int
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Cut intervals at multiples of `size`: each piece's interval number, tile number, start and end."""
    first = np.minimum(np.maximum(np.floor(start / size), 0), tiles).astype(np.int64)
    last = np.minimum(np.maximum(np.ceil(end / size), 0), tiles).astype(np.int64)
    count = np.maximum(last - first, 0)
    origin = np.repeat(np.arange(start.size, dtype=np.int64), count)
    tile = first[origin] + np.arange(origin.size, dtype=np.int64) - np.repeat(np.cumsum(count) - count, count)
    piece_start = np.maximum(start[origin], tile * size)
    piece_end = np.minimum(end[origin], (tile + 1) * size)
    keep = piece_end - piece_start > SLIVER * size
    return origin[keep], tile[keep], piece_start[keep], piece_end[keep]
