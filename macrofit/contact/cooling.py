"""A wheel warmer than its axle: its free expansion widens the bore, and a wheel that cools shrinks onto the axle.

The thermal strain e = alpha dT is the same in the whole wheel, so that a free wheel expands without stress, by

    u_r = e r,   u_z = e (z - z_m),   z_m the middle of the bore.

At a temperature that stays only the radius matters: the bore is (1 + e) times as wide, and u_z is part of where the
wheel was put. While it cools, de r closes the gap, and de (z - z_m) slips along the seat until friction holds it.
Elastic constants do not change, and the lines face each other at their places of the drawing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..base.arrays import FloatArray
from ..bodies.body import ContactLine
from .interface import MortarCoupling
from .release import Solved, ends, force_free


def warmed(bore: ContactLine, thermal_strain: float) -> ContactLine:
    """The bore of a wheel of this thermal strain."""
    if thermal_strain == bore.generatrix.thermal_strain:
        return bore
    return replace(bore, generatrix=replace(bore.generatrix, thermal_strain=thermal_strain))


def cooled(fit_at: Callable[[float], Solved]) -> Solved:
    """The fit of a wheel whose temperature has changed: nothing pushes, so that it moves to where no force is left.

    Args:
        fit_at: solves the fit whose support has moved by a distance [mm].

    Returns:
        The fit at 0 where there is no such place: friction does not hold what the slope of the fit pushes.
    """
    held = fit_at(0.0)
    if ends(held) or held.friction_bound == 0.0:
        return held
    return force_free(fit_at, 0.0, held.force) or held


def thermal_slip(bore: ContactLine, coupling: MortarCoupling, change: float) -> FloatArray:
    """How far the bore slips along the seat [mm] (n,) for a change of its thermal strain."""
    return np.asarray(coupling.bore_moments(change * free_expansion(bore))[1])


def heat_work(bore: ContactLine, loads: tuple[FloatArray, FloatArray], change: float) -> float:
    """Work [N mm] of a change of the thermal strain against the mean of the loads on the bore before and after.

    What slip adds to it, where friction has its last value from the first slip on, is in `state.slip_work`.
    """
    if change == 0.0:
        return 0.0
    before, after = loads
    return -0.5 * change * float((before + after) @ free_expansion(bore))


def free_expansion(bore: ContactLine) -> FloatArray:
    """Displacement (2 bore nodes,) of the bore's nodes for a thermal strain of 1 [mm]."""
    r, z = bore.nodes.T
    return np.concatenate([r, z - 0.5 * (z[0] + z[-1])])
