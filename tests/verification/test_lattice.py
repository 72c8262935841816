"""The lattice against the strength of materials: one beam, many beams, rigid motion, energy, momentum, time step.

Tolerances: a matrix entry is a sum of a dozen products and a force one of some 80, so that they agree to 1e-13 of the
largest. A central difference of a quadratic energy is exact; at a step of 1e-3 of u rounding leaves 1e-11 of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from found import Found
from scipy.linalg import eigh

from macrofit.base.arrays import FloatArray
from meso import kernels
from meso.lattice.lattice import Lattice, build, join, turned_over
from meso.material import Beams, ExternalFace, Material
from meso.packing.pack import Packing, pack
from meso.surfaces.surface import Surface, generator

BEAMS = Beams(youngs_modulus=5e6, radius_ratio=0.33)
STEEL = Material()
SPHERES = 80
STEPS = 100_000


def packing(number: int = 0) -> Packing:
    return pack(generator("test of the lattice", number), spheres=SPHERES, size=(0.4, 0.4), thickness=0.4)


def two_spheres() -> Packing:
    """They overlap by 1 % and lie askew."""
    radii, axis = np.array([0.03, 0.05]), np.array([2.0, -1.0, 2.0]) / 3.0
    middle = np.array([0.5, 0.5, 0.15])
    length = 0.99 * radii.sum()
    return Packing(np.array([middle, middle + length * axis]), radii, Surface.flat((1.0, 1.0)), 0.3)


def textbook(axis: FloatArray, E: float, nu: float, radius: float) -> FloatArray:
    """Stiffness (12, 12) of an Euler-Bernoulli beam of round section from 0 to `axis` [mm]; u, t of either end.

    The familiar matrix in a frame whose x is the beam's (Przemieniecki, Theory of Matrix Structural Analysis, 1968,
    eq. 5.116 without shear), carried into the global frame.
    """
    length = float(np.linalg.norm(axis))
    S, I = np.pi * radius**2, np.pi * radius**4 / 4.0  # noqa: E741
    G = E / (2.0 * (1.0 + nu))
    stretch, twist = E * S / length, 2.0 * G * I / length
    a, b, c, d = (E * I * n for n in (12.0 / length**3, 6.0 / length**2, 4.0 / length, 2.0 / length))
    local = np.zeros((12, 12))
    for p, k in ((0, stretch), (3, twist)):
        local[np.ix_([p, p + 6], [p, p + 6])] = k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    plane = np.array([[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]])
    for bent, sign in (((1, 5, 7, 11), 1.0), ((2, 4, 8, 10), -1.0)):
        signs = np.array([1.0, sign, 1.0, sign])  # a rotation about y lowers z ahead of it
        local[np.ix_(bent, bent)] = plane * np.outer(signs, signs)
    x = axis / length
    y = np.cross(x, np.eye(3)[np.argmin(np.abs(x))])
    y /= np.linalg.norm(y)
    turn = np.kron(np.eye(4), np.array([x, y, np.cross(x, y)]))
    matrix: FloatArray = turn.T @ local @ turn
    return matrix


def bond() -> tuple[Lattice, FloatArray, float]:
    """A lattice of one beam, its axis [mm] and its radius [mm]."""
    pair = two_spheres()
    return build(pair, STEEL, BEAMS), pair.centres[1] - pair.centres[0], BEAMS.radius_ratio * pair.radii.mean()


def force(lattice: Lattice, u: FloatArray) -> FloatArray:
    f = np.zeros((lattice.nodes, 6))
    kernels.beam_forces(
        u, f, lattice.rows, lattice.cols, lattice.beams, lattice.anchored, lattice.anchors, lattice.twist
    )
    return f


def rigid(lattice: Lattice) -> FloatArray:
    """Three shifts and three small rotations about the origin, shape (6, n, 6)."""
    motions = np.zeros((6, lattice.nodes, 6))
    for k, unit in enumerate(np.eye(3)):
        motions[k, :, :3] = unit
        motions[3 + k, :, :3] = np.cross(unit, lattice.centres)
        motions[3 + k, :, 3:] = unit
    return motions


def largest(matrix: FloatArray) -> float:
    return float(np.abs(matrix).max())


def test_tip_of_a_cantilever() -> None:
    """F l^3/3EI and F l^2/2EI across, F l/ES along, T l/G I_o about the axis."""
    lattice, axis, radius = bond()
    length = float(np.linalg.norm(axis))
    e = axis / length
    across = np.cross(e, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    E, S, I = BEAMS.youngs_modulus, np.pi * radius**2, np.pi * radius**4 / 4.0  # noqa: E741
    G = E / (2.0 * (1.0 + BEAMS.poisson_ratio))
    tip = lattice.stiffness().toarray()[6:, 6:]
    zero = np.zeros(3)
    bent = np.linalg.solve(tip, [*(3.0 * across), *zero])
    assert bent[:3] == pytest.approx(3.0 * length**3 / (3.0 * E * I) * across, rel=1e-12, abs=1e-12 * largest(bent))
    turned = 3.0 * length**2 / (2.0 * E * I) * np.cross(e, across)
    assert bent[3:] == pytest.approx(turned, rel=1e-12, abs=1e-12 * largest(turned))
    stretched = np.linalg.solve(tip, [*(3.0 * e), *zero])
    assert stretched[:3] == pytest.approx(3.0 * length / (E * S) * e, rel=1e-12)
    twisted = np.linalg.solve(tip, [*zero, *(3.0 * e)])
    assert twisted[3:] == pytest.approx(3.0 * length / (G * 2.0 * I) * e, rel=1e-12)


def test_one_beam_is_the_textbook_element() -> None:
    lattice, axis, radius = bond()
    expected = textbook(axis, BEAMS.youngs_modulus, BEAMS.poisson_ratio, radius)
    found = lattice.stiffness().toarray()
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)):
        for cols in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)):
            block = expected[rows, cols]
            assert largest(found[rows, cols] - block) <= 1e-13 * largest(block)


def test_many_beams_are_textbook_elements(found: Found) -> None:
    box = packing()
    lattice = build(box, STEEL, BEAMS)
    expected = np.zeros((6 * lattice.nodes, 6 * lattice.nodes))
    for i, j in box.contacts:
        radius = BEAMS.radius_ratio * 0.5 * (box.radii[i] + box.radii[j])
        place = np.concatenate([6 * i + np.arange(6), 6 * j + np.arange(6)])
        expected[np.ix_(place, place)] += textbook(
            box.centres[j] - box.centres[i], BEAMS.youngs_modulus, BEAMS.poisson_ratio, radius
        )
    error = largest(lattice.stiffness().toarray() - expected) / largest(expected)
    assert found("beams against the closed forms: stiffness", error, 1e-13)


def test_masses_add_up_to_the_hull() -> None:
    box = packing()
    lattice = build(box, STEEL, BEAMS)
    assert lattice.masses.sum() == pytest.approx(STEEL.density * box.volume, rel=1e-12)
    assert lattice.inverse[:, 1] == pytest.approx(1.0 / (0.4 * lattice.masses * lattice.radii**2), rel=1e-12)


def test_bars_of_beams_are_held_textbook_elements() -> None:
    """Each bar of the kind "beams" is the near end of a beam of radius R that hangs down to where it is held."""
    box = packing()
    lattice = build(box, STEEL, BEAMS, cube=1.0, external_face="beams")
    bare = build(box, STEEL, BEAMS).stiffness().toarray()
    found = lattice.stiffness().toarray() - bare
    for i, (along, across, couple, _, _) in zip(lattice.anchored, lattice.anchors, strict=True):
        length, radius = -2.0 * couple / across, box.radii[i]
        assert across * length**2 == pytest.approx(3.0 * along * radius**2, rel=1e-12)
        modulus = along * length / (np.pi * radius**2)
        expected = textbook(np.array([0.0, 0.0, -length]), modulus, BEAMS.poisson_ratio, radius)[:6, :6]
        place = slice(6 * i, 6 * i + 6)
        assert largest(found[place, place] - expected) <= 1e-13 * largest(bare)  # a difference of sums
        found[place, place] = 0.0
    assert not found.any()


def plate(face: ExternalFace | None, number: int = 0) -> Lattice:
    box = packing(number)
    if face is None:
        return build(box, STEEL, BEAMS)
    return build(box, STEEL, BEAMS, cube=1.0, external_face=face)


LATTICES: dict[str, Callable[[], Lattice]] = {
    "free": lambda: plate(None),
    "solid": lambda: plate("solid"),
    "beams": lambda: plate("beams"),
    "turned over": lambda: turned_over(plate("beams"), 0.8),
    "joined": lambda: join(turned_over(plate("beams", 1), 0.8), plate("solid")),
}


@pytest.fixture(params=LATTICES)
def lattice(request: pytest.FixtureRequest) -> Lattice:
    return LATTICES[request.param]()


def test_stiffness_is_that_of_the_kernel(lattice: Lattice, found: Found) -> None:
    u = generator("displacements").normal(size=(lattice.nodes, 6))
    u[:, :3] *= 0.05  # so that shifts and rotations load the beams alike
    expected = (lattice.stiffness() @ u.ravel()).reshape(-1, 6)
    for part in (slice(0, 3), slice(3, 6)):
        error = largest(force(lattice, u)[:, part] + expected[:, part]) / largest(expected[:, part])
        assert found("stiffness of a lattice against its force kernel", error, 1e-13)


def test_stiffness_is_symmetric_and_positive(lattice: Lattice) -> None:
    """Definite where an external face holds it; free, it has the six rigid motions and no other, per piece."""
    K = lattice.stiffness().toarray()
    assert largest(K - K.T) <= 1e-15 * largest(K)
    scale = np.sqrt(lattice.inverse[:, [0, 0, 0, 1, 1, 1]]).ravel()
    modes = np.linalg.eigvalsh(scale[:, None] * K * scale)
    zero = np.abs(modes) < 1e-12 * modes[-1]
    assert zero.sum() == (0 if len(lattice.anchored) else 6)
    assert modes[~zero].min() > 1e-7 * modes[-1]


def test_two_free_plates_have_twelve_zero_modes() -> None:
    both = join(plate(None), plate(None, 1))
    modes = np.linalg.eigvalsh(both.stiffness().toarray())
    assert np.sum(np.abs(modes) < 1e-12 * modes[-1]) == 12


@pytest.mark.parametrize("name", ["free", "turned over free"])
def test_rigid_motion_costs_no_force(name: str) -> None:
    lattice = plate(None) if name == "free" else turned_over(plate(None), 0.8)
    scale = np.abs(lattice.stiffness())
    for u in rigid(lattice):
        terms = (scale @ np.abs(u).ravel()).reshape(-1, 6)
        for part in (slice(0, 3), slice(3, 6)):
            assert largest(force(lattice, u)[:, part]) <= 1e-14 * largest(terms[:, part])


@pytest.mark.parametrize("face", ["solid", "beams"])
def test_turned_over_is_the_mirror_image(face: ExternalFace) -> None:
    """K' = S K S with the mirror S: z of the displacements, x and y of the rotations change sign."""
    upright = plate(face)
    mirror = np.tile([1.0, 1.0, -1.0, -1.0, -1.0, 1.0], upright.nodes)
    K, turned = upright.stiffness().toarray(), turned_over(upright, 0.8).stiffness().toarray()
    assert largest(turned - mirror[:, None] * K * mirror) <= 1e-15 * largest(K)


