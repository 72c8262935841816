"""The test that every friction provider has to pass; a plugin's own test is three lines that call `check`."""

from __future__ import annotations

import numpy as np

from macrofit.errors import ProviderError
from macrofit.friction.answer import PairFriction, checked_answer, checked_uncertainty, declared_dependence, reasons_of
from macrofit.friction.contract import (
    QUANTITIES,
    FrictionProvider,
    HearsAhead,
    IntArray,
    KnowsItsRange,
    StatesUncertainty,
    TilePairs,
)

BATCH_TOLERANCE = 1e-6
"""How far the make-up of a batch may move a coefficient: the rounding of a single-precision network [-]."""

PRESSURE_RANGE = (1.0, 400.0)
"""Pressures asked about [MPa]."""

SLIDING_RANGE = (0.0, 200.0)
"""Slid distances asked about [mm]."""


class ConformanceError(ProviderError):
    """A provider that does not keep the friction contract."""


def check(
    provider: FrictionProvider,
    seat_tiles: int = 8,
    bore_tiles: int = 8,
    seed: int = 0,
    *,
    batch: int = 12,
    tolerance: float = BATCH_TOLERANCE,
) -> None:
    """Hold a provider to the contract; silent when it keeps it.

    Checked: `depends_on` is valid and honest (what it does not list changes nothing), an empty batch gets an
    empty answer, shape and bounds, inputs left as they were, the same answer when asked again (to the bit),
    and answers that depend neither on the order of the batch nor on what else is in it (within `tolerance`).
    Where the provider states its uncertainty, all of this holds for that too. Where it has `outside`, that has a
    number for each pair, for the same reasons whatever pairs are asked about. Where it has `announced`, that changes no
    answer.

    Args:
        provider: the provider to check; asked about ten batches, and about each pair alone.
        seat_tiles: tiles 0 .. seat_tiles - 1 of the seat are asked about.
        bore_tiles: the same for the bore.
        seed: of the random pairs.
        batch: pairs in a batch, at least 2.
        tolerance: largest change of a coefficient with the make-up of the batch [-]; 0: equal to the bit.

    Raises:
        ConformanceError: the first rule that is broken, in one line.
    """
    name = type(provider).__name__
    try:
        depends_on = declared_dependence(provider, name)
    except ProviderError as error:
        raise ConformanceError(str(error)) from error
    rng = np.random.default_rng(seed)
    pairs = _random_pairs(rng, seat_tiles, bore_tiles, batch)
    _asked(provider, pairs.take(np.empty(0, dtype=np.int64)), "an empty batch")
    answer = _asked(provider, pairs, "a batch")
    again = _asked(provider, pairs, "a batch for the second time")
    _same(pairs, answer, again, 0.0, f"{name} is not deterministic: the same batch asked twice")
    _check_make_up(provider, pairs, answer, rng, tolerance)
    _check_honesty(provider, pairs, answer, depends_on, (seat_tiles, bore_tiles), rng)
    if isinstance(provider, KnowsItsRange):
        _check_range(provider, pairs, rng)
    if isinstance(provider, HearsAhead):
        for heard in (_random_pairs(rng, seat_tiles, bore_tiles, batch), pairs):
            _told(provider, "announced", heard, "pairs that it hears of ahead")
            after = _asked(provider, pairs, "a batch after it heard of pairs")
            _same(pairs, answer, after, tolerance, f"{name} answers otherwise once it has heard of pairs")


def _check_range(provider: FrictionProvider, pairs: TilePairs, rng: np.random.Generator) -> None:
    """What it says of its range has a number for each pair, which nothing else in the batch changes."""
    name, order = type(provider).__name__, rng.permutation(pairs.seat.size)
    batches = (pairs, pairs.take(order), pairs.take(order[:0]))
    for batch in batches:
        _told(provider, "outside", batch, "pairs outside of its range")
    try:
        said, mixed, none = (reasons_of(provider, batch, name) for batch in batches)
    except ProviderError as error:
        raise ConformanceError(str(error)) from error
    if not said.keys() == mixed.keys() == none.keys():
        raise ConformanceError(f"{name} names other reasons for other pairs; give 0 for those that are not concerned")
    wrong = [reason for reason in said if not np.array_equal(said[reason][order], mixed[reason])]
    if wrong:
        raise ConformanceError(f"{name} judges its range by the order of the batch: {wrong[0]:.60}")


