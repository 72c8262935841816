"""Stress on the contact line, from the traction of the contact and the strain along the surface.

What the bodies press each other with is known, t = sigma n, and so is how the surface is strained: along the line from
the displacements of its nodes, around the axis as u_r / r. Hooke's law gives the rest:

    s_n = n . t,    tau = m . t,    m = (-n_z, n_r),    k = E / (1 - nu^2)
    s_m = nu / (1 - nu) s_n + k (eps_m + nu eps_t),    s_t = nu / (1 - nu) s_n + k (eps_t + nu eps_m)

Nothing reaches across the edge of the contact or into the body, as the patch of a vertex does. It is the usual way of
boundary elements (Brebbia, Telles, Wrobel, *Boundary Element Techniques*, 1984, 5.8). The traction of a vertex is the
mean of its two facets'; the strain, smoother, is a parabola over each facet with its mean.

Where steel flowed, eps - eps_p would be needed at the surface, where eps_p is steep: 0.1 % of strain is 230 MPa. See
`plasticity.surface` for these nodes.
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import FloatArray
from .body import Body


def surface_stress(body: Body, displacement: FloatArray, traction: FloatArray) -> FloatArray:
    """Stress (line nodes, 4) = (rr, zz, tt, rz) [MPa] at the nodes of a body's contact line, where nothing flowed.

    Args:
        body: the body.
        displacement: of all its nodes (dofs,) [mm].
        traction: (t_r, t_z) in the middle of each facet (facets, 2) [MPa].
    """
    line, material = body.line, body.material
    u = displacement.reshape(-1, 2)[body.trace[: len(line.nodes)]]
    ends, moved = line.nodes[:: line.order], u[:: line.order]
    along = np.diff(ends, axis=0) / line.length[:, None]
    mean = (np.diff(moved, axis=0) * along).sum(axis=1) / line.length
    stretch, radius = _parabolic(mean, line.order), line.nodes[:, 0]
    hoop = np.where(radius > 0.0, u[:, 0] / np.where(radius > 0.0, radius, 1.0), stretch)  # alike on the axis
    n_r, n_z, normal, shear = line_traction(body, traction)
    nu = material.poisson_ratio
    k, pressed = material.youngs_modulus / (1.0 - nu**2), nu / (1.0 - nu) * normal
    tangential, around = pressed + k * (stretch + nu * hoop), pressed + k * (hoop + nu * stretch)
    return from_line(n_r, n_z, np.stack([normal, tangential, around, shear]))


def line_traction(body: Body, traction: FloatArray) -> FloatArray:
    """Unit normal n_r, n_z, normal and shear part of a traction (facets, 2) [MPa] at the nodes of the line, (4, n)."""
    n_r, n_z = _normals(body).T
    t_r, t_z = _linear(traction, body.line.order).T
    return np.stack([n_r, n_z, n_r * t_r + n_z * t_z, n_r * t_z - n_z * t_r])


def from_line(n_r: FloatArray, n_z: FloatArray, stress: FloatArray) -> FloatArray:
    """Stresses (n, 4) = (rr, zz, tt, rz) of those in the frame of a line (4, n): s_n, s_m, s_t and tau."""
    normal, tangential, around, shear = stress
    return np.stack(
        [
            normal * n_r**2 + tangential * n_z**2 - 2.0 * shear * n_r * n_z,
            normal * n_z**2 + tangential * n_r**2 + 2.0 * shear * n_r * n_z,
            around,
            (normal - tangential) * n_r * n_z + shear * (n_r**2 - n_z**2),
        ],
        axis=1,
    )


def to_line(n_r: FloatArray, n_z: FloatArray, stress: FloatArray) -> FloatArray:
    """The inverse of `from_line`."""
    rr, zz, tt, rz = stress.T
    return np.stack(
        [
            rr * n_r**2 + zz * n_z**2 + 2.0 * rz * n_r * n_z,
            rr * n_z**2 + zz * n_r**2 - 2.0 * rz * n_r * n_z,
            tt,
            (zz - rr) * n_r * n_z + rz * (n_r**2 - n_z**2),
        ]
    )


def _normals(body: Body) -> FloatArray:
    """Unit normals at the nodes of the contact line (line nodes, 2): means of the facets'."""
    normals = _linear(body.line.normals, body.line.order)
    return np.asarray(normals / np.hypot(*normals.T)[:, None])


def _linear(middle: FloatArray, order: int) -> FloatArray:
    """Values at the nodes of a line from those in the middle of its facets (facets, k): means at the vertices."""
    padded = np.concatenate([middle[:1], middle, middle[-1:]])
    return _joined(0.5 * (padded[1:] + padded[:-1]), middle, order)


def _parabolic(mean: FloatArray, order: int) -> FloatArray:
    """Values at the nodes of a line from the means over its facets (facets,): exact for cubics on equal facets."""
    a, b, c, d = (np.pad(mean, 2, mode="edge")[k : len(mean) + 1 + k] for k in range(4))
    ends = (7.0 * (b + c) - (a + d)) / 12.0
    return _joined(ends, (6.0 * mean - ends[1:] - ends[:-1]) / 4.0, order)


def _joined(ends: FloatArray, middles: FloatArray, order: int) -> FloatArray:
    if order == 1:
        return ends
    out = np.empty((len(ends) + len(middles), *ends.shape[1:]))
    out[::2], out[1::2] = ends, middles
    return out
