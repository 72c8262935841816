"""The checks on what a provider declares and answers: nothing it says reaches the solver unexamined."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from macrofit.base.foreign import foreign_code
from macrofit.errors import ProviderError
from macrofit.friction.contract import (
    LIMIT,
    QUANTITIES,
    FloatArray,
    FrictionProvider,
    KnowsItsRange,
    StatesUncertainty,
    TilePairs,
)

TAKEN = frozenset({"calls"})
"""Counters of a provider that would stand in a summary under the name of one of the solver's, provider_calls."""


class PairFriction(NamedTuple):
    """The friction of n pairs of tiles: two arrays of shape (n,)."""

    coefficient: FloatArray
    """Coefficient of friction mu of each pair [-]."""
    uncertainty: FloatArray
    """Its standard deviation [-]; NaN where the provider states none."""


def declared_dependence(provider: object, name: str) -> frozenset[str]:
    """`provider.depends_on`, once the provider is seen to have the members of the contract.

    Raises:
        ProviderError: no method `coefficients`, an `uncertainty` that is no method, `depends_on` is not a
            frozenset of known quantities, or `counters` that are none, see `declared_counters`.
    """
    broken = f"friction provider {name!r} breaks the contract"
    if not callable(getattr(provider, "coefficients", None)):
        raise ProviderError(f"{broken}: it has no method coefficients(pairs)")
    stated = getattr(provider, "uncertainty", None)
    if stated is not None and not callable(stated):
        raise ProviderError(f"{broken}: uncertainty is {stated!r}, not a method uncertainty(pairs); rename it")
    declared = getattr(provider, "depends_on", None)
    if not isinstance(declared, frozenset) or not declared <= QUANTITIES:
        choices = ", ".join(sorted(QUANTITIES))
        raise ProviderError(f"{broken}: depends_on is {declared!r}, not a frozenset with members of {{{choices}}}")
    declared_counters(provider, name)
    return declared


def declared_counters(provider: object, name: str) -> dict[str, int]:
    """`provider.counters`, a dict of names and whole numbers that the summary of a run shows; empty without any.

    Raises:
        ProviderError: they cannot be read, are no such dict, or one has a name that the solver uses.
    """
    broken = f"friction provider {name!r} breaks the contract: counters"
    try:
        stated = getattr(provider, "counters", {})
        if not isinstance(stated, Mapping):
            raise TypeError(f"is {stated!r:.60}, not a dict of names and whole numbers")
        counted = {key: operator.index(count) for key, count in stated.items()}
    except Exception as error:
        raise ProviderError(f"{broken}: {type(error).__name__}: {error}; give names and whole numbers") from error
    wrong = [key for key in counted if not isinstance(key, str) or not key.isidentifier() or key in TAKEN]
    if wrong:
        raise ProviderError(f"{broken}: the name {wrong[0]!r} is no word or the solver's own; choose another")
    return counted


def answered(provider: FrictionProvider, pairs: TilePairs, name: str) -> PairFriction:
    """What `provider` says about `pairs`, each question put to a copy of them, and checked.

    Raises:
        ProviderError: a bad answer, see `checked_answer` and `checked_uncertainty`.
        Exception: whatever the provider raises; an exit (SystemExit, KeyboardInterrupt) as `ForeignExit`.
    """
    with foreign_code():
        coefficient = checked_answer(provider.coefficients(pairs.copy()), pairs, name)
        if not isinstance(provider, StatesUncertainty):
            return PairFriction(coefficient, np.full(pairs.seat.size, np.nan))
        return PairFriction(coefficient, checked_uncertainty(provider.uncertainty(pairs.copy()), pairs, name))


