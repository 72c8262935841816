"""The rough face of a plate out of measured surfaces: a place on a strip, or a place on patches dealt to a strip.

A strip lies in place: tile i of the axle covers i ... i + 2 mm of it; where the body goes on, the strip is reflected.

Patches are smaller than a body, and what is not measured has to be made of what is: pieces, each a patch drawn by the
seed, a place on it and a reflection, are laid one after the other along the body, as long as a patch and overlapping by
`BLEND` of it. In an overlap the heights are cos(t) A + sin(t) B, t from 0 to 90 degrees: A and B are independent and of
mean 0, so that the variance is theirs everywhere (a linear fade would halve it). So neighbouring tiles share what they
overlap, as on a real seat. Left out: grooves lose their phase at each overlap, and waves longer than a patch are
not there.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from math import floor
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.base.errors import OutputError

from ..errors import SurfaceError
from ..measured.clean import Scan, cleaned
from ..measured.keys import ScanKeys, digest
from ..measured.read import read_scan
from ..settings import SHARED, FaceKeys
from .gaussian import filtered
from .surface import TILES, Body, Surface, generator

LONG = 5.0
"""A single scan longer than so many widths of a tile is a strip, where the keys leave it open."""
BLEND = 0.25
"""Share of a piece that overlaps with the next [-]."""
LONGEST_PIECE = 4.0
"""Length of a piece, at most, in widths of a tile."""


def scan_of(keys: ScanKeys, which: int) -> Scan:
    """One of the files of a body, read and cleaned; read again where its content has changed.

    Raises:
        SurfaceError: it cannot be used, or has another content than the digest among the keys.
    """
    if keys.sha256:
        return _scans(keys)[which]
    try:
        return _scans(keys.found())[which]
    except OutputError as error:
        raise SurfaceError(str(error)) from None


@functools.lru_cache(maxsize=2)
def _scans(keys: ScanKeys) -> tuple[Scan, ...]:
    """All files of a body: a face takes all of its patches. Those of two bodies are kept."""
    return tuple(_scan(keys, which) for which in range(len(keys.files)))


def _scan(keys: ScanKeys, which: int) -> Scan:
    """One of the files of a body, whose digest is among the keys."""
    path = Path(keys.files[which])
    try:
        if digest(path) != keys.sha256[which]:
            raise SurfaceError(
                f"{path}: its content is another than that with the digest {keys.sha256[which][:12]}: put the file "
                "back, or take the key sha256 out and begin anew"
            )
    except OutputError as error:
        raise SurfaceError(str(error)) from None
    try:
        raw = read_scan(path)
        scan = cleaned(raw, keys)
    except SurfaceError as error:
        raise SurfaceError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    if keys.filter is None:
        return scan
    if keys.filter > max(scan.size):
        raise SurfaceError(
            f"{path}: filter = {keys.filter:g} mm is longer than its {scan.size[0]:.4g} x {scan.size[1]:.4g} mm, and "
            "takes nothing away: take a shorter cut-off, such as 0.8, or leave it out"
        )
    rest = filtered(as_surface(scan), keys.filter).heights
    done = (*scan.done, f"waves above {keys.filter:g} mm filtered out (Gaussian)")
    return replace(scan, heights=rest, done=done)


def as_surface(scan: Scan) -> Surface:
    """A scan with its outer points on the border."""
    (nx, ny), (dx, dy) = scan.heights.shape, scan.spacing
    return Surface(scan.heights, (dx * (nx - 1), dy * (ny - 1)))


def is_strip(keys: ScanKeys, width: float) -> bool:
    """Whether the files of a body are one strip for tiles of this width [mm].

    Raises:
        SurfaceError: several files where a strip is asked for; a file that cannot be used.
    """
    if keys.use == "strip" and len(keys.files) > 1:
        raise SurfaceError(f"use = 'strip' takes one file, and there are {len(keys.files)}: take use = 'patches'")
    return keys.use == "strip" or (
        keys.use == "auto" and len(keys.files) == 1 and scan_of(keys, 0).size[0] >= LONG * width
    )


def measured_face(keys: ScanKeys, body: Body, seed: int, size: tuple[float, float]) -> Surface:
    """The face that a seed has on the measured surfaces of a body; means over areas of 2^-levels mm.

    Args:
        keys: files, and what is done with them; levels says the grid.
        body: whose streams are taken.
        seed: 65536 draw + tile; a strip is one for all draws.
        size: length along the slide and width [mm].

    Raises:
        SurfaceError: a file that cannot be used, is too small, or too short for the tile.
    """
    draw, place = divmod(seed, TILES)
    length, width = size
    cells = max(2, round(width * 2**keys.levels))
    step = width / cells
    x = place * width + np.linspace(0.0, length, max(2, round(length / step)) + 1)
    y = np.linspace(0.0, width, cells + 1)
    if keys.use == "face":
        heights = _in_the_middle(keys, x - x[0], y)
    elif is_strip(keys, width):
        heights = _on_strip(keys, x, y)
    else:
        heights = _on_patches(keys, body, draw, x, y)
    return Surface(heights, size)


def doubts_of(keys: FaceKeys, counts: Mapping[Body, int], width: float) -> list[str]:
    """What may be wrong with the measured faces of bodies with so many tiles, and what was made up, in words.

    Args:
        keys: of both bodies' faces.
        counts: tiles of each body.
        width: of a tile, and its length [mm].

    Raises:
        SurfaceError: a file that cannot be used, is too small, or not half as long as the body.
    """
    found = [f"{name}: {SHARED}" for name in keys.shared_files()]
    for body, count in counts.items():
        scan = keys.measured(body)
        if scan is None:
            continue
        measured_face(scan, body, min(count, TILES) - 1, (2.0 * width if body == "axle" else width, width))
        long = scan_of(scan, 0).size[0]
        if scan.use != "face" and is_strip(scan, width) and count * width > long + width:
            found.append(f"{scan.files[0]}: is {long:.4g} mm long, the {body} has {count} tiles: it is reflected there")
        each = [(name, scan_of(scan, k)) for k, name in enumerate(scan.files)]
        found += [f"{name}: {line}" for name, file in each for line in (*file.made_up, *file.doubts)]
    return found


def place_doubts(keys: ScanKeys, seed: int, size: tuple[float, float]) -> tuple[str, ...]:
    """What may be wrong with the place that a seed has on a body's files, in words: a strip may end before it.

    Args:
        keys: files, and what is done with them.
        seed: 65536 draw + tile.
        size: length along the slide and width of the tile [mm].

    Raises:
        SurfaceError: a file that cannot be used.
    """
    if keys.use == "face" or not is_strip(keys, size[1]):
        return ()
    long, tile = scan_of(keys, 0).size[0], seed % TILES
    if tile * size[1] + size[0] <= long * (1.0 + 1e-9):
        return ()
    return (
        f"tile {tile} ends at {tile * size[1] + size[0]:.4g} mm, and the strip at {long:.4g} mm: it is reflected there",
    )


def covering(keys: ScanKeys, size: tuple[float, float]) -> tuple[ScanKeys, tuple[str, ...]]:
    """The keys of a file that is a face, and what is assumed of it, in words.

    A file without a spacing covers all of the face, its outer points on the border.

    Raises:
        SurfaceError: its points would be much farther apart along the slide than across, or the other way round.
    """
    if keys.spacing is not None:
        return keys, ()
    raw = read_scan(Path(keys.files[0]))
    if raw.spacing is not None or raw.remarks.unclear or raw.heights.ndim != 2 or min(raw.heights.shape) < 2:
        return keys, ()
    nx, ny = raw.heights.shape if keys.along == "x" else raw.heights.shape[::-1]
    spacing = size[0] / (nx - 1), size[1] / (ny - 1)
    if not 0.5 < spacing[0] / spacing[1] < 2.0:
        raise SurfaceError(
            f"{keys.files[0]}: {nx} x {ny} points are not those of {size[0]:g} x {size[1]:g} mm: rows run along the "
            f"slide, and the face is {size[0]:g} mm long; or give the spacing"
        )
    told = (
        f"no spacing is stated: taken to cover the face of {size[0]:g} x {size[1]:g} mm, its points "
        f"{1e3 * spacing[0]:.3g} x {1e3 * spacing[1]:.3g} µm apart; else give the spacing"
    )
    return msgspec.structs.replace(keys, spacing=spacing), (told,)


def _in_the_middle(keys: ScanKeys, x: FloatArray, y: FloatArray) -> FloatArray:
    """Heights at places on a face that is the middle of a scan."""
    scan = scan_of(keys, 0)
    _check_width(scan, keys.files[0], float(x[-1]), float(y[-1]))
    middle = [0.5 * (have - places[-1]) for have, places in zip(scan.size, (x, y), strict=True)]
    return area_means(scan, x + middle[0], y + middle[1], float(y[1]))


def _on_strip(keys: ScanKeys, x: FloatArray, y: FloatArray) -> FloatArray:
    """Heights at places along a strip; beyond its end it is reflected once."""
    scan, width = scan_of(keys, 0), float(y[-1])
    _check_width(scan, keys.files[0], width, width)
    if x[0] + width > 2.0 * scan.size[0]:
        raise SurfaceError(
            f"{keys.files[0]}: is {scan.size[0]:.4g} mm long, and tile {round(x[0] / width)} begins at {x[0]:.4g} mm: "
            "measure a longer strip, or take use = 'patches'"
        )
    along = scan.size[0] - np.abs(scan.size[0] - x)
    return area_means(scan, along, y + 0.5 * (scan.size[1] - width), float(y[1]))


class _Piece(NamedTuple):
    """A piece of a patch as it is laid."""

    which: int  # patch
    place: tuple[float, float]  # on it [mm]
    flipped: tuple[bool, bool]  # along, across


def _laid(scans: list[Scan], body: Body, draw: int, start: float, end: float, width: float) -> dict[float, _Piece]:
    """Pieces that lie on a strip between two places, by the place where each begins [mm]; and how long each is."""
    long = _longest(scans, width)
    pitch = (1.0 - BLEND) * long
    numbers = range(floor((start - long) / pitch), floor(end / pitch) + 1)
    return {number * pitch: _drawn(scans, body, draw, number, (long, width)) for number in numbers}


def laid_pieces(keys: ScanKeys, body: Body, draw: int, size: tuple[float, float]) -> list[tuple[float, _Piece]]:
    """The pieces of patches that a body of this length and width [mm] is laid out of, and where each begins [mm]."""
    length, width = size
    scans = [scan_of(keys, which) for which in range(len(keys.files))]
    long, laid = _longest(scans, width), _laid(scans, body, draw, 0.0, length, width)
    return [(begin, piece) for begin, piece in laid.items() if -long < begin <= length]


def _longest(scans: list[Scan], width: float) -> float:
    """Length of the pieces [mm]."""
    return min(LONGEST_PIECE * width, *(scan.size[0] for scan in scans))


def pieces_of(keys: ScanKeys, body: Body, seed: int, size: tuple[float, float]) -> tuple[str, ...]:
    """Which patches the seed has chosen for a tile, and where on them, in words; none where patches are not dealt.

    Args:
        keys: files, and what is done with them.
        body: whose streams are taken.
        seed: 65536 draw + tile.
        size: length along the slide and width of the tile [mm].

    Raises:
        SurfaceError: a file that cannot be used.
    """
    length, width = size
    if keys.use == "face" or is_strip(keys, width):
        return ()
    draw, tile = divmod(seed, TILES)
    scans = [scan_of(keys, which) for which in range(len(keys.files))]
    long, found = _longest(scans, width), []
    for begin, laid in _laid(scans, body, draw, tile * width, tile * width + length, width).items():
        low, high = max(0.0, begin - tile * width), min(length, begin + long - tile * width)
        if low < high:
            turned = [name for name, flipped in zip(("along", "across"), laid.flipped, strict=True) if flipped]
            how = f", reflected {' and '.join(turned)}" if turned else ""
            found.append(
                f"{low:.3g} ... {high:.3g} mm of the tile: {keys.files[laid.which]} from {laid.place[0]:.3g} mm along "
                f"and {laid.place[1]:.3g} mm across{how}"
            )
    return tuple(found)


def _on_patches(keys: ScanKeys, body: Body, draw: int, x: FloatArray, y: FloatArray) -> FloatArray:
    """Heights at places along a strip that is laid out of pieces of patches."""
    width = float(y[-1])
    scans = [scan_of(keys, which) for which in range(len(keys.files))]
    for scan, name in zip(scans, keys.files, strict=True):
        _check_width(scan, name, width, width)
    piece = _longest(scans, width)
    pitch = (1.0 - BLEND) * piece
    heights = np.zeros((len(x), len(y)))
    for begin, laid in _laid(scans, body, draw, float(x[0]), float(x[-1]), width).items():
        inside = np.flatnonzero((x >= begin) & (x <= begin + piece))
        if not inside.size:
            continue
        along = x[inside] - begin
        rise = np.clip(np.minimum(along, piece - along) / (piece - pitch), 0.0, 1.0)
        heights[inside] += np.sin(0.5 * np.pi * rise)[:, None] * _read(scans[laid.which], laid, along, y, piece)
    return heights


def _drawn(scans: list[Scan], body: Body, draw: int, number: int, size: tuple[float, float]) -> _Piece:
    """The piece of this number."""
    rng = generator(f"patches of the {body}", draw, TILES + number)
    which = int(rng.integers(len(scans)))
    free = [max(0.0, have - need) for have, need in zip(scans[which].size, size, strict=True)]
    x, y = rng.random(2) * free
    flip = rng.random(2) < 0.5
    return _Piece(which, (float(x), float(y)), (bool(flip[0]), bool(flip[1])))


def _read(scan: Scan, laid: _Piece, along: FloatArray, y: FloatArray, piece: float) -> FloatArray:
    """Heights of a piece at places along and across it."""
    turned, mirrored = laid.flipped
    x = laid.place[0] + (piece - along[::-1] if turned else along)
    across = laid.place[1] + (y[-1] - y[::-1] if mirrored else y)
    heights = area_means(scan, x, across, float(y[1]))
    heights = heights[::-1] if turned else heights
    return heights[:, ::-1] if mirrored else heights


def area_means(scan: Scan, x: FloatArray, y: FloatArray, step: float) -> FloatArray:
    """Means of a scan over the cells of a grid, shape (len(x), len(y)).

    A cell reaches half a `step` [mm] of the grid to each side of its place, and ends where the scan does. Where the
    scan is no finer than the grid, its points are joined by triangles instead, as those of a `Surface`.
    """
    dx, dy = scan.spacing
    if min(dx, dy) / step > 1.0 - 1e-9:
        return as_surface(scan).at(x[:, None] - 0.5 * dx, y[None, :] - 0.5 * dy)
    along, rows = _weights(x, step, scan.spacing[0], scan.heights.shape[0])
    across, columns = _weights(y, step, scan.spacing[1], scan.heights.shape[1])
    means: FloatArray = along @ scan.heights[rows, columns] @ across.T
    return means


def _weights(places: FloatArray, step: float, spacing: float, count: int) -> tuple[FloatArray, slice]:
    """Weights of the points of a scan at each place, shape (places, points), and which points they are."""
    first = max(0, floor((places.min() - step) / spacing) - 1)
    last = min(count, floor((places.max() + step) / spacing) + 2)
    edges = spacing * np.arange(first, last + 1)
    if spacing < step * (1.0 - 1e-9):
        low, high = np.clip(places - 0.5 * step, 0.0, None), np.clip(places + 0.5 * step, None, count * spacing)
        share = np.minimum(high[:, None], edges[None, 1:]) - np.maximum(low[:, None], edges[None, :-1])
        weights = np.clip(share, 0.0, None)
    else:
        middle = 0.5 * (edges[1:] + edges[:-1])
        held = np.clip(places, middle[0], middle[-1])
        weights = np.clip(1.0 - np.abs(held[:, None] - middle[None, :]) / spacing, 0.0, None)
    return weights / weights.sum(axis=1, keepdims=True), slice(first, last)


def _check_width(scan: Scan, name: str, length: float, width: float) -> None:
    """Refuse a scan that does not hold a tile.

    Raises:
        SurfaceError: it is too small, or lies across.
    """
    (have_x, have_y), (dx, dy) = scan.size, scan.spacing
    if have_x < length - dx * 1.001 or have_y < width - dy * 1.001:
        turned = "; it is long enough across: is along = 'y' right?" if have_y >= length > have_x else ""
        raise SurfaceError(
            f"{name}: covers {have_x:.4g} mm along the slide and {have_y:.4g} mm across, a tile needs {length:g} x "
            f"{width:g} mm{turned}"
        )
    coarse = 0.25 * width
    if max(dx, dy) > coarse:
        raise SurfaceError(f"{name}: its points are {max(dx, dy):g} mm apart, a tile needs {coarse:g} mm or less")
