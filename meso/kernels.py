"""Numba kernels of the sliding plates: the scalar laws first, then loops that only index.

Everything that calls each other stands in this one file: the cache of compiled code does not see other files change.

Arrays that several kernels share
---------------------------------
u, v, f : (n, 6)      displacement and rotation [mm, rad], their rates, force and moment [N, N mm]
rows, cols            half of the bonds in compressed rows: bond k of row i joins i to cols[k] > i
beams   : (bonds, 6)  axis e from i to j (3), 1 / length, EA / l [N/mm], EI / l [N mm]
anchored, anchors     nodes held by an external face (m,), and what holds each: stiffness along z and across [N/mm],
                      across to rotation [N], of rotation and of twist about z [N mm], (m, 5)
pair    : (p, 2)      wheel node, axle node of an encounter
apart   : (p, 3)      centre of the axle sphere minus that of the wheel sphere, before any motion [mm]
law     : (p, 4)      radius of the wheel sphere, of the axle sphere [mm], k_n, k_t [N/mm]
history : (p, 9)      of the last state: tangential force on the wheel sphere [N], displacement of the wheel sphere
                      against the axle's [mm], r_i t_i + r_j t_j [mm]; history[p, 0] = inf where they were apart
"""

from __future__ import annotations

import numpy as np
from numba import njit

FAST = {"contract", "nsz"}
"""Fused multiply-add is allowed, reordering is not: the same bits every time."""


@njit(cache=True, fastmath=FAST)
def beam(ex, ey, ez, per_length, axial, bending, twist, ui, uj):
    """Force on i (3), w (3) and h (3) of an Euler-Bernoulli beam; moments are w - h on i and -w - h on j.

    d = u_j - u_i, a = t_i + t_j less its part along e and less 2 (e x d)/l, M = 6 (EI/l) a:
    F_i = (EA/l)(d.e) e - (M x e)/l,  w = (EI/l)(t_j - t_i) + (G I_o/l - EI/l)((t_j - t_i).e) e,  h = M/2,
    with G I_o = EI/(1 + nu) and twist = -nu/(1 + nu). Andre et al. 2012, CMAME 213-216, 113-125, written without
    a local frame.
    """
    dx, dy, dz = uj[0] - ui[0], uj[1] - ui[1], uj[2] - ui[2]
    ax, ay, az = ui[3] + uj[3], ui[4] + uj[4], ui[5] + uj[5]
    wx, wy, wz = uj[3] - ui[3], uj[4] - ui[4], uj[5] - ui[5]
    de = dx * ex + dy * ey + dz * ez
    ae = ax * ex + ay * ey + az * ez
    we = twist * (wx * ex + wy * ey + wz * ez)
    two = 2.0 * per_length
    hx = 3.0 * bending * (ax - ae * ex - two * (ey * dz - ez * dy))
    hy = 3.0 * bending * (ay - ae * ey - two * (ez * dx - ex * dz))
    hz = 3.0 * bending * (az - ae * ez - two * (ex * dy - ey * dx))
    along = axial * de
    fx = along * ex - two * (hy * ez - hz * ey)
    fy = along * ey - two * (hz * ex - hx * ez)
    fz = along * ez - two * (hx * ey - hy * ex)
    wx, wy, wz = bending * (wx + we * ex), bending * (wy + we * ey), bending * (wz + we * ez)
    return fx, fy, fz, wx, wy, wz, hx, hy, hz


@njit(cache=True, fastmath=FAST)
def touch(dx, dy, dz, reach, normal_stiffness):
    """Unit normal n (3) from the wheel sphere to the axle sphere and the contact force f_n = k_n <reach - |d|> [N]."""
    square = dx * dx + dy * dy + dz * dz
    if square >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    distance = np.sqrt(square)
    return dx / distance, dy / distance, dz / distance, normal_stiffness * (reach - distance)


