"""Spheres seen from afar and obliquely, drawn with a depth buffer: a picture, without labels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]

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
    image = image.reshape(shape[0] // SAMPLES, SAMPLES, width, SAMPLES, 4).mean(axis=(1, 3))
    image[..., :3] /= np.maximum(image[..., 3:], 1e-9)  # what is half background keeps its colour
    top = low[1] + shape[0] / scale
    return np.rint(255.0 * image[::-1]).astype(np.uint8), (float(low[0]), float(high[0]), float(low[1]), float(top))


def outside(view: View, centres: FloatArray, radii: FloatArray) -> npt.NDArray[np.bool_]:
    """Which spheres of a box are near one of its three sides that face the viewer, shape (n,)."""
    towards = view.axes[2]
    faced = np.where(towards > 0.0, centres.max(axis=0) - centres, centres - centres.min(axis=0))
    near: npt.NDArray[np.bool_] = np.any(faced < SHELL * radii[:, None], axis=1)
    return near


def _buffers(place: FloatArray, radii: FloatArray, shape: tuple[int, int]) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Depth of what is seen at each sample (-inf: nothing) and the number of its sphere (-1); lengths in samples."""
    depth = np.full(shape, -np.inf)
    owner = np.full(shape, -1)
    first = np.maximum(np.floor(place[:, :2] - radii[:, None]).astype(int), 0)
    last = np.minimum(np.ceil(place[:, :2] + radii[:, None]).astype(int) + 1, [shape[1], shape[0]])
    for k in range(len(radii)):
        (i, j), (m, n) = first[k], last[k]
        x, y = np.arange(i, m) + 0.5 - place[k, 0], np.arange(j, n) + 0.5 - place[k, 1]
        bulge = np.sqrt(np.maximum(radii[k] ** 2 - x[None, :] ** 2 - y[:, None] ** 2, 0.0))
        here = np.where(bulge > 0.0, place[k, 2] + bulge, -np.inf)
        patch = (slice(j, n), slice(i, m))
        nearer = here > depth[patch]
        depth[patch][nearer] = here[nearer]
        owner[patch][nearer] = k
    return depth, owner


def _shaded(
    depth: FloatArray, owner: npt.NDArray[np.int64], place: FloatArray, radii: FloatArray, colours: FloatArray
) -> FloatArray:
    """Colour times opacity, and opacity, at each sample: matt light, and darker where neighbours are in front."""
    from scipy.ndimage import uniform_filter

    rows, columns = np.nonzero(owner >= 0)
    k = owner[rows, columns]
    seen = depth[rows, columns]
    samples = np.stack([columns + 0.5, rows + 0.5, seen], axis=1)
    light = np.maximum((samples - place[k]) @ LIGHT / radii[k], 0.0)
    size = 2 * int(1.5 * radii.mean()) + 1
    filled = np.where(owner >= 0, depth, seen.min())
    # what lies deeper than its surroundings gets less light (Luft, Colditz, Deussen 2006, doi 10.1145/1141911.1142016)
    pit = (uniform_filter(filled, size)[rows, columns] - seen) / (2.0 * radii.mean())
    shade = (0.34 + 0.70 * light) * (1.0 - 0.55 * np.clip(pit, 0.0, 1.0))
    image = np.zeros((*depth.shape, 4))
    image[rows, columns, :3] = np.clip(colours[k] * shade[:, None] + 0.16 * (light**24)[:, None], 0.0, 1.0)
    image[rows, columns, 3] = 1.0
    return image
