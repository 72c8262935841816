"""The plain formats of instruments: SDF and SUR, AL3D and X3P, each a head with numbers and a block of heights.

Files of other kinds are read by SurfaceTopography where it is installed (`foreign`).
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray

from .raw import RawScan, ScanError, length_unit

SUR_MAGIC, AL3D_MAGIC, ZIP_MAGIC = b"DIGITAL SURF", b"AliconaImaging\x00\r\n", b"PK\x03\x04"
SDF_MAGICS = (b"aBCR-1.0", b"bBCR-1.0", b"aISO-1.0", b"bISO-1.0")
MOST_POINTS = 50_000_000
"""Points of a scan that is read."""
SDF_KINDS: dict[int, str] = {
    0: "u1", 1: "<u2", 2: "<u4", 3: "<f4", 4: "i1", 5: "<i2", 6: "<i4", 7: "<f8",
}  # fmt: skip
X3P_KINDS = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
MOST_XML = 1_000_000
"""Size of the index of an X3P file."""


def read_sdf(data: bytes) -> RawScan:
    """A surface data file in text or binary form, lengths in m.

    Raises:
        ScanError: it is damaged, or compressed.

    Source: ISO 25178-71:2017.
    """
    return _sdf_text(data) if data[:1] == b"a" else _sdf_binary(data)


def _sdf_text(data: bytes) -> RawScan:
    parts = data[8:].decode("latin1").split("*")
    head = {}
    for line in parts[0].splitlines():
        name, equals, value = line.partition("=")
        if equals:
            head[name.strip().lower()] = value.strip()
    if len(parts) < 2:
        raise ScanError("its head does not end (a line with * is missing)")
    nx, ny = _counts(_number(head, "numpoints"), _number(head, "numprofiles"))
    scales = tuple(_number(head, name) for name in ("xscale", "yscale", "zscale"))
    words = parts[1].replace(",", ".").split()
    bad = {"BAD", "NAN", "---"}
    if len(words) != nx * ny:
        raise ScanError(f"its head states {nx} x {ny} points, and {len(words)} heights follow")
    try:
        values = np.array([math.nan if word.upper() in bad else float(word) for word in words])
    except ValueError as error:
        raise ScanError(f"a height is no number ({error})") from None
    return _sdf_scan(values.reshape(ny, nx), scales)


def _sdf_binary(data: bytes) -> RawScan:
    if len(data) < 81:
        raise ScanError("its head is cut off")
    nx, ny, *scales, _, compression, kind, _ = struct.unpack_from("<HHddddBBB", data, 42)
    if compression or kind not in SDF_KINDS:
        raise ScanError(f"its heights are compressed, or of kind {kind}, which is not read; save it uncompressed")
    nx, ny = _counts(nx, ny)
    raw = _block(data, 81, nx * ny, SDF_KINDS[kind])
    values = raw.astype(np.float64)
    if raw.dtype.kind == "f":
        values[~(np.abs(values) < 1e30)] = math.nan
    elif raw.dtype.itemsize > 1:  # bytes have no mark for what was not measured
        values[raw == (np.iinfo(raw.dtype).min if raw.dtype.kind == "i" else np.iinfo(raw.dtype).max)] = math.nan
    return _sdf_scan(values.reshape(ny, nx), tuple(scales))


def _sdf_scan(values: FloatArray, scales: tuple[float, ...]) -> RawScan:
    x, y, z = scales
    return RawScan(values.T * z, 1e3, _spacing(1e3 * x, 1e3 * y))


def read_sur(data: bytes) -> RawScan:
    """A surface of Digital Surf, not compressed; points that were not measured are zmin - 2.

    Raises:
        ScanError: it is damaged, compressed, or no surface.
    """
    if len(data) < 512:
        raise ScanError("its head is cut off")
    kind, special = struct.unpack_from("<H", data, 18)[0], struct.unpack_from("<H", data, 86)[0]
    bits, low, _, nx, ny, total = struct.unpack_from("<HiiiiI", data, 98)
    dx, dy, dz = struct.unpack_from("<fff", data, 120)
    units = [length_unit(data[at : at + 16].decode("latin1")) for at in (180, 196, 212)]
    if kind not in (0, 2, 12) or bits not in (16, 32):
        raise ScanError(f"it is no plain surface (object type {kind}, {bits} bits); save it as one surface")
    nx, ny = _counts(nx, ny)
    if total not in (0, nx * ny):
        raise ScanError(f"its head states {nx} x {ny} points, and {total} in all")
    comment, private = struct.unpack_from("<HH", data, 334)
    raw = _block(data, 512 + comment + private, nx * ny, "<i2" if bits == 16 else "<i4")
    values = raw.astype(np.float64)
    if special:
        values[raw == low - 2] = math.nan
    inverted = struct.unpack_from("<H", data, 290)[0]
    grid = values.reshape(ny, nx).T * (-float(dz) if inverted in (1, 2, 3) else float(dz))
    grid = grid[::-1] if inverted == 2 else grid[:, ::-1] if inverted == 3 else grid
    x, y, z = (1.0 if unit is None else unit for unit in units)
    return RawScan(grid, z if units[2] else None, _spacing(dx * x, dy * y))


def read_al3d(data: bytes) -> RawScan:
    """A depth image of Alicona Imaging, lengths in m, rows padded to eight bytes.

    Raises:
        ScanError: it is damaged.
    """
    tags: dict[str, str] = {}
    place, count = len(AL3D_MAGIC), 2
    while count and place + 52 <= len(data):
        key, value = (data[a:b].split(b"\0")[0].decode("latin1").strip() for a, b in (
            (place, place + 20), (place + 20, place + 50)
        ))  # fmt: skip
        tags[key.lower()] = value
        count += int(_number(tags, "tagcount")) - 1 if key == "TagCount" else -1
        place += 52
    nx, ny = _counts(_number(tags, "cols"), _number(tags, "rows"))
    row = (4 * nx + 7) // 8 * 2
    raw = _block(data, int(_number(tags, "depthimageoffset")), row * ny, "<f4").reshape(ny, row)[:, :nx]
    values = raw.astype(np.float64)
    mark = tags.get("invalidpixelvalue", "nan")
    invalid = float(mark) if mark.lower() != "nan" else math.nan
    values[~np.isfinite(values) | (np.abs(values - invalid) <= 2e-7 * abs(invalid))] = math.nan
    return RawScan(
        values.T, 1e3, _spacing(1e3 * _number(tags, "pixelsizexmeter"), 1e3 * _number(tags, "pixelsizeymeter"))
    )


def read_x3p(data: bytes) -> RawScan:
    """A surface in the XML container with binary heights, lengths in m.

    Raises:
        ScanError: it is damaged, a list of points, or has no binary heights.

    Source: ISO 25178-72:2017.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if archive.getinfo("main.xml").file_size > MOST_XML:
                raise ScanError("its index is too large")
            text = archive.read("main.xml")
            if b"<!" in text.replace(b"<!--", b""):
                raise ScanError("its index has declarations of its own, which are not read")
            root = ElementTree.fromstring(text)
            axes = {axis: _axis(root, axis) for axis in ("CX", "CY", "CZ")}
            nx, ny = _counts(*(_number(_children(root, ".//MatrixDimension"), name) for name in ("sizex", "sizey")))
            raw = _x3p_block(archive, root, axes["CZ"], nx * ny)
    except (KeyError, zipfile.BadZipFile, zlib.error, ElementTree.ParseError, OSError, RuntimeError, EOFError) as error:
        raise ScanError(f"it is no X3P archive of a surface, or a damaged one ({error})") from None
    if axes["CX"].get("axistype") != "I" or axes["CY"].get("axistype") != "I":
        raise ScanError("its points are no regular grid; resample it")
    dx, dy = _number(axes["CX"], "increment"), _number(axes["CY"], "increment")
    heights = raw * float(axes["CZ"].get("increment") or 1.0) + float(axes["CZ"].get("offset") or 0.0)
    return RawScan(heights.reshape(ny, nx).T, 1e3, _spacing(1e3 * dx, 1e3 * dy))


