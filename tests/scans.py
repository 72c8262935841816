"""Writers of the formats in which instruments keep surfaces, and surfaces to write: heights (nx, ny) in mm, x first."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable

import numpy as np

from macrofit.base.arrays import FloatArray

Spacing = tuple[float, float]


def npy(heights: FloatArray, spacing: Spacing) -> bytes:
    file = io.BytesIO()
    np.save(file, heights)
    return file.getvalue()


def npz(heights: FloatArray, spacing: Spacing) -> bytes:
    file = io.BytesIO()
    np.savez(file, heights=1e3 * heights, spacing=spacing, unit="µm")
    return file.getvalue()


def csv(heights: FloatArray, spacing: Spacing) -> bytes:
    rows = [",".join(f"{1e3 * z:.9g}" for z in row) for row in heights.tolist()]
    return "\n".join(
        [f"# spacing = {1e3 * spacing[0]:.12g}, {1e3 * spacing[1]:.12g} µm", "# heights [µm]", *rows, ""]
    ).encode()


def xyz(heights: FloatArray, spacing: Spacing) -> bytes:
    (nx, ny), (dx, dy) = heights.shape, spacing
    rows = [f"{i * dx:.9g} {j * dy:.9g} {1e3 * heights[i, j]:.9g}" for j in range(ny) for i in range(nx)]
    return "\n".join(["# x [mm] y [mm] z [µm]", *rows, ""]).encode()


def sdf(heights: FloatArray, spacing: Spacing) -> bytes:
    (nx, ny), (dx, dy) = heights.shape, spacing
    scale = 1e-10
    head = {"ManufacID": "test", "CreateDate": "010120261200", "ModDate": "010120261200", "NumPoints": nx}
    head |= {"NumProfiles": ny, "Xscale": f"{1e-3 * dx:.12g}", "Yscale": f"{1e-3 * dy:.12g}", "Zscale": scale}
    head |= {"Zresolution": -1, "Compression": 0, "DataType": 7, "CheckType": 0}
    values = (1e-3 / scale * heights).T.ravel()
    words = ["BAD" if not np.isfinite(value) else f"{value:.10g}" for value in values.tolist()]
    lines = ["aBCR-1.0", *(f"{name:<12}= {value}" for name, value in head.items()), "*", *words, "*", ""]
    return "\r\n".join(lines).encode()


def sdf_binary(heights: FloatArray, spacing: Spacing) -> bytes:
    (nx, ny), (dx, dy) = heights.shape, spacing
    scale = 1e-10
    head = struct.pack(
        "<8s10s12s12sHHddddBBB", b"bBCR-1.0", b"test", b"010120261200", b"010120261200", nx, ny,
        1e-3 * dx, 1e-3 * dy, scale, -1.0, 0, 6, 0,
    )  # fmt: skip
    values = np.where(np.isfinite(heights), np.round(1e-3 / scale * np.nan_to_num(heights)), -(2**31))
    return head + values.T.astype("<i4").tobytes()


def sur(heights: FloatArray, spacing: Spacing) -> bytes:
    (nx, ny), (dx, dy) = heights.shape, spacing
    step = 1e-7  # mm
    raw = np.round(np.nan_to_num(heights) / step).astype(np.int64)
    low, high = int(raw.min()), int(raw.max())
    raw[~np.isfinite(heights)] = low - 2
    head = bytearray(512)
    struct.pack_into("<12sHHHH30s30sHHHH", head, 0, b"DIGITAL SURF", 0, 1, 1, 2, b"test", b"test", 0, 0, 0, 1)
    struct.pack_into("<HiiiiI", head, 98, 32, low, high, nx, ny, nx * ny)
    struct.pack_into("<fff", head, 120, 1e3 * dx, dy, 1e3 * step)
    for at, name in enumerate((b"X", b"Y", b"Z", b"\xb5m", b"mm", b"\xb5m", b"mm", b"mm", b"\xb5m")):
        struct.pack_into("16s", head, 132 + 16 * at, name)
    struct.pack_into("<fff", head, 276, 1e-3, 1.0, 1.0)
    struct.pack_into("<HH", head, 334, 7, 5)
    return bytes(head) + b"comment" + b"12345" + raw.T.astype("<i4").tobytes()


def al3d(heights: FloatArray, spacing: Spacing) -> bytes:
    (nx, ny), (dx, dy) = heights.shape, spacing
    tags = {"Rows": ny, "Cols": nx, "PixelSizeXMeter": f"{1e-3 * dx:.10g}", "PixelSizeYMeter": f"{1e-3 * dy:.10g}"}
    start = 17 + 52 * (2 + len(tags) + 2) + 256
    tags |= {"DepthImageOffset": start, "InvalidPixelValue": "-1e6"}
    every = {"Version": 1, "TagCount": len(tags)} | tags
    head = b"AliconaImaging\x00\r\n"
    head += b"".join(
        struct.pack("20s30s2s", key.encode(), str(value).encode(), b"\r\n") for key, value in every.items()
    )
    row = (4 * nx + 7) // 8 * 2
    depth = np.zeros((ny, row), dtype="<f4")
    depth[:, :nx] = np.where(np.isfinite(heights), 1e-3 * heights, -1e6).T
    return head + b"comment".ljust(254, b"\0") + b"\r\n" + depth.tobytes()


def x3p(heights: FloatArray, spacing: Spacing) -> bytes:
    (nx, ny), (dx, dy) = heights.shape, spacing
    valid = np.packbits(np.isfinite(heights).T.ravel(), bitorder="little")

    def axis(name: str, kind: str, step: float, data: str) -> str:
        inside = f"<AxisType>{kind}</AxisType><DataType>{data}</DataType><Increment>{step:.12g}</Increment>"
        return f"<{name}>{inside}<Offset>0</Offset></{name}>"

    axes = axis("CX", "I", 1e-3 * dx, "D") + axis("CY", "I", 1e-3 * dy, "D") + axis("CZ", "A", 1.0, "D")
    size = f"<MatrixDimension><SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension>"
    link = "<PointDataLink>bindata/data.bin</PointDataLink><ValidPointsLink>bindata/valid.bin</ValidPointsLink>"
    first = f"<Revision>ISO5436 - 2000</Revision><FeatureType>SUR</FeatureType><Axes>{axes}</Axes>"
    text = f"<Record1>{first}</Record1><Record3>{size}<DataLink>{link}</DataLink></Record3>"
    root = f'<?xml version="1.0"?><p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2">{text}</p:ISO5436_2>'
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("main.xml", root)
        archive.writestr("bindata/data.bin", np.nan_to_num(1e-3 * heights).T.astype("<f8").tobytes())
        archive.writestr("bindata/valid.bin", valid.tobytes())
    return file.getvalue()


WRITERS: dict[str, Callable[[FloatArray, Spacing], bytes]] = {
    "a.npy": npy, "a.npz": npz, "a.csv": csv, "a.xyz": xyz, "a.sdf": sdf, "b.sdf": sdf_binary, "a.sur": sur,
    "a.al3d": al3d, "a.x3p": x3p,
}  # fmt: skip
"""Names of files, and who writes them."""


def textured(rng: np.random.Generator, shape: tuple[int, int], spacing: Spacing, rms: float = 1.6e-3) -> FloatArray:
    """An isotropic self-affine surface of this Sq [mm], flat above 0.3 mm and smooth below 20 um."""
    fx, fy = (np.fft.fftfreq(n, d)[:, None] for n, d in zip(shape, spacing, strict=True))
    q = np.hypot(fx, fy.T)
    amplitude = np.maximum(q, 1.0 / 0.3) ** -1.8 * np.exp(-((0.02 * q) ** 2))
    amplitude[0, 0] = 0.0
    field = np.fft.ifft2(amplitude * np.fft.fft2(rng.standard_normal(shape))).real
    heights: FloatArray = field * (rms / field.std())
    return heights


def turned(
    rng: np.random.Generator, shape: tuple[int, int], spacing: Spacing, feed: float = 0.2, depth: float = 0.005
) -> FloatArray:
    """A turned surface: grooves across x of this feed and depth [mm], parabolas of a nose, with a fine texture."""
    u = np.arange(shape[0]) * spacing[0] / feed + rng.random()
    grooves = depth * ((2.0 * (u - np.floor(u)) - 1.0) ** 2 - 1.0 / 3.0)
    heights: FloatArray = grooves[:, None] + textured(rng, shape, spacing, 0.15 * depth)
    return heights
