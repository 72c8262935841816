"""The co-rotational beam: gradient of its energy, balanced, free of force when turned, `beam` when turned little."""

from __future__ import annotations

import numpy as np
import pytest

from macrofit.base.arrays import FloatArray
from meso import kernels
from meso.engines.fracture import Breaking
from meso.engines.time_step import critical_time_step
from meso.lattice.lattice import Lattice, build
from meso.material import Beams, Material
from meso.packing.pack import pack
from meso.settings import Breakage

LENGTH, AXIAL, BENDING, TWIST = 0.06, 3.0e4, 2.0, -0.3 / 1.3  # mm, N/mm, N mm, -
AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
ACROSS = np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)
UNBREAKABLE = Breakage(tensile_strength=np.inf, shear_strength=np.inf)


def quaternion(turn: FloatArray) -> FloatArray:
    """Of the rotation vector (3)."""
    angle = float(np.linalg.norm(turn))
    return np.array([np.cos(angle / 2.0), *(np.sinc(angle / (2.0 * np.pi)) / 2.0 * turn)])


def after(p: FloatArray, q: FloatArray) -> FloatArray:
    """The rotation q, then p."""
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


def matrix(q: FloatArray) -> FloatArray:
    """Shape (3, 3)."""
    return np.column_stack([kernels.turned(q, *column) for column in np.eye(3)])


