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


@njit(cache=True)
def overshoots(trial, accumulated, back, radius, strains, gains):
    """|s - X| - R [MPa] of trial stresses (n, 4)."""
    out, relative = np.empty(len(trial)), np.empty(4)
    for point in range(len(trial)):
        mean = (trial[point, 0] + trial[point, 1] + trial[point, 2]) / 3.0
        for c in range(4):
            relative[c] = trial[point, c] if c == 3 else trial[point, c] - mean
            for i in range(back.shape[1]):
                relative[c] -= back[point, i, c]
        out[point] = equivalent(relative) - yield_radius(accumulated[point], radius, strains, gains)[0]
    return out


@njit(cache=True, fastmath={"reassoc", "nsz", "contract"})
def strains_at(points, operators, unknowns, displacement):
    """B u (m, 4) at some points, of operators B (n, 4, b) on some unknowns (n, b) each."""
    out = np.empty((len(points), 4))
    own = np.empty(operators.shape[2])
    for k in range(len(points)):
        point = points[k]
        for j in range(len(own)):
            own[j] = displacement[unknowns[point, j]]
        for c in range(4):
            total = 0.0
            for j in range(len(own)):
                total += operators[point, c, j] * own[j]
            out[k, c] = total
    return out


@njit(cache=True, fastmath={"reassoc", "nsz", "contract"})
def loads_of(points, operators, unknowns, stress, size):
    """Sum of B' s (size,) of stresses s (m, 4) at some points, times what the points weigh."""
    out = np.zeros(size)
    for k in range(len(points)):
        point, rr, zz, tt, rz = points[k], stress[k, 0], stress[k, 1], stress[k, 2], stress[k, 3]
        for j in range(operators.shape[2]):
            b = operators[point, :, j]
            out[unknowns[point, j]] += b[0] * rr + b[1] * zz + b[2] * tt + b[3] * rz
    return out


@njit(cache=True)
def reached_from(rows, own, parent):
    """Which supernodes (k,) are those of some rows or above one of them, by the supernode of each row."""
    out = np.zeros(len(parent), dtype=np.bool_)
    for row in rows:
        k = own[row]
        while k >= 0 and not out[k]:
            out[k] = True
            k = parent[k]
    return out


@njit(cache=True)
def forward(part, first, begin, place, rows, values, y):
    """L^-1 y in place, on some supernodes in ascending order; y must vanish below all others."""
    work = np.empty(len(y))
    for k in part:
        column, wide, high = first[k], first[k + 1] - first[k], begin[k + 1] - begin[k]
        own, below = y[column : column + wide], rows[begin[k] + wide : begin[k + 1]]
        work[:wide] = own
        work[wide:high] = 0.0
        for j in range(wide):
            at = place[k] + j * high
            share = work[j] / values[at + j]
            own[j] = share
            column_of, left = values[at + j + 1 : at + high], work[j + 1 : high]
            for i in range(len(left)):
                left[i] -= column_of[i] * share
        left = work[wide:high]
        for i in range(len(below)):
            y[below[i]] += left[i]


@njit(cache=True, fastmath={"reassoc", "nsz", "contract"})
def backward(part, first, begin, place, rows, values, y):
    """L'^-1 y in place, on some supernodes in ascending order and all that are above them; four columns at a time."""
    work, sums = np.empty(len(y)), np.empty(len(y))
    for q in range(len(part) - 1, -1, -1):
        k = part[q]
        wide, high, start = first[k + 1] - first[k], begin[k + 1] - begin[k], place[k]
        own, below = y[first[k] : first[k + 1]], rows[begin[k] + wide : begin[k + 1]]
        known = work[: len(below)]
        for i in range(len(below)):
            known[i] = y[below[i]]
        fours = wide - wide % 4
        for j in range(fours, wide):
            at = start + j * high + wide
            sums[j] = product(values[at : at + len(below)], known)
        for j in range(0, fours, 4):
            a = start + j * high + wide
            b, c, d = a + high, a + 2 * high, a + 3 * high
            sums[j], sums[j + 1], sums[j + 2], sums[j + 3] = four_products(
                values[a : a + len(below)],
                values[b : b + len(below)],
                values[c : c + len(below)],
                values[d : d + len(below)],
                known,
            )
        for j in range(wide - 1, -1, -1):
            at, total = start + j * high, sums[j]
            for i in range(j + 1, wide):
                total += values[at + i] * own[i]
            own[j] = (own[j] - total) / values[at + j]


@njit(cache=True, fastmath={"reassoc", "nsz", "contract"})
def product(a, x):
    """The product of two vectors."""
    total = 0.0
    for i in range(len(x)):
        total += a[i] * x[i]
    return total


@njit(cache=True, fastmath={"reassoc", "nsz", "contract"})
def four_products(a, b, c, d, x):
    """The products of four vectors with x."""
    of_a, of_b, of_c, of_d = 0.0, 0.0, 0.0, 0.0
    for i in range(len(x)):
        of_a += a[i] * x[i]
        of_b += b[i] * x[i]
        of_c += c[i] * x[i]
        of_d += d[i] * x[i]
    return of_a, of_b, of_c, of_d


check_compiled(follow)