@njit(cache=True, fastmath=FAST)
def slide(nx, ny, nz, bound, stiffness, tx, ty, tz, sx, sy, sz):
    """Tangential force on the wheel sphere (3) and the work lost, after the step (sx, sy, sz) of its contact point.

    Trial: the old force and -k_t times the step, both projected on the plane of the new normal; then brought back
    to the bound mu f_n (Coulomb). The loss is the new force times the slip, (|trial| - bound)/k_t.
    """
    tx, ty, tz = tx - stiffness * sx, ty - stiffness * sy, tz - stiffness * sz
    tn = tx * nx + ty * ny + tz * nz
    tx, ty, tz = tx - tn * nx, ty - tn * ny, tz - tn * nz
    size = np.sqrt(tx * tx + ty * ty + tz * tz)
    if size <= bound:
        return tx, ty, tz, 0.0
    scale = bound / size
    return scale * tx, scale * ty, scale * tz, bound * (size - bound) / stiffness


@njit(cache=True, fastmath=FAST)
def anchor_forces(u, f, anchored, anchors):
    """Add the forces of the external faces: f_z -= k_n u_z, f_x -= k_s u_x + k_c t_y, f_y -= k_s u_y - k_c t_x,
    and the moments that belong to them."""
    for a in range(len(anchored)):
        i = anchored[a]
        kn, ks, kc, kr, kt = anchors[a, 0], anchors[a, 1], anchors[a, 2], anchors[a, 3], anchors[a, 4]
        f[i, 0] -= ks * u[i, 0] + kc * u[i, 4]
        f[i, 1] -= ks * u[i, 1] - kc * u[i, 3]
        f[i, 2] -= kn * u[i, 2]
        f[i, 3] -= kr * u[i, 3] - kc * u[i, 1]
        f[i, 4] -= kr * u[i, 4] + kc * u[i, 0]
        f[i, 5] -= kt * u[i, 5]


@njit(cache=True, fastmath=FAST)
def beam_forces(u, f, rows, cols, beams, anchored, anchors, twist):
    """Add the forces of all beams to f: f += -K u."""
    anchor_forces(u, f, anchored, anchors)
    for i in range(len(rows) - 1):
        for k in range(rows[i], rows[i + 1]):
            j = cols[k]
            b = beams[k]
            fx, fy, fz, wx, wy, wz, hx, hy, hz = beam(b[0], b[1], b[2], b[3], b[4], b[5], twist, u[i], u[j])
            f[i, 0] += fx
            f[i, 1] += fy
            f[i, 2] += fz
            f[i, 3] += wx - hx
            f[i, 4] += wy - hy
            f[i, 5] += wz - hz
            f[j, 0] -= fx
            f[j, 1] -= fy
            f[j, 2] -= fz
            f[j, 3] -= wx + hx
            f[j, 4] -= wy + hy
            f[j, 5] -= wz + hz


@njit(cache=True, fastmath=FAST)
def contact_forces(u, f, live, pair, apart, law, history, micro_friction, ox, oy, oz, total):
    """Add the forces of the live encounters to f, move their history on, and sum.

    (ox, oy, oz) is how far the wheel has been carried [mm]. Adds to total[0:3] the force on the wheel [N] and to
    total[3] the work lost in friction [N mm].
    """
    for q in range(len(live)):
        p = live[q]
        i, j = pair[p, 0], pair[p, 1]
        px, py, pz = ox + u[i, 0] - u[j, 0], oy + u[i, 1] - u[j, 1], oz + u[i, 2] - u[j, 2]
        ri, rj, kn, kt = law[p, 0], law[p, 1], law[p, 2], law[p, 3]
        nx, ny, nz, fn = touch(apart[p, 0] - px, apart[p, 1] - py, apart[p, 2] - pz, ri + rj, kn)
        if fn <= 0.0:
            history[p, 0] = np.inf
            continue
        rx = ri * u[i, 3] + rj * u[j, 3]
        ry = ri * u[i, 4] + rj * u[j, 4]
        rz = ri * u[i, 5] + rj * u[j, 5]
        tx, ty, tz, lost = 0.0, 0.0, 0.0, 0.0  # a new touch begins without a tangential force
        if history[p, 0] != np.inf:
            ax, ay, az = rx - history[p, 6], ry - history[p, 7], rz - history[p, 8]
            tx, ty, tz, lost = slide(
                nx, ny, nz, micro_friction * fn, kt,
                history[p, 0], history[p, 1], history[p, 2],
                px - history[p, 3] + ay * nz - az * ny,
                py - history[p, 4] + az * nx - ax * nz,
                pz - history[p, 5] + ax * ny - ay * nx,
            )  # fmt: skip
        history[p, 0], history[p, 1], history[p, 2] = tx, ty, tz
        history[p, 3], history[p, 4], history[p, 5] = px, py, pz
        history[p, 6], history[p, 7], history[p, 8] = rx, ry, rz
        mx, my, mz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        fx, fy, fz = tx - fn * nx, ty - fn * ny, tz - fn * nz
        f[i, 0] += fx
        f[i, 1] += fy
        f[i, 2] += fz
        f[i, 3] += ri * mx
        f[i, 4] += ri * my
        f[i, 5] += ri * mz
        f[j, 0] -= fx
        f[j, 1] -= fy
        f[j, 2] -= fz
        f[j, 3] += rj * mx
        f[j, 4] += rj * my
        f[j, 5] += rj * mz
        total[0] += fx
        total[1] += fy
        total[2] += fz
        total[3] += lost