def law(moved: FloatArray, turned: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Forces and moments (2, 6) on both ends of the beam, its energy, and the unit vector along it."""
    u = np.zeros((2, 6))
    u[:, :3] = moved
    answer = np.array(kernels.beam_large(*AXIS, 1.0 / LENGTH, AXIAL, BENDING, TWIST, *u, *turned))
    force = answer[3] * answer[:3] + answer[4:7]
    return np.array([[*force, *answer[7:10]], [*-force, *answer[10:13]]]), float(answer[15]), answer[:3]


def drawn(rng: np.random.Generator, size: float) -> tuple[FloatArray, FloatArray]:
    """Displacements (2, 3) of about size times the length, quaternions (2, 4) of about `size` rad."""
    moved = 0.3 * size * LENGTH * rng.normal(size=(2, 3))
    return moved, np.stack([quaternion(0.3 * size * rng.normal(size=3)) for _ in range(2)])


@pytest.mark.parametrize("size", [1e-3, 1e-1, 1.0, 3.0])
def test_force_is_the_gradient_of_the_energy(size: float) -> None:
    """At any rotation: central differences of 1e-5 rad leave 1e-10 of curvature and 1e-11 / size^2 of rounding.

    Moments about node i balance: T_i + T_j + (x_j - x_i) x F_j = 0 to the rounding of angles, 1e-15 EI/l and more.
    """
    rng, step = np.random.default_rng(7), 1e-5
    for _ in range(5):
        moved, turned = drawn(rng, size)
        gradient = np.zeros((2, 6))
        for node in (0, 1):
            for k in range(6):
                energies = []
                for sign in (step, -step):
                    m, q, unit = moved.copy(), turned.copy(), sign * np.eye(3)[k % 3]
                    if k < 3:
                        m[node] += LENGTH * unit
                    else:
                        q[node] = after(quaternion(unit), q[node])
                    energies.append(law(m, q)[1])
                gradient[node, k] = (energies[0] - energies[1]) / (2.0 * step * (LENGTH if k < 3 else 1.0))
        wrench, _, _ = law(moved, turned)
        scale = np.array([LENGTH] * 3 + [1.0] * 3)
        assert np.abs((wrench + gradient) * scale).max() < 1e-6 * np.abs(wrench * scale).max()
        arm = LENGTH * AXIS + moved[1] - moved[0]
        moment = wrench[0, 3:] + wrench[1, 3:] + np.cross(arm, wrench[1, :3])
        assert np.abs(moment).max() < 2e-14 * max(BENDING, np.abs(wrench * scale).max())


def test_small_rotations_give_the_linear_beam() -> None:
    """The difference from `beam` over the force shrinks as the rotation does (the chord lengthens by its square)."""
    sizes = np.array([1e-1, 1e-2, 1e-3, 1e-4])
    rng = np.random.default_rng(3)
    moved, turns = 0.3 * LENGTH * rng.normal(size=(2, 3)), 0.3 * rng.normal(size=(2, 3))
    error = []
    for size in sizes:
        u = size * np.hstack([moved, turns])
        answer = np.array(kernels.beam(*AXIS, 1.0 / LENGTH, AXIAL, BENDING, TWIST, u[0], u[1]))
        force, w, h = answer.reshape(3, 3)
        linear = np.array([[*force, *(w - h)], [*-force, *(-w - h)]])
        wrench, _, _ = law(u[:, :3], np.stack([quaternion(turn) for turn in u[:, 3:]]))
        error.append(np.linalg.norm(wrench - linear, axis=0) / np.linalg.norm(linear, axis=0))
    order = np.log10(np.array(error[:-1]) / np.array(error[1:]))
    assert np.all(order[1:] > 0.9)
    assert np.max(error[-1]) < 3e-4


def test_torsion_and_uniform_bending() -> None:
    """An angle p between the ends: moments g sin p about the axis, b sin p across it, no force; exact."""
    g = BENDING * (1.0 + TWIST)
    for angle in (1e-6, 0.1, 1.0):
        twisted = np.stack([quaternion(-0.5 * angle * AXIS), quaternion(0.5 * angle * AXIS)])
        wrench, energy, _ = law(np.zeros((2, 3)), twisted)
        assert wrench[0] == pytest.approx([0, 0, 0, *(g * np.sin(angle) * AXIS)], rel=1e-9, abs=1e-13)
        assert wrench[1] == pytest.approx(-wrench[0], rel=1e-9, abs=1e-13)
        assert energy == pytest.approx(2.0 * g * np.sin(angle / 2.0) ** 2, rel=1e-9)
        bent = np.stack([quaternion(-0.5 * angle * ACROSS), quaternion(0.5 * angle * ACROSS)])
        wrench, _, _ = law(np.zeros((2, 3)), bent)
        assert wrench[0] == pytest.approx([0, 0, 0, *(BENDING * np.sin(angle) * ACROSS)], rel=1e-9, abs=1e-13)


def test_cantilever() -> None:
    """Deflection F l^3/(3 EI), rotation F l^2/(2 EI) of the end carry F and no moment, to the square of the angle."""
    side = np.cross(ACROSS, AXIS)
    error = []
    for angle in (1e-2, 1e-3):
        force = 2.0 * BENDING / LENGTH * angle  # b = EI/l
        moved = np.stack([np.zeros(3), force * LENGTH**2 / (3.0 * BENDING) * side])
        turned = np.stack([quaternion(np.zeros(3)), quaternion(angle * np.cross(AXIS, side))])
        wrench, _, along = law(moved, turned)
        shear = wrench[1, :3] - (wrench[1, :3] @ along) * along
        error.append(max(abs(np.linalg.norm(shear) / force - 1.0), np.linalg.norm(wrench[1, 3:]) / (force * LENGTH)))
        assert shear @ side < 0.0  # it pulls the end back
    assert error[1] < 2e-6
    assert np.log10(error[0] / error[1]) == pytest.approx(2.0, abs=0.05)


@pytest.fixture(scope="module")
def block() -> Lattice:
    packing = pack(np.random.default_rng(5), spheres=120, size=(0.4, 0.3), thickness=0.3)
    return build(packing, Material(), Beams(youngs_modulus=5e6, radius_ratio=0.33))


def test_no_force_in_a_turned_block(block: Lattice) -> None:
    """Turned by any angle and carried off, no beam holds more than the rounding of its length, 1e-12 EA."""
    for angle in (1e-6, 0.3, 2.0, np.pi, 5.0):
        q = quaternion(angle * ACROSS)
        u = np.zeros((block.nodes, 6))
        u[:, :3] = block.centres @ (matrix(q) - np.eye(3)).T + [0.3, -0.2, 0.5]
        turned = np.tile(q, (block.nodes, 1))
        for k, (i, j) in enumerate(zip(block.first, block.cols, strict=True)):
            answer = kernels.beam_large(*block.beams[k], block.twist, u[i], u[j], turned[i], turned[j])
            assert np.abs(answer[3:13]).max() < 1e-12 * block.beams[k, 4] / block.beams[k, 3]


def test_small_motion_follows_the_linear_lattice(block: Lattice) -> None:
    """500 steps of `leapfrog` and of the large lattice, started alike: they differ in the order of the rotations."""
    dt = 0.8 * critical_time_step(block)
    error = []
    for size in (1e-6, 1e-7):
        body = Breaking(block, UNBREAKABLE, dt=dt, contact_modulus=206e3)
        body.v[:] = size / dt * np.random.default_rng(0).normal(size=(block.nodes, 6))
        body.v[:, :3] *= block.radii.mean()
        u, v = np.zeros_like(body.u), body.v.copy()
        body.advance(500)
        kernels.leapfrog(u, v, block.blocks, block.twist, dt, 0.0, 500)
        error.append(np.abs(body.v - v).max() / np.abs(v).max())
    assert error[1] < 1e-5
    assert error[0] / error[1] == pytest.approx(10.0, rel=0.05)


def test_spinning_block(block: Lattice) -> None:
    """Free, turned 2 rad in 4000 steps: both momenta to rounding, energy to the order of (strain) (omega dt)^2."""
    dt = 0.8 * critical_time_step(block)
    body = Breaking(block, UNBREAKABLE, dt=dt, contact_modulus=206e3)
    arm = block.centres - block.masses @ block.centres / block.masses.sum()
    axis = np.linalg.eigh(np.einsum("n,na,nb->ab", block.masses, arm, arm))[1][:, 0]  # the stiffest to spin about
    spin = 2.0 / (4000 * dt) * axis
    body.v[:, :3] = np.cross(spin, arm) + np.array([500.0, 0.0, 0.0])
    body.v[:, 3:] = spin
    linear, angular = momenta(body)
    first = body.advance(1).stored
    last = body.advance(3999)
    assert momenta(body)[0] == pytest.approx(linear, rel=1e-10, abs=1e-10 * np.abs(linear).max())
    assert momenta(body)[1] == pytest.approx(angular, rel=1e-10, abs=1e-10 * np.abs(angular).max())
    assert last.elastic > 1e-6 * last.kinetic  # it is strained by the spin
    assert last.stored == pytest.approx(first, rel=1e-6)
    mean = body.q.mean(axis=0) / np.linalg.norm(body.q.mean(axis=0))
    assert matrix(mean) == pytest.approx(matrix(quaternion(2.0 * axis)), abs=1e-4)


def momenta(body: Breaking) -> tuple[FloatArray, FloatArray]:
    """Linear and angular momentum of all spheres, the latter about the origin."""
    mass, inertia = 1.0 / body.lattice.inverse.T
    push = mass[:, None] * body.v[:, :3]
    return push.sum(axis=0), (np.cross(body.positions, push) + inertia[:, None] * body.v[:, 3:]).sum(axis=0)