def energy(lattice: Lattice, u: FloatArray) -> float:
    """Of stretch, bending and torsion of the beams [N mm], by hand.

    phi = rotation of an end against the chord: U = k (d.e)^2/2 + 2 b (phi_i^2 + phi_i.phi_j + phi_j^2)
    + (G I_o/l) ((t_j - t_i).e)^2/2, b = EI/l.
    """
    e, per_length = lattice.beams[:, :3], lattice.beams[:, 3:4]
    near, far = u[lattice.first], u[lattice.cols]
    d = far[:, :3] - near[:, :3]
    chord = np.cross(e, d) * per_length
    stretch = np.sum(d * e, axis=1)
    twist = np.sum((far[:, 3:] - near[:, 3:]) * e, axis=1)
    p, q = (t - np.sum(t * e, axis=1, keepdims=True) * e - chord for t in (near[:, 3:], far[:, 3:]))
    bent = np.sum(p * p + p * q + q * q, axis=1)
    b = lattice.beams[:, 5]
    torsion = b / (1.0 + BEAMS.poisson_ratio)
    return float(np.sum(0.5 * lattice.beams[:, 4] * stretch**2 + 2.0 * b * bent + 0.5 * torsion * twist**2))


def test_force_is_the_gradient_of_the_energy() -> None:
    lattice, rng = plate(None), generator("directions")
    u = rng.normal(size=(lattice.nodes, 6)) * [0.05, 0.05, 0.05, 1.0, 1.0, 1.0]
    assert energy(lattice, u) == pytest.approx(0.5 * u.ravel() @ (lattice.stiffness() @ u.ravel()), rel=1e-13)
    f, rate = force(lattice, u), 1e-3
    for _ in range(20):
        step = rate * rng.normal(size=u.shape) * [0.05, 0.05, 0.05, 1.0, 1.0, 1.0]
        slope = 0.5 * (energy(lattice, u + step) - energy(lattice, u - step))
        assert slope == pytest.approx(-np.sum(f * step), abs=1e-6 * np.linalg.norm(f) * np.linalg.norm(step))