@njit(cache=True, fastmath=FAST)
def move(u, v, f, rows, cols, beams, anchored, anchors, twist, inverse, dt, damping):
    """Beam forces and one leapfrog step, in one pass over memory; f is left at zero; returns sum of m v^2 [N mm].

    v+ = ((1 - c dt/2) v- + dt f/m) / (1 + c dt/2), u+ = u + dt v+; inverse (n, 2) is 1/m and 1/I.
    A row holds the bonds to later nodes only: when row i is done, node i is complete, and no later row reads it.
    """
    anchor_forces(u, f, anchored, anchors)
    keep = (1.0 - 0.5 * damping * dt) / (1.0 + 0.5 * damping * dt)
    push = dt / (1.0 + 0.5 * damping * dt)
    twice_kinetic = 0.0
    for i in range(len(rows) - 1):
        ui = u[i]
        f0, f1, f2, f3, f4, f5 = f[i, 0], f[i, 1], f[i, 2], f[i, 3], f[i, 4], f[i, 5]
        for k in range(rows[i], rows[i + 1]):
            j = cols[k]
            b = beams[k]
            fx, fy, fz, wx, wy, wz, hx, hy, hz = beam(b[0], b[1], b[2], b[3], b[4], b[5], twist, ui, u[j])
            f0 += fx
            f1 += fy
            f2 += fz
            f3 += wx - hx
            f4 += wy - hy
            f5 += wz - hz
            f[j, 0] -= fx
            f[j, 1] -= fy
            f[j, 2] -= fz
            f[j, 3] -= wx + hx
            f[j, 4] -= wy + hy
            f[j, 5] -= wz + hz
        per_mass, per_inertia = push * inverse[i, 0], push * inverse[i, 1]
        v0, v1, v2 = keep * v[i, 0] + per_mass * f0, keep * v[i, 1] + per_mass * f1, keep * v[i, 2] + per_mass * f2
        v3 = keep * v[i, 3] + per_inertia * f3
        v4 = keep * v[i, 4] + per_inertia * f4
        v5 = keep * v[i, 5] + per_inertia * f5
        twice_kinetic += (v0 * v0 + v1 * v1 + v2 * v2) / inverse[i, 0] + (v3 * v3 + v4 * v4 + v5 * v5) / inverse[i, 1]
        v[i, 0], v[i, 1], v[i, 2], v[i, 3], v[i, 4], v[i, 5] = v0, v1, v2, v3, v4, v5
        u[i, 0] += dt * v0
        u[i, 1] += dt * v1
        u[i, 2] += dt * v2
        u[i, 3] += dt * v3
        u[i, 4] += dt * v4
        u[i, 5] += dt * v5
        f[i, 0], f[i, 1], f[i, 2], f[i, 3], f[i, 4], f[i, 5] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return twice_kinetic


