"""What the provider `surrogate` answers: the network asked about pairs of tiles, and what it does not know."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from macrofit.base.arrays import HeightArray
from macrofit.friction import FloatArray, FrictionProvider, IntArray, ProviderError, TilePairs, answered
from meso.surfaces.surface import Body

from ..errors import SurrogateError
from ..levels import HALVED, distinct_pairs

if TYPE_CHECKING:
    from ..tiles import Tiles

UNKNOWN = 0.2
"""Share by which the coefficient of a pair is taken to be wrong that is unlike all that were learned from [-]."""
LARGEST_FRICTION = math.nextafter(2.0, 0.0)
"""Largest coefficient that the contract accepts [-]."""
UNLIKE = (
    "unknown faces: are unlike all that the network has learned from, by their heights and their load together; take "
    "lower or smoother friction.options.surface, or friction.options.fallback = 'dem' (slow)"
)
UNSEEN = (
    "unknown inputs: are asked for what the network has not seen ({}); take inputs within, or fallback = 'dem' (slow)"
)
BEYOND_PRESSURE = (
    "unknown pressures: are pressed beyond the {:.3g} to {:.3g} MPa that the network has learned from and are answered "
    "for the nearer end; take friction.options.fallback = 'dem' (slow), which asks the plates for their own pressure"
)
"""Why the network should not have been asked, as `KnowsItsRange` wants it."""


class MicroFriction(Protocol):
    """What of the options the answers need."""

    @property
    def micro_friction(self) -> float:
        """Coefficient of sphere on sphere [-]."""
        ...


class _Answer(NamedTuple):
    """Coefficients of m distinct pairs: arrays of shape (m,)."""

    pairs: tuple[IntArray, IntArray, IntArray]
    """Seat tile, bore tile and level of the pressure of each, sorted."""
    mean: FloatArray
    """mu [-], 0 <= mu < 2."""
    spread: FloatArray
    """Standard deviation of mu [-]."""


class TileNetwork:
    """The predicted meso coefficient of each pair of tiles.

    What comes out below 0 counts as 0. A batch is predicted in one call, each of its distinct pairs once; the answers
    to the last batch are kept.

    Args:
        tiles: tiles of both bodies, with the network.
        options: micro coefficient; seed and surfaces are those of `tiles`.
        unseen: inputs that the network has not seen, in words.
        fallback: gives the provider to ask about pairs that are predicted to lose contact, are like none learned from,
            or are pressed beyond what was, for a pressure [MPa], or None for its own; None: the network answers.
        youngs_modulus: of the axle, that the pressures press on [MPa]; left out, that of the network's plates.
    """

    depends_on: frozenset[str]
    """With the pressure, where the network knows many; a pair is asked anew where it leaves a level."""

    clipped: int
    """Pairs predicted out of the bounds of the contract, and answered with the nearest bound."""
    out_of_range: int
    """Pairs predicted for inputs the network has not seen, by keys or by what it sees of the faces."""
    clamped: int
    """Pairs pressed beyond what the network has learned from, and asked for at the nearer end of that."""
    losing_contact: int
    """Pairs that are predicted to lose contact somewhere along the slide."""
    asked_anew: int
    """Pairs whose pressure has left the level at which they were asked before."""

    def __init__(
        self,
        tiles: Tiles,
        options: MicroFriction,
        *,
        unseen: Sequence[str] = (),
        fallback: Callable[[float | None], FrictionProvider] | None = None,
        youngs_modulus: float | None = None,
    ) -> None:
        self.tiles, self.options, self.unseen = tiles, options, tuple(unseen)
        several = tiles.pressures is not None and tiles.pressures.count > 1
        self.depends_on = frozenset({"tiles", "pressure"} if several else {"tiles"})
        about = tiles.predictor.provenance
        self._on_steel = 1.0 if youngs_modulus is None else about.at_modulus(1.0, youngs_modulus)
        self.clipped = self.out_of_range = self.clamped = self.losing_contact = self.asked_anew = 0
        self._level = np.full(tiles.counts, -1, dtype=np.int16) if several else None  # of each pair, when last asked
        self._fallback = fallback
        self._last: _Answer | None = None
        self._asked: tuple[FloatArray, IntArray] | None = None  # pairs of the last batch, and their numbers in `_last`

    @property
    def trusted(self) -> bool:
        """Whether the network has seen such inputs."""
        return not self.unseen

    @property
    def counters(self) -> dict[str, int]:
        """Counts for the report of a run."""
        counts = {"clipped": self.clipped, "out_of_range": self.out_of_range, "unheld": self.losing_contact}
        own = {"clamped": self.clamped, "asked_anew": self.asked_anew}
        return counts | (own if self._level is not None else {})

    @property
    def origin(self) -> dict[str, Any]:
        """What measured faces are made of, for the record of a run."""
        from meso.surfaces.origin import measured_origin

        counts: dict[Body, int] = {"axle": self.tiles.counts[0], "wheel": self.tiles.counts[1]}
        width = self.tiles.predictor.provenance.plates.edge
        return measured_origin(self.tiles.surface, self.tiles.seed, counts, width)

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu of each pair [-], shape (n,).

        Raises:
            ProviderError: a tile without a surface, or surfaces that the network refuses.
        """
        answer, which = self._answered(pairs)
        return answer.mean[which]

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        """Standard deviation of mu of each pair, over packings and from the network together [-], shape (n,).

        Where another provider answered it is what that one states, NaN if nothing.

        Raises:
            ProviderError: as `coefficients`.
        """
        answer, which = self._answered(pairs)
        return answer.spread[which]

    def announced(self, pairs: TilePairs) -> None:
        """Have the pairs prepared with those that others on the same tiles will be asked for."""
        self.tiles.expect(pairs.seat, pairs.bore, self._known(self._levels(pairs)))

    def heights(self, body: Body, tile: int) -> HeightArray:
        """The rough face of a tile as the network takes it [mm], read-only.

        Shape (n, n) for the wheel, (2 n - 1, n) for the axle, with n the points of the network's training.

        Raises:
            ProviderError: there is no such tile.
        """
        try:
            return self.tiles.heights(body, tile)
        except SurrogateError as error:
            raise ProviderError(f"friction provider 'surrogate': {error}") from error

    def outside(self, pairs: TilePairs) -> dict[str, FloatArray]:
        """By how much coefficients may be wrong for what the network has not seen, by reason; see `KnowsItsRange`.

        Beyond its pressures that is `HALVED` for each factor of two, else `UNKNOWN`; nothing where another provider
        answers for such pairs.

        Raises:
            ProviderError: as `coefficients`.
        """
        if self._fallback is not None:
            return {}
        count, level = len(pairs.seat), self._known(self._levels(pairs))
        try:
            seen = self.tiles.predict(pairs.seat, pairs.bore, self.options.micro_friction, level).seen
        except SurrogateError as error:
            raise ProviderError(f"friction provider 'surrogate': {error}") from error
        found = {UNLIKE: np.where(seen, 0.0, UNKNOWN)}
        if self.unseen:
            found[UNSEEN.format("; ".join(self.unseen))] = np.full(count, UNKNOWN)
        levels = self.tiles.pressures
        if self._level is not None and levels is not None:
            ends = [end / self._on_steel for end in (levels.low, levels.high)]
            found[BEYOND_PRESSURE.format(*ends)] = HALVED * levels.octaves(self._on_steel * pairs.pressure)
        return found

    def _levels(self, pairs: TilePairs) -> IntArray:
        """The level of each pair's pressure; beyond those that there are where the pressure is."""
        pressure, levels = self._on_steel * pairs.pressure, self.tiles.pressures
        return self.tiles.levels(pressure) if self._level is None or levels is None else levels.beyond(pressure)

    def _known(self, level: IntArray) -> IntArray:
        """The nearest of the levels that the network is asked at."""
        count = 1 if self.tiles.pressures is None else self.tiles.pressures.count
        return np.clip(level, 0, count - 1)

    def _answered(self, pairs: TilePairs) -> tuple[_Answer, IntArray]:
        """The distinct pairs with their answers, and the number of each pair among them, (n,)."""
        asked = np.stack([pairs.seat, pairs.bore, pairs.pressure])
        if self._asked is None or not np.array_equal(self._asked[0], asked):
            distinct, which = distinct_pairs(pairs.seat, pairs.bore, self._levels(pairs))
            if self._last is None or not all(map(np.array_equal, self._last.pairs, distinct)):
                self._last = self._predicted(*distinct)
            self._asked = asked, which
        assert self._last is not None
        return self._last, self._asked[1]

    def _predicted(self, seat: IntArray, bore: IntArray, level: IntArray) -> _Answer:
        """The answers to distinct pairs."""
        if not seat.size:
            return _Answer((seat, bore, level), np.empty(0), np.empty(0))
        known = self._known(level)
        try:
            prediction = self.tiles.predict(seat, bore, self.options.micro_friction, known)
        except SurrogateError as error:
            raise ProviderError(f"friction provider 'surrogate': {error}") from error
        answer = _Answer((seat, bore, level), np.array(prediction.mean), np.array(prediction.spread))
        clamped = known != level
        self._replace(answer, np.flatnonzero(~(prediction.in_contact & prediction.seen) | clamped))
        self._bound(answer)
        if self._level is not None:
            before = self._level[seat, bore]
            self.asked_anew += int(((before >= 0) & (before != known)).sum())
            self._level[seat, bore] = known
        self.clamped += int(clamped.sum())
        self.losing_contact += int((~prediction.in_contact).sum())
        self.out_of_range += seat.size if self.unseen else int((~prediction.seen).sum())
        return answer

    def _replace(self, answer: _Answer, doubted: IntArray) -> None:
        """Have the pairs numbered `doubted` answered by the other provider at their pressures, if there is one."""
        if not doubted.size or self._fallback is None:
            return
        seat, bore, level = (column[doubted] for column in answer.pairs)
        for one in np.unique(level).tolist():
            some = level == one
            unused, which = np.zeros(int(some.sum())), doubted[some]
            other = self._fallback(self._pressure(one))
            told = answered(other, TilePairs(seat[some], bore[some], unused, unused), "dem")
            answer.mean[which], answer.spread[which] = told

    def _pressure(self, level: int) -> float | None:
        """The pressure of a level on the axle's material [MPa]; None where all pairs have that of the plates."""
        if self._level is None or self.tiles.pressures is None:
            return None
        return float(self.tiles.pressures.pressure(np.array(level))) / self._on_steel

    def _bound(self, answer: _Answer) -> None:
        """Bring the coefficients within the contract."""
        wrong = np.flatnonzero((answer.mean < 0.0) | (answer.mean > LARGEST_FRICTION))
        if wrong.size and not self.clipped:
            seat, bore, mean, spread = (column[wrong[0]] for column in (*answer.pairs[:2], answer.mean, answer.spread))
            warnings.warn(
                f"friction provider 'surrogate': the coefficient of seat tile {seat} and bore tile {bore} comes out as "
                f"{mean:.4f} +- {spread:.4f} and is taken as {min(2, max(0, round(mean)))}, and so will others be",
                stacklevel=2,
            )
        self.clipped += wrong.size
        answer.mean[wrong] = np.clip(answer.mean[wrong], 0.0, LARGEST_FRICTION)
