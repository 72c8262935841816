"""The critical time step of the explicit engine: the largest at which the undamped leapfrog is stable."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from macrofit.base.arrays import FloatArray

from .. import kernels
from ..lattice.candidates import ContactCandidates
from ..lattice.lattice import Lattice

CONTACTS = 3.0
"""Contacts that a sphere of the rough face is allowed at once, in the estimate of the critical time step."""


def critical_time_step(lattice: Lattice, candidates: ContactCandidates | None = None) -> float:
    """Largest stable time step of the undamped leapfrog, 2/sqrt(lambda_max(M^-1 K)) [s].

    lambda_max by Lanczos on the force kernel. The contacts of a sphere of the rough faces count as three springs
    between it and spheres that move against it, 6 k_n on its diagonal.
    """
    scale = np.sqrt(np.repeat(lattice.inverse, 3, axis=1))
    diagonal = np.zeros((lattice.nodes, 6))
    if candidates is not None and len(candidates.pair):
        for side in (0, 1):
            nodes, place = np.unique(candidates.pair[:, side], return_index=True)
            stiffness = 2.0 * CONTACTS * candidates.parameters[place, kernels.NORMAL_STIFFNESS]
            diagonal[nodes, :3] = stiffness[:, None]
            diagonal[nodes, 3:] = (stiffness * lattice.radii[nodes] ** 2)[:, None]
    force = np.empty((lattice.nodes, 6))

    def apply(x: FloatArray) -> FloatArray:
        u = scale * x.reshape(-1, 6)
        force[:] = 0.0
        kernels.beam_forces(
            u, force, lattice.rows, lattice.cols, lattice.beams, lattice.anchored, lattice.anchors, lattice.twist
        )
        product: FloatArray = (scale * (diagonal * u - force)).ravel()
        return product

    unknowns = 6 * lattice.nodes
    start = np.random.default_rng(0).normal(size=unknowns)
    operator = LinearOperator((unknowns, unknowns), matvec=apply, dtype=np.float64)
    largest = eigsh(operator, k=1, which="LA", tol=5e-3, return_eigenvectors=False, v0=start)
    return float(2.0 / np.sqrt(largest[0]))