@njit(cache=True, fastmath=FAST)
def march(
    u, v, f, rows, cols, beams, anchored, anchors, twist, inverse, dt, damping,
    first, last, pair, apart, law, history, micro_friction, window, live,
    drive, speed, target, compliance, steps, total,
):  # fmt: skip
    """`steps` leapfrog steps of both plates while the wheel is carried along; returns the number of live encounters.

    drive (3,): where the wheel is [mm], moved in place by speed (3,) [mm/s]; with target > 0 its height follows the
    normal force instead, dz/dt = compliance (N - target). Encounters are sorted by `first`, the slide at which they
    may begin; window (2,) holds the next one to begin and the number alive, `live` their numbers.
    total (7,): sums over the steps of the force on the wheel (3) [N], work lost in friction, in damping, work done
    by the drive [N mm], and at its end twice the kinetic energy of the last step [N mm].
    """
    sums = np.zeros(4)
    for _ in range(steps):
        drive[0] += dt * speed[0]
        drive[1] += dt * speed[1]
        drive[2] += dt * speed[2]
        while window[0] < len(first) and first[window[0]] <= drive[0]:
            live[window[1]] = window[0]
            window[0] += 1
            window[1] += 1
        q = 0
        while q < window[1]:
            if last[live[q]] < drive[0]:
                window[1] -= 1
                live[q] = live[window[1]]
            else:
                q += 1
        sums[:] = 0.0
        contact_forces(
            u, f, live[: window[1]], pair, apart, law, history, micro_friction, drive[0], drive[1], drive[2], sums
        )
        vz = speed[2]
        if target > 0.0:
            vz = compliance * (sums[2] - target)
            drive[2] += dt * vz
        total[0] += sums[0]
        total[1] += sums[1]
        total[2] += sums[2]
        total[3] += sums[3]
        total[5] -= dt * (sums[0] * speed[0] + sums[1] * speed[1] + sums[2] * vz)
        twice_kinetic = move(u, v, f, rows, cols, beams, anchored, anchors, twist, inverse, dt, damping)
        total[4] += dt * damping * twice_kinetic
        total[6] = twice_kinetic
    return window[1]


@njit(cache=True)
def first_touch(wheel, wheel_radii, axle, axle_radii, order, x):
    """Height of the wheel's plate at which it first touches the axle's when carried to slide x [mm]; -inf if never.

    order: the axle's spheres sorted by y.
    """
    y = axle[order, 1]
    widest = axle_radii.max()
    height = -np.inf
    for i in range(len(wheel)):
        reach = wheel_radii[i] + widest
        for q in range(np.searchsorted(y, wheel[i, 1] - reach), np.searchsorted(y, wheel[i, 1] + reach)):
            j = order[q]
            dx, dy = axle[j, 0] - wheel[i, 0] - x, axle[j, 1] - wheel[i, 1]
            square = (wheel_radii[i] + axle_radii[j]) ** 2 - dx * dx - dy * dy
            if square > 0.0:
                height = max(height, axle[j, 2] - wheel[i, 2] + np.sqrt(square))
    return height


@njit(cache=True)
def meetings(wheel, wheel_radii, axle, axle_radii, order, low, high, travel, margin):
    """Pairs that may touch while the wheel is carried from x = 0 to `travel`, its height within low ... high [mm].

    Returns the pairs (p, 2) and the slides (p, 2) between which their gap may be below `margin` [mm].
    """
    y = axle[order, 1]
    widest = axle_radii.max()
    pairs = np.empty((64 * len(wheel), 2), np.int64)
    spans = np.empty((64 * len(wheel), 2))
    count = 0
    for i in range(len(wheel)):
        reach = wheel_radii[i] + widest + margin
        for q in range(np.searchsorted(y, wheel[i, 1] - reach), np.searchsorted(y, wheel[i, 1] + reach)):
            j = order[q]
            dz = wheel[i, 2] - axle[j, 2]
            dz = max(0.0, dz + low, -dz - high)
            dy = axle[j, 1] - wheel[i, 1]
            square = (wheel_radii[i] + axle_radii[j] + margin) ** 2 - dy * dy - dz * dz
            if square <= 0.0:
                continue
            middle, half = axle[j, 0] - wheel[i, 0], np.sqrt(square)
            if middle + half < 0.0 or middle - half > travel:
                continue
            if count == len(pairs):
                more = np.empty((2 * count, 2), np.int64)
                more[:count] = pairs
                pairs = more
                wider = np.empty((2 * count, 2))
                wider[:count] = spans
                spans = wider
            pairs[count, 0] = i
            pairs[count, 1] = j
            spans[count, 0] = middle - half
            spans[count, 1] = middle + half
            count += 1
    return pairs[:count], spans[:count]
