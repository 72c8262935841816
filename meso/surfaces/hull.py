"""The closed shell of a plate: a box whose upper face is rough."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray

from ..errors import OutputError, SurfaceError
from .surface import Surface

IntArray = npt.NDArray[np.int64]
FORMATS = {".stl": "stl", ".vtk": "vtk", ".vtu": "vtu", ".ply": "ply"}


@dataclass(frozen=True, eq=False)
class Hull:
    """Triangles around a plate, closed, their normals outward by the right-hand rule."""

    points: FloatArray
    """x, y, z [mm], shape (n, 3): first the rough face, point (i, j) at i ny + j, then the back face likewise."""

    triangles: IntArray
    """Numbers of the points, shape (m, 3): the rough face, the back face, then the four sides."""

    @property
    def volume(self) -> float:
        """V = 1/6 sum of a . (b x c) over the triangles a b c [mm^3] (divergence theorem)."""
        a, b, c = np.moveaxis(self.points[self.triangles], 1, 0)
        return float(np.sum(a * np.cross(b, c)) / 6.0)


def hull(surface: Surface, thickness: float) -> Hull:
    """The plate with this rough face: back face flat at z = 0, rough face at z = H + h(x, y).

    Args:
        surface: heights h, outward from the nominal face.
        thickness: H, from the back face to the nominal rough face [mm].

    Raises:
        SurfaceError: the rough face reaches the back face, H + min h <= 0.
    """
    (nx, ny), h = surface.shape, surface.heights
    if not (np.isfinite(thickness) and thickness + h.min() > 0.0):
        raise SurfaceError(
            f"the rough face reaches the back of the plate: thickness {thickness:g} mm, deepest valley "
            f"{h.min():g} mm; take a thicker plate or lower heights"
        )
    x, y = np.meshgrid(surface.x, surface.y, indexing="ij")
    rough, back = (np.stack([x, y, z], axis=-1).reshape(-1, 3) for z in (thickness + h, np.zeros_like(h)))

    number = np.arange(nx * ny, dtype=np.int64).reshape(nx, ny)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    top = np.concatenate([_rows(a, b, c), _rows(a, c, d)])  # the diagonal of Surface: (i, j) to (i+1, j+1)

    # anticlockwise seen from above, each corner once
    border = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    following, below = np.roll(border, -1), nx * ny
    sides = [_rows(border + below, following + below, following), _rows(border + below, following, border)]
    return Hull(np.concatenate([rough, back]), np.concatenate([top, top[:, ::-1] + below, *sides]))


def is_watertight(triangles: IntArray) -> bool:
    """Whether every edge belongs to exactly two triangles (m, 3), which run along it in opposite directions."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    if len(start) == 0 or np.any(start == end):
        return False
    count = np.int64(triangles.max()) + 1
    forward, backward = np.sort(start * count + end), np.sort(end * count + start)
    return bool(np.all(forward[1:] != forward[:-1]) and np.array_equal(forward, backward))


def write(hull: Hull, path: Path) -> Path:
    """Write the hull in the format its suffix names (.stl, .vtk, .vtu, .ply; binary) and give the path back.

    An .stl holds coordinates in single precision, and no numbering: readers merge equal points.

    Raises:
        OutputError: an unknown suffix, or a file that cannot be written.
    """
    known = FORMATS.get(path.suffix.lower())
    if known is None:
        raise OutputError(f"{path}: a hull is written as {', '.join(FORMATS)}, not as {path.suffix or 'a bare name'}")
    import meshio

    mesh = meshio.Mesh(hull.points, [("triangle", hull.triangles.astype(np.int32))])
    try:
        meshio.write(path, mesh, file_format=known, binary=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    return path


def _rows(*corners: IntArray) -> IntArray:
    return np.stack([corner.ravel() for corner in corners], axis=1)