def _x3p_block(archive: zipfile.ZipFile, root: ElementTree.Element, axis: Mapping[str, str], count: int) -> FloatArray:
    """The heights as they stand, NaN where the archive says that a point is not valid."""
    link = _children(root, ".//DataLink")
    kind = X3P_KINDS.get(axis.get("datatype", ""))
    if kind is None or "pointdatalink" not in link:
        raise ScanError("it holds no binary heights; save it with binary data")
    stated = count * np.dtype(kind).itemsize
    if archive.getinfo(link["pointdatalink"]).file_size != stated:
        raise ScanError(f"its index states {count} points, its block of heights has another size")
    values = np.frombuffer(archive.read(link["pointdatalink"]), dtype=kind).astype(np.float64)
    values[~np.isfinite(values)] = math.nan
    valid = link.get("validpointslink")
    if valid and valid in archive.namelist():
        bits = np.unpackbits(np.frombuffer(archive.read(valid), dtype=np.uint8), bitorder="little")
        if len(bits) < count:
            raise ScanError("its list of valid points is cut off")
        values[bits[:count] == 0] = math.nan
    return values


def _axis(root: ElementTree.Element, name: str) -> dict[str, str]:
    return _children(root, f".//Axes/{name}")


def _children(root: ElementTree.Element, path: str) -> dict[str, str]:
    """Texts of the children of an element by their names in small letters."""
    found = root.find(path)
    if found is None:
        raise ScanError(f"its index lacks {path.rpartition('/')[2]}")
    return {child.tag.rpartition("}")[2].lower(): (child.text or "").strip() for child in found}


def _number(head: Mapping[str, str], name: str) -> float:
    """A number of a head; raises ScanError where it is missing or none."""
    try:
        return float(head[name].replace(",", "."))
    except (KeyError, ValueError):
        raise ScanError(f"its head has no number {name}") from None


def _counts(x: float, y: float) -> tuple[int, int]:
    """Numbers of points along both axes, once they are seen to be plausible."""
    if not (x >= 2 and y >= 2 and x * y <= MOST_POINTS and x == int(x) and y == int(y)):
        raise ScanError(f"its head states {x:g} x {y:g} points: take 2 x 2 to {MOST_POINTS:,} of them")
    return int(x), int(y)


def _spacing(dx: float, dy: float) -> tuple[float, float]:
    """Spacings [mm], once they are seen to be positive."""
    if not (0.0 < dx < math.inf and 0.0 < dy < math.inf):
        raise ScanError(f"its head states spacings of {dx:g} and {dy:g} mm")
    return float(dx), float(dy)


def _block(data: bytes, place: int, count: int, kind: str) -> npt.NDArray[Any]:
    """So many numbers of a kind from a place on."""
    if place < 0 or place + count * np.dtype(kind).itemsize > len(data):
        raise ScanError(f"its head states {count} points, and {max(0, len(data) - place)} bytes follow")
    return np.frombuffer(data, dtype=kind, count=count, offset=place)
