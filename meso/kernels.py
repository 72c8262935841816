"""Numba kernels of the sliding plates: the laws first, then loops that only index.

Everything that calls each other stands in this one file: the cache of compiled code does not see other files change.

Arrays that several kernels share
---------------------------------
u, v, f : (n, 6)      displacement and rotation [mm, rad], their rates, force and moment [N, N mm]; while time runs
                      each sphere has a line of 64 bytes, (lines, 8), in the order of `blocks` (`meso.lattice.blocks`)
rows, cols            half of the bonds in compressed rows: bond k of row i joins i to cols[k] > i
beams   : (bonds, 6)  axis e from i to j (3), 1 / length, EA / l [N/mm], EI / l [N mm]
anchored, anchors     nodes held by an external face (m,), and what holds each: stiffness along z and across [N/mm],
                      across to rotation [N], of rotation and of twist about z [N mm], (m, 5)
pair    : (p, 2)      wheel node, axle node of an candidate
offset  : (p, 3)      centre of the axle sphere minus that of the wheel sphere, before any motion [mm]
parameters : (p, 4)   of each contact, see the columns below
history : (p, 9)      of the last state: tangential force on the wheel sphere [N], displacement of the wheel sphere
                      against the axle's [mm], r_i t_i + r_j t_j [mm]; history[p, 0] = inf where they were apart
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from macrofit.base.caches import ensure_cache
from macrofit.base.compiled import check_compiled

ensure_cache()  # numba looks for it where a kernel is declared

FAST = {"contract", "nsz"}
"""Fused multiply-add is allowed, reordering is not: the same bits every time on one processor."""
EXACT = False
"""Only what is written as `fma` is fused: the same bits on every processor. Said, or a caller's would be taken over."""

WHEEL, AXLE = range(2)
"""Columns of pair: the wheel's node, the axle's."""
WHEEL_RADIUS, AXLE_RADIUS, NORMAL_STIFFNESS, TANGENTIAL_STIFFNESS = range(4)
"""Columns of the contact parameters: radii of both spheres [mm], k_n, k_t [N/mm]."""
AXIS_X, AXIS_Y, AXIS_Z, PER_LENGTH, AXIAL, BENDING = range(6)
"""Columns of beams: axis from i to j, 1/length [1/mm], EA/l [N/mm], EI/l [N mm]."""
ALONG, ACROSS, COUPLING, ROTATION, TORSION = range(5)
"""Columns of anchors: stiffness along z and across [N/mm], across to rotation [N], of rotation and twist [N mm]."""
PER_AREA, PER_MODULUS, TENSILE_STRENGTH, SHEAR_STRENGTH = range(4)
"""Columns of section: 1/S [1/mm2], r/I [1/mm3], strengths [MPa]."""

# --- eight numbers at once -------------------------------------------------------------------------------------------
#
# `Lanes` are eight doubles in one register, or in as many as the processor needs for them. Nothing is reordered, and
# only what is written with `fma` is rounded once: the same bits on every processor. The laws below take numbers or
# lanes.

WIDTH = 8
"""Lanes, and doubles in the line of 64 bytes of a sphere."""
EIGHT = ir.VectorType(ir.DoubleType(), WIDTH)
INT = ir.IntType(32)


class Lanes(types.Type):
    """Eight doubles."""


LANES = Lanes(name="Lanes")


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):
    """Lanes are a vector of LLVM."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, EIGHT)


def picked(builder: Any, a: Any, b: Any, numbers: Sequence[int]) -> Any:
    """Lanes of a (0 to 7) and b (8 to 15) by their numbers."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT, WIDTH), numbers))


def transposed(builder: Any, rows: Sequence[Any]) -> Sequence[Any]:
    """The columns of eight rows, in three rounds: of pairs, fours and eights."""
    rounds = {
        1: ((0, 8, 2, 10, 4, 12, 6, 14), (1, 9, 3, 11, 5, 13, 7, 15)),
        2: ((0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)),
        4: ((0, 1, 2, 3, 8, 9, 10, 11), (4, 5, 6, 7, 12, 13, 14, 15)),
    }
    for reach, (low, high) in rounds.items():
        merged = list(rows)
        for k in (k for k in range(WIDTH) if not k & reach):
            merged[k] = picked(builder, rows[k], rows[k + reach], low)
            merged[k + reach] = picked(builder, rows[k], rows[k + reach], high)
        rows = merged
    return rows


def pointer(context: Any, builder: Any, kind: Any, array: Any, at: Any, line: int = 0) -> Any:
    """Where eight doubles of an array stand, from element at + 8 line of its memory on."""
    data = context.make_array(kind)(context, builder, array).data
    place = builder.add(at, ir.Constant(at.type, WIDTH * line))
    return builder.bitcast(builder.gep(data, [place]), EIGHT.as_pointer())


@intrinsic
def load(typing, array, at):
    """Eight doubles of an array, from element `at` of its memory on."""

    def emit(context: Any, builder: Any, called_as: Any, values: Any) -> Any:
        return builder.load(pointer(context, builder, called_as.args[0], *values), align=8)

    return LANES(array, types.intp), emit


@intrinsic
def store(typing, array, at, value):
    """Write eight doubles into an array, from element `at` of its memory on."""

    def emit(context: Any, builder: Any, called_as: Any, values: Any) -> Any:
        builder.store(values[2], pointer(context, builder, called_as.args[0], *values[:2]), align=8)

    return types.void(array, types.intp, LANES), emit


@intrinsic
def load_lines(typing, lines, index, at):
    """The lines of eight spheres, which begin where index[at : at + 8] of the flat index tells: eight times lanes."""

    def emit(context: Any, builder: Any, called_as: Any, values: Any) -> Any:
        lines, index, at = values
        data = context.make_array(called_as.args[1])(context, builder, index).data
        places = [builder.gep(data, [builder.add(at, ir.Constant(at.type, k))]) for k in range(WIDTH)]
        starts = [builder.zext(builder.load(place), at.type) for place in places]
        rows = [pointer(context, builder, called_as.args[0], lines, start) for start in starts]
        return cgutils.pack_array(builder, transposed(builder, [builder.load(row, align=8) for row in rows]), EIGHT)

    return types.UniTuple(LANES, WIDTH)(lines, index, types.intp), emit


@intrinsic
def load_block(typing, lines, at):
    """The lines of eight spheres that follow each other, from element `at` on: eight times lanes."""

    def emit(context: Any, builder: Any, called_as: Any, values: Any) -> Any:
        rows = [pointer(context, builder, called_as.args[0], values[0], values[1], line) for line in range(WIDTH)]
        return cgutils.pack_array(builder, transposed(builder, [builder.load(row, align=8) for row in rows]), EIGHT)

    return types.UniTuple(LANES, WIDTH)(lines, types.intp), emit


@intrinsic
def store_block(typing, lines, at, columns):
    """Write the lines of eight spheres that follow each other, from element `at` on."""

    def emit(context: Any, builder: Any, called_as: Any, values: Any) -> Any:
        for line, row in enumerate(transposed(builder, cgutils.unpack_tuple(builder, values[2]))):
            builder.store(row, pointer(context, builder, called_as.args[0], values[0], values[1], line), align=8)

    return types.void(lines, types.intp, columns), emit


def operation(kind: Any, write: Callable[..., Any]) -> Any:
    """An operation on one to three lanes or numbers with a result of this kind; `write` (builder, a, ...) emits it."""

    def written(*kinds: Any) -> Any:
        return kind(*kinds), lambda context, builder, called_as, values: write(builder, *values)

    by_count = (lambda _, a: written(a), lambda _, a, b: written(a, b), lambda _, a, b, c: written(a, b, c))
    return intrinsic(by_count[len(signature(write).parameters) - 2])


def called(builder: Any, name: str, *values: Any) -> Any:
    """A function of LLVM of doubles or of lanes."""
    kind = values[0].type
    function = ir.FunctionType(kind, [kind] * len(values))
    name = f"llvm.{name}.{'v8f64' if kind == EIGHT else 'f64'}"
    return builder.call(cgutils.get_or_insert_function(builder.module, function, name), values)


def spread_out(builder: Any, number: Any) -> Any:
    """Eight times the same number."""
    one = builder.insert_element(ir.Constant(EIGHT, ir.Undefined), number, ir.Constant(INT, 0))
    return picked(builder, one, one, [0] * WIDTH)


def chosen(builder: Any, which: Any, a: Any, b: Any) -> Any:
    """Lanes of a where `which` is not zero, otherwise of b."""
    return builder.select(builder.fcmp_ordered("!=", which, ir.Constant(EIGHT, [0.0] * WIDTH)), a, b)