def critical(lattice: Lattice) -> float:
    """2/sqrt(lambda_max(M^-1 K)) [s], by a dense solver."""
    mass = np.diag(1.0 / lattice.inverse[:, [0, 0, 0, 1, 1, 1]].ravel())
    last = 6 * lattice.nodes - 1
    top = eigh(lattice.stiffness().toarray(), mass, eigvals_only=True, subset_by_index=(last, last))
    return float(2.0 / np.sqrt(top[0]))


class Motion:
    """A free lattice let go with random velocities, less 99 % of their rigid motion.

    With all of it the lattice would turn by 370 rad in 1e5 steps, and what rounding leaves of a rigid turn's moment
    (the axes of the beams are units to 1e-16 only), summed over time, reaches 1.5e-10 of the angular momentum.
    """

    def __init__(self, lattice: Lattice, fraction: float) -> None:
        self.lattice, self.dt = lattice, fraction * critical(lattice)
        self.mass = 1.0 / lattice.inverse[:, [0, 0, 0, 1, 1, 1]]
        self.u = np.zeros((lattice.nodes, 6))
        self.v = generator("velocities").normal(size=(lattice.nodes, 6)) / np.sqrt(self.mass)
        R = rigid(lattice).reshape(6, -1)
        share = np.linalg.solve((R * self.mass.ravel()) @ R.T, R @ (self.mass * self.v).ravel())
        self.v -= 0.99 * (share @ R).reshape(-1, 6)

    def run_leapfrog(self, steps: int) -> float:
        lattice = self.lattice
        return float(kernels.leapfrog(self.u, self.v, lattice.blocks, lattice.twist, self.dt, 0.0, steps))

    def energy(self) -> float:
        """v-.M v+ / 2 + u.K u / 2 [N mm]; one step on.

        With the velocities half a step before and after u: what the leapfrog keeps of a linear system, to rounding.
        The mean of both kinetic energies in its place swings with the square of the time step.
        """
        before, u = self.v.copy(), self.u.copy()
        self.run_leapfrog(1)
        stored = u.ravel() @ (self.lattice.stiffness() @ u.ravel())
        return float(0.5 * (np.sum(before * self.mass * self.v) + stored))

    def momentum(self) -> FloatArray:
        """Linear, and angular about the origin at the rest places, of each node: shape (n, 6)."""
        p: FloatArray = self.mass * self.v
        p[:, 3:] += np.cross(self.lattice.centres, p[:, :3])
        return p


def test_energy_and_momentum_stay_over_1e5_steps_at_nine_tenths_of_the_critical_one(found: Found) -> None:
    """Rounding adds up to 1e5 times 1e-16 at worst, and a little for the rigid turn."""
    motion = Motion(plate(None), 0.9)
    energy, momentum = motion.energy(), motion.momentum()
    motion.run_leapfrog(STEPS)
    what = "free lattice, 1e5 steps of 0.9 of the limit:"
    assert found(f"{what} energy", abs(motion.energy() / energy - 1.0), 1e-9)
    lost = np.abs((motion.momentum() - momentum).sum(axis=0)) / np.abs(momentum).sum(axis=0)
    assert found(f"{what} momentum", lost.max(), 1e-10)


def test_a_step_above_the_critical_one_blows_up(found: Found) -> None:
    """By exp(2 acosh(1.1)) = 2.4 per step in the fastest mode: 1e77 in 200 steps."""
    motion = Motion(plate(None), 1.1)
    start = motion.run_leapfrog(1)
    grown = motion.run_leapfrog(200) / start
    assert found("the same, 200 steps of 1.1 of the limit: growth of the energy", grown, 1e70, at_least=True)
