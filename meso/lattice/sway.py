"""The sway resonance: a plate on the bars behind it, moving along the slide as one.

Sliding spheres hit each other once a mean diameter d. Where the speed comes near f d, the plates ring, and the meso
coefficient is higher the nearer it comes; faster still it falls again.
"""

from __future__ import annotations

import numpy as np

from macrofit.base.arrays import FloatArray

from .equilibrium import cut, settled
from .lattice import Lattice


def sway_frequency(lattice: Lattice) -> float:
    """Frequency at which a plate sways along the slide on what holds its back [Hz]; 0 where nothing does.

    Rayleigh's quotient of the shape that the plate takes when its own weight acts along the slide,

        f = (1/2 pi) sqrt(sum F_i u_i / sum (m_i |u_i|^2 + 2/5 m_i r_i^2 |t_i|^2)),    F_i = m_i along x,

    which is a little above the lowest mode of that shape. A rigid plate would have sqrt(sum of k / sum of m).

    Raises:
        SettingsError: no equilibrium is found, the beams are too thin.
    """
    if not len(lattice.anchored):
        return 0.0
    load: FloatArray = np.zeros((lattice.nodes, 6))
    load[:, 0] = lattice.masses
    rigid = np.zeros_like(load)
    rigid[:, 0] = lattice.masses.sum() / lattice.anchors[:, 1].sum()
    u = settled(lattice, rigid, load=load, free=np.ones_like(load))
    weight = np.repeat(1.0 / lattice.inverse, 3, axis=1)
    return cut(float(np.sqrt(np.sum(load * u) / np.sum(weight * u**2)) / (2.0 * np.pi)))
