"""The checks on what a provider declares and answers: nothing it says reaches the solver unexamined."""

from __future__ import annotations

import numpy as np

from macrofit.errors import ProviderError
from macrofit.friction.contract import LIMIT, QUANTITIES, FloatArray, TilePairs


def declared_dependence(provider: object, name: str) -> frozenset[str]:
    """`provider.depends_on`, once the provider is seen to have the two members of the contract.

    Raises:
        ProviderError: no method `coefficients`, or `depends_on` is not a frozenset of known quantities.
    """
    broken = f"friction provider {name!r} breaks the contract"
    if not callable(getattr(provider, "coefficients", None)):
        raise ProviderError(f"{broken}: it has no method coefficients(pairs)")
    declared = getattr(provider, "depends_on", None)
    if not isinstance(declared, frozenset) or not declared <= QUANTITIES:
        choices = ", ".join(sorted(QUANTITIES))
        raise ProviderError(f"{broken}: depends_on is {declared!r}, not a frozenset with members of {{{choices}}}")
    return declared


def checked_answer(answer: object, pairs: TilePairs, name: str) -> FloatArray:
    """A float64 copy of what a provider answered for `pairs`, shape (n,), with 0 <= mu < 2 everywhere [-].

    Raises:
        ProviderError: not an array of real numbers, wrong shape, not finite, out of bounds; the message has
            the provider's name, the first offending pair and its value.
    """
    who = f"friction provider {name!r} answered"
    try:
        given = np.asarray(answer)
    except Exception as error:
        raise ProviderError(f"{who} with {type(answer).__name__}, which is no array: {error}") from error
    if given.dtype.kind not in "fiu":
        raise ProviderError(f"{who} with {type(answer).__name__} of {given.dtype}, not with real numbers")
    if given.shape != pairs.seat.shape:
        raise ProviderError(f"{who} with shape {given.shape} to {pairs.seat.size} tile pairs")
    values = np.array(given, dtype=np.float64)
    wrong = ~((values >= 0.0) & (values < LIMIT))  # written so that NaN is wrong
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ProviderError(
            f"{who} {values[i]} for the pair of seat tile {pairs.seat[i]} and bore tile {pairs.bore[i]} "
            f"(pressure {pairs.pressure[i]:g} MPa, slid {pairs.sliding[i]:g} mm); "
            f"a coefficient has 0 <= mu < {LIMIT:g}"
        )
    return values
