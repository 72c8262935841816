"""Calibration of the beams: tensile tests on packed boxes until they stretch and narrow as the material does.

The order is that of Andre et al. 2012, CMAME 213-216, 113-125 (https://doi.org/10.1016/j.cma.2011.12.002): nu_mu is
fixed, since it hardly matters; the radius ratio r~ follows from the Poisson ratio nu_M; E_mu follows from Young's
modulus E_M, to which it is proportional. The tests are static, one sparse solve each, where the paper has dynamics;
`dynamic_tensile_test` is its way, for comparison.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import msgspec
import numpy as np
from scipy.optimize import brentq
from scipy.sparse import diags

from macrofit.base.arrays import BoolArray, FloatArray, IntArray

from . import kernels
from .engines.time_step import critical_time_step
from .errors import SettingsError
from .lattice.calibration import Calibration
from .lattice.cholmod import factor
from .lattice.equilibrium import forces
from .lattice.lattice import BACK, build
from .lattice.modulus import STRAIN, middle_strain
from .material import Beams, Material
from .packing.pack import Packing, pack
from .surfaces.surface import generator

BRACKET = (0.2, 0.9)
"""Radius ratios between which the root is sought [-]: nu_M from 0.35 to 0.1."""


class TensileTest(msgspec.Struct, frozen=True, kw_only=True):
    """What a box shows when it is pulled; means over the axes where there are several."""

    youngs_modulus: float
    """E_M = (F / A) / axial strain [MPa], A the nominal area of the box."""
    poisson_ratio: float
    """nu_M = -(mean of the two lateral strains) / axial strain [-]."""


class Influence(msgspec.Struct, frozen=True, kw_only=True):
    """One point of the figures of the paper: what the beams make of a packing."""

    beams: Beams
    test: TensileTest


class Scatter(msgspec.Struct, frozen=True, kw_only=True):
    """Spread of the macroscopic constants over packings of one size; standard deviations are of one packing."""

    spheres: int
    packings: int
    youngs_modulus: float
    """Mean Young's modulus [MPa]."""
    modulus_scatter: float
    """Standard deviation over mean [-]."""
    poisson_ratio: float
    """Mean Poisson ratio [-]."""
    poisson_scatter: float
    """Standard deviation [-]."""


def tensile_test(packing: Packing, beams: Beams, *, axes: Sequence[int] = (0, 1, 2)) -> TensileTest:
    """Pull a flat box along one axis after the other, statically, and take the mean.

    The spheres at both ends (centre closer to the face than 1.25 radii) move along the axis as a uniform strain
    would move them and are free otherwise: clamped ends hinder the lateral strain and, in a cube, lower nu_M by
    0.02 and raise E_M by 2 %. Strain is the slope of a linear fit of the displacements to the coordinates in the
    middle half, where the ends are not felt. The packing is denser along walls, so the axes differ; in a cube by
    chance only, in a plate truly.

    Args:
        packing: a flat box.
        beams: between its spheres.
        axes: along which to pull, 0 to 2.
    """
    lattice = build(packing, Material(), beams)
    K = lattice.stiffness()
    results = []
    for axis in axes:
        ends, far = _ends(packing, axis)
        fixed = _pinned(packing.centres, ends, axis)
        u = np.zeros((lattice.nodes, 6))
        u[ends, axis] = STRAIN * packing.centres[ends, axis]
        u = _solve(K, fixed.ravel(), u.ravel()).reshape(-1, 6)
        force = (K @ u.ravel()).reshape(-1, 6)[far, axis].sum()
        results.append(_measured(packing, axis, u, force))
    return TensileTest(
        youngs_modulus=float(np.mean([test.youngs_modulus for test in results])),
        poisson_ratio=float(np.mean([test.poisson_ratio for test in results])),
    )


def dynamic_tensile_test(
    packing: Packing, beams: Beams, *, axis: int = 0, material: Material | None = None, damping: float = 0.5
) -> TensileTest:
    """The tensile test in explicit dynamics, as in the paper: the ends are drawn apart and then held.

    Their speed is constant for five periods T = 2 L sqrt(rho/E_M) of the first mode, then zero for five; what swings
    is damped by c = 2 zeta (2 pi/T). The test is `tensile_test` in all else.

    Args:
        packing: a flat box.
        beams: between its spheres.
        axis: along which to pull, 0 to 2.
        material: its density and modulus set the time scale; steel by default.
        damping: zeta [-].
    """
    material = material or Material()
    lattice = build(packing, material, beams)
    dt = 0.9 * critical_time_step(lattice)
    period = 2.0 * _edges(packing)[axis] * np.sqrt(material.density / material.youngs_modulus)
    steps = int(np.ceil(5.0 * period / dt))
    ends, far = _ends(packing, axis)
    final = STRAIN * packing.centres[ends, axis]
    u, v = np.zeros((lattice.nodes, 6)), np.zeros((lattice.nodes, 6))
    for step in range(2 * steps):
        kernels.leapfrog(u, v, lattice.blocks, lattice.twist, dt, 4.0 * np.pi * damping / period, 1)
        u[ends, axis] = min(1.0, (step + 1) / steps) * final
        v[ends, axis] = final / (steps * dt) if step < steps else 0.0
    return _measured(packing, axis, u, -forces(lattice, u)[far, axis].sum())


