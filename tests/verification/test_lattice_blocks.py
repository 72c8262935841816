"""The blocks of the explicit engine: the same lattice, the same forces, the same bits on any processor."""

from __future__ import annotations

import hashlib
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from macrofit.base.arrays import FloatArray
from meso import kernels
from meso.engines.fracture import Breaking
from meso.engines.linear import Linear
from meso.engines.time_step import critical_time_step
from meso.lattice.blocks import WIDTH
from meso.lattice.candidates import ContactCandidates, Faces
from meso.lattice.equilibrium import forces
from meso.lattice.lattice import Lattice, build, join, turned_over
from meso.material import Beams, ExternalFace, Material
from meso.packing.pack import pack
from meso.settings import Breakage

DAMPING = 1e5
"""c of the force -c m v [1/s]."""


def plate(face: ExternalFace = "beams") -> Lattice:
    """A plate whose number of spheres is no multiple of eight, held by an external face."""
    packing = pack(np.random.default_rng(3), spheres=203, size=(0.6, 0.4), thickness=0.3)
    return build(packing, Material(), Beams(youngs_modulus=5e6, radius_ratio=0.33), cube=0.8, external_face=face)


Scene = tuple[Lattice, ContactCandidates, float, float]


def plates() -> Scene:
    """Two of them, the candidates of their faces, the height at which these first touch, and a time step."""
    wheel = turned_over(plate(), 0.9)
    lattice = join(wheel, plate())
    faces = Faces(lattice, wheel.nodes)
    height = faces.first_touch()
    meet = faces.candidates((height - 0.01, height), 0.02, 0.004, Material(), 1.0, 0.8)
    return lattice, meet, height, 0.8 * critical_time_step(lattice, meet)


def test_every_beam_is_listed_from_both_ends_and_few_rows_are_empty() -> None:
    lattice = plate()
    blocks, n = lattice.blocks, lattice.nodes
    assert np.array_equal(np.sort(blocks.place), np.arange(n))
    node = np.full(WIDTH * len(blocks.held), -1)
    node[blocks.place] = np.arange(n)
    row, lane = np.nonzero(blocks.bond >= 0)
    block = np.repeat(np.arange(len(blocks.held)), np.diff(blocks.start))
    here, there = node[WIDTH * block[row] + lane], node[blocks.others[row, lane] // WIDTH]
    bond = blocks.bond[row, lane]
    near = here == lattice.first[bond]
    assert np.array_equal(np.where(near, here, there), lattice.first[bond])
    assert np.array_equal(np.where(near, there, here), lattice.cols[bond])
    assert np.array_equal(np.bincount(2 * bond + near), np.ones(2 * len(lattice.cols)))
    signed = lattice.beams[bond] * np.where(near, 1.0, -1.0)[:, None] ** [1, 1, 1, 0, 0, 0]
    assert np.array_equal(blocks.beams[row, :, lane], signed)
    assert len(row) > 0.9 * blocks.bond.size
    assert not blocks.beams[:, kernels.AXIAL :][(blocks.bond < 0)[:, None].repeat(2, axis=1)].any()


@pytest.mark.parametrize("face", ["beams", "solid"])
def test_leapfrog_adds_up_the_forces_of_the_lattice(face: ExternalFace) -> None:
    """Against `forces`, one beam after the other, in 200 steps: rounding, 1e-16 a step, grown by the sums."""
    lattice = plate(face)
    dt = 0.9 * critical_time_step(lattice)
    mass = 1.0 / np.repeat(lattice.inverse, 3, axis=1)
    v = np.random.default_rng(0).normal(size=(lattice.nodes, 6)) / np.sqrt(mass)
    u, known_u, known = np.zeros_like(v), np.zeros_like(v), v.copy()
    for _ in range(200):
        push = known * (1.0 - 0.5 * DAMPING * dt) + dt * forces(lattice, known_u) / mass
        known = push / (1.0 + 0.5 * DAMPING * dt)
        known_u += dt * known
    twice_kinetic = kernels.leapfrog(u, v, lattice.blocks, lattice.twist, dt, DAMPING, 200)
    assert np.abs(v - known).max() < 1e-12 * np.abs(known).max()
    assert np.abs(u - known_u).max() < 1e-12 * np.abs(known_u).max()
    assert twice_kinetic == pytest.approx(np.sum(mass * v**2), rel=1e-13)


def pressed_and_slid(body: Linear | Breaking, height: float) -> FloatArray:
    """Motion and forces after a squeeze by 5 um and a slide of 20 um, in 200 steps."""
    body.drive[2] = height
    down = body.advance(100, (0.0, 0.0, -0.005 / (100 * body.dt)), damping=6e6)
    along = body.advance(100, (0.02 / (100 * body.dt), 0.0, 0.0), damping=5e5)
    assert np.isfinite(body.history[:, 0]).any()
    return np.concatenate([body.u.ravel(), body.v.ravel(), body.history.ravel(), down.force, along.force])


def bits(scene: Scene) -> list[str]:
    """Check sums of such runs, of linear lattices and of beams that break."""
    lattice, meet, height, dt = scene
    linear = Linear(lattice, dt=dt, micro_friction=0.1, candidates=meet)
    breaking = Breaking(
        lattice,
        Breakage(tensile_strength=5e3, shear_strength=5e3),
        dt=dt,
        contact_modulus=206e3,
        micro_friction=0.1,
        candidates=meet,
        wheel_nodes=lattice.nodes // 2,
    )
    found = [hashlib.sha256(pressed_and_slid(body, height).tobytes()).hexdigest() for body in (linear, breaking)]
    assert 0 < len(breaking.broken.bond) < len(lattice.cols)
    return found


OTHER = f"""
import pickle, sys
sys.path[:0] = [{str(Path(__file__).parent)!r}]
from test_lattice_blocks import bits
print(*bits(pickle.load(sys.stdin.buffer)))
"""


@pytest.mark.parametrize(("name", "features"), [("haswell", "+avx,+avx2,+fma"), ("generic", "")])
def test_the_same_bits_on_other_processors(name: str, features: str) -> None:
    """Registers of 256 bits, and of 128 without a fused product: as here, and as again here."""
    scene = plates()
    known = bits(scene)
    assert bits(scene) == known
    environment = os.environ | {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features}
    command = [sys.executable, "-c", OTHER]
    answer = subprocess.run(command, env=environment, input=pickle.dumps(scene), check=True, capture_output=True)
    assert answer.stdout.decode().split() == known