spread = operation(LANES, spread_out)
lane_of = operation(types.float64, lambda builder, a, number: builder.extract_element(a, number))
either = operation(LANES, chosen)
fused_numbers = operation(types.float64, lambda builder, a, b, c: called(builder, "fma", a, b, c))
fused_lanes = operation(LANES, lambda builder, a, b, c: called(builder, "fma", a, b, c))
negative = operation(LANES, lambda builder, a: builder.fneg(a))
roots = operation(LANES, lambda builder, a: called(builder, "sqrt", a))
with_signs = operation(LANES, lambda builder, a, b: called(builder, "copysign", spread_out(builder, a), b))
larger = operation(LANES, lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))


def fma(a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once where it is compiled; a number may multiply lanes."""
    return a * b + c


@overload(fma, jit_options={"fastmath": EXACT})
def _fma(a, b, c):
    if b is not LANES:
        return lambda a, b, c: fused_numbers(a, b, c)
    return (lambda a, b, c: fused_lanes(a, b, c)) if a is LANES else (lambda a, b, c: fused_lanes(spread(a), b, c))


def overload_of_one(function: Any, implementation: Any) -> None:
    """Let a function of one number take lanes."""

    @overload(function, jit_options={"fastmath": EXACT})
    def _(a):
        return (lambda a: implementation(a)) if a is LANES else None


def overload_of_two(function: Any, implementation: Any) -> None:
    """Let a function of two numbers take lanes, or lanes and a number."""

    @overload(function, jit_options={"fastmath": EXACT})
    def _(a, b):
        if a is LANES and b is LANES:
            return lambda a, b: implementation(a, b)
        if a is LANES and isinstance(b, types.Float):
            return lambda a, b: implementation(a, spread(b))
        if isinstance(a, types.Float) and b is LANES:
            return lambda a, b: implementation(spread(a), b)
        return None


overload_of_one(operator.neg, negative)
overload_of_one(np.sqrt, roots)
overload_of_two(operator.add, operation(LANES, lambda builder, a, b: builder.fadd(a, b)))
overload_of_two(operator.sub, operation(LANES, lambda builder, a, b: builder.fsub(a, b)))
overload_of_two(operator.mul, operation(LANES, lambda builder, a, b: builder.fmul(a, b)))
overload_of_two(operator.truediv, operation(LANES, lambda builder, a, b: builder.fdiv(a, b)))
overload_of_two(max, larger)


@overload(math.copysign, jit_options={"fastmath": EXACT})
def _copysign(a, b):
    return (lambda a, b: with_signs(a, b)) if b is LANES else None


# --- explicit slides -------------------------------------------------------------------------------------------------


@njit(cache=True, fastmath=EXACT, forceinline=True)
def dot(ax, ay, az, bx, by, bz):
    """a.b of two vectors of numbers or of lanes."""
    return fma(az, bz, fma(ay, by, ax * bx))


@njit(cache=True, fastmath=EXACT, forceinline=True)
def beam(ex, ey, ez, per_length, axial, bending, twist, ui, uj):
    """Force on i (3), w (3) and h (3) of an Euler-Bernoulli beam; moments are w - h on i and -w - h on j.

    d = u_j - u_i, a = t_i + t_j less its part along e and less 2 (e x d)/l, M = 6 (EI/l) a:
    F_i = (EA/l)(d.e) e - (M x e)/l,  w = (EI/l)(t_j - t_i) + (G I_o/l - EI/l)((t_j - t_i).e) e,  h = M/2,
    with G I_o = EI/(1 + nu) and twist = -nu/(1 + nu). Andre et al. 2012, CMAME 213-216, 113-125, written without
    a local frame. For numbers and for lanes.
    """
    dx, dy, dz = uj[0] - ui[0], uj[1] - ui[1], uj[2] - ui[2]
    ax, ay, az = ui[3] + uj[3], ui[4] + uj[4], ui[5] + uj[5]
    wx, wy, wz = uj[3] - ui[3], uj[4] - ui[4], uj[5] - ui[5]
    along = axial * dot(dx, dy, dz, ex, ey, ez)
    back = -dot(ax, ay, az, ex, ey, ez)
    we = twist * dot(wx, wy, wz, ex, ey, ez)
    two, three = 2.0 * per_length, 3.0 * bending
    ox, oy, oz = two * ex, two * ey, two * ez
    hx = three * fma(oz, dy, fma(-oy, dz, fma(back, ex, ax)))
    hy = three * fma(ox, dz, fma(-oz, dx, fma(back, ey, ay)))
    hz = three * fma(oy, dx, fma(-ox, dy, fma(back, ez, az)))
    fx = fma(along, ex, fma(hz, oy, -(hy * oz)))
    fy = fma(along, ey, fma(hx, oz, -(hz * ox)))
    fz = fma(along, ez, fma(hy, ox, -(hx * oy)))
    wx, wy, wz = bending * fma(we, ex, wx), bending * fma(we, ey, wy), bending * fma(we, ez, wz)
    return fx, fy, fz, wx, wy, wz, hx, hy, hz


@njit(cache=True, fastmath=EXACT)
def touch(dx, dy, dz, reach, normal_stiffness):
    """Unit normal n (3) from the wheel sphere to the axle sphere and the contact force f_n = k_n <reach - |d|> [N]."""
    square = dx * dx + dy * dy + dz * dz
    if square >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    distance = np.sqrt(square)
    return dx / distance, dy / distance, dz / distance, normal_stiffness * (reach - distance)


@njit(cache=True, fastmath=EXACT)
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


@njit(cache=True, fastmath=EXACT, forceinline=True)
def anchor(kn, ks, kc, kr, kt, ui):
    """Force and moment (6) of an external face on a sphere; numbers or lanes.

    f_z = -k_n u_z, f_x = -k_s u_x - k_c t_y, f_y = -k_s u_y + k_c t_x, and the moments that belong to them.
    """
    return (
        -fma(kc, ui[4], ks * ui[0]),
        fma(kc, ui[3], -(ks * ui[1])),
        -(kn * ui[2]),
        fma(kc, ui[1], -(kr * ui[3])),
        -fma(kc, ui[0], kr * ui[4]),
        -(kt * ui[5]),
    )


@njit(cache=True, fastmath=EXACT)
def beam_forces(u, f, rows, cols, beams, anchored, anchors, twist):
    """Add the forces of all beams to f: f += -K u."""
    for a in range(len(anchored)):
        i, s = anchored[a], anchors[a]
        f0, f1, f2, f3, f4, f5 = anchor(s[ALONG], s[ACROSS], s[COUPLING], s[ROTATION], s[TORSION], u[i])
        f[i, 0] += f0
        f[i, 1] += f1
        f[i, 2] += f2
        f[i, 3] += f3
        f[i, 4] += f4
        f[i, 5] += f5
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


@njit(cache=True, fastmath=EXACT)
def contact_forces(u, f, pushed, live, pair, offset, parameters, history, micro_friction, ox, oy, oz, total):
    """Add the forces of the live candidates to f, move their history on, and sum; u and f in lines.

    pushed (blocks,) is set where f is not zero.

    (ox, oy, oz) is how far the wheel has been carried [mm]. Adds to total[0:3] the force on the wheel [N] and to
    total[3] the work lost in friction [N mm].
    """
    for q in range(len(live)):
        p = live[q]
        i, j = pair[p, WHEEL], pair[p, AXLE]
        px, py, pz = ox + u[i, 0] - u[j, 0], oy + u[i, 1] - u[j, 1], oz + u[i, 2] - u[j, 2]
        ri, rj, kn, kt = (
            parameters[p, WHEEL_RADIUS],
            parameters[p, AXLE_RADIUS],
            parameters[p, NORMAL_STIFFNESS],
            parameters[p, TANGENTIAL_STIFFNESS],
        )
        nx, ny, nz, fn = touch(offset[p, 0] - px, offset[p, 1] - py, offset[p, 2] - pz, ri + rj, kn)
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
        pushed[i // WIDTH], pushed[j // WIDTH] = True, True
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


@njit(cache=True, fastmath=EXACT)
def zeros_in_lines(count):
    """Zeros (count, 8), each row within one line of the processor's cache."""
    memory = np.zeros((count + 1) * WIDTH)
    skip = -(memory.ctypes.data // 8) % WIDTH
    return memory[skip : skip + count * WIDTH].reshape(-1, WIDTH)


@njit(cache=True, fastmath=EXACT)
def lines_of(values, place, count):
    """Values (n, k) of the spheres in their lines, (count, 8)."""
    lines = zeros_in_lines(count)
    for i in range(len(values)):
        for k in range(values.shape[1]):
            lines[place[i], k] = values[i, k]
    return lines


@njit(cache=True, fastmath=EXACT)
def take_lines(lines, place, values):
    """Values (n, k) of the spheres out of their lines."""
    for i in range(len(values)):
        for k in range(values.shape[1]):
            values[i, k] = lines[place[i], k]


@njit(cache=True, fastmath=EXACT)
def lanes_of(values, place, count):
    """Values (n, 6) of the spheres in lanes: six rows of eight for every block."""
    lanes = zeros_in_lines(6 * count // WIDTH)
    for i in range(len(values)):
        block, lane = place[i] // WIDTH, place[i] % WIDTH
        for k in range(6):
            lanes[6 * block + k, lane] = values[i, k]
    return lanes


@njit(cache=True, fastmath=EXACT)
def take_lanes(lanes, place, values):
    """Values (n, 6) of the spheres out of their lanes."""
    for i in range(len(values)):
        block, lane = place[i] // WIDTH, place[i] % WIDTH
        for k in range(6):
            values[i, k] = lanes[6 * block + k, lane]


@njit(cache=True, fastmath=EXACT)
def largest_of(values):
    """The largest of lanes."""
    largest = lane_of(values, 0)
    for k in range(1, WIDTH):
        largest = max(largest, lane_of(values, k))
    return largest


@njit(cache=True, fastmath=EXACT, forceinline=True)
def store_six(lanes, block, v0, v1, v2, v3, v4, v5):
    """Write the six values of the spheres of a block in lanes."""
    at = 6 * WIDTH * block
    store(lanes, at, v0)
    store(lanes, at + WIDTH, v1)
    store(lanes, at + 2 * WIDTH, v2)
    store(lanes, at + 3 * WIDTH, v3)
    store(lanes, at + 4 * WIDTH, v4)
    store(lanes, at + 5 * WIDTH, v5)


@njit(cache=True, fastmath=EXACT)
def total_of(values):
    """The sum of eight lanes."""
    return ((lane_of(values, 0) + lane_of(values, 1)) + (lane_of(values, 2) + lane_of(values, 3))) + (
        (lane_of(values, 4) + lane_of(values, 5)) + (lane_of(values, 6) + lane_of(values, 7))
    )


@njit(cache=True, fastmath=EXACT, forceinline=True)
def row(values, number):
    """A row of an array of rows of eight."""
    return load(values, WIDTH * number)


@njit(cache=True, fastmath=EXACT, forceinline=True)
def forces_before(f, pushed, block, held, anchors, ui):
    """Forces and moments (6) on the spheres of a block from contacts, which are left at zero, and external faces."""
    f0, f1, f2, f3, f4, f5 = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    if pushed[block]:
        pushed[block] = False
        at, nothing = WIDTH * WIDTH * block, spread(0.0)
        f0, f1, f2, f3, f4, f5, _, _ = load_block(f, at)
        store_block(f, at, (nothing, nothing, nothing, nothing, nothing, nothing, nothing, nothing))
    if held[block] >= 0:
        a = 5 * held[block]
        g0, g1, g2, g3, g4, g5 = anchor(
            row(anchors, a + ALONG),
            row(anchors, a + ACROSS),
            row(anchors, a + COUPLING),
            row(anchors, a + ROTATION),
            row(anchors, a + TORSION),
            ui,
        )
        f0, f1, f2, f3, f4, f5 = f0 + g0, f1 + g1, f2 + g2, f3 + g3, f4 + g4, f5 + g5
    return f0, f1, f2, f3, f4, f5


@njit(cache=True, fastmath=EXACT)
def leapfrog_step(old, new, v, f, pushed, blocks, twist, dt, damping):
    """Beam forces and one leapfrog step, in one pass over memory; f is left at zero; returns sum of m v^2 [N mm].

    v+ = ((1 - c dt/2) v- + dt f/m) / (1 + c dt/2), new = old + dt v+. Eight spheres at once, each of which asks all
    its beams for the force on it alone: no sphere writes to another.
    """
    keep = spread((1.0 - 0.5 * damping * dt) / (1.0 + 0.5 * damping * dt))
    push = dt / (1.0 + 0.5 * damping * dt)
    step, nothing = spread(dt), spread(0.0)
    twice_kinetic = nothing
    for block in range(len(blocks.start) - 1):
        ui = load_block(old, WIDTH * WIDTH * block)
        f0, f1, f2, f3, f4, f5 = forces_before(f, pushed, block, blocks.held, blocks.anchors, ui)
        for k in range(blocks.start[block], blocks.start[block + 1]):
            b = 6 * k
            fx, fy, fz, wx, wy, wz, hx, hy, hz = beam(
                row(blocks.beams, b + AXIS_X),
                row(blocks.beams, b + AXIS_Y),
                row(blocks.beams, b + AXIS_Z),
                row(blocks.beams, b + PER_LENGTH),
                row(blocks.beams, b + AXIAL),
                row(blocks.beams, b + BENDING),
                twist,
                ui,
                load_lines(old, blocks.others, WIDTH * k),
            )
            f0, f1, f2 = f0 + fx, f1 + fy, f2 + fz
            f3, f4, f5 = f3 + (wx - hx), f4 + (wy - hy), f5 + (wz - hz)
        mass, inertia = row(blocks.mass, 2 * block), row(blocks.mass, 2 * block + 1)
        per_mass, per_inertia = push / mass, push / inertia
        b = 6 * block
        v0 = fma(per_mass, f0, keep * row(v, b))
        v1 = fma(per_mass, f1, keep * row(v, b + 1))
        v2 = fma(per_mass, f2, keep * row(v, b + 2))
        v3 = fma(per_inertia, f3, keep * row(v, b + 3))
        v4 = fma(per_inertia, f4, keep * row(v, b + 4))
        v5 = fma(per_inertia, f5, keep * row(v, b + 5))
        twice_kinetic = fma(mass, dot(v0, v1, v2, v0, v1, v2), twice_kinetic)
        twice_kinetic = fma(inertia, dot(v3, v4, v5, v3, v4, v5), twice_kinetic)
        store_six(v, block, v0, v1, v2, v3, v4, v5)
        store_block(
            new,
            WIDTH * WIDTH * block,
            (
                fma(step, v0, ui[0]),
                fma(step, v1, ui[1]),
                fma(step, v2, ui[2]),
                fma(step, v3, ui[3]),
                fma(step, v4, ui[4]),
                fma(step, v5, ui[5]),
                nothing,
                nothing,
            ),
        )
    return total_of(twice_kinetic)


@njit(cache=True, fastmath=EXACT)
def run_leapfrog(
    u, v, blocks, twist, dt, damping, first, last, pair, offset, parameters, history, micro_friction, window, live,
    drive, speed, target, carriage, steps, total,
):  # fmt: skip
    """`steps` leapfrog steps of both plates while the wheel is carried along; returns the number of live candidates.

    u, v (n, 6) are in the order of the spheres, pair (p, 2) holds the places of both in `blocks`.
    drive (3,): where the wheel is [mm], moved in place by speed (3,) [mm/s]. With target > 0 [N] the carriage falls
    freely under that load: m dv_z/dt = N - target - c v_z with carriage = (m [t], c [N s/mm]). Candidates are sorted
    by `first`, the slide at which they may begin; window (2,) holds the next one to begin and the number alive,
    `live` their numbers.
    total (7,): sums over the steps of the force on the wheel (3) [N], work lost in friction, in damping, work done
    by the drive [N mm], and at its end twice the kinetic energy of the last step [N mm].
    """
    count = WIDTH * (len(blocks.start) - 1)
    old, rates = lines_of(u, blocks.place, count), lanes_of(v, blocks.place, count)
    new, f, pushed = zeros_in_lines(count), zeros_in_lines(count), np.zeros(count // WIDTH, np.bool_)
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
            old, f, pushed, live[: window[1]], pair, offset, parameters, history, micro_friction,
            drive[0], drive[1], drive[2], sums,
        )  # fmt: skip
        if target > 0.0:
            speed[2] += dt * (sums[2] - target - carriage[1] * speed[2]) / carriage[0]
        total[0] += sums[0]
        total[1] += sums[1]
        total[2] += sums[2]
        total[3] += sums[3]
        total[5] -= dt * (sums[0] * speed[0] + sums[1] * speed[1] + sums[2] * speed[2])
        twice_kinetic = leapfrog_step(old, new, rates, f, pushed, blocks, twist, dt, damping)
        old, new = new, old
        total[4] += dt * damping * twice_kinetic
        total[6] = twice_kinetic
    take_lines(old, blocks.place, u)
    take_lanes(rates, blocks.place, v)
    return window[1]


@njit(cache=True, fastmath=EXACT)
def leapfrog(u, v, blocks, twist, dt, damping, steps):
    """`steps` leapfrog steps of a lattice by itself, u and v (n, 6); returns sum of m v^2 in the last one [N mm]."""
    count = WIDTH * (len(blocks.start) - 1)
    old, rates = lines_of(u, blocks.place, count), lanes_of(v, blocks.place, count)
    new, f, pushed = zeros_in_lines(count), zeros_in_lines(count), np.zeros(count // WIDTH, np.bool_)
    twice_kinetic = 0.0
    for _ in range(steps):
        twice_kinetic = leapfrog_step(old, new, rates, f, pushed, blocks, twist, dt, damping)
        old, new = new, old
    take_lines(old, blocks.place, u)
    take_lanes(rates, blocks.place, v)
    return twice_kinetic


# --- quasi-static slides: both plates condensed on the spheres that may meet -----------------------------------------


@njit(cache=True, fastmath=FAST)
def contact_law(dx, dy, dz, rx, ry, rz, ox, oy, oz, parameters, old, micro_friction, force, tangent, now):
    """Force on the wheel sphere (3) of one contact and its tangent -dF/dw (3, 3); returns f_n and the work lost.

    d: wheel to axle centre; r = r_i t_i + r_j t_j; o: displacement of the wheel sphere against the axle's; w is the
    displacement of the contact point, o + r x n. A pair that was apart begins from where it was: an increment is long
    beside the slip mu f_n / k_t at which a contact yields. `old` and `now` are histories. Left out of the tangent: the
    turning of the normal, f_n/|d| against k_n.
    """
    kn, kt = parameters[2], parameters[3]
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    nx, ny, nz = dx / distance, dy / distance, dz / distance
    fn = max(0.0, kn * (parameters[0] + parameters[1] - distance))
    now[0], now[1], now[2], now[3], now[4], now[5], now[6], now[7], now[8] = 0.0, 0.0, 0.0, ox, oy, oz, rx, ry, rz
    if old[0] == np.inf or (fn == 0.0 and old[0] == 0.0 and old[1] == 0.0 and old[2] == 0.0):
        sx, sy, sz = 0.0, 0.0, 0.0
    else:
        ax, ay, az = rx - old[6], ry - old[7], rz - old[8]
        sx = ox - old[3] + ay * nz - az * ny
        sy = oy - old[4] + az * nx - ax * nz
        sz = oz - old[5] + ax * ny - ay * nx
    bound = micro_friction * fn
    tx, ty, tz, slipped, lost = 0.0, 0.0, 0.0, 0.0, 0.0
    if old[0] != np.inf:
        tx, ty, tz, slipped = slide(nx, ny, nz, bound, kt, old[0], old[1], old[2], sx, sy, sz)
        # the loss: mean of the old and the new force, times the slip in the plane half-way between both states
        mx, my, mz = 2.0 * dx + ox - old[3], 2.0 * dy + oy - old[4], 2.0 * dz + oz - old[5]
        sm = (sx * mx + sy * my + sz * mz) / (mx * mx + my * my + mz * mz)
        way = np.sqrt((sx - sm * mx) ** 2 + (sy - sm * my) ** 2 + (sz - sm * mz) ** 2)
        before = np.sqrt(old[0] ** 2 + old[1] ** 2 + old[2] ** 2)
        after = np.sqrt(tx * tx + ty * ty + tz * tz)
        if slipped > 0.0 or fn == 0.0:
            lost = max(0.0, 0.5 * (before + after) * (way + (after - before) / kt))
    if fn == 0.0:
        return 0.0, lost
    now[0], now[1], now[2] = tx, ty, tz
    force[0], force[1], force[2] = tx - fn * nx, ty - fn * ny, tz - fn * nz
    n = (nx, ny, nz)
    t = (tx, ty, tz)
    slips = slipped > 0.0 or bound == 0.0 or old[0] == np.inf
    for a in range(3):
        for b in range(3):
            tangent[a, b] = kn * n[a] * n[b]
            if not slips:
                tangent[a, b] += kt * ((1.0 if a == b else 0.0) - n[a] * n[b])
            elif slipped > 0.0:
                trial = bound + kt * slipped / bound
                tangent[a, b] -= t[a] * n[b] * kn / fn
                across = (1.0 if a == b else 0.0) - n[a] * n[b] - t[a] * t[b] / (bound * bound)
                tangent[a, b] += kt * bound / trial * across
    return fn, lost


@njit(cache=True, fastmath=FAST)
def displacements(nodes, compliance, sources, wrench, u):
    """u (n, 6) at the given nodes: sum over the sources of compliance[node, source] wrench[source]."""
    for a in range(len(nodes)):
        i = 6 * nodes[a]
        t0, t1, t2, t3, t4, t5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for b in range(len(sources)):
            column = compliance[6 * sources[b] : 6 * sources[b] + 6, i : i + 6]  # symmetric: read along rows
            for k in range(6):
                w = wrench[b, k]
                t0 += column[k, 0] * w
                t1 += column[k, 1] * w
                t2 += column[k, 2] * w
                t3 += column[k, 3] * w
                t4 += column[k, 4] * w
                t5 += column[k, 5] * w
        node = u[nodes[a]]
        node[0], node[1], node[2], node[3], node[4], node[5] = t0, t1, t2, t3, t4, t5


@njit(cache=True, fastmath=FAST)
def coupling(one, other, arm, other_arm, compliance, block):
    """Add to block (3, 3) the displacement of a contact point on sphere `one` by a unit force at that on `other`.

    The arms (3) are radius times normal: the contact point moves by u + t x arm, a force F turns by arm x F.
    """
    i, j = 6 * one, 6 * other
    for b in range(3):
        c, d = (b + 1) % 3, (b + 2) % 3
        # a unit force along b: moment arm x e_b has components arm_d along c and -arm_c along d
        col0, colc, cold = j + b, j + 3 + c, j + 3 + d
        mc, md = other_arm[d], -other_arm[c]
        s0 = compliance[i, col0] + mc * compliance[i, colc] + md * compliance[i, cold]
        s1 = compliance[i + 1, col0] + mc * compliance[i + 1, colc] + md * compliance[i + 1, cold]
        s2 = compliance[i + 2, col0] + mc * compliance[i + 2, colc] + md * compliance[i + 2, cold]
        t0 = compliance[i + 3, col0] + mc * compliance[i + 3, colc] + md * compliance[i + 3, cold]
        t1 = compliance[i + 4, col0] + mc * compliance[i + 4, colc] + md * compliance[i + 4, cold]
        t2 = compliance[i + 5, col0] + mc * compliance[i + 5, colc] + md * compliance[i + 5, cold]
        block[0, b] += s0 + t1 * arm[2] - t2 * arm[1]
        block[1, b] += s1 + t2 * arm[0] - t0 * arm[2]
        block[2, b] += s2 + t0 * arm[1] - t1 * arm[0]


@njit(cache=True, fastmath=FAST)
def load_plates(wheel, axle, near, pair, parameters, forces, normal, uw, ua):
    """Displacements uw, ua (n, 6) of the nodes of the near candidates under `forces` (p, 3); the elastic energy."""
    loaded = np.empty(len(near), np.int64)
    count = 0
    for q in range(len(near)):
        p = near[q]
        if forces[p, 0] != 0.0 or forces[p, 1] != 0.0 or forces[p, 2] != 0.0:
            loaded[count] = p
            count += 1
    loaded = loaded[:count]
    wrench_w, wrench_a = np.empty((count, 6)), np.empty((count, 6))
    for k in range(count):
        p = loaded[k]
        f, n = forces[p], normal[p]
        moment = (n[1] * f[2] - n[2] * f[1], n[2] * f[0] - n[0] * f[2], n[0] * f[1] - n[1] * f[0])
        for a in range(3):
            wrench_w[k, a], wrench_a[k, a] = f[a], -f[a]
            wrench_w[k, 3 + a], wrench_a[k, 3 + a] = (
                parameters[p, WHEEL_RADIUS] * moment[a],
                parameters[p, AXLE_RADIUS] * moment[a],
            )
    displacements(np.unique(pair[near, WHEEL]), wheel, pair[loaded, WHEEL], wrench_w, uw)
    displacements(np.unique(pair[near, AXLE]), axle, pair[loaded, AXLE], wrench_a, ua)
    energy = 0.0
    for k in range(count):
        for a in range(6):
            energy += 0.5 * (wrench_w[k, a] * uw[pair[loaded[k], 0], a] + wrench_a[k, a] * ua[pair[loaded[k], 1], a])
    return energy


@njit(cache=True, fastmath=FAST)
def newton_step(wheel, axle, touching, pair, parameters, normal, tangent, answer, forces, target, step):
    """Solve (1 - dlaw/dw W) step = law - forces over the touching candidates; returns the step in height.

    W couples the contact points through both plates. With target > 0 the height is an unknown, and the sum of the
    vertical forces an equation.
    """
    m = len(touching)
    extra = 1 if target > 0.0 else 0
    W = np.empty((3 * m, 3 * m))
    block = np.empty((3, 3))
    arms = np.empty((m, 2, 3))
    for a in range(m):
        p = touching[a]
        for c in range(3):
            arms[a, 0, c], arms[a, 1, c] = (
                parameters[p, WHEEL_RADIUS] * normal[p, c],
                -parameters[p, AXLE_RADIUS] * normal[p, c],
            )
    for a in range(m):
        i, j = pair[touching[a]]
        for b in range(a, m):
            k, n = pair[touching[b]]
            block[:] = 0.0
            coupling(i, k, arms[a, 0], arms[b, 0], wheel, block)
            coupling(j, n, arms[a, 1], arms[b, 1], axle, block)
            for c in range(3):
                for d in range(3):
                    W[3 * a + c, 3 * b + d] = block[c, d]
                    W[3 * b + d, 3 * a + c] = block[c, d]
    J = np.zeros((3 * m + extra, 3 * m + extra))
    R = np.empty(3 * m + extra)
    total = 0.0
    for a in range(m):
        p = touching[a]
        total += forces[p, 2]
        for c in range(3):
            row = J[3 * a + c]
            for d in range(3):
                value = tangent[p, c, d]
                if value != 0.0:
                    source = W[3 * a + d]
                    for e in range(3 * m):
                        row[e] += value * source[e]
            row[3 * a + c] += 1.0
            R[3 * a + c] = answer[p, c] - forces[p, c]
            if extra:
                row[3 * m] = tangent[p, c, 2]
    if extra:
        for a in range(m):
            J[3 * m, 3 * a + 2] = 1.0
        R[3 * m] = target - total
    change = np.linalg.solve(J, R)
    for a in range(m):
        for c in range(3):
            step[touching[a], c] = change[3 * a + c]
    return change[3 * m] if extra else 0.0


@njit(cache=True, fastmath=FAST)
def solve_increment(
    wheel, axle, live, pair, offset, parameters, history, forces, micro_friction, drive, target,
    iterations, tolerance, close, trial, normal, sums,
):  # fmt: skip
    """One increment: forces (p, 3) of the live candidates in equilibrium with both plates at `drive` (3).

    wheel, axle: compliances (6 n, 6 n) in the nodes that `pair` numbers. Newton on R(F) = F - law(w(F)), the step
    halved while the residual grows; with target > 0 [N] the height drive[2] is an unknown too. Candidates that are
    farther apart than `close` [mm] after the first evaluation are left out of the others. The history moves on into
    `trial`; `normal` (p, 3) are those the forces act along.
    Returns iterations used, residual (largest |R|, or turn of a normal times the force, over the largest contact
    force) and the farthest two spheres came towards each other by elastic displacements alone [mm]; sums (6,): force
    on the wheel, work lost [N mm], elastic energy of the plates and of the contacts [N mm].
    """
    uw, ua = np.zeros((len(wheel) // 6, 6)), np.zeros((len(axle) // 6, 6))
    answer, step = np.zeros(forces.shape), np.zeros(forces.shape)
    tangent = np.zeros((len(pair), 3, 3))
    direction = np.empty(3)
    height, height_step = drive[2], 0.0
    damped, previous, residual, largest, closing = False, np.inf, 0.0, 0.0, 0.0
    for p in live:
        between = offset[p] - drive
        if normal[p, 0] == 0.0 and normal[p, 1] == 0.0 and normal[p, 2] == 0.0:
            normal[p] = between / np.sqrt(np.sum(between * between))
    floor = 0.0  # of the force that residuals are compared to, where a contact has only just been made
    for p in live:
        floor = max(
            floor, 1e-6 * parameters[p, NORMAL_STIFFNESS] * (parameters[p, WHEEL_RADIUS] + parameters[p, AXLE_RADIUS])
        )
    near = live
    iteration = 0
    while True:
        energy = load_plates(wheel, axle, near, pair, parameters, forces, normal, uw, ua)
        residual, largest = 0.0, floor
        sums[:] = 0.0
        sums[4] = energy
        touching, following = np.empty(len(near), np.int64), np.empty(len(near), np.int64)
        touch_count, near_count = 0, 0
        for q in range(len(near)):
            p = near[q]
            i, j = pair[p, WHEEL], pair[p, AXLE]
            ri, rj = parameters[p, WHEEL_RADIUS], parameters[p, AXLE_RADIUS]
            ox, oy, oz = drive[0] + uw[i, 0] - ua[j, 0], drive[1] + uw[i, 1] - ua[j, 1], height + uw[i, 2] - ua[j, 2]
            dx, dy, dz = offset[p, 0] - ox, offset[p, 1] - oy, offset[p, 2] - oz
            tangent[p] = 0.0
            answer[p] = 0.0
            fn, lost = contact_law(
                dx, dy, dz, ri * uw[i, 3] + rj * ua[j, 3], ri * uw[i, 4] + rj * ua[j, 4], ri * uw[i, 5] + rj * ua[j, 5],
                ox, oy, oz, parameters[p], history[p], micro_friction, answer[p], tangent[p], trial[p],
            )  # fmt: skip
            size = np.sqrt(dx * dx + dy * dy + dz * dz)
            direction[0], direction[1], direction[2] = dx / size, dy / size, dz / size
            toward = (ox - drive[0]) * direction[0] + (oy - drive[1]) * direction[1] + (oz - height) * direction[2]
            closing = max(closing, toward)
            pulled = forces[p, 0] != 0.0 or forces[p, 1] != 0.0 or forces[p, 2] != 0.0
            held = history[p, 0] != np.inf and (history[p, 0] != 0.0 or history[p, 1] != 0.0 or history[p, 2] != 0.0)
            if pulled or fn > 0.0:
                touching[touch_count] = p
                touch_count += 1
                for a in range(3):
                    residual = max(residual, abs(answer[p, a] - forces[p, a]))
                    residual = max(residual, abs(direction[a] - normal[p, a]) * fn)
                    sums[a] += answer[p, a]
            normal[p] = direction
            if pulled or held or size < ri + rj + close:
                following[near_count] = p
                near_count += 1
            sums[3] += lost
            if fn > 0.0:
                largest = max(largest, fn)
                square = trial[p, 0] ** 2 + trial[p, 1] ** 2 + trial[p, 2] ** 2
                sums[5] += (
                    0.5 * fn * fn / parameters[p, NORMAL_STIFFNESS] + 0.5 * square / parameters[p, TANGENTIAL_STIFFNESS]
                )
        if target > 0.0:
            residual = max(residual, abs(target - sums[2]))
        if residual <= tolerance * largest or touch_count == 0 or iteration == iterations:
            break
        iteration += 1
        near = following[:near_count]
        if residual > previous and iteration > 3 and not damped:  # went too far: take back half of the last step
            damped = True
            for p in near:
                for a in range(3):
                    step[p, a] *= 0.5
                    forces[p, a] -= step[p, a]
            height_step *= 0.5
            height -= height_step
            continue
        damped, previous = False, residual
        touching = touching[:touch_count]
        step[near] = 0.0
        height_step = newton_step(
            wheel, axle, touching, pair, parameters, normal, tangent, answer, forces, target, step
        )
        height += height_step
        for p in touching:
            for a in range(3):
                forces[p, a] += step[p, a]
    for p in live:
        forces[p] = answer[p]
    drive[2] = height
    return iteration, residual / max(largest, 1e-300), closing


# --- large rotations and breakage: the co-rotational lattice ---------------------------------------------------------
#
# Arrays of this section
# q       : (n, 4)      unit quaternion (w, x, y, z) of each sphere; u[:, 3:] is then the time integral of its angular
#                       velocity, whose increments are what a contact needs
# mode    : (bonds,)    0 whole, 1 broken by tension and bending, 2 broken by shear and torsion
# section : (bonds, 4)  1/S [1/mm2], r/I [1/mm3], tensile and shear strength [MPa]
# grip    : (n,)        0 free, otherwise the number of the grip that moves the sphere at the velocity it has
# near_*                pairs of detached spheres (they have lost a beam) and what is near them, in the layout of the
#                       candidates; the first `within` of them lie in one plate, the rest join wheel to axle


@njit(cache=True, fastmath=EXACT, error_model="numpy", forceinline=True)
def cross(ax, ay, az, bx, by, bz):
    """a x b of two vectors of numbers or of lanes."""
    return fma(ay, bz, -(az * by)), fma(az, bx, -(ax * bz)), fma(ax, by, -(ay * bx))


@njit(cache=True, fastmath=EXACT, error_model="numpy", forceinline=True)
def turned(q, x, y, z):
    """The vector (x, y, z) turned by a unit quaternion: e + 2 w (v x e) + 2 v x (v x e)."""
    cx, cy, cz = cross(q[1], q[2], q[3], x, y, z)
    dx, dy, dz = cross(q[1], q[2], q[3], cx, cy, cz)
    return fma(2.0 * q[0], cx, x + 2.0 * dx), fma(2.0 * q[0], cy, y + 2.0 * dy), fma(2.0 * q[0], cz, z + 2.0 * dz)


@njit(cache=True, fastmath=EXACT, error_model="numpy", forceinline=True)
def beam_large(ex, ey, ez, per_length, axial, bending, twist, ui, uj, qi, qj):
    """The beam at any rotation: the gradient of an energy that no rigid motion changes, so its moments balance.

    X is the unit vector from i to j now, L their distance, a_k the rest axis e as sphere k has carried it, Q = (w, v)
    the quaternion q_j q_i* (w >= 0). With s = a_i + a_j, P = X x s (the sum of the angles X x a_k that the ends make
    with the chord) and the twist p = 2 v.X, in b = EI/l and g = G I_o/l:

        U   = EA/(2 l) (L - l)^2 + b/2 |a_j - a_i|^2 + 3 b/2 |P|^2 + g/2 p^2
        F_i = EA/l (L - l) X + 3 b (X.s)/L X x P + 2 g p/L (v - (v.X) X)                          = -F_j
        T_i = -2 b a_i x a_j - 3 b (X.s) X x a_i + g p (w X - v x X)
        T_j =  2 b a_i x a_j - 3 b (X.s) X x a_j - g p (w X + v x X)

    T_i + T_j + L X x F_j = 0. For small rotations it is `beam`; the angles appear by their sines (2 sin(p/2) for the
    twist), never by acos, and elongations below the rounding of L are kept.
    ui (3) and uj are displacements, qi (4) and qj quaternions, of numbers or of lanes. After Andre et al. 2012, made
    independent of the frame.

    Returns X (3), normal force EA/l (L - l), shear force on i (3), T_i (3), T_j (3) and what breaks the beam: square
    of the larger bending moment, torsion moment; at last U.
    """
    length = 1.0 / per_length
    dx, dy, dz = uj[0] - ui[0], uj[1] - ui[1], uj[2] - ui[2]
    x, y, z = fma(length, ex, dx), fma(length, ey, dy), fma(length, ez, dz)
    distance = np.sqrt(dot(x, y, z, x, y, z))
    longer = fma(2.0 * length, dot(dx, dy, dz, ex, ey, ez), dot(dx, dy, dz, dx, dy, dz)) / (distance + length)
    per_distance = 1.0 / distance
    x, y, z = per_distance * x, per_distance * y, per_distance * z
    ix, iy, iz = turned(qi, ex, ey, ez)
    jx, jy, jz = turned(qj, ex, ey, ez)
    cx, cy, cz = cross(ix, iy, iz, jx, jy, jz)
    gx, gy, gz = cross(x, y, z, ix, iy, iz)
    hx, hy, hz = cross(x, y, z, jx, jy, jz)
    px, py, pz = gx + hx, gy + hy, gz + hz
    pull = 3.0 * bending * dot(x, y, z, ix + jx, iy + jy, iz + jz)
    two = 2.0 * bending
    ax, ay, az = -fma(pull, gx, two * cx), -fma(pull, gy, two * cy), -fma(pull, gz, two * cz)
    bx, by, bz = fma(two, cx, -(pull * hx)), fma(two, cy, -(pull * hy)), fma(two, cz, -(pull * hz))
    moment = max(dot(ax, ay, az, ax, ay, az), dot(bx, by, bz, bx, by, bz))
    w = fma(qj[0], qi[0], dot(qj[1], qj[2], qj[3], qi[1], qi[2], qi[3]))
    vx, vy, vz = cross(qi[1], qi[2], qi[3], qj[1], qj[2], qj[3])
    vx, vy, vz = fma(qi[0], qj[1], vx), fma(qi[0], qj[2], vy), fma(qi[0], qj[3], vz)
    vx, vy, vz = fma(-qj[0], qi[1], vx), fma(-qj[0], qi[2], vy), fma(-qj[0], qi[3], vz)
    sign = math.copysign(1.0, w)
    w, vx, vy, vz = sign * w, sign * vx, sign * vy, sign * vz
    half = dot(vx, vy, vz, x, y, z)
    torsion = 2.0 * bending * (1.0 + twist) * half
    mx, my, mz = cross(vx, vy, vz, x, y, z)
    ax, ay, az = fma(torsion, fma(w, x, -mx), ax), fma(torsion, fma(w, y, -my), ay), fma(torsion, fma(w, z, -mz), az)
    bx, by, bz = fma(-torsion, fma(w, x, mx), bx), fma(-torsion, fma(w, y, my), by), fma(-torsion, fma(w, z, mz), bz)
    pull, two = per_distance * pull, 2.0 * per_distance * torsion
    sx, sy, sz = cross(x, y, z, px, py, pz)
    sx = fma(pull, sx, two * fma(-half, x, vx))
    sy = fma(pull, sy, two * fma(-half, y, vy))
    sz = fma(pull, sz, two * fma(-half, z, vz))
    ox, oy, oz = jx - ix, jy - iy, jz - iz
    bent = fma(3.0, dot(px, py, pz, px, py, pz), dot(ox, oy, oz, ox, oy, oz))
    energy = fma(0.5, fma(axial * longer, longer, bending * bent), torsion * half)
    return x, y, z, axial * longer, sx, sy, sz, ax, ay, az, bx, by, bz, moment, torsion, energy


@njit(cache=True, fastmath=EXACT)
def stress_ratio(normal, shear_square, moment_square, torsion, section):
    """Stresses of a beam over its strengths (2): (N/S + r M_b/I)/tensile and (4/3 V/S + r |M_t|/I_o)/shear [-].

    4/3 V/S is the shear stress of a round section on its neutral axis; I_o = 2 I.
    """
    tensile = section[0] * normal + section[1] * np.sqrt(moment_square)
    shear = 4.0 / 3.0 * section[0] * np.sqrt(shear_square) + 0.5 * section[1] * abs(torsion)
    return tensile / section[2], shear / section[3]


@njit(cache=True, fastmath=EXACT, error_model="numpy", forceinline=True)
def excess(normal, square, moment, torsion, per_area, per_modulus, tensile, shear):
    """Not negative where a beam breaks; numbers or lanes, without a square root.

    Of (N/S + r M_b/I) against the tensile strength and (4/3 V/S + r |M_t|/I_o) against the shear strength, given the
    squares of V and of M_b; I_o = 2 I, and 4/3 V/S is the shear stress of a round section on its neutral axis.
    """
    room = tensile - per_area * normal
    left = shear - 0.5 * per_modulus * max(torsion, -torsion)
    bent, sheared = per_modulus * per_modulus * moment, 16.0 / 9.0 * per_area * per_area * square
    return max(max(-room, fma(-room, room, bent)), max(-left, fma(-left, left, sheared)))


@njit(cache=True, fastmath=EXACT, error_model="numpy")
def bond_forces_large(lines, g, blocks, beams, section, beyond, twist):
    """Forces and moments of all beams on the spheres, in lanes g; whether any is too much, and their energy [N mm].

    lines (lines, 8): displacement (3) and quaternion (4). beyond (blocks,) tells where a beam is beyond its strength.
    """
    energy = spread(0.0)
    any_beyond = False
    for block in range(len(blocks.start) - 1):
        x, y, z, q0, q1, q2, q3, _ = load_block(lines, WIDTH * WIDTH * block)
        f0, f1, f2, f3, f4, f5 = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
        most = spread(-1.0)
        for k in range(blocks.start[block], blocks.start[block + 1]):
            b, c = 6 * k, 4 * k
            xj, yj, zj, p0, p1, p2, p3, _ = load_lines(lines, blocks.others, WIDTH * k)
            nx, ny, nz, normal, sx, sy, sz, ax, ay, az, _, _, _, moment, torsion, one = beam_large(
                row(beams, b + AXIS_X),
                row(beams, b + AXIS_Y),
                row(beams, b + AXIS_Z),
                row(beams, b + PER_LENGTH),
                row(beams, b + AXIAL),
                row(beams, b + BENDING),
                twist,
                (x, y, z),
                (xj, yj, zj),
                (q0, q1, q2, q3),
                (p0, p1, p2, p3),
            )
            over = excess(
                normal,
                dot(sx, sy, sz, sx, sy, sz),
                moment,
                torsion,
                row(section, c + PER_AREA),
                row(section, c + PER_MODULUS),
                row(section, c + TENSILE_STRENGTH),
                row(section, c + SHEAR_STRENGTH),
            )
            most, energy = max(over, most), fma(0.5, one, energy)
            f0, f1, f2 = f0 + fma(normal, nx, sx), f1 + fma(normal, ny, sy), f2 + fma(normal, nz, sz)
            f3, f4, f5 = f3 + ax, f4 + ay, f5 + az
        store_six(g, block, f0, f1, f2, f3, f4, f5)
        beyond[block] = largest_of(most) >= 0.0
        any_beyond = any_beyond or beyond[block]
    return any_beyond, total_of(energy)


@njit(cache=True, fastmath=EXACT, error_model="numpy")
def break_beams(lines, v, f, pushed, blocks, beams, section, beyond, twist, dt, mode, broken, released):
    """Break the beams beyond their strength in the blocks where there are some; returns how many did.

    A beam that breaks loses its stiffness, except for a compression, which is left in this step: then a contact takes
    over. mode, broken, released: of all beams, numbers of those that broke and what each gave up [N mm],
    U + dt/2 (v-.F) less that of the compression. With U its energy and v-.F half a step ago it is what leapfrog, which
    keeps sum of m v-.v+ / 2 + U, then misses.
    """
    count = 0
    for block in np.flatnonzero(beyond):
        for k in range(blocks.start[block], blocks.start[block + 1]):
            for lane in range(WIDTH):
                bond, i, j = blocks.bond[k, lane], WIDTH * block + lane, blocks.others[k, lane] // WIDTH
                if bond < 0 or mode[bond] != 0:
                    continue
                b, s, ui, uj = beams[k, :, lane], section[k, :, lane], lines[i], lines[j]
                x, y, z, normal, sx, sy, sz, ax, ay, az, bx, by, bz, moment, torsion, energy = beam_large(
                    b[0], b[1], b[2], b[3], b[4], b[5], twist, ui, uj, ui[3:], uj[3:]
                )
                square = dot(sx, sy, sz, sx, sy, sz)
                if excess(normal, square, moment, torsion, s[0], s[1], s[2], s[3]) < 0.0:
                    continue
                tensile, shear = stress_ratio(normal, square, moment, torsion, s)
                kept = min(normal, 0.0)
                lost = normal - kept
                vi, vj = v[6 * block : 6 * block + 6, lane], v[6 * (j // WIDTH) : 6 * (j // WIDTH) + 6, j % WIDTH]
                rate = (vi[0] - vj[0]) * (lost * x + sx) + vi[3] * ax + vj[3] * bx
                rate += (vi[1] - vj[1]) * (lost * y + sy) + vi[4] * ay + vj[4] * by
                rate += (vi[2] - vj[2]) * (lost * z + sz) + vi[5] * az + vj[5] * bz
                mode[bond] = 1 if tensile >= shear else 2
                broken[count] = bond
                released[count] = energy - (0.5 * kept * kept / b[AXIAL] if kept < 0.0 else 0.0) + 0.5 * dt * rate
                count += 1
                pushed[block], pushed[j // WIDTH] = True, True
                f[i, 0], f[i, 1], f[i, 2] = f[i, 0] + kept * x, f[i, 1] + kept * y, f[i, 2] + kept * z
                f[j, 0], f[j, 1], f[j, 2] = f[j, 0] - kept * x, f[j, 1] - kept * y, f[j, 2] - kept * z
                take_away(blocks, beams, section, bond, block)
                take_away(blocks, beams, section, bond, j // WIDTH)
    return count


@njit(cache=True, fastmath=EXACT)
def take_away(blocks, beams, section, bond, block):
    """Leave a beam without stiffness, as seen from the spheres of a block."""
    for k in range(blocks.start[block], blocks.start[block + 1]):
        for lane in range(WIDTH):
            if blocks.bond[k, lane] == bond:
                beams[k, AXIAL, lane], beams[k, BENDING, lane] = 0.0, 0.0
                section[k, TENSILE_STRENGTH, lane], section[k, SHEAR_STRENGTH, lane] = np.inf, np.inf


@njit(cache=True, fastmath=EXACT, error_model="numpy")
def move_large(lines, u, v, f, pushed, g, blocks, free, dt, damping, sums):
    """One leapfrog step under f, left at zero, the external faces, and g, the beams, which receives the sum of all.

    Quaternions turn by q+ = (1, dt w/2) q, normalised: the Cayley form of the rotation, exact to third order. What is
    not free (blocks, 8) keeps its velocity. sums (6,) receives sum of m v-.v+ [N mm], work lost in damping in the half
    step before and after [N mm], and at its end the fastest sphere [mm/s].
    """
    keep = spread((1.0 - 0.5 * damping * dt) / (1.0 + 0.5 * damping * dt))
    push, step, half, nothing = dt / (1.0 + 0.5 * damping * dt), spread(dt), spread(0.5 * dt), spread(0.0)
    kinetic, before, after, fastest = nothing, nothing, nothing, nothing
    for block in range(len(blocks.start) - 1):
        at, b = WIDTH * WIDTH * block, 6 * block
        x, y, z, q0, q1, q2, q3, _ = load_block(lines, at)
        ui = load_block(u, at)
        f0, f1, f2, f3, f4, f5 = forces_before(f, pushed, block, blocks.held, blocks.anchors, ui)
        f0, f1, f2 = f0 + row(g, b), f1 + row(g, b + 1), f2 + row(g, b + 2)
        f3, f4, f5 = f3 + row(g, b + 3), f4 + row(g, b + 4), f5 + row(g, b + 5)
        store_six(g, block, f0, f1, f2, f3, f4, f5)
        w0, w1, w2, w3, w4, w5 = row(v, b), row(v, b + 1), row(v, b + 2), row(v, b + 3), row(v, b + 4), row(v, b + 5)
        mass, inertia, loose = row(blocks.mass, 2 * block), row(blocks.mass, 2 * block + 1), row(free, block)
        per_mass, per_inertia = push / mass, push / inertia
        v0 = either(loose, fma(per_mass, f0, keep * w0), w0)
        v1 = either(loose, fma(per_mass, f1, keep * w1), w1)
        v2 = either(loose, fma(per_mass, f2, keep * w2), w2)
        v3 = either(loose, fma(per_inertia, f3, keep * w3), w3)
        v4 = either(loose, fma(per_inertia, f4, keep * w4), w4)
        v5 = either(loose, fma(per_inertia, f5, keep * w5), w5)
        store_six(v, block, v0, v1, v2, v3, v4, v5)
        square = dot(v0, v1, v2, v0, v1, v2)
        mass, inertia = loose * mass, loose * inertia
        mixed = fma(mass, dot(w0, w1, w2, v0, v1, v2), inertia * dot(w3, w4, w5, v3, v4, v5))
        before = before + mixed + fma(mass, dot(w0, w1, w2, w0, w1, w2), inertia * dot(w3, w4, w5, w3, w4, w5))
        after = after + mixed + fma(mass, square, inertia * dot(v3, v4, v5, v3, v4, v5))
        kinetic, fastest = kinetic + mixed, max(square, fastest)
        x, y, z = fma(step, v0, x), fma(step, v1, y), fma(step, v2, z)
        t0, t1, t2 = fma(step, v3, ui[3]), fma(step, v4, ui[4]), fma(step, v5, ui[5])
        store_block(u, at, (x, y, z, t0, t1, t2, nothing, nothing))
        r0, r1, r2 = half * v3, half * v4, half * v5
        cx, cy, cz = cross(r0, r1, r2, q1, q2, q3)
        p0 = q0 - dot(r0, r1, r2, q1, q2, q3)
        p1, p2, p3 = q1 + fma(r0, q0, cx), q2 + fma(r1, q0, cy), q3 + fma(r2, q0, cz)
        scale = 1.0 / np.sqrt(fma(p0, p0, dot(p1, p2, p3, p1, p2, p3)))
        store_block(lines, at, (x, y, z, scale * p0, scale * p1, scale * p2, scale * p3, nothing))
    sums[0] = total_of(kinetic)
    sums[1], sums[2] = 0.25 * dt * damping * total_of(before), 0.25 * dt * damping * total_of(after)
    sums[5] = np.sqrt(largest_of(fastest))


@njit(cache=True, fastmath=EXACT, error_model="numpy")
def leapfrog_step_large(
    lines, u, v, f, pushed, g, blocks, beams, section, beyond, mode, twist, grip, free, gripped, dt, damping,
    reaction, broken, released, sums,
):  # fmt: skip
    """As `leapfrog_step`, co-rotational: beams that reach their strength break; returns how many did.

    reaction (grips, 6): the forces and moments that the grips exert are added. sums (6,) as in `move_large`, and in
    between the work of the grips in each half step and the elastic energy of the beams [N mm].
    """
    count = 0
    any_beyond, elastic = bond_forces_large(lines, g, blocks, beams, section, beyond, twist)
    if any_beyond:
        count = break_beams(lines, v, f, pushed, blocks, beams, section, beyond, twist, dt, mode, broken, released)
        _, elastic = bond_forces_large(lines, g, blocks, beams, section, beyond, twist)
    move_large(lines, u, v, f, pushed, g, blocks, free, dt, damping, sums)
    work = 0.0
    for i in gripped:
        line = blocks.place[i]
        for k in range(6):
            force = g[6 * (line // WIDTH) + k, line % WIDTH]
            reaction[grip[i] - 1, k] -= force
            work -= force * v[6 * (line // WIDTH) + k, line % WIDTH]
    sums[3], sums[4] = 0.5 * dt * work, elastic
    return count


@njit(cache=True, fastmath=EXACT)
def contact_energy(u, live, pair, offset, parameters, history, ox, oy, oz):
    """Elastic energy f_n^2/(2 k_n) + f_t^2/(2 k_t) of the live candidates after `contact_forces` [N mm]."""
    total = 0.0
    for s in range(len(live)):
        p = live[s]
        if history[p, 0] == np.inf:
            continue
        i, j = pair[p, WHEEL], pair[p, AXLE]
        x = offset[p, 0] - ox - u[i, 0] + u[j, 0]
        y = offset[p, 1] - oy - u[i, 1] + u[j, 1]
        z = offset[p, 2] - oz - u[i, 2] + u[j, 2]
        fn = touch(x, y, z, parameters[p, WHEEL_RADIUS] + parameters[p, AXLE_RADIUS], parameters[p, NORMAL_STIFFNESS])[
            3
        ]
        square = history[p, 0] ** 2 + history[p, 1] ** 2 + history[p, 2] ** 2
        total += 0.5 * fn * fn / parameters[p, NORMAL_STIFFNESS] + 0.5 * square / parameters[p, TANGENTIAL_STIFFNESS]
    return total


@njit(cache=True, fastmath=EXACT)
def anchor_energy(u, held, anchors):
    """Elastic energy of the external faces [N mm], u in lines."""
    total = 0.0
    for block in range(len(held)):
        for lane in range(WIDTH if held[block] >= 0 else 0):
            w, s = u[WIDTH * block + lane], anchors[held[block], :, lane]
            total += s[0] * w[2] * w[2] + s[1] * (w[0] * w[0] + w[1] * w[1]) + 2.0 * s[2] * (w[0] * w[4] - w[1] * w[3])
            total += s[3] * (w[3] * w[3] + w[4] * w[4]) + s[4] * w[5] * w[5]
    return 0.5 * total


@njit(cache=True, fastmath=EXACT, error_model="numpy")
def run_leapfrog_large(
    u, v, q, blocks, beams, section, mode, twist, grip, dt, damping,
    first, last, pair, offset, parameters, history, micro_friction, window, live,
    detached, near_pair, near_offset, near_parameters, near_history, near_live, within, room,
    drive, speed, target, carriage, steps, reaction, broken, released, carry, total,
):  # fmt: skip
    """As `run_leapfrog`, co-rotational and with breakage.

    u, v (n, 6), q (n, 4), grip and detached (n,) are in the order of the spheres, pairs hold places in `blocks`. beams
    (rows, 6, 8) and section (rows, 4, 8) are seen from both ends, as in `blocks`; those of a broken beam are changed.
    Returns the steps done, the number of beams that broke in the last of them and what is left of `room` [mm]. It
    stops early after a step in which a beam broke, and when two spheres may have come closer by `room`, so that the
    caller can renew the pairs near detached spheres. Candidates of detached spheres are left to those pairs.
    total (10,): as in `run_leapfrog`, with the grips' work in the drive's and the sum of m v-.v+ as twice the
    kinetic energy; then, after the last step, the elastic energy of beams and faces, that of contacts, and the sum of
    the energy released [N mm]. carry (5,): force on the wheel in the last step (3), and what damping took and the grips
    gave in the half step since: the works are trapezoids, the account is of second order.
    """
    size = len(blocks.start) - 1
    at, lines = lines_of(u, blocks.place, WIDTH * size), lines_of(u, blocks.place, WIDTH * size)
    f, loose = zeros_in_lines(WIDTH * size), np.zeros(WIDTH * size, np.bool_)
    rates, g, free = lanes_of(v, blocks.place, WIDTH * size), zeros_in_lines(6 * size), zeros_in_lines(size)
    pushed, beyond = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    lines[:, 3] = 1.0
    for i in range(len(q)):
        line = blocks.place[i]
        lines[line, 3], lines[line, 4], lines[line, 5], lines[line, 6] = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        free[line // WIDTH, line % WIDTH] = 1.0 if grip[i] == 0 else 0.0
        loose[line] = detached[i]
    gripped = np.flatnonzero(grip)
    sums = np.zeros(4)
    moved = np.zeros(6)
    done, count, faces = 0, 0, 0.0
    while done < steps and count == 0 and room > 0.0:
        done += 1
        drive[0] += dt * speed[0]
        drive[1] += dt * speed[1]
        drive[2] += dt * speed[2]
        while window[0] < len(first) and first[window[0]] <= drive[0]:
            live[window[1]] = window[0]
            window[0] += 1
            window[1] += 1
        a = 0
        while a < window[1]:
            p = live[a]
            if last[p] < drive[0] or loose[pair[p, WHEEL]] or loose[pair[p, AXLE]]:
                window[1] -= 1
                live[a] = live[window[1]]
            else:
                a += 1
        sums[:] = 0.0
        contact_forces(
            at,
            f,
            pushed,
            near_live[:within],
            near_pair,
            near_offset,
            near_parameters,
            near_history,
            micro_friction,
            0.0,
            0.0,
            0.0,
            sums,
        )
        sums[0], sums[1], sums[2] = 0.0, 0.0, 0.0
        contact_forces(
            at, f, pushed, near_live[within:], near_pair, near_offset, near_parameters, near_history, micro_friction,
            drive[0], drive[1], drive[2], sums,
        )  # fmt: skip
        contact_forces(
            at,
            f,
            pushed,
            live[: window[1]],
            pair,
            offset,
            parameters,
            history,
            micro_friction,
            drive[0],
            drive[1],
            drive[2],
            sums,
        )
        if done == steps:
            faces = anchor_energy(at, blocks.held, blocks.anchors)
            total[8] = (
                contact_energy(
                    at, near_live[:within], near_pair, near_offset, near_parameters, near_history, 0.0, 0.0, 0.0
                )
                + contact_energy(
                    at,
                    near_live[within:],
                    near_pair,
                    near_offset,
                    near_parameters,
                    near_history,
                    drive[0],
                    drive[1],
                    drive[2],
                )
                + contact_energy(at, live[: window[1]], pair, offset, parameters, history, drive[0], drive[1], drive[2])
            )
        total[5] += carry[4]
        for a in range(3):
            total[5] -= 0.5 * dt * (carry[a] + sums[a]) * speed[a]
        carry[0], carry[1], carry[2] = sums[0], sums[1], sums[2]
        if target > 0.0:
            speed[2] += dt * (sums[2] - target - carriage[1] * speed[2]) / carriage[0]
        total[0] += sums[0]
        total[1] += sums[1]
        total[2] += sums[2]
        total[3] += sums[3]
        count = leapfrog_step_large(
            lines, at, rates, f, pushed, g, blocks, beams, section, beyond, mode, twist, grip, free, gripped,
            dt, damping, reaction, broken, released, moved,
        )  # fmt: skip
        total[4] += carry[3] + moved[1]
        total[5] += moved[3]
        carry[3], carry[4] = moved[2], moved[3]
        total[6] = moved[0]
        for k in range(count):
            total[9] += released[k]
        path = abs(speed[0]) + abs(speed[1]) + abs(speed[2])
        room -= dt * (2.0 * moved[5] + path)
    take_lines(at, blocks.place, u)
    take_lanes(rates, blocks.place, v)
    for i in range(len(q)):
        line = blocks.place[i]
        q[i, 0], q[i, 1], q[i, 2], q[i, 3] = lines[line, 3], lines[line, 4], lines[line, 5], lines[line, 6]
    total[7] = faces + moved[4]
    return done, count, room


check_compiled(contact_law)
