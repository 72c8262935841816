"""Spheres seen from afar and obliquely, drawn with a depth buffer: a picture, without labels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray

SampleArray: TypeAlias = npt.NDArray[np.float32]
IndexArray: TypeAlias = npt.NDArray[np.int32]

LIGHT = np.array([-0.45, 0.55, 0.70]) / np.linalg.norm([-0.45, 0.55, 0.70])
"""Direction the light comes from, in the frame of the picture: right, up, towards the viewer."""
SAMPLES = 2
"""Samples per pixel along each side."""
SHELL = 5.0
"""Spheres deeper than this many radii below the sides that face the viewer are not drawn: they cannot be seen."""


@dataclass(frozen=True)
class View:
    """A parallel projection; the viewer stands in front (-y), to the right by `azimuth` and above by `elevation`."""

    azimuth: float = 28.0  # degrees
    elevation: float = 24.0  # degrees

    @property
    def axes(self) -> FloatArray:
        """Right, up, and towards the viewer, rows of shape (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = [np.cos(a), np.sin(a), 0.0]
        up = [-np.sin(e) * np.sin(a), np.sin(e) * np.cos(a), np.cos(e)]
        return np.array([right, up, np.cross(right, up)])

    def flat(self, points: npt.ArrayLike) -> FloatArray:
        """Where points (..., 3) lie in the picture, right and up (..., 2) [mm]."""
        projected: FloatArray = np.asarray(points, dtype=np.float64) @ self.axes[:2].T
        return projected


def draw(
    view: View, centres: FloatArray, radii: FloatArray, colours: FloatArray, width: int
) -> tuple[npt.NDArray[np.uint8], tuple[float, float, float, float]]:
    """The picture, shape (height, width, 4), and where its edges are: left, right, bottom, top [mm].

    Args:
        view: where it is seen from.
        centres: shape (n, 3) [mm].
        radii: shape (n,) [mm].
        colours: of each sphere, shape (n, 3), 0 to 1.
        width: of the picture, in pixels.
    """
    place = centres @ view.axes.T
    margin = 2.0 * radii.max()
    low, high = place[:, :2].min(axis=0) - margin, place[:, :2].max(axis=0) + margin
    scale = SAMPLES * width / (high[0] - low[0])
    shape = (SAMPLES * int(np.ceil((high[1] - low[1]) * scale / SAMPLES)), SAMPLES * width)
    depth, owner = _buffers((place - [*low, 0.0]) * scale, radii * scale, shape)
    image = _shaded(depth, owner, (place - [*low, 0.0]) * scale, radii * scale, colours)
    parts = [image[i::SAMPLES, j::SAMPLES] for i in range(SAMPLES) for j in range(SAMPLES)]
    image = np.add.reduce(parts) / np.float32(len(parts))
    image[..., :3] /= np.maximum(image[..., 3:], 1e-9)  # what is half background keeps its colour
    top = low[1] + shape[0] / scale
    return np.rint(255.0 * image[::-1]).astype(np.uint8), (float(low[0]), float(high[0]), float(low[1]), float(top))


def outside(view: View, centres: FloatArray, radii: FloatArray) -> npt.NDArray[np.bool_]:
    """Which spheres of a box are near one of its three sides that face the viewer, shape (n,)."""
    towards = view.axes[2]
    faced = np.where(towards > 0.0, centres.max(axis=0) - centres, centres - centres.min(axis=0))
    near: npt.NDArray[np.bool_] = np.any(faced < SHELL * radii[:, None], axis=1)
    return near


def _buffers(place: FloatArray, radii: FloatArray, shape: tuple[int, int]) -> tuple[SampleArray, IndexArray]:
    """Depth of what is seen at each sample (-inf: nothing) and the number of its sphere (-1); lengths in samples."""
    depth = np.full(shape, -np.inf, dtype=np.float32)
    owner = np.full(shape, -1, dtype=np.int32)
    place, radii = place.astype(np.float32), radii.astype(np.float32)
    first = np.maximum(np.floor(place[:, :2] - radii[:, None]).astype(int), 0)
    last = np.minimum(np.ceil(place[:, :2] + radii[:, None]).astype(int) + 1, [shape[1], shape[0]])
    across, up = (np.arange(count, dtype=np.float32) + np.float32(0.5) for count in (shape[1], shape[0]))
    for k, ((i, j), (m, n)) in enumerate(zip(first, last, strict=True)):
        x, y = across[i:m] - place[k, 0], up[j:n] - place[k, 1]
        bulge = (radii[k] ** 2 - x**2)[None, :] - (y**2)[:, None]
        here = np.where(bulge > 0.0, place[k, 2] + np.sqrt(np.maximum(bulge, 0.0)), -np.inf)
        patch = (slice(j, n), slice(i, m))
        nearer = here > depth[patch]
        np.copyto(depth[patch], here, where=nearer)
        np.copyto(owner[patch], k, where=nearer)
    return depth, owner


def _shaded(
    depth: SampleArray, owner: IndexArray, place: FloatArray, radii: FloatArray, colours: FloatArray
) -> SampleArray:
    """Colour times opacity, and opacity, at each sample: matt light, and darker where neighbours are in front."""
    from scipy.ndimage import uniform_filter

    flat = np.flatnonzero(owner >= 0)
    rows, columns = np.divmod(flat.astype(np.int32), np.int32(owner.shape[1]))
    k, seen = owner.ravel()[flat], depth.ravel()[flat]
    # (sample - centre) . light / radius, without a table of samples
    centre, inverse = (place @ LIGHT).astype(np.float32)[k], (1.0 / radii).astype(np.float32)[k]
    right, up, near = LIGHT.astype(np.float32)
    light = (right * columns.astype(np.float32) + up * rows.astype(np.float32) + near * seen - centre) * inverse
    light = np.maximum(light, np.float32(0.0))
    size = 2 * int(1.5 * radii.mean()) + 1
    filled = np.where(owner >= 0, depth, seen.min())
    # what lies deeper than its surroundings gets less light (Luft, Colditz, Deussen 2006, doi 10.1145/1141911.1142016)
    pit = (uniform_filter(filled, size).ravel()[flat] - seen) * np.float32(0.5 / radii.mean())
    shade = (0.36 + 0.72 * light) * (1.0 - 0.55 * np.clip(pit, 0.0, 1.0))
    glint = light * light
    glint = 0.16 * (glint * glint * glint) ** 4
    image = np.zeros((depth.size, 4), dtype=np.float32)
    for channel in range(3):
        image[flat, channel] = np.minimum(colours[:, channel].astype(np.float32)[k] * shade + glint, 1.0)
    image[flat, 3] = 1.0
    return image.reshape(*depth.shape, 4)
