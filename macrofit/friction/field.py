"""The coefficient of friction of each seat facet, asked of a provider as seldom as possible."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from macrofit.base.arrays import BoolArray
from macrofit.base.foreign import foreign_code
from macrofit.errors import ProviderError
from macrofit.friction.answer import (
    PairFriction,
    answered,
    checked_answer,
    checked_uncertainty,
    declared_counters,
    declared_dependence,
    origin_of,
)
from macrofit.friction.contract import FloatArray, FrictionProvider, HearsAhead, IntArray, StatesUncertainty, TilePairs
from macrofit.friction.tiles import FacingPairs, TileOverlaps, pair_key, tiles_of

Ask: TypeAlias = Callable[[FrictionProvider, TilePairs], PairFriction]
"""How a batch is put to a provider; the solver shares it over MPI ranks."""
Part: TypeAlias = Callable[[TilePairs], TilePairs]
"""Which pairs of a batch are asked on this rank."""


_Told: TypeAlias = tuple[IntArray, FloatArray]
"""Keys of pairs (m,), and their coefficients and uncertainties (2, m)."""

JOURNALED = "friction."
"""What the names of the field's arrays start with in a journal."""

FINGERPRINT, NONE = f"{JOURNALED}fingerprint", np.empty(0, dtype=np.uint8)
"""Name of the fingerprint in a journal, and the value of none."""


class FieldState(NamedTuple):
    """What is known of m pairs of tiles, for a checkpoint and for files: four arrays of shape (m,)."""

    seat: IntArray
    bore: IntArray
    coefficient: FloatArray
    """mu [-]; of a provider that depends on pressure or sliding, its latest answer."""
    uncertainty: FloatArray
    """Its standard deviation [-]; NaN where the provider states none."""


class Question(NamedTuple):
    """What a field asks its provider before an increment."""

    facing: FacingPairs
    """The pairs of tiles that the facets face."""
    facets: int
    """Number of facets of the seat."""
    pairs: TilePairs | None
    """Each pair once, as it is asked; None where pairs that are known already need not be asked again."""


