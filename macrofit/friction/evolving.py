"""The friction provider `evolving`: the roughness of any other provider flattens with the work done on it.

    [friction]
    provider = "evolving"

    [friction.options]
    base = "surrogate"
    options = { micro_friction = 0.07, seed = 1 }
    flat_coefficient = 0.07
    work = 4e4

`Evolving` has the options and the law, `FlatteningPairs` answers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import msgspec
import numpy as np

from macrofit.errors import ProviderError
from macrofit.friction.answer import (
    PairFriction,
    answered,
    declared_counters,
    declared_dependence,
    origin_of,
    reasons_of,
)
from macrofit.friction.contract import LIMIT, BuildContext, FloatArray, FrictionProvider, TilePairs
from macrofit.friction.registry import build_provider, load_options

WEAR = ("wear_coefficient", "hardness", "height")
"""Options that give the work between them."""


class Evolving(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Coefficients of friction of another provider whose roughness flattens as the tiles slide under pressure.

        mu(p, s) = mu_flat + (mu_pair - mu_flat) exp(-p s / w)

    with mu_pair the other provider's coefficient, p the pair's mean pressure at the last accepted increment and s the
    distance its seat tile has slid. Without a work w nothing evolves, and the other provider answers itself.

    Where w comes from: Archard's law of wear (Archard 1953, J. Appl. Phys. 24, 981) gives the worn depth h = K p s / H
    with K the wear coefficient [-] and H the hardness of the softer face [MPa]; peaks of height R [mm] are gone at
    p s = w = R H / K. Example: R = 0.02 mm, H = 2000 MPa (about 200 HV), K = 1e-3 (dry steel on steel) give
    w = 4e4 N/mm; 120 MPa over 180 mm are p s = 2.2e4 N/mm, which leave exp(-0.54) = 58 % of the roughness part;
    K = 1e-5 (lubricated) leaves 99.5 %.

    Left out: the history of the pressure (p s stands for the integral of p ds, which it is under constant pressure),
    the wear of the bore, which meets fresh seat, and debris.

    Raises:
        ProviderError: an option is out of bounds, contradicts another, or is refused by the other provider.
    """

    base: str
    """Name of the other provider, one that depends on tiles at most."""
    options: dict[str, Any] = {}
    """Options of the provider that is wrapped."""
    flat_coefficient: float
    """mu_flat, of the smoothed faces [-]."""
    work: float | None = None
    """w [N/mm]: pressure times sliding at which 63 % of the roughness part is gone; None or infinite: never."""
    wear_coefficient: float | None = None
    """K of Archard's law [-]; with hardness and height in place of work."""
    hardness: float | None = None
    """H of the softer face [MPa]: 9.81 times the Vickers number."""
    height: float | None = None
    """R of the peaks [mm]."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.flat_coefficient < LIMIT:
            raise ProviderError(
                f"flat_coefficient = {self.flat_coefficient} is out of bounds: take 0 <= flat_coefficient < {LIMIT:g}"
            )
        for key in ("work", *WEAR):
            value = getattr(self, key)
            if value is not None and not value > 0.0:
                raise ProviderError(f"{key} = {value} must be positive")
        given = [key for key in WEAR if getattr(self, key) is not None]
        if given and self.work is not None:
            raise ProviderError(f"work: leave out either it or {', '.join(given)}, which say the same")
        if given and len(given) < len(WEAR):
            missing = " and ".join(key for key in WEAR if key not in given)
            raise ProviderError(
                f"{missing}: needed beside {' and '.join(given)}, for work = height hardness / wear_coefficient"
            )
        try:
            load_options(self.base, self.options)
        except ProviderError as error:
            raise ProviderError(_inner(error)) from None

    @property
    def full_work(self) -> float:
        """w [N/mm], given or R H / K; infinite where nothing evolves."""
        if self.height is not None and self.hardness is not None and self.wear_coefficient is not None:
            return self.height * self.hardness / self.wear_coefficient
        return math.inf if self.work is None else self.work

    def build(self, context: BuildContext) -> FrictionProvider:
        """The provider; the other one itself where nothing evolves.

        Raises:
            ProviderError: the other one cannot be built, or depends on more than tiles.
        """
        try:
            base = build_provider(self.base, self.options, context)
        except ProviderError as error:
            raise ProviderError(_inner(error)) from error
        more = declared_dependence(base, self.base) - {"tiles"}
        if math.isinf(self.full_work):
            return base
        if more:
            one = more == {"pressure"} and hasattr(load_options(self.base, self.options), "pressure")
            remedy = "give it one, friction.options.options.pressure = 170.0 [MPa], or " if one else ""
            raise ProviderError(
                f"friction.options.base: {self.base!r} depends on {' and '.join(sorted(more))} itself; "
                f"{remedy}take one that depends on tiles at most"
            )
        return FlatteningPairs(base, self.base, self.flat_coefficient, self.full_work)


class FlatteningPairs:
    """mu(p, s) = mu_pair + (mu_pair - mu_flat) (exp(-p s / w) - 1), which is mu_pair to the bit before anything slid.

    Args:
        base: gives mu_pair; asked once about each pair. Under MPI that is once on each rank that meets the pair.
        name: of the base, for messages.
        flat_coefficient: mu_flat [-].
        work: w [N/mm].
    """

    depends_on: ClassVar[frozenset[str]] = frozenset({"tiles", "pressure", "sliding"})

    def __init__(self, base: FrictionProvider, name: str, flat_coefficient: float, work: float) -> None:
        self.base, self.name, self.flat_coefficient, self.work = base, name, flat_coefficient, work
        self._known: dict[tuple[int, int], tuple[float, float]] = {}

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu of each pair [-], shape (n,).

        Raises:
            ProviderError: the base answers badly.
        """
        first = self._first(pairs).coefficient
        return first + (first - self.flat_coefficient) * self._lost(pairs)

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        """Standard deviation of mu of each pair [-], shape (n,): the base's, times exp(-p s / w).

        Raises:
            ProviderError: the base answers badly.
        """
        return self._first(pairs).uncertainty * (1.0 + self._lost(pairs))

    def outside(self, pairs: TilePairs) -> dict[str, FloatArray]:
        """What the base says of pairs outside of what it knows, see `KnowsItsRange`.

        Raises:
            ProviderError: the base answers badly.
        """
        return reasons_of(self.base, pairs, self.name)

    @property
    def counters(self) -> dict[str, int]:
        """What the base counts."""
        return declared_counters(self.base, self.name)

    @property
    def origin(self) -> Mapping[str, Any]:
        """What the base's coefficients come from."""
        return origin_of(self.base, self.name)

    def _lost(self, pairs: TilePairs) -> FloatArray:
        """exp(-p s / w) - 1, number by number: a vectorised one may round by the place in the batch."""
        exponents = (-pairs.pressure * pairs.sliding / self.work).tolist()
        return np.array([math.expm1(exponent) for exponent in exponents], dtype=np.float64)

    def _first(self, pairs: TilePairs) -> PairFriction:
        """mu_pair and its standard deviation, from the base where they are not known yet."""
        asked = list(zip(pairs.seat.tolist(), pairs.bore.tolist(), strict=True))
        new = sorted(set(asked) - self._known.keys())
        if new:
            seat, bore = np.array(new, dtype=np.int64).T
            told = answered(self.base, TilePairs(seat, bore, np.zeros(len(new)), np.zeros(len(new))), self.name)
            self._known |= zip(new, zip(told.coefficient.tolist(), told.uncertainty.tolist(), strict=True), strict=True)
        known = np.array([self._known[pair] for pair in asked], dtype=np.float64).reshape(-1, 2)
        return PairFriction(known[:, 0], known[:, 1])


def _inner(error: ProviderError) -> str:
    """The message with its keys as they stand in the scene."""
    return (
        str(error)
        .replace("friction.options.", "friction.options.options.")
        .replace("friction.provider", "friction.options.base")
    )
