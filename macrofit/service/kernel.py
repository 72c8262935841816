"""The fit around the whole ring: harmonics to angles and back, and the influence between angles.

K = 2 H + 1 angles, an odd number: at the highest harmonic of an even one sin n t vanishes at every angle. Values are
arrays (K, 3 m), real; their amplitudes (H + 1, 3 m) have -i b around the axle (see `elements`).
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np

from ..base.arrays import FloatArray, IntArray
from .bonded import Harmonic
from .elements import ComplexArray
from .fit import Fit


class Kernel:
    """S, loads and rigid motions of all harmonics of a fit."""

    def __init__(self, fit: Fit, harmonics: list[Harmonic]) -> None:
        self.fit, self.angles = fit, 2 * len(harmonics) - 1
        m = fit.moments
        self.turn = np.concatenate([np.ones(2 * m), np.full(m, -1j)])
        self.load = np.stack([self.turn * each.traction for each in harmonics])
        self._jumps = np.stack([self.turn * each.jump for each in harmonics])
        self._balances = [each.balance for each in harmonics]
        self._responses = [fit.response(n) for n in range(len(harmonics))]

    @cached_property
    def between_angles(self) -> FloatArray:
        """S between angles k apart (K, 3 m, 3 m) [MPa/mm]."""
        turned = [self.turn[:, None] * response.matrix / self.turn for response in self._responses]
        return np.asarray(np.fft.irfft(np.stack(turned), n=self.angles, axis=0))

    @property
    def normal_stiffness(self) -> FloatArray:
        """S (m, m) [MPa/mm] between openings that are the same all around and pressures."""
        m = self.fit.moments
        return self._responses[0].matrix[:m, :m]

    def respond(self, slip: FloatArray) -> FloatArray:
        """S w (K, 3 m) [MPa] of a slip (K, 3 m) [mm]."""
        return self.product([response.matrix for response in self._responses], self.turn, slip)

    def between(self, places: IntArray) -> list[FloatArray]:
        """S of each harmonic between some places (q,) among 3 m."""
        return [response.matrix[places[:, None], places] for response in self._responses]

    def product(self, matrices: list[FloatArray], turn: ComplexArray, slip: FloatArray) -> FloatArray:
        """Tractions (K, q) [MPa] of slips (K, q) at places with these S and this factor around the axle."""
        plain = self.amplitudes(slip) * turn.conj()
        out = np.empty_like(plain)
        for n, matrix in enumerate(matrices):  # a vector at a time: products of two columns take twice as long
            out.real[n], out.imag[n] = matrix @ plain.real[n], matrix @ plain.imag[n]
        return self.values(turn * out)

    def amplitudes(self, values: FloatArray) -> ComplexArray:
        """Amplitudes (H + 1, 3 m) of values (K, 3 m)."""
        return np.asarray(np.fft.rfft(values, axis=0) / self.angles)

    def values(self, amplitudes: ComplexArray) -> FloatArray:
        """Values (K, 3 m) of amplitudes (H + 1, 3 m)."""
        return np.asarray(np.fft.irfft(self.angles * amplitudes, n=self.angles, axis=0))

    def turned(self, values: FloatArray, angle: float) -> FloatArray:
        """Values that have turned by an angle [rad]."""
        return self.values(self.amplitudes(values) * self._phase(angle)[:, None])

    def load_at(self, angle: float) -> FloatArray:
        """Tractions (K, 3 m) [MPa] of the loads at an angle [rad] where nothing slips."""
        return self.values(self.load * self._phase(angle)[:, None])

    def _phase(self, angle: float) -> ComplexArray:
        return np.asarray(np.exp(-1j * np.arange((self.angles + 1) // 2) * angle))

    def work(
        self, angles: tuple[float, float], scales: tuple[float, float], change: FloatArray, slip: FloatArray
    ) -> float:
        """Work of the loads [N mm] by what friction changes, over a step: their mean times that change.

        Args:
            angles: of the loads before and after [rad].
            scales: what part of the loads acts.
            change: of the tractions (K, 3 m) [MPa].
            slip: change of the slip (K, 3 m) [mm].
        """
        before, after = (scale * self._phase(angle) for scale, angle in zip(scales, angles, strict=True))
        moved, slipped = self.amplitudes(change), self.amplitudes(slip) / self.turn
        weight, total = np.tile(self.fit.weight, 3), 0.0
        for n, response in enumerate(self._responses):
            mean, more = 0.5 * (before[n] + after[n]), after[n] - before[n]
            share = np.vdot(mean * self._jumps[n], weight * moved[n])
            motion = response.rigid(slipped[n] - more * self._jumps[n] / self.turn, more * self._balances[n])
            share += np.vdot(mean * self._balances[n], motion)
            total += (1.0 if n == 0 else 2.0) * share.real
        return float(total)

    def gathered(self, rows: tuple[IntArray, IntArray], columns: tuple[IntArray, IntArray]) -> FloatArray:
        """The influence of columns on rows, both (angles in ascending order, places among 3 m)."""
        out = np.empty((len(rows[0]), len(columns[0])))
        ends = [np.searchsorted(angle, np.arange(self.angles + 1)) for angle, _ in (rows, columns)]
        there = [np.flatnonzero(np.diff(end)).tolist() for end in ends]
        for i, j in product(*there):
            across, along = (slice(end[k], end[k + 1]) for end, k in zip(ends, (i, j), strict=True))
            block = self.between_angles[(i - j) % self.angles]
            out[across, along] = block[rows[1][across, None], columns[1][along]]
        return out