class FrictionField:
    """The coefficients of friction of the seat's facets for one run.

    Facet i faces several pairs of tiles p with overlaps w_ip; its coefficient is

        mu_i = mu_0 + sum_p w_ip (mu_p - mu_0) / sum_p w_ip,        mu_0: that of the facet's first overlap,

    the overlap-weighted mean written so that equal values give exactly that value. A facet without overlap
    has 0.

    A provider that depends on nothing is asked once, for the pair (0, 0), and every facet gets its answer,
    overlap or not. One that depends on tiles alone is asked for new pairs only. Any other is asked for all
    pairs present. Where the provider states its uncertainty, it is asked for that with the coefficients.

    Args:
        provider: where the coefficients come from.
        name: what messages call it; its class name if not given.
        ask: how to put a batch to the provider; by default as it is. Where it is collective, so is `facet_friction`:
            the same overlaps on all ranks make them ask for the same pairs in the same order.
        part: which pairs of a batch ``ask`` puts to this rank's provider; all by default.
        fingerprint: hexadecimal, of a provider that no scene tells from others; a journal keeps it with the answers.

    Raises:
        ProviderError: the provider lacks a member of the contract.
    """

    calls: int
    """Batches put to the provider."""
    pairs_asked: int
    """Pairs in those batches."""

    def __init__(
        self,
        provider: FrictionProvider,
        name: str | None = None,
        ask: Ask | None = None,
        *,
        part: Part | None = None,
        fingerprint: str = "",
    ) -> None:
        self.provider = provider
        self.name = type(provider).__name__ if name is None else name
        self.fingerprint = np.frombuffer(bytes.fromhex(fingerprint), dtype=np.uint8)
        self.calls = 0
        self.pairs_asked = 0
        self._ask = ask or (lambda provider, pairs: answered(provider, pairs, self.name))
        self.part = part or (lambda pairs: pairs)
        self._depends_on = declared_dependence(provider, self.name)
        self._keys: IntArray = np.empty(0, dtype=np.int64)  # sorted
        self._known: FloatArray = np.empty((2, 0))  # coefficient and uncertainty of each key
        self._deaf = False  # its `announced` has failed
        self._news: list[_Told] = []  # answered since `news`
        self._pending: list[_Told] = []  # answered, and not among those known yet
        self._facing: FacingPairs | None = None  # of the last question, and where pairs are asked each time ...
        self._spread: FloatArray | None = None  # ... the uncertainty of each pair

    def facet_friction(self, overlaps: TileOverlaps, pressure: FloatArray, sliding: FloatArray) -> FloatArray:
        """The coefficient of friction of each facet for the coming increment [-], shape (n_facets,).

        Args:
            overlaps: the pairs of tiles each facet faces, in any order; those of no weight are left out.
            pressure: contact pressure of each facet at the last accepted increment [MPa], shape (n_facets,).
            sliding: distance each facet has already slid [mm], shape (n_facets,).

        Raises:
            ProviderError: the provider fails or answers badly; the message has its name, the pair, the value.
        """
        return self.answer(self.question(FacingPairs.of(overlaps), pressure, sliding))

    def question(self, facing: FacingPairs, pressure: FloatArray, sliding: FloatArray) -> Question:
        """What `facet_friction` asks the provider; see `announce` and `answer`.

        Args:
            facing: the pairs of tiles that the facets face.
            pressure: as in `facet_friction`.
            sliding: as in `facet_friction`.
        """
        if self._depends_on <= {"tiles"}:
            return Question(facing, pressure.size, None)
        pairs, _ = facing.distinct
        return Question(
            facing, pressure.size, TilePairs(*tiles_of(pairs), facing.pair_mean(pressure), facing.pair_mean(sliding))
        )

    def announce(self, pairs: TilePairs) -> None:
        """Let the provider hear of pairs, if it wants to; one that fails at it is warned of, and hears no more."""
        if self._deaf or not isinstance(self.provider, HearsAhead):
            return
        try:
            with foreign_code():
                self.provider.announced(self.part(pairs).copy())
        except Exception as error:
            self._deaf = True
            warnings.warn(
                f"friction provider {self.name!r} failed at `announced`, with {type(error).__name__}: {error}; it is "
                f"asked all the same",
                stacklevel=2,
            )

    def answer(self, question: Question) -> FloatArray:
        """The coefficient of friction of each facet, as `facet_friction`.

        Raises:
            ProviderError: as `facet_friction`.
        """
        facing, pairs, facets = question.facing, question.pairs, question.facets
        self._facing, self._spread = facing, None
        if not self._depends_on:
            return np.full(facets, self._cached(np.zeros(1, dtype=np.int64))[0])
        if pairs is None:
            friction = self._cached(facing.keys)
            self._spread = None  # what is known already was not asked
        else:
            friction = self._asked(pairs)[facing.distinct[1]] if pairs.seat.size else np.empty(0)
        return _facet_mean(facing.overlaps.facet, facing.overlaps.weight, friction, facets)

    def deviation(self, pressure: FloatArray, slips: BoolArray) -> float:
        """Standard deviation of the friction of what slips, over the normal force, by what `answer` gave last [-].

            sigma^2 = sum_p (S_p s_p)^2 / (sum_i P_i)^2,        S_p = sum over i that slip of w_ip P_i

        with s_p the standard deviation of pair p that the provider states, w_ip the length over which facet i faces it
        and P_i the facet's pressure. What sticks bears what the bodies ask for, whatever its coefficient. Pairs are
        taken as independent. NaN where none is stated; 0 without pressure.

        Args:
            pressure: of each facet, in any unit; times the radius where that varies, (facets,).
            slips: whether each facet slips, (facets,).
        """
        facing = self._facing
        if facing is None or not self._depends_on or not isinstance(self.provider, StatesUncertainty):
            return math.nan
        pairs, which = facing.distinct
        spread = self._spread
        if spread is None:
            self._merge()
            spread = self._known[1, np.searchsorted(self._keys, pairs)]
        if not np.isfinite(spread).any():
            return math.nan
        facet, weight = facing.overlaps.facet, facing.overlaps.weight
        whole = float(weight @ pressure[facet])
        if not whole > 0.0:
            return 0.0
        carried = np.bincount(which, weight * np.where(slips, pressure, 0.0)[facet], minlength=pairs.size)
        shares = carried[carried > 0.0] * spread[carried > 0.0]
        return math.sqrt(float(shares @ shares)) / whole

    @property
    def per_pair(self) -> bool:
        """Whether pairs may differ: the provider depends on something."""
        return bool(self._depends_on)

    @property
    def lasting(self) -> bool:
        """Whether a pair keeps its coefficient for the whole run: the provider depends on tiles at most."""
        return self._depends_on <= {"tiles"}

    @property
    def counters(self) -> dict[str, int]:
        """What the provider itself counts on this rank, if it has `counters`: clipped answers, inputs out of range.

        They were checked when the field was made; ones that have gone bad since are warned of and left out, for
        they are no reason to lose a run.
        """
        try:
            counted = declared_counters(self.provider, self.name)
        except ProviderError as error:
            warnings.warn(f"{error}; they are left out of the summary", stacklevel=2)
            return {}
        return {f"provider_{name}": count for name, count in counted.items()}

    def origin(self) -> dict[str, Any]:
        """What the provider says that its coefficients come from, for the record of a run."""
        return origin_of(self.provider, self.name)

    def state(self) -> FieldState:
        """What is known of all pairs so far; a field restored from it does not ask for them again."""
        self._merge()
        return FieldState(*tiles_of(self._keys), *self._known.copy())

    def news(self) -> dict[str, FloatArray | IntArray]:
        """What was answered since this was last called, each pair once, as arrays that a journal adds to its own."""
        keys, values = _latest(self._news)
        self._news = []
        state = FieldState(*tiles_of(keys), *values)
        news: dict[str, Any] = {f"{JOURNALED}{column}": values for column, values in state._asdict().items()}
        return news | ({FINGERPRINT: self.fingerprint} if self.fingerprint.size else {})

    def recall(self, journal: Iterable[Mapping[str, FloatArray | IntArray]]) -> None:
        """Take over all `news` of an earlier run, in its order; entries of a journal without any are passed over.

        Raises:
            ProviderError: they are of another provider, or hold no coefficients of friction.
        """
        journal = list(journal)
        if any(not np.array_equal(entry.get(FINGERPRINT, NONE), self.fingerprint) for entry in journal):
            raise ProviderError(
                f"the journal is of a run with another friction provider than {self.name!r} with its digest and "
                f"options; resume with the friction it was started with, or start anew"
            )
        columns = [f"{JOURNALED}{column}" for column in FieldState._fields]
        told = [entry for entry in journal if all(column in entry for column in columns)]
        self.restore(*(FieldState(*(entry[column] for column in columns)) for entry in told))  # type: ignore[arg-type]

    def restore(self, *saved: FieldState) -> None:
        """Take over what is `saved` in place of what this field knew; of a pair saved twice, the later one.

        Raises:
            ProviderError: the arrays differ in length or hold no coefficients of friction.
        """
        self._keys, self._known, self._news, self._pending = self._keys[:0], self._known[:, :0], [], []
        for state in saved:
            seat, bore = np.asarray(state.seat, dtype=np.int64), np.asarray(state.bore, dtype=np.int64)
            if seat.ndim != 1 or seat.shape != bore.shape:
                raise ProviderError(f"saved tile pairs have {seat.shape} seat and {bore.shape} bore tiles")
            unused = np.zeros(seat.size)
            pairs, who = TilePairs(seat, bore, unused, unused), f"{self.name} (saved)"
            coefficient = checked_answer(state.coefficient, pairs, who)
            values = np.stack([coefficient, checked_uncertainty(state.uncertainty, pairs, who)])
            self._pending.append((pair_key(seat, bore), values))
        self._merge()

    def _cached(self, keys: IntArray) -> FloatArray:
        """The coefficient of each key, asking the provider for those not seen yet."""
        self._merge()
        new = np.setdiff1d(keys, self._keys) if not self._knows(keys) else keys[:0]
        if new.size:
            unused = np.zeros(new.size)
            self._asked(TilePairs(*tiles_of(new), unused, unused))
            self._merge()
        known: FloatArray = self._known[0, np.searchsorted(self._keys, keys)]
        return known

    def _merge(self) -> None:
        """Remember what was said of pairs lately, in place of what was known of them."""
        if self._pending:
            self._keys, self._known = _latest([(self._keys, self._known), *self._pending])
            self._pending = []

    def _knows(self, keys: IntArray) -> bool:
        if not self._keys.size:
            return not keys.size
        place = np.minimum(np.searchsorted(self._keys, keys), self._keys.size - 1)
        return bool(np.all(self._keys[place] == keys))

    def _asked(self, pairs: TilePairs) -> FloatArray:
        """The provider's checked answer to one batch of distinct pairs, which is remembered."""
        self.calls += 1
        self.pairs_asked += pairs.seat.size
        try:
            answer = self._ask(self.provider, pairs)
        except Exception as error:
            if isinstance(error, ProviderError) and repr(self.name) in str(error):
                raise  # an `ask` shared over ranks has already told it all
            first = f"seat tile {pairs.seat[0]} and bore tile {pairs.bore[0]}"
            raise ProviderError(
                f"friction provider {self.name!r} failed on {pairs.seat.size} tile pairs, "
                f"the first of {first}, with {type(error).__name__}: {error}"
            ) from error
        coefficient = checked_answer(answer.coefficient, pairs, self.name)
        values = np.stack([coefficient, checked_uncertainty(answer.uncertainty, pairs, self.name)])
        told = pair_key(pairs.seat, pairs.bore), values
        self._pending.append(told)
        self._news.append(told)
        self._spread = values[1]
        return coefficient


