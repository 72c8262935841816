"""Numba kernels of the picture of the plates: a depth buffer, and the light on what it holds."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from macrofit.base.caches import ensure_cache
from macrofit.base.compiled import check_compiled

ensure_cache()  # numba looks for it where a kernel is declared

SAMPLES = 2
"""Samples per pixel along each side."""


@njit(cache=True)
def nearest(place, radii, depth, owner):
    """The nearest sphere of each sample: its depth there and its number, over -inf and -1; lengths in samples."""
    rows, columns = depth.shape
    half = np.float32(0.5)
    for k in range(len(radii)):
        x, y, z = place[k]
        r = radii[k]
        for j in range(max(0, math.floor(y - r)), min(rows, math.ceil(y + r) + 1)):
            rest = r * r - (j + half - y) ** 2
            for i in range(max(0, math.floor(x - r)), min(columns, math.ceil(x + r) + 1)):
                bulge = rest - (i + half - x) ** 2
                if bulge > 0.0:
                    here = z + np.sqrt(bulge)
                    if here > depth[j, i]:
                        depth[j, i] = here
                        owner[j, i] = k


@njit(cache=True)
def shade(place, radii, colours, light, depth, owner, around, mean, image):
    """Colour and opacity of each pixel, the mean of its samples: matt light, and darker where neighbours are in front.

    What lies deeper than its surroundings gets less light (Luft, Colditz, Deussen 2006, doi 10.1145/1141911.1142016);
    ``around`` is their mean depth, ``mean`` the mean radius. What is half background keeps its colour.
    """
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            red, green, blue, covered = 0.0, 0.0, 0.0, 0
            for j in range(SAMPLES * row, SAMPLES * (row + 1)):
                for i in range(SAMPLES * column, SAMPLES * (column + 1)):
                    k = owner[j, i]
                    if k < 0:
                        continue
                    toward = light[0] * (i - place[k, 0]) + light[1] * (j - place[k, 1])
                    lit = max(0.0, (toward + light[2] * (depth[j, i] - place[k, 2])) / radii[k])
                    pit = min(1.0, max(0.0, (around[j, i] - depth[j, i]) * 0.5 / mean))
                    tone = (0.36 + 0.72 * lit) * (1.0 - 0.55 * pit)
                    glint = 0.16 * (lit * lit) ** 12
                    red += min(1.0, colours[k, 0] * tone + glint)
                    green += min(1.0, colours[k, 1] * tone + glint)
                    blue += min(1.0, colours[k, 2] * tone + glint)
                    covered += 1
            if covered:
                image[row, column, 0] = np.uint8(255.0 * red / covered + 0.5)
                image[row, column, 1] = np.uint8(255.0 * green / covered + 0.5)
                image[row, column, 2] = np.uint8(255.0 * blue / covered + 0.5)
                image[row, column, 3] = np.uint8(255.0 * covered / SAMPLES**2 + 0.5)


check_compiled(nearest)
