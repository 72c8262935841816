"""Roughness behind a Gaussian filter, where drawings state it: profiles of ISO 21920 (ISO 4287), areas of ISO 25178.

A face of 1 or 2 mm is one or two cut-offs long, and the standard takes five: waves of its own size are half kept, and
near its borders the filter has one side only. What a drawing says is `profile` of a long piece of the strip.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from ..settings import FaceKeys
from .face import rough_face
from .gaussian import CUTOFF, filtered, gaussian_mean
from .surface import TILES, Body, Surface

SECTIONS = 5
"""Section lengths, of a cut-off each, in an evaluation length."""
LONG = 40.0
"""Length of the piece of a strip that is measured, at most [mm]: ten evaluation lengths."""
MOST_POINTS = 1_000_000
"""Points of such a piece, at most: fine strips are measured on one evaluation length."""


__all__ = ["CUTOFF", "LONG", "MOST_POINTS", "SECTIONS", "Profile", "filtered", "measured_length", "profile"]


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Measures of profiles along the slide behind the filter, means over all lines across."""

    Ra: float
    """Mean of |z| [mm]."""

    Rq: float
    """Root of the mean of z^2 [mm]."""

    Rz: float
    """Highest peak to deepest valley of a section as long as the cut-off, mean over the sections [mm]."""

    evaluation: float
    """Length of the profiles that are measured [mm]."""


def profile(surface: Surface, cutoff: float = CUTOFF) -> Profile:
    """Ra, Rq and Rz of the lines along the slide behind the filter.

    Half a cut-off at each end is left out where at least one remains.

    Args:
        surface: the face, or a long piece of a strip.
        cutoff: wavelength of which half is kept [mm].

    Source: ISO 4287:1997, 4.1 and 4.2 (ISO 21920-2:2021); ISO 16610-21:2011.
    """
    dx = surface.spacing[0]
    z = surface.heights - gaussian_mean(surface.heights, dx, cutoff)
    ends = round(0.5 * cutoff / dx)
    if surface.size[0] >= 2.0 * cutoff:
        z = z[ends : len(z) - ends]
    sections = np.array_split(z, max(1, round((len(z) - 1) * dx / cutoff)))
    return Profile(
        Ra=float(np.abs(z).mean()),
        Rq=float(np.mean(np.sqrt(np.mean(z**2, axis=0)))),
        Rz=float(np.mean([np.ptp(each, axis=0).mean() for each in sections])),
        evaluation=(len(z) - 1) * dx,
    )


def measured_length(keys: FaceKeys, body: Body, seed: int, face: Surface) -> Surface:
    """What a profile is measured on: a long piece of the strip that a face was cut from, or the tile itself.

    Args:
        keys: how the face is made.
        body: body whose face it is.
        seed: seed of the face.
        face: the face.
    """
    if keys.form != "strip" or keys.measured(body) is not None:
        return face
    width, (_, across) = face.size[1], face.shape
    least, most = ceil((SECTIONS + 1) * CUTOFF / width), round(LONG / width)
    tiles = max(least, min(most, int(MOST_POINTS / across**2)))
    strip, place = divmod(seed, TILES)
    return rough_face(keys, body, TILES * strip + place, (tiles * width, width))
