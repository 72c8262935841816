"""A bar of spheres pulled until it breaks: notch, grips, the static stresses of its beams, force against stretch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray, IntArray

from ..lattice.lattice import Lattice
from ..settings import Breakage
from .fracture import SHEAR, TENSION, Account, Breaking, sections


def without(lattice: Lattice, beams: npt.NDArray[np.bool_]) -> Lattice:
    """The lattice less some beams, given as a mask (bonds,): a notch."""
    rows = np.concatenate([[0], np.cumsum(np.bincount(lattice.first[~beams], minlength=lattice.nodes))])
    return replace(lattice, rows=rows, cols=lattice.cols[~beams], beams=np.ascontiguousarray(lattice.beams[~beams]))


def stresses(lattice: Lattice, u: FloatArray) -> FloatArray:
    """N/S + r |M_b|/I and 4/3 V/S + r |M_t|/I_o of the linear lattice displaced by u (n, 6), shape (bonds, 2) [MPa]."""
    e, per_length, axial, bending = lattice.beams[:, :3], *lattice.beams[:, 3:].T
    ui, uj = u[lattice.first], u[lattice.cols]
    d, turn = uj[:, :3] - ui[:, :3], uj[:, 3:] - ui[:, 3:]
    chord = per_length[:, None] * np.cross(e, d)
    near, far = (t - np.sum(t * e, axis=1)[:, None] * e - chord for t in (ui[:, 3:], uj[:, 3:]))
    moment = 2.0 * bending * np.sqrt(np.maximum(np.sum((2.0 * near + far) ** 2, 1), np.sum((2.0 * far + near) ** 2, 1)))
    shear = 6.0 * bending * per_length * np.linalg.norm(near + far, axis=1)
    torsion = bending * (1.0 + lattice.twist) * np.abs(np.sum(turn * e, axis=1))
    per_area, per_modulus = sections(lattice).T
    tensile = per_area * axial * np.sum(d * e, axis=1) + per_modulus * moment
    return np.stack([tensile, 4.0 / 3.0 * per_area * shear + 0.5 * per_modulus * torsion], axis=1)


def first_break(lattice: Lattice, u: FloatArray, breakage: Breakage) -> tuple[float, int, int]:
    """Factor on a static solution u (n, 6) at which the first beam breaks, its number and its mode.

    Once u is that of a unit macroscopic stress, the factor is the stress at the first break [MPa]. It is proportional
    to the strengths, so those that make a solid of a given strength follow: for steel in tension they are 60 times
    larger. Bars pulled, with a notch or without, carried at most 1 % more than at their first break.
    """
    ratio = stresses(lattice, u) / np.array([breakage.tensile_strength, breakage.shear_strength])
    bond, mode = np.unravel_index(np.argmax(ratio), ratio.shape)
    return float(1.0 / ratio[bond, mode]), int(bond), (TENSION, SHEAR)[mode]


@dataclass(frozen=True)
class Pulled:
    """A bar pulled along x: its force against its stretch."""

    stretch: FloatArray
    """Increase of the distance of the grips at the end of each sample, shape (k,) [mm]."""
    force: FloatArray
    """Mean over each sample of the pull of both grips, shape (k,) [N]."""
    accounts: tuple[Account, ...]
    """Account of the energies at the end of each sample."""


def ends(lattice: Lattice, depth: float) -> IntArray:
    """Grips 1 and 2: the spheres whose centres are within `depth` [mm] of the first and of the last along x."""
    x = lattice.centres[:, 0]
    return np.where(x <= x.min() + depth, 1, np.where(x >= x.max() - depth, 2, 0))


def pull(bar: Breaking, *, stretch: float, speed: float, samples: int, damping: float = 0.0) -> Pulled:
    """Move grips 1 and 2 apart along x by `stretch` [mm] at `speed` [mm/s], in equal samples.

    The free spheres start with the velocities of a uniform strain, so that no wave runs through the bar.
    """
    x = bar.lattice.centres[:, 0]
    low, high = x[bar.grip == 1].max(), x[bar.grip == 2].min()
    bar.v[:, 0] = speed * (np.clip((x - low) / (high - low), 0.0, 1.0) - 0.5)
    steps = max(1, round(stretch / (speed * bar.dt * samples)))
    accounts = tuple(bar.advance(steps, damping=damping) for _ in range(samples))
    force = np.array([0.5 * (account.grips[1, 0] - account.grips[0, 0]) for account in accounts])
    return Pulled(speed * bar.dt * steps * np.arange(1, samples + 1), force, accounts)