def _random_pairs(rng: np.random.Generator, seat_tiles: int, bore_tiles: int, batch: int) -> TilePairs:
    """Random pairs; the first and the last tile of each body are always among them."""
    seat, bore = rng.integers(seat_tiles, size=batch), rng.integers(bore_tiles, size=batch)
    seat[:2], bore[:2] = (0, seat_tiles - 1), (bore_tiles - 1, 0)
    return TilePairs(seat, bore, rng.uniform(*PRESSURE_RANGE, batch), rng.uniform(*SLIDING_RANGE, batch))


def _check_make_up(
    provider: FrictionProvider,
    pairs: TilePairs,
    answer: PairFriction,
    rng: np.random.Generator,
    tolerance: float,
) -> None:
    """Neither the order of a batch nor the company in it may matter."""
    name = type(provider).__name__
    size = pairs.seat.size
    for order in (np.arange(size)[::-1], rng.permutation(size)):
        shuffled = pairs.take(order)
        mixed = _asked(provider, shuffled, "a batch in another order")
        _same(shuffled, _taken(answer, order), mixed, tolerance, f"{name} depends on the order of the batch")
    alone = [_asked(provider, pairs.take(np.array([i])), "one pair") for i in range(size)]
    together = PairFriction(*(np.concatenate(column) for column in zip(*alone, strict=True)))
    _same(pairs, answer, together, tolerance, f"{name} depends on the other pairs of the batch")


def _check_honesty(
    provider: FrictionProvider,
    pairs: TilePairs,
    answer: PairFriction,
    depends_on: frozenset[str],
    tiles: tuple[int, int],
    rng: np.random.Generator,
) -> None:
    """What `depends_on` does not list must change nothing."""
    other = _random_pairs(rng, *tiles, pairs.seat.size)
    seat, bore = (pairs.seat + 1) % tiles[0], (pairs.bore + 1) % tiles[1]
    changes = {
        "tiles": [pairs._replace(seat=seat), pairs._replace(bore=bore), pairs._replace(seat=other.seat)],
        "pressure": [pairs._replace(pressure=0.0 * pairs.pressure), pairs._replace(pressure=other.pressure)],
        "sliding": [pairs._replace(sliding=0.0 * pairs.sliding), pairs._replace(sliding=other.sliding)],
    }
    for quantity in sorted(QUANTITIES - depends_on):
        for changed in changes[quantity]:
            moved = _asked(provider, changed, f"a batch with other {quantity}")
            rule = f"{type(provider).__name__} depends on {quantity}, which its depends_on does not list"
            _same(changed, answer, moved, 0.0, rule)


def _asked(provider: FrictionProvider, pairs: TilePairs, what: str) -> PairFriction:
    """The checked answers to copies of the batch, which must come back as they were."""
    name = type(provider).__name__
    try:
        coefficient = checked_answer(_told(provider, "coefficients", pairs, what), pairs, name)
        if not isinstance(provider, StatesUncertainty):
            return PairFriction(coefficient, np.full(coefficient.shape, np.nan))
        return PairFriction(coefficient, checked_uncertainty(_told(provider, "uncertainty", pairs, what), pairs, name))
    except ConformanceError:
        raise
    except ProviderError as error:
        raise ConformanceError(f"asked about {what}: {error}") from error


def _told(provider: FrictionProvider, method: str, pairs: TilePairs, what: str) -> object:
    who = f"{type(provider).__name__}, asked about {what},"
    given = pairs.copy()
    try:
        answer: object = getattr(provider, method)(given)
    except (Exception, SystemExit) as error:
        raise ConformanceError(f"{who} raised {type(error).__name__}: {error}") from error
    for field, before, after in zip(TilePairs._fields, pairs, given, strict=True):
        if not np.array_equal(before, after):
            raise ConformanceError(f"{who} modified its input {field!r}")
    return answer


def _taken(answer: PairFriction, order: IntArray) -> PairFriction:
    return PairFriction(answer.coefficient[order], answer.uncertainty[order])


def _same(pairs: TilePairs, expected: PairFriction, found: PairFriction, tolerance: float, rule: str) -> None:
    for column, before, after in zip(("", " as uncertainty"), expected, found, strict=True):
        moved = ~((np.abs(after - before) <= tolerance) | (np.isnan(after) & np.isnan(before)))
        if moved.any():
            i = int(np.argmax(moved))
            raise ConformanceError(
                f"{rule}: seat tile {pairs.seat[i]} and bore tile {pairs.bore[i]} "
                f"got {before[i]!r}, then {after[i]!r}{column}"
            )