def announce(asked: Iterable[tuple[FrictionField, Question]]) -> None:
    """Let the providers of several runs hear what they will be asked, those that want to know (see `HearsAhead`)."""
    for field, question in asked:
        if question.pairs is not None:
            field.announce(question.pairs)


def _latest(told: list[_Told]) -> _Told:
    """Each pair once, in order, with what was said of it last."""
    if not told:
        return np.empty(0, dtype=np.int64), np.empty((2, 0))
    keys, values = (np.concatenate(column, axis=-1) for column in zip(*told, strict=True))
    if len(told) == 1 and np.all(keys[1:] > keys[:-1]):
        return keys, values
    keys, first = np.unique(keys[::-1], return_index=True)
    return keys, values[:, values.shape[1] - 1 - first]


def _facet_mean(facet: IntArray, weight: FloatArray, friction: FloatArray, facets: int) -> FloatArray:
    """The overlap-weighted mean of `friction` over each facet, shape (facets,); 0 without overlap."""
    mean = np.zeros(facets)
    mean[facet[::-1]] = friction[::-1]  # the last one written is the facet's first overlap
    excess = np.bincount(facet, weight * (friction - mean[facet]), minlength=facets)
    total = np.bincount(facet, weight, minlength=facets)
    covered = total > 0.0
    mean[covered] += excess[covered] / total[covered]
    return np.maximum(mean, 0.0)  # rounding can pass 0 by an ulp
