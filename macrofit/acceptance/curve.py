"""The shape of a pressing curve in numbers: where it begins, its jump, steps, dips, flat stretches and bulge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import BoolArray, FloatArray

BEGINS = 0.005
"""Force over the peak from which a wheel counts as engaged [-]: below it is friction of the press, or its zero."""
SHORT, BESIDE = 1.0, 10.0
"""Length within which a rise is a jump, and that of the neighbouring stretches it is compared with [mm]."""


@dataclass(frozen=True)
class Found:
    """A measure of a curve and the displacement where it was found."""

    value: float
    at: float  # mm
    within: float = 0.0  # mm, length of the stretch that shows it, of a jump

    @property
    def resolved(self) -> bool:
        """Whether the points are close enough to tell a jump from a steep rise."""
        return self.within <= SHORT + 1e-9


@dataclass(frozen=True)
class Dip:
    """A stretch below what the force had reached before."""

    start: float  # mm, where it had been reached
    end: float  # mm, where it is again; the end of the curve where it is not
    depth: float  # N
    at: float  # mm, where it is deepest


@dataclass(frozen=True)
class Rises:
    """Short stretches of a curve and what is gained in them, arrays (n,)."""

    left: FloatArray  # mm
    width: FloatArray  # mm
    gain: FloatArray  # N, beyond the slope of the steeper neighbour

    def largest(self, among: BoolArray) -> Found:
        """The largest gain of those that count, 0 where none is above it."""
        if not among.any():
            return Found(0.0, 0.0)
        worst = int(np.argmax(np.where(among, self.gain, -np.inf)))
        return Found(max(float(self.gain[worst]), 0.0), float(self.left[worst]), float(self.width[worst]))


class Curve:
    """A pressing curve from its first force on, ascending in displacement."""

    def __init__(self, displacement: FloatArray, force: FloatArray) -> None:
        """Cut what comes before the first force; ``force`` (n,) [N] has a positive largest value."""
        self.peak = float(force.max())
        first = max(int(np.argmax(force > BEGINS * self.peak)) - 1, 0)
        self.s: FloatArray = displacement[first:]  # (m,) [mm]
        self.f: FloatArray = force[first:]  # (m,) [N]
        self.reached: FloatArray = np.maximum.accumulate(self.f)

    @property
    def length(self) -> float:
        """Displacement from the first force to the end [mm]."""
        return float(self.s[-1] - self.s[0])

    @property
    def final(self) -> Found:
        """Force at the end [N]."""
        return Found(float(self.f[-1]), float(self.s[-1]))

    @property
    def top(self) -> Found:
        """The largest force [N]."""
        return Found(self.peak, float(self.s[int(np.argmax(self.f))]))

    def start_jump(self) -> Found:
        """The largest jump within `BESIDE` of the first force [N], that at the first force itself included."""
        begin, end = float(self.s[0]), float(self.s[-1])
        width = float(self._widths()[0])
        after = min(begin + width + BESIDE, end)
        low, high = np.interp([begin + width, after], self.s, self.reached)
        slope = (high - low) / (after - begin - width) if after > begin + width else 0.0
        before = float(self.f[0]) if self.f[0] <= BEGINS * self.peak else 0.0  # a record may begin within the jump
        first = Found(float(low - slope * width) - before, begin, width)  # the line along what follows, taken back
        rises = self._rises()
        later = rises.largest(rises.left < begin + BESIDE)
        return max(first, later, key=lambda found: found.value)

    def step(self) -> Found:
        """The largest jump after that [N]."""
        rises = self._rises()
        return rises.largest(rises.left >= self.s[0] + BESIDE)

    def without_rise(self, noise: float) -> Found:
        """Longest stretch within which what was reached grows by less than ``noise`` of the peak [mm]."""
        wanted = self.reached + max(noise, 1e-9) * self.peak
        after = np.searchsorted(self.reached, wanted)
        k = np.minimum(after, len(self.s) - 1)
        low, high = self.reached[k - 1], self.reached[k]
        share = np.clip((wanted - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
        end = np.where(after < len(self.s), self.s[k - 1] + share * (self.s[k] - self.s[k - 1]), self.s[-1])
        worst = int(np.argmax(end - self.s))
        return Found(float(end[worst] - self.s[worst]), float(self.s[worst]))

    def dips(self, noise: float) -> list[Dip]:
        """The dips deeper than ``noise`` of the peak, from the first to the last."""
        below = np.concatenate([[False], self.reached > self.f, [False]])
        begins, ends = np.flatnonzero(np.diff(below.astype(int)) > 0), np.flatnonzero(np.diff(below.astype(int)) < 0)
        dips = [self._dip(int(i), int(j)) for i, j in zip(begins, ends, strict=True)]
        return [dip for dip in dips if dip.depth > noise * self.peak]

    def bulge(self) -> float:
        """Mean height above the chord from the first force to the end [N]."""
        chord = self.f[0] + (self.f[-1] - self.f[0]) * (self.s - self.s[0]) / self.length
        above = self.f - chord
        return float((0.5 * (above[1:] + above[:-1])) @ np.diff(self.s)) / self.length

    def _dip(self, i: int, j: int) -> Dip:
        """The dip of the points i to j - 1."""
        deepest = i + int(np.argmax(self.reached[i:j] - self.f[i:j]))
        end = float(self.s[-1])
        if j < len(self.s):
            share = (self.reached[j - 1] - self.f[j - 1]) / (self.f[j] - self.f[j - 1])
            end = float(self.s[j - 1] + share * (self.s[j] - self.s[j - 1]))
        depth = float(self.reached[deepest] - self.f[deepest])
        return Dip(float(self.s[i - 1]), end, depth, float(self.s[deepest]))

    def _widths(self) -> FloatArray:
        """Length of the stretch after each point but the last that shows a jump [mm]: never less than to the next."""
        return np.maximum(SHORT, np.diff(self.s))

    def _rises(self) -> Rises:
        """The stretches of `SHORT`, or to the next point; the recovery from a dip gains nothing."""
        width = self._widths()
        inside = (self.s[:-1] >= self.s[0] + width[0] - 1e-9) & (self.s[:-1] + width <= self.s[-1] + 1e-9)
        left, width = self.s[:-1][inside], width[inside]
        slope = np.maximum(self._slope(left - BESIDE, left), self._slope(left + width, left + width + BESIDE))
        return Rises(left, width, self._at(left + width) - self._at(left) - slope * width)

    def _at(self, place: FloatArray) -> FloatArray:
        return np.interp(place, self.s, self.reached)

    def _slope(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Mean slope of what was reached between two places, cut to the curve [N/mm]; 0 where nothing is left."""
        left, right = np.maximum(left, self.s[0]), np.minimum(right, self.s[-1])
        length = right - left
        slope: FloatArray = np.where(length > 1e-9, (self._at(right) - self._at(left)) / np.maximum(length, 1e-9), 0.0)
        return slope
