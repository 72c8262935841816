"""Stress at the surface of the seat, from the tractions there and the strains of the surface.

In the frame (n, m, t) of a facet, outward, along the seat and around it, n . sigma is the traction, and the
surface gives

    eps_m = d u_m / dm,   eps_t = (u_r + n b) / r,   gamma_mt = d b / dm - (b m_r + n u_m) / r

(cos families of eps, sin of gamma), of which Hooke's law makes, with k = E / (1 - nu^2), s the normal traction,

    s_m = nu / (1 - nu) s + k (eps_m + nu eps_t),   s_t alike,   tau_mt = G gamma_mt

as `bodies.surface` does without a circumference. All values are means over facets.
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import IntArray
from ..bodies.body import ContactLine
from .elements import ComplexArray

NN, MM, TT, NM, NT, MT = range(6)
"""Components of a stress in the frame of a facet; NT and MT belong to the sin family."""


def surface_stress(line: ContactLine, n: int, displacement: ComplexArray, traction: ComplexArray) -> ComplexArray:
    """Amplitudes of stress (facets, 6) [MPa]; those of the sin family as b, see `elements`.

    Args:
        line: the seat.
        n: the harmonic.
        displacement: amplitudes (line nodes, 3) of a, b, c [mm].
        traction: amplitudes (facets, 3): normal, along, around [MPa].
    """
    a, b, c = displacement.T
    step, length = line.order, line.length
    ends = line.nodes[::step]
    along_r, along_z = (np.diff(ends, axis=0) / length[:, None]).T
    radius = 0.5 * (ends[1:, 0] + ends[:-1, 0])
    stretch = (np.diff(a[::step]) * along_r + np.diff(c[::step]) * along_z) / length
    mean_a, mean_b, mean_c = (facet_mean(values, step) for values in (a, b, c))
    hoop = (mean_a + n * mean_b) / radius
    shear = np.diff(b[::step]) / length - (mean_b * along_r + n * (mean_a * along_r + mean_c * along_z)) / radius
    nu = line.material.poisson_ratio
    k, pressed = line.material.youngs_modulus / (1.0 - nu**2), nu / (1.0 - nu) * traction[:, 0]
    return np.stack(
        [
            traction[:, 0],
            pressed + k * (stretch + nu * hoop),
            pressed + k * (hoop + nu * stretch),
            traction[:, 1],
            traction[:, 2],
            line.material.shear_modulus * shear,
        ],
        axis=1,
    )


def facet_mean(values: ComplexArray, order: int) -> ComplexArray:
    """Means over the facets of values at the nodes of a line (Simpson's rule for order 2)."""
    start, end = values[:-1:order], values[order::order]
    return np.asarray(0.5 * (start + end) if order == 1 else (start + 4.0 * values[1::2] + end) / 6.0)


def by_facet(facets: int, facet: IntArray, moments: ComplexArray) -> ComplexArray:
    """Means over the facets (facets, k) of moments (m, k) of equal weights; 0 where there is none."""
    count = np.bincount(facet, minlength=facets)
    out = np.zeros((facets, moments.shape[1]), dtype=moments.dtype)
    np.add.at(out, facet, moments)
    return np.asarray(out / np.maximum(count, 1)[:, None])
