"""The law of one point as compiled loops: many points, each along a path of strains. The formulas are in `law`.

Everything that calls each other stands in this one file: the cache of compiled code does not see other files change.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..base.caches import ensure_cache
from ..base.compiled import check_compiled

ensure_cache()  # numba looks for it where a kernel is declared

YIELD, ISOTROPIC, SATURATION, RATE = range(4)
"""Places in `radius`: R(0) [MPa], its linear growth [MPa], Q [MPa] and b [-] of Voce."""
BACKS = 3
"""Most back-stresses."""
ITERATIONS = 60
ROUNDING = 1e-13


@njit(cache=True)
def yield_radius(p, radius, strains, gains):
    """R(p) [MPa] and its slope [MPa]."""
    left = math.exp(-radius[RATE] * p)
    value = radius[YIELD] + radius[ISOTROPIC] * p + radius[SATURATION] * (1.0 - left)
    slope = radius[ISOTROPIC] + radius[SATURATION] * radius[RATE] * left
    last = len(strains) - 1
    if last >= 0:
        if p >= strains[last]:
            value += gains[last]
        else:
            k = np.searchsorted(strains, p, side="right") - 1
            rise = (gains[k + 1] - gains[k]) / (strains[k + 1] - strains[k])
            value += gains[k] + rise * (p - strains[k])
            slope += rise
    return value, slope


@njit(cache=True)
def equivalent(t):
    """sqrt(3/2 t : t) of a deviatoric tensor (rr, zz, tt, rz)."""
    return math.sqrt(1.5 * (t[0] * t[0] + t[1] * t[1] + t[2] * t[2] + 2.0 * t[3] * t[3]))


@njit(cache=True)
def flow_length(stress, back, p, radius, strains, gains, moduli, recalls, shear_modulus, fade, relative):
    """dp > 0 by Newton's method in a bracket, and |s - X|; leaves exp(-g dp) in `fade`, s - X in `relative`."""
    backs = len(moduli)
    low, high, dp, scale = 0.0, 0.0, 0.0, 0.0
    for iteration in range(ITERATIONS):
        value, slope = yield_radius(p + dp, radius, strains, gains)
        value, slope = -value - 3.0 * shear_modulus * dp, -slope - 3.0 * shear_modulus
        for c in range(4):
            relative[c] = stress[c]
        for i in range(backs):
            fade[i] = math.exp(-recalls[i] * dp)
            value -= moduli[i] * (-math.expm1(-recalls[i] * dp) / recalls[i] if recalls[i] > 0.0 else dp)
            slope -= moduli[i] * fade[i]
            for c in range(4):
                relative[c] -= back[i, c] * fade[i]
        size = equivalent(relative)
        value += size
        for i in range(backs):
            if recalls[i] > 0.0:
                turned = 2.0 * back[i, 3] * relative[3]
                for c in range(3):
                    turned += back[i, c] * relative[c]
                slope += 1.5 * recalls[i] * fade[i] * turned / size
        if iteration == 0:
            high, scale = 1.001 * value / (3.0 * shear_modulus), value + radius[YIELD]
        elif abs(value) <= ROUNDING * scale:
            break
        if value > 0.0:
            low = dp
        else:
            high = dp
        step = dp - value / slope
        dp = step if low <= step <= high else 0.5 * (low + high)
    return dp, size


@njit(cache=True)
def follow(path, strain, accumulated, back, radius, strains, gains, moduli, recalls, shear_modulus):
    """Lead points along total strains (steps, points, 4); their plastic strain, p and back-stresses change in place."""
    backs = len(moduli)
    stress, relative, fade = np.empty(4), np.empty(4), np.empty(BACKS)
    for point in range(path.shape[1]):
        for step in range(path.shape[0]):
            mean = 0.0
            for c in range(4):
                stress[c] = path[step, point, c] - strain[point, c]
            mean = (stress[0] + stress[1] + stress[2]) / 3.0
            for c in range(3):
                stress[c] = 2.0 * shear_modulus * (stress[c] - mean)
            stress[3] *= shear_modulus
            for c in range(4):
                relative[c] = stress[c]
                for i in range(backs):
                    relative[c] -= back[point, i, c]
            p = accumulated[point]
            if equivalent(relative) <= yield_radius(p, radius, strains, gains)[0]:
                continue
            dp, size = flow_length(
                stress, back[point], p, radius, strains, gains, moduli, recalls, shear_modulus, fade, relative
            )
            accumulated[point] = p + dp
            for c in range(4):
                normal = relative[c] / size
                strain[point, c] += (3.0 if c == 3 else 1.5) * dp * normal
                for i in range(backs):
                    grown = -math.expm1(-recalls[i] * dp) / recalls[i] if recalls[i] > 0.0 else dp
                    back[point, i, c] = back[point, i, c] * fade[i] + moduli[i] * grown * normal


check_compiled(follow)
