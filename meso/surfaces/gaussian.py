"""The Gaussian filter of profiles and areas."""

from __future__ import annotations

from math import log, pi, sqrt

import numpy as np

from .surface import FloatArray, Surface

CUTOFF = 0.8
"""Cut-off wavelength of the filter [mm], that of Ra from 0.1 to 2 um (ISO 21920-3, ISO 4288)."""
_ALPHA = sqrt(log(2.0) / pi)


def filtered(surface: Surface, cutoff: float = CUTOFF) -> Surface:
    """The surface without its waves above the cut-off: h less its Gaussian mean surface.

    Where the filter reaches beyond the border it is cut off, and its weights are scaled to the sum 1.

    Args:
        surface: the face.
        cutoff: wavelength of which half is kept [mm].

    Source: ISO 16610-61:2015; ISO 16610-21:2011, 4.2 in each direction; ends as ISO 16610-28.
    """
    (dx, dy), h = surface.spacing, surface.heights
    mean = gaussian_mean(gaussian_mean(h, dx, cutoff).T, dy, cutoff).T
    return Surface(h - mean, surface.size)


def gaussian_mean(heights: FloatArray, spacing: float, cutoff: float) -> FloatArray:
    """Gaussian mean along the first axis: s(x) = exp(-pi (x / (alpha cutoff))^2), to one cut-off on each side."""
    reach = min(int(cutoff / spacing), len(heights) - 1)
    lags = np.arange(-reach, reach + 1) * spacing
    weights = np.exp(-pi * (lags / (_ALPHA * cutoff)) ** 2)
    size = len(heights) + 2 * reach
    transform = np.fft.rfft(weights, size)
    ends = np.fft.irfft(transform * np.fft.rfft(np.ones(len(heights)), size), size)
    sums = np.fft.irfft(transform[:, None] * np.fft.rfft(heights, size, axis=0), size, axis=0)
    inner = slice(reach, reach + len(heights))
    mean: FloatArray = sums[inner] / ends[inner, None]
    return mean