def origin_of(provider: object, name: str) -> dict[str, Any]:
    """`provider.origin`, a dict that the record of a run keeps; empty where it has none.

    One that fails at it, or gives what JSON does not know, is warned of: that is no reason to lose a run.
    """
    try:
        with foreign_code():
            stated = msgspec.to_builtins(dict(getattr(provider, "origin", {})))
            msgspec.json.encode(stated)
        return dict(stated)
    except Exception as error:
        warnings.warn(
            f"friction provider {name!r}: its `origin` is left out of the summary, {type(error).__name__}: {error}",
            stacklevel=2,
        )
        return {}


def reasons_of(provider: object, pairs: TilePairs, name: str) -> dict[str, FloatArray]:
    """What `provider` says of pairs outside of what it knows, see `KnowsItsRange`; none where it does not say.

    Raises:
        ProviderError: it is no dict of texts and numbers of 0 or more, one for each pair.
        Exception: whatever the provider raises; an exit as `ForeignExit`.
    """
    if not isinstance(provider, KnowsItsRange):
        return {}
    with foreign_code():
        told = provider.outside(pairs.copy())
    found = {" ".join(f"{reason}".split()): np.asarray(off, dtype=np.float64) for reason, off in dict(told).items()}
    for reason, off in found.items():
        if not reason or off.shape != pairs.seat.shape or not (np.isfinite(off).all() and (off >= 0.0).all()):
            raise ProviderError(
                f"friction provider {name!r} breaks the contract: outside(pairs) gives {off.dtype} of shape "
                f"{off.shape} for {reason[:60]!r}; a number of 0 or more for each pair is wanted, and a reason in words"
            )
    return found


def checked_answer(answer: object, pairs: TilePairs, name: str) -> FloatArray:
    """A float64 copy of what a provider answered for `pairs`, shape (n,), with 0 <= mu < 2 everywhere [-].

    Raises:
        ProviderError: not an array of real numbers, wrong shape, not finite, out of bounds; the message has
            the provider's name, the first offending pair and its value.
    """
    who = f"friction provider {name!r} answered"
    values = _real_numbers(answer, pairs, who)
    if values.size and not (values.min() >= 0.0 and values.max() < LIMIT):  # written so that NaN is wrong
        right = (values >= 0.0) & (values < LIMIT)
        _refuse(~right, values, pairs, who, f"a coefficient has 0 <= mu < {LIMIT:g}")
    return values


def checked_uncertainty(answer: object, pairs: TilePairs, name: str) -> FloatArray:
    """The same for standard deviations of the coefficients: finite and >= 0, or NaN where none is stated [-].

    Raises:
        ProviderError: as `checked_answer`.
    """
    who = f"friction provider {name!r} answered, asked for its uncertainty,"
    values = _real_numbers(answer, pairs, who)
    if values.size and not (values.min() >= 0.0 and values.max() < np.inf):  # so it is where NaN is among them
        wrong = (values < 0.0) | np.isinf(values)
        _refuse(wrong, values, pairs, who, "a standard deviation is finite and >= 0, or NaN where none is stated")
    return values


def _real_numbers(answer: object, pairs: TilePairs, who: str) -> FloatArray:
    try:
        given = np.asarray(answer)
    except Exception as error:
        raise ProviderError(f"{who} with {type(answer).__name__}, which is no array: {error}") from error
    if given.dtype.kind not in "fiu":
        raise ProviderError(f"{who} with {type(answer).__name__} of {given.dtype}, not with real numbers")
    if given.shape != pairs.seat.shape:
        raise ProviderError(f"{who} with shape {given.shape} to {pairs.seat.size} tile pairs")
    return np.array(given, dtype=np.float64)


def _refuse(wrong: npt.NDArray[np.bool_], values: FloatArray, pairs: TilePairs, who: str, rule: str) -> None:
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ProviderError(
            f"{who} {values[i]} for the pair of seat tile {pairs.seat[i]} and bore tile {pairs.bore[i]} "
            f"(pressure {pairs.pressure[i]:g} MPa, slid {pairs.sliding[i]:g} mm); {rule}"
        )
