"""Spheres seen from afar and obliquely, drawn with a depth buffer: a picture, without labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray

from .shading import SAMPLES, nearest, shade

LIGHT = np.array([-0.45, 0.55, 0.70]) / np.linalg.norm([-0.45, 0.55, 0.70])
"""Direction the light comes from, in the frame of the picture: right, up, towards the viewer."""
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
    from scipy.ndimage import uniform_filter

    place = centres @ view.axes.T
    margin = 2.0 * radii.max()
    low, high = place[:, :2].min(axis=0) - margin, place[:, :2].max(axis=0) + margin
    scale = SAMPLES * width / (high[0] - low[0])
    shape = (SAMPLES * int(np.ceil((high[1] - low[1]) * scale / SAMPLES)), SAMPLES * width)
    centre, size = ((place - [*low, 0.0]) * scale).astype(np.float32), (radii * scale).astype(np.float32)
    depth, owner = np.full(shape, -np.inf, dtype=np.float32), np.full(shape, -1, dtype=np.int32)
    nearest(centre, size, depth, owner)
    mean = size.mean()
    filled = np.maximum(depth, centre[:, 2].min())  # the background, as deep as what is drawn
    around = uniform_filter(filled, 2 * int(1.5 * mean) + 1)
    image = np.zeros((shape[0] // SAMPLES, width, 4), dtype=np.uint8)
    shade(centre, size, colours.astype(np.float32), LIGHT.astype(np.float32), depth, owner, around, mean, image)
    top = low[1] + shape[0] / scale
    return image[::-1], (float(low[0]), float(high[0]), float(low[1]), float(top))


def outside(view: View, centres: FloatArray, radii: FloatArray) -> npt.NDArray[np.bool_]:
    """Which spheres of a box are near one of its three sides that face the viewer, shape (n,)."""
    towards = view.axes[2]
    faced = np.where(towards > 0.0, centres.max(axis=0) - centres, centres - centres.min(axis=0))
    near: npt.NDArray[np.bool_] = np.any(faced < SHELL * radii[:, None], axis=1)
    return near