def calibrate(
    material: Material | None = None,
    *,
    spheres: int = 2000,
    packings: int = 20,
    box: tuple[float, float, float] = (1.0, 1.0, 1.0),
    seed: int = 0,
    poisson_ratio: float = 0.3,
) -> Calibration:
    """Find the beams of a material: r~ where the mean of nu_M over the packings is the material's, then E_mu.

    Args:
        material: steel by default; only its Poisson ratio matters, for E_mu/E_M is stored.
        spheres: in each packing.
        packings: number of them.
        box: edges [mm].
        seed: of the packings.
        poisson_ratio: nu_mu of the beams [-].

    Raises:
        SettingsError: no radius ratio in 0.2 ... 0.9 gives the Poisson ratio; no packing.
        PackingError: the box cannot be filled.
    """
    material = material or Material()
    if packings < 1:
        raise SettingsError(f"packings = {packings}: take at least 1, better 10")
    boxes = sample("calibration", seed, spheres=spheres, packings=packings, box=box)

    @cache
    def found(ratio: float) -> Scatter:
        beams = Beams(youngs_modulus=material.youngs_modulus, radius_ratio=ratio, poisson_ratio=poisson_ratio)
        return _scatter(spheres, [tensile_test(packing, beams) for packing in boxes])

    def excess(ratio: float) -> float:
        return found(ratio).poisson_ratio - material.poisson_ratio

    low, high = (excess(ratio) for ratio in BRACKET)
    if not low >= 0.0 >= high:
        raise SettingsError(
            f"material: no beams give poisson_ratio = {material.poisson_ratio:g}: these packings reach "
            f"{high + material.poisson_ratio:.3f} to {low + material.poisson_ratio:.3f}"
        )
    ratio = float(brentq(excess, *BRACKET, xtol=1e-4, rtol=1e-6))
    at_root = found(ratio)
    return Calibration(
        poisson_ratio=material.poisson_ratio,
        radius_ratio=ratio,
        stiffening=material.youngs_modulus / at_root.youngs_modulus,
        beams_poisson_ratio=poisson_ratio,
        spheres=spheres,
        box=box,
        packings=packings,
        modulus_scatter=at_root.modulus_scatter,
        poisson_scatter=at_root.poisson_scatter,
        residual=abs(excess(ratio)),
    )


def influence(packing: Packing, *, radius_ratios: Sequence[float], youngs_moduli: Sequence[float]) -> list[Influence]:
    """E_M and nu_M for every pair of r~ [-] and E_mu [MPa], each from tests of its own: the figures of the paper."""
    choices = [Beams(youngs_modulus=modulus, radius_ratio=r) for r in radius_ratios for modulus in youngs_moduli]
    return [Influence(beams=beams, test=tensile_test(packing, beams)) for beams in choices]


def scatter(beams: Beams, *, spheres: Sequence[int], packings: int, seed: int = 0) -> list[Scatter]:
    """Spread over `packings` cubes of 1 mm for each number of spheres: one row each."""
    rows = []
    for count in spheres:
        boxes = sample("scatter", seed, spheres=count, packings=packings)
        rows.append(_scatter(count, [tensile_test(packing, beams) for packing in boxes]))
    return rows


def sample(
    purpose: str, seed: int, *, spheres: int, packings: int, box: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> list[Packing]:
    """Packings of one flat box [mm], from streams of their own."""
    return [
        pack(generator(purpose, seed, spheres, k), spheres=spheres, size=box[:2], thickness=box[2])
        for k in range(packings)
    ]


def _edges(packing: Packing) -> FloatArray:
    return np.array([*packing.size, packing.thickness])


def _ends(packing: Packing, axis: int) -> tuple[IntArray, IntArray]:
    """Spheres at both ends of the box, and those at the far one."""
    x, reach = packing.centres[:, axis], BACK * packing.radii
    far = np.flatnonzero(_edges(packing)[axis] - x < reach)
    return np.concatenate([np.flatnonzero(x < reach), far]), far


def _pinned(centres: FloatArray, ends: IntArray, axis: int) -> BoolArray:
    """What is fixed, shape (n, 6): the ends along the axis, and three components more against rigid motion."""
    p, q = (axis + 1) % 3, (axis + 2) % 3
    fixed = np.zeros((len(centres), 6), dtype=np.bool_)
    fixed[ends, axis] = True
    first, second = centres[:, p].argmin(), centres[:, p].argmax()
    fixed[first, [p, q]] = fixed[second, q] = True
    return fixed


def _solve(K: object, fixed: BoolArray, u: FloatArray) -> FloatArray:
    """The solution of K u = 0 but for what is fixed: those rows and columns become the identity's."""
    free, held = diags((~fixed).astype(float)), diags(fixed.astype(float))
    rhs = np.where(fixed, u, -(K @ u))  # type: ignore[operator]
    return factor(free @ K @ free + held).solve(rhs)


def _measured(packing: Packing, axis: int, u: FloatArray, force: float) -> TensileTest:
    """From the displacements u (n, 6) [mm] and the force [N] on the far end."""
    strain, edges = middle_strain(packing, u, axis), _edges(packing)
    lateral = 0.5 * (strain.sum() - strain[axis])
    stress = force * edges[axis] / edges.prod()
    return TensileTest(youngs_modulus=float(stress / strain[axis]), poisson_ratio=float(-lateral / strain[axis]))


def _scatter(spheres: int, tests: Sequence[TensileTest]) -> Scatter:
    modulus, poisson = np.array([(test.youngs_modulus, test.poisson_ratio) for test in tests]).T
    freedom = 1 if len(tests) > 1 else 0
    return Scatter(
        spheres=spheres,
        packings=len(tests),
        youngs_modulus=float(modulus.mean()),
        modulus_scatter=float(modulus.std(ddof=freedom) / modulus.mean()),
        poisson_ratio=float(poisson.mean()),
        poisson_scatter=float(poisson.std(ddof=freedom)),
    )
