"""The coefficient of friction of each seat facet, asked of a provider as seldom as possible."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from macrofit.errors import ProviderError
from macrofit.friction.answer import checked_answer, declared_dependence
from macrofit.friction.contract import FloatArray, FrictionProvider, IntArray, TilePairs
from macrofit.friction.tiles import TileOverlaps

Ask: TypeAlias = Callable[[FrictionProvider, TilePairs], FloatArray]
"""How a batch is put to a provider; the solver may share it over MPI ranks."""


class FieldState(NamedTuple):
    """The coefficients known so far, for a checkpoint: three arrays of one shape (m,)."""

    seat: IntArray
    bore: IntArray
    coefficient: FloatArray


def ask_directly(provider: FrictionProvider, pairs: TilePairs) -> FloatArray:
    """The whole batch, in one call."""
    return provider.coefficients(pairs)


class FrictionField:
    """The coefficients of friction of the seat's facets for one run.

    Facet i faces several pairs of tiles p with overlaps w_ip; its coefficient is

        mu_i = mu_0 + sum_p w_ip (mu_p - mu_0) / sum_p w_ip,        mu_0: that of the facet's first overlap,

    the overlap-weighted mean written so that equal values give exactly that value. A facet without overlap
    has 0.

    A provider that depends on nothing is asked once, for the pair (0, 0), and every facet gets its answer,
    overlap or not. One that depends on tiles alone is asked for new pairs only. Any other is asked for all
    pairs present.

    Args:
        provider: where the coefficients come from.
        name: what messages call it; its class name if not given.
        ask: how to put a batch to the provider. Where it is collective, so is `facet_friction`: the same
            overlaps on all ranks make them ask for the same pairs in the same order.

    Raises:
        ProviderError: the provider lacks a member of the contract.
    """

    calls: int
    """Batches put to the provider."""
    pairs_asked: int
    """Pairs in those batches."""

    def __init__(self, provider: FrictionProvider, name: str | None = None, ask: Ask = ask_directly) -> None:
        self.provider = provider
        self.name = type(provider).__name__ if name is None else name
        self.calls = 0
        self.pairs_asked = 0
        self._ask = ask
        self._depends_on = declared_dependence(provider, self.name)
        self._keys: IntArray = np.empty(0, dtype=np.int64)  # sorted
        self._known: FloatArray = np.empty(0)

    def facet_friction(self, overlaps: TileOverlaps, pressure: FloatArray, sliding: FloatArray) -> FloatArray:
        """The coefficient of friction of each facet for the coming increment [-], shape (n_facets,).

        Args:
            overlaps: the pairs of tiles each facet faces, in any order; those of no weight are left out.
            pressure: contact pressure of each facet at the last accepted increment [MPa], shape (n_facets,).
            sliding: distance each facet has already slid [mm], shape (n_facets,).

        Raises:
            ProviderError: the provider fails or answers badly; the message has its name, the pair, the value.
        """
        if not self._depends_on:
            return np.full(pressure.size, self._cached(np.zeros(1, dtype=np.int64))[0])
        present = overlaps.take(np.flatnonzero(overlaps.weight > 0.0))
        keys = _key(present.seat, present.bore)
        if self._depends_on <= {"tiles"}:
            friction = self._cached(keys)
        else:
            friction = self._present(keys, present, pressure, sliding)
        return _facet_mean(present.facet, present.weight, friction, pressure.size)

    def state(self) -> FieldState:
        """The coefficients known so far; a field restored from them does not ask for these pairs again."""
        return FieldState(*_pair(self._keys), self._known.copy())

    def restore(self, state: FieldState) -> None:
        """Take over the coefficients of `state` in place of what this field knew.

        Raises:
            ProviderError: the arrays differ in length or hold no coefficients of friction.
        """
        seat, bore = np.asarray(state.seat, dtype=np.int64), np.asarray(state.bore, dtype=np.int64)
        if seat.ndim != 1 or seat.shape != bore.shape:
            raise ProviderError(f"saved tile pairs have {seat.shape} seat and {bore.shape} bore tiles")
        unused = np.zeros(seat.size)
        pairs = TilePairs(seat, bore, unused, unused)
        saved = checked_answer(state.coefficient, pairs, f"{self.name} (saved)")
        self._keys, first = np.unique(_key(seat, bore), return_index=True)
        self._known = saved[first]

    def _cached(self, keys: IntArray) -> FloatArray:
        """The coefficient of each key, asking the provider for those not seen yet."""
        new = np.setdiff1d(keys, self._keys) if not self._knows(keys) else keys[:0]
        if new.size:
            unused = np.zeros(new.size)
            answer = self._asked(TilePairs(*_pair(new), unused, unused))
            merged = np.concatenate([self._keys, new])
            order = np.argsort(merged, kind="stable")
            self._keys, self._known = merged[order], np.concatenate([self._known, answer])[order]
        return self._known[np.searchsorted(self._keys, keys)]

    def _knows(self, keys: IntArray) -> bool:
        if not self._keys.size:
            return not keys.size
        place = np.minimum(np.searchsorted(self._keys, keys), self._keys.size - 1)
        return bool(np.all(self._keys[place] == keys))

    def _present(self, keys: IntArray, present: TileOverlaps, pressure: FloatArray, sliding: FloatArray) -> FloatArray:
        """The coefficient of each overlap, from pairs asked afresh with their mean pressure and sliding."""
        pairs, which = np.unique(keys, return_inverse=True)
        if not pairs.size:
            return np.empty(0)
        total = np.bincount(which, present.weight)
        mean_pressure = np.bincount(which, present.weight * pressure[present.facet]) / total
        mean_sliding = np.bincount(which, present.weight * sliding[present.facet]) / total
        friction: FloatArray = self._asked(TilePairs(*_pair(pairs), mean_pressure, mean_sliding))[which]
        return friction

    def _asked(self, pairs: TilePairs) -> FloatArray:
        """The provider's checked answer to one batch."""
        self.calls += 1
        self.pairs_asked += pairs.seat.size
        private = pairs.take(np.arange(pairs.seat.size))  # a provider that writes into it harms nobody
        try:
            answer = self._ask(self.provider, private)
        except Exception as error:
            if isinstance(error, ProviderError) and repr(self.name) in str(error):
                raise  # an `ask` shared over ranks has already told it all
            first = f"seat tile {pairs.seat[0]} and bore tile {pairs.bore[0]}"
            raise ProviderError(
                f"friction provider {self.name!r} failed on {pairs.seat.size} tile pairs, "
                f"the first of {first}, with {type(error).__name__}: {error}"
            ) from error
        return checked_answer(answer, pairs, self.name)


def _key(seat: IntArray, bore: IntArray) -> IntArray:
    """One sortable number for each pair of tiles; both tile numbers are below 2**31."""
    return (seat << 32) | bore


def _pair(key: IntArray) -> tuple[IntArray, IntArray]:
    return key >> 32, key & 0xFFFFFFFF


def _facet_mean(facet: IntArray, weight: FloatArray, friction: FloatArray, facets: int) -> FloatArray:
    """The overlap-weighted mean of `friction` over each facet, shape (facets,); 0 without overlap."""
    mean = np.zeros(facets)
    mean[facet[::-1]] = friction[::-1]  # the last one written is the facet's first overlap
    excess = np.bincount(facet, weight * (friction - mean[facet]), minlength=facets)
    total = np.bincount(facet, weight, minlength=facets)
    covered = total > 0.0
    mean[covered] += excess[covered] / total[covered]
    return np.maximum(mean, 0.0)  # rounding can pass 0 by an ulp
