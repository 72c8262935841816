"""Numba kernels of the packing: harmonic spheres in a box with one rough wall, quenched by FIRE."""

from __future__ import annotations

import numpy as np
from numba import njit

from macrofit.base.caches import ensure_cache
from macrofit.base.compiled import check_compiled

ensure_cache()  # numba looks for it where a kernel is declared

SKIN = 0.35
"""Reach of the neighbour list beyond contact, in mean radii."""


@njit(cache=True)
def neighbours(x, r, skin):
    """Pairs (i < j) whose gap |x_j - x_i| - r_i - r_j is below `skin` [mm]: array (n, 2), sorted by i.

    Cells as large as the farthest reach; a sphere looks in its own and the 26 around.
    """
    n = len(r)
    reach = 2.0 * r.max() + skin
    low = np.array([x[:, 0].min(), x[:, 1].min(), x[:, 2].min()])
    high = np.array([x[:, 0].max(), x[:, 1].max(), x[:, 2].max()])
    shape = np.empty(3, np.int64)
    for a in range(3):
        shape[a] = min(max(1, int((high[a] - low[a]) / reach)), 512)
    width = (high - low) / shape + 1e-300
    cell = np.empty(n, np.int64)
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(n):
        c = 0
        for a in range(3):
            c = c * shape[a] + min(shape[a] - 1, int((x[i, a] - low[a]) / width[a]))
        cell[i] = c
        start[c + 1] += 1
    start = np.cumsum(start)
    fill = start[:-1].copy()
    member = np.empty(n, np.int64)
    for i in range(n):
        member[fill[cell[i]]] = i
        fill[cell[i]] += 1
    pairs = np.empty((16 * n + 64, 2), np.int64)
    count = 0
    for i in range(n):
        cz = cell[i] % shape[2]
        cy = (cell[i] // shape[2]) % shape[1]
        cx = cell[i] // (shape[2] * shape[1])
        for ax in range(max(0, cx - 1), min(shape[0], cx + 2)):
            for ay in range(max(0, cy - 1), min(shape[1], cy + 2)):
                for az in range(max(0, cz - 1), min(shape[2], cz + 2)):
                    c = (ax * shape[1] + ay) * shape[2] + az
                    for m in range(start[c], start[c + 1]):
                        j = member[m]
                        if j <= i:
                            continue
                        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
                        limit = r[i] + r[j] + skin
                        if dx * dx + dy * dy + dz * dz < limit * limit:
                            if count == len(pairs):
                                larger = np.empty((2 * count, 2), np.int64)
                                larger[:count] = pairs
                                pairs = larger
                            pairs[count, 0] = i
                            pairs[count, 1] = j
                            count += 1
    return pairs[:count]


@njit(cache=True)
def wall_height(heights, dx, dy, x, y):
    """Height h and slopes (h_x, h_y) of the triangulated surface at (x, y), clamped at its border.

    Each cell is cut along the diagonal from (i, j) to (i + 1, j + 1), as `meso.surfaces.surface` does.
    """
    nx, ny = heights.shape
    s = min(max(x / dx, 0.0), nx - 1.0)
    t = min(max(y / dy, 0.0), ny - 1.0)
    i, j = min(int(s), nx - 2), min(int(t), ny - 2)
    s, t = s - i, t - j
    h00, h11 = heights[i, j], heights[i + 1, j + 1]
    if s >= t:
        corner = heights[i + 1, j]
        hx, hy = corner - h00, h11 - corner
    else:
        corner = heights[i, j + 1]
        hx, hy = h11 - corner, corner - h00
    return h00 + hx * s + hy * t, hx / dx, hy / dy


@njit(cache=True)
def _forces(x, r, pairs, size, thickness, heights, force):
    """Forces -dU/dx of U = sum of overlap^2 / 2 over pairs and walls; returns the mean contact force."""
    dx, dy = size[0] / (heights.shape[0] - 1), size[1] / (heights.shape[1] - 1)
    force[:] = 0.0
    total, contacts = 0.0, 0
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        ex, ey, ez = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        reach = r[i] + r[j]
        square = ex * ex + ey * ey + ez * ez
        if square < reach * reach:
            distance = np.sqrt(square) + 1e-300
            overlap = reach - distance
            s = overlap / distance
            force[i, 0] -= s * ex
            force[i, 1] -= s * ey
            force[i, 2] -= s * ez
            force[j, 0] += s * ex
            force[j, 1] += s * ey
            force[j, 2] += s * ez
            total += overlap
            contacts += 1
    for i in range(len(r)):
        for a in range(2):
            force[i, a] += max(0.0, r[i] - x[i, a]) - max(0.0, x[i, a] + r[i] - size[a])
        force[i, 2] += max(0.0, r[i] - x[i, 2])
        if x[i, 2] + 3.0 * r[i] > thickness + heights.min():
            h, hx, hy = wall_height(heights, dx, dy, x[i, 0], x[i, 1])
            nz = 1.0 / np.sqrt(1.0 + hx * hx + hy * hy)
            overlap = r[i] - (thickness + h - x[i, 2]) * nz
            if overlap > 0.0:
                force[i, 0] += overlap * nz * hx
                force[i, 1] += overlap * nz * hy
                force[i, 2] -= overlap * nz
    return total / max(1, contacts)


@njit(cache=True)
def quench(x, r, size, thickness, heights, iterations, tolerance):
    """Move the centres x (n, 3) in place to a minimum of the overlap energy by FIRE; returns the iterations used.

    Ends when the rms residual force is `tolerance` times the mean contact force, or after `iterations`.
    Bitzek et al. 2006, Phys. Rev. Lett. 97, 170201.
    """
    n = len(r)
    mean = r.mean()
    skin = SKIN * mean
    v = np.zeros((n, 3))
    force = np.zeros((n, 3))
    pairs = neighbours(x, r, skin)
    origin = x.copy()
    dt, alpha, uphill = 0.1, 0.1, 0
    for iteration in range(iterations):
        contact = _forces(x, r, pairs, size, thickness, heights, force)
        ff, vv, power = 0.0, 0.0, 0.0
        for i in range(n):
            for a in range(3):
                ff += force[i, a] * force[i, a]
                vv += v[i, a] * v[i, a]
                power += force[i, a] * v[i, a]
        if np.sqrt(ff / n) <= tolerance * contact or ff == 0.0:
            return iteration
        if power > 0.0:
            mix = alpha * np.sqrt(vv / ff)
            for i in range(n):
                for a in range(3):
                    v[i, a] = (1.0 - alpha) * v[i, a] + mix * force[i, a]
            uphill += 1
            if uphill > 5:
                dt = min(dt * 1.1, 0.45)
                alpha *= 0.99
        else:
            v[:] = 0.0
            dt, alpha, uphill = max(0.5 * dt, 0.02), 0.1, 0
        moved = 0.0
        for i in range(n):
            d = 0.0
            for a in range(3):
                v[i, a] += dt * force[i, a]
                x[i, a] += dt * v[i, a]
                d += (x[i, a] - origin[i, a]) ** 2
            moved = max(moved, d)
        if 4.0 * moved > skin * skin:
            pairs = neighbours(x, r, skin)
            origin[:] = x
    return iterations


@njit(cache=True)
def envelope(x, r, size, shape):
    """Highest point of the spheres above each node of a grid: heights (shape) [mm]; -inf where there is none.

    The node (i, j) stands at (i dx, j dy); a sphere covers it where (x - x_i)^2 + (y - y_i)^2 < r_i^2.
    """
    top = np.full(shape, -np.inf)
    dx, dy = size[0] / (shape[0] - 1), size[1] / (shape[1] - 1)
    for k in range(len(r)):
        i0, i1 = max(0, int(np.ceil((x[k, 0] - r[k]) / dx))), min(shape[0] - 1, int((x[k, 0] + r[k]) / dx))
        j0, j1 = max(0, int(np.ceil((x[k, 1] - r[k]) / dy))), min(shape[1] - 1, int((x[k, 1] + r[k]) / dy))
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                cap = r[k] ** 2 - (i * dx - x[k, 0]) ** 2 - (j * dy - x[k, 1]) ** 2
                if cap > 0.0:
                    top[i, j] = max(top[i, j], x[k, 2] + np.sqrt(cap))
    return top


check_compiled(envelope)
