"""How wrong the force may be for what the provider of friction was asked for and does not know."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from macrofit.friction.answer import reasons_of
from macrofit.friction.contract import FloatArray, KnowsItsRange, TilePairs
from macrofit.friction.field import FrictionField
from macrofit.friction.tiles import FacingPairs, tiles_of

LOOKED_AT = 5
"""Increments that are looked at, besides that of the largest normal force: every one takes a hundred pairs."""

Moment: TypeAlias = tuple[FacingPairs, FloatArray, FloatArray]
"""The pairs of tiles at an increment, and pressure [MPa] and accumulated sliding [mm] of the facets."""
Ask: TypeAlias = Callable[[Mapping[str, FloatArray], int], Mapping[str, FloatArray]]
"""Gives what all ranks have said of their parts of a batch, of what this one has of so many pairs."""


@dataclass(frozen=True, kw_only=True)
class Outside:
    """Pairs for which the provider may be wrong by one reason, at the increment where they carry most."""

    reason: str
    """In the provider's words: "two words: are so and so; what to try"."""
    error: float
    """By what share of the largest normal force of the run times mu they may make the force wrong there [-]."""
    share: float
    """What they carry there of that normal force [-]."""
    increment: int
    """Number of that increment."""
    pairs: int
    """How many such pairs are in contact there."""
    of: int
    """How many pairs are."""
    pressure: tuple[float, float]
    """Their smallest and largest pressure [MPa]."""


def looked_at(normal_force: FloatArray) -> list[int]:
    """Numbers of the increments that are looked at: evenly spaced among those in contact, and the most pressed."""
    touching = np.flatnonzero(normal_force > 0.0)
    if not touching.size:
        return []
    places = np.linspace(0, touching.size - 1, LOOKED_AT).round().astype(np.int64)
    return sorted({*touching[places].tolist(), int(np.argmax(normal_force))})


def outside_range(
    field: FrictionField, normal_force: FloatArray, moment: Callable[[int], Moment], share: Ask
) -> tuple[Outside, ...]:
    """For each reason the increment at which the pairs that it concerns make the force most wrong. Collective.

    A pair carries its pressure times the length over which it is in contact, N_p of all their N. Errors e_p of its
    coefficient are taken as of one sign: sum_p N_p e_p / N.

    Args:
        field: with the provider.
        normal_force: of all increments [N].
        moment: the pairs at an increment of this number, with pressures and sliding.
        share: how the ranks' parts come together.
    """
    if not isinstance(field.provider, KnowsItsRange):
        return ()
    worst: dict[str, Outside] = {}
    most = float(normal_force.max(initial=0.0))
    for number in looked_at(normal_force):
        for found in _at(field, number, moment(number), float(normal_force[number]) / most, share):
            if found.reason not in worst or found.error > worst[found.reason].error:
                worst[found.reason] = found
    return tuple(worst.values())


def _at(field: FrictionField, number: int, moment: Moment, held: float, share: Ask) -> Iterator[Outside]:
    """What is outside at one increment, whose normal force is `held` of the largest."""
    facing, pressure, sliding = moment
    keys, which = facing.distinct
    pressed = facing.pair_mean(pressure) if keys.size else np.empty(0)
    part = field.part(TilePairs(*tiles_of(keys), pressed, facing.pair_mean(sliding))) if keys.size else None
    told = {} if part is None else share(_told(field, part), part.seat.size)
    overlaps = facing.overlaps
    carried = np.bincount(which, overlaps.weight * pressure[overlaps.facet]) if told else pressed
    touching = pressed > 0.0
    whole = float(carried.sum())
    parts = carried * (held / whole if whole > 0.0 else 0.0)
    for reason, off in told.items():
        some = (off > 0.0) & touching
        if some.any():
            ends = float(pressed[some].min()), float(pressed[some].max())
            yield Outside(
                reason=reason,
                error=float(parts[some] @ off[some]),
                share=float(parts[some].sum()),
                increment=number,
                pairs=int(some.sum()),
                of=int(touching.sum()),
                pressure=ends,
            )


def _told(field: FrictionField, part: TilePairs) -> Mapping[str, FloatArray]:
    """What this rank's provider says of its part; one that fails at it is warned of: it is no reason to lose a run."""
    try:
        return reasons_of(field.provider, part, field.name)
    except Exception as error:
        said = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        warnings.warn(
            f"friction provider {field.name!r} failed at `outside`, with {said}; it is not judged", stacklevel=2
        )
        return {}
