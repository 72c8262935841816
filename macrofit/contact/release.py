"""A fit that nothing from outside holds along the axis: friction carries all.

A wheel shrunk on in place (`release`) and a press that lets go (`force_free`) look for the place without force.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol, TypeVar

from .newton import Report

FREE = 1e-10
"""Largest force from outside that is left, over the force that friction can carry; Newton's method leaves 1e-12."""
ROUNDING = 1e-12
"""The same over the normal force, where nothing rubs."""
MOST_STEPS = 20
"""How often the support gives way before its force turns; two do where no facet slips, for the force is linear then."""

HALVINGS = 14
"""How often the interval is halved in which bodies part."""

FIRST_WAY, LAST_WAY = 1e-6, 20.0
"""First and last distance by which a press goes back [mm]; each is four times the one before."""


class Fit(Protocol):
    """A solved position of the wheel."""

    @property
    def report(self) -> Report:
        """How Newton's method ended."""
        ...

    @property
    def force(self) -> float:
        """Axial force from outside [N]."""
        ...

    @property
    def normal_force(self) -> float:
        """Integral of the pressure [N]."""
        ...

    @property
    def friction_bound(self) -> float:
        """Largest force that friction can carry, the integral of mu p [N]."""
        ...


Solved = TypeVar("Solved", bound=Fit)


def release(fit_at: Callable[[float], Solved], flexibility: float) -> Solved:
    """The fit without a force from outside: by secants from the fit at 0, once the force turns by Brent's method.

    Args:
        fit_at: solves the fit whose support has given way by a distance [mm].
        flexibility: how far it gives way for a force, to start with [mm/N].

    Returns:
        The fit at 0 where friction cannot carry its force, as on a cone steeper than it.
    """
    held = fit = fit_at(0.0)
    if abs(held.force) >= held.friction_bound:
        return held
    given = 0.0
    for _ in range(MOST_STEPS):
        if ends(fit):
            return fit
        further = -flexibility * fit.force
        after = fit_at(given + further)
        if after.force * fit.force < 0.0 and not ends(after):
            return _between(fit_at, {given: fit, given + further: after})
        gained = after.force - fit.force
        if gained * further <= 0.0:
            break
        given, fit, flexibility = given + further, after, further / gained
    return held


def force_free(
    fit_at: Callable[[float], Solved], start: float, force: float, first: float = FIRST_WAY
) -> Solved | None:
    """The fit after the press let go: the wheel goes back, or on, until no force is left.

    Args:
        fit_at: solves the move from the start to a displacement [mm].
        start: displacement at which the press holds the wheel [mm].
        force: its force there [N].
        first: how far it goes first [mm].

    Returns:
        That fit, or one that did not converge; None where the force never turns within `LAST_WAY`, or within ``first``.
    """
    way = first
    known: dict[float, Solved] = {}
    while way <= LAST_WAY:
        at = start - math.copysign(way, force)
        before, known = known, {at: fit_at(at)}
        if known[at].force == 0.0 and known[at].report.converged and before:
            return _parted(fit_at, next(iter(before)), at)
        if ends(known[at]):
            return known[at]
        if known[at].force * force < 0.0:
            return _between(fit_at, before | known) if before else None
        way *= 4.0
    return None


def _parted(fit_at: Callable[[float], Solved], held: float, parted: float) -> Solved:
    """The fit just beyond where bodies part between two displacements [mm]: their force is 0 from there on."""
    free = fit_at(parted)
    for _ in range(HALVINGS):
        middle = 0.5 * (held + parted)
        fit = fit_at(middle)
        if not fit.report.converged:
            return fit
        if fit.force == 0.0:
            parted, free = middle, fit
        else:
            held = middle
    return free


def ends(fit: Fit) -> bool:
    """Whether the search ends here: free, or not converged, which refuses the increment."""
    free = max(FREE * fit.friction_bound, ROUNDING * fit.normal_force)
    return not fit.report.converged or abs(fit.force) <= free


def _between(fit_at: Callable[[float], Solved], known: dict[float, Solved]) -> Solved:
    """The free fit between two whose forces have opposite signs."""
    from scipy.optimize import brentq  # 0.1 s that few fits need

    def force(given: float) -> float:
        if given not in known:
            known[given] = fit_at(given)
        return 0.0 if ends(known[given]) else known[given].force

    low, high = sorted(known)
    return known[brentq(force, low, high, xtol=1e-12 * (high - low))]
