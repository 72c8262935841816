"""Plates and bars whose beams can break: cracks that start and grow, pieces that turn, touch and fly.

The lattice is co-rotational (`kernels.beam_large`). In every step each beam of radius r, S = pi r^2, I = pi r^4/4,
I_o = 2 I breaks where

    N/S + r |M_b|/I > tensile strength     (tension and bending, at the end that is bent more)
    4/3 V/S + r |M_t|/I_o > shear strength (shear and torsion, on the neutral axis)

with N > 0 in tension. The strengths are those of the beams, not of the solid: a lattice of E_M = 210 GPa has beams
of E_mu = 5 TPa or so, whose stresses are larger by about as much, and unequal. `tension.first_break` tells by how much
in any static state; a force at failure is found by pulling a bar (`tension.pull`) and scales with the strengths.

A sphere that has lost a beam is detached: it pushes on whatever comes near it, by the contact law of the plates.
The two ends of a broken beam touch where they come closer than its length, with its stiffness EA/l, so a
compression goes on without a jump; two others that overlap without ever having touched do so from where they are.
Left out: damage before the break, rate effects, and the rolling and twisting of spheres against each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from macrofit.base.arrays import FloatArray, IntArray

from .. import kernels
from ..errors import StabilityError
from ..lattice.blocks import in_lines
from ..lattice.candidates import NOBODY, ContactCandidates
from ..lattice.lattice import Lattice
from ..records import Sums
from ..settings import Breakage

TENSION, SHEAR = 1, 2
"""Modes in which a beam breaks."""
SKIN = 0.2
"""Reach of the pairs near detached spheres beyond contact, in mean radii [-]."""


@dataclass(frozen=True, kw_only=True)
class Broken:
    """The beams that broke, in time."""

    time: FloatArray
    """Shape (k,) [s]."""
    slide: FloatArray
    """Where the drive was along x, shape (k,) [mm]."""
    bond: IntArray
    """Number of the beam, shape (k,)."""
    mode: IntArray
    """TENSION or SHEAR, shape (k,)."""
    ends: IntArray
    """Spheres, shape (k, 2)."""
    place: FloatArray
    """Middle of the beam before any motion, shape (k, 3) [mm]."""
    released: FloatArray
    """Energy it gave up, shape (k,) [N mm]."""


@dataclass(frozen=True)
class Account(Sums):
    """Sums over some steps, and the energies at their end: work = d(stored) + losses + released."""

    grips: FloatArray
    """Mean force and sum of the moments that each grip exerts, shape (grips, 6) [N, N mm]."""
    kinetic: float
    """sum of m v-.v+ / 2 with the velocities half a step before and after: exact where the forces are linear [N mm]."""
    elastic: float
    """Elastic energy of the beams and external faces [N mm]."""
    contact: float
    """Energy stored in the contacts [N mm]."""

    @property
    def stored(self) -> float:
        """Kinetic, elastic and contact energy [N mm]."""
        return self.kinetic + self.elastic + self.contact

    @property
    def lost(self) -> float:
        """By friction, damping and breaks [N mm]."""
        return self.friction + self.damping + self.released


class Breaking:
    """An explicit run of a lattice whose beams may break.

    Args:
        lattice: One plate or bar, or the two plates joined, the wheel's nodes first.
        breakage: Strengths; those of single beams may be changed in `section[:, 2:]` [MPa] before the run.
        contact_modulus: k_n = contact_modulus (r_i + r_j)/2 where detached spheres meet [MPa]: normal_stiffness E_M.
        tangential_ratio: k_t/k_n of detached spheres [-].
        micro_friction: Coefficient of every contact [-].
        candidates: Of the two faces, as long as neither sphere is detached.
        wheel_nodes: How many nodes are the wheel's; the drive carries them.
        grip: Shape (n,): 0 free, or the number of the grip that moves the sphere at its velocity v.
        dt: Time step [s]: 0.8 of the critical one leaves room for the contacts of broken pieces.
    """

    def __init__(
        self,
        lattice: Lattice,
        breakage: Breakage,
        *,
        dt: float,
        contact_modulus: float,
        tangential_ratio: float = 0.8,
        micro_friction: float = 0.0,
        candidates: ContactCandidates = NOBODY,
        wheel_nodes: int = 0,
        grip: IntArray | None = None,
    ) -> None:
        n, bonds = lattice.nodes, len(lattice.cols)
        self.lattice, self.wheel_nodes, self.micro_friction = lattice, wheel_nodes, micro_friction
        self.contact_modulus, self.tangential_ratio = contact_modulus, tangential_ratio
        self.dt, self.steps, self.drive, self.speed = dt, 0, np.zeros(3), np.zeros(3)
        self.u, self.v = np.zeros((n, 6)), np.zeros((n, 6))
        self.q = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        self.grip = np.zeros(n, np.int64) if grip is None else grip.astype(np.int64)
        self.mode = np.zeros(bonds, np.int64)
        self.section = np.empty((bonds, 4))
        self.section[:, :2] = sections(lattice)
        self.section[:, 2:] = breakage.tensile_strength, breakage.shear_strength
        self.detached = np.zeros(n, np.bool_)
        self.candidates, self.history = candidates, candidates.at_rest()
        self.meet(candidates)
        self._near, self._near_history, self._within, self._room = NOBODY, NOBODY.at_rest(), 0, np.inf
        self._blocked: tuple[FloatArray, FloatArray] | None = None
        self._carry = np.zeros(5)
        self._key = lattice.first * n + lattice.cols
        self._by_key = np.argsort(self._key, kind="stable")
        self._broken, self._released = np.empty(bonds, np.int64), np.empty(bonds)
        self._log: list[tuple[float, float, IntArray, FloatArray]] = []

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return self.steps * self.dt

    @property
    def positions(self) -> FloatArray:
        """Places of the centres now, shape (n, 3) [mm]."""
        x: FloatArray = self.lattice.centres + self.u[:, :3]
        x[: self.wheel_nodes] += self.drive
        return x

    @property
    def broken(self) -> Broken:
        """Every beam that broke so far."""
        bond = np.concatenate([np.empty(0, np.int64), *(number for *_, number, _ in self._log)])
        when = np.array([(time, slide) for time, slide, number, _ in self._log for _ in number]).reshape(-1, 2)
        ends = np.stack([self.lattice.first[bond], self.lattice.cols[bond]], axis=1)
        place = self.lattice.centres[ends].mean(axis=1)
        released = np.concatenate([np.empty(0), *(energy for *_, energy in self._log)])
        return Broken(
            time=when[:, 0],
            slide=when[:, 1],
            bond=bond,
            mode=self.mode[bond],
            ends=ends,
            place=place,
            released=released,
        )

    @property
    def live(self) -> IntArray:
        """Numbers of the candidates that are looked at now, those of detached spheres left out."""
        live: IntArray = self._live[: self._window[1]]
        live = live[~self.detached[self.candidates.pair[live]].any(axis=1)]
        return live

    def stored(self) -> tuple[float, float, float]:
        """Energy in the beams, in the contacts, and kinetic energy, at the end of the last steps [N mm]."""
        return self.account.elastic, self.account.contact, self.account.kinetic

    def meet(self, candidates: ContactCandidates) -> None:
        """Take other candidates of the two faces; those known from before keep their history."""
        self.candidates, self.history = candidates, candidates.remembering(self.candidates, self.history)
        self._places = self.lattice.blocks.place[candidates.pair]
        self._window, self._live = np.zeros(2, np.int64), np.empty(len(self.history), np.int64)

    def pieces(self) -> IntArray:
        """Number of the connected piece each sphere belongs to, the largest first, shape (n,)."""
        whole, n = self.mode == 0, self.lattice.nodes
        graph = coo_matrix((np.ones(whole.sum()), (self.lattice.first[whole], self.lattice.cols[whole])), shape=(n, n))
        count, label = connected_components(graph, directed=False)
        rank = np.empty(count, np.int64)
        rank[np.argsort(-np.bincount(label), kind="stable")] = np.arange(count)
        piece: IntArray = rank[label]
        return piece

    def advance(
        self,
        steps: int,
        speed: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        damping: float = 0.0,
        target: float = 0.0,
        carriage: Sequence[float] = (1.0, 0.0),
    ) -> Account:
        """Take some leapfrog steps while the wheel is carried at `speed` [mm/s]; see `kernels.run_leapfrog`.

        Args:
            steps: How many, at least one.
            speed: Of the wheel (3) [mm/s].
            damping: c of the force -c m v [1/s].
            target: Load under which the wheel falls freely [N], or 0 for the vertical speed prescribed.
            carriage: Its mass [t] and damping [N s/mm], where there is a target.

        Raises:
            StabilityError: the motion is not finite.
        """
        lattice, meet = self.lattice, self.candidates
        total, left, falling = np.zeros(10), steps, np.array(carriage, dtype=np.float64)
        self.speed[: 2 if target > 0.0 else 3] = speed[: 2 if target > 0.0 else 3]
        reaction = np.zeros((self.grip.max(initial=0), 6))
        while left > 0:
            near, (beams, section) = self._near, self._in_blocks()
            done, count, self._room = kernels.run_leapfrog_large(
                self.u, self.v, self.q, lattice.blocks, beams, section, self.mode, lattice.twist, self.grip,
                self.dt, damping, meet.first, meet.last, self._places, meet.offset, meet.parameters, self.history,
                self.micro_friction, self._window, self._live, self.detached,
                lattice.blocks.place[near.pair], near.offset, near.parameters, self._near_history,
                np.arange(len(near.pair)), self._within,
                self._room, self.drive, self.speed, target, falling, left, reaction,
                self._broken, self._released, self._carry, total,
            )  # fmt: skip
            left -= done
            self.steps += done
            if not np.isfinite(total[6]):
                raise StabilityError(f"no finite motion after {self.steps} steps: take dt below {self.dt:.3g} s")
            if count:
                bond = self._broken[:count].copy()
                self._log.append((self.time, float(self.drive[0]), bond, self._released[:count].copy()))
                self.loosen(np.concatenate([lattice.first[bond], lattice.cols[bond]]))
            elif self._room <= 0.0:
                self._renew()
        self.account = Account(
            force=total[:3] / steps, grips=reaction / steps, work=total[5], friction=total[3], damping=total[4],
            released=total[9], kinetic=0.5 * total[6], elastic=total[7], contact=total[8],
        )  # fmt: skip
        return self.account

    def _in_blocks(self) -> tuple[FloatArray, FloatArray]:
        """Beams and their section from both ends, those that break without stiffness; of the first steps on."""
        if self._blocked is None:
            blocks = self.lattice.blocks
            self._blocked = in_lines(blocks.beams), blocks.from_both_ends(self.section, (0.0, 0.0, np.inf, np.inf))
        return self._blocked

    def loosen(self, nodes: IntArray) -> None:
        """Let spheres meet whatever comes near them, as if they had lost a beam: the flanks of a notch, say."""
        self.detached[nodes] = True
        self._renew()

    def _renew(self) -> None:
        """List again the pairs near detached spheres; those that were known keep their law and history."""
        lattice, old, x = self.lattice, self._near, self.positions
        skin = SKIN * lattice.radii.mean()
        detached = np.flatnonzero(self.detached)
        reach = 2.0 * lattice.radii.max() + skin
        ends = cKDTree(x[detached]).sparse_distance_matrix(cKDTree(x), reach, output_type="coo_matrix")
        i, j = np.sort([detached[ends.row], ends.col], axis=0)
        key = np.unique((i * lattice.nodes + j)[i < j])
        i, j = np.divmod(key, lattice.nodes)  # i < j: the wheel's node first
        radii = np.stack([lattice.radii[i], lattice.radii[j]], axis=1)
        touching, distance = radii.sum(axis=1), np.linalg.norm(x[j] - x[i], axis=1)
        place, known = _find(key, self._key[self._by_key])
        bond = self._by_key[place]
        keep = (distance < touching + skin) & ~(known & (self.mode[bond] == 0))
        across = (i < self.wheel_nodes) & (j >= self.wheel_nodes)
        order = np.concatenate([np.flatnonzero(keep & ~across), np.flatnonzero(keep & across)])
        key, known, bond, distance = key[order], known[order], bond[order], distance[order]
        i, j, radii, touching = i[order], j[order], radii[order], touching[order]
        per_length, axial = lattice.beams[bond, 3], lattice.beams[bond, 4]
        parameters = np.empty((len(key), 4))
        parameters[:, :2] = (
            radii * (np.where(known, 1.0 / per_length, np.minimum(touching, distance)) / touching)[:, None]
        )
        parameters[:, kernels.NORMAL_STIFFNESS] = np.where(known, axial, self.contact_modulus * 0.5 * touching)
        parameters[:, kernels.TANGENTIAL_STIFFNESS] = self.tangential_ratio * parameters[:, kernels.NORMAL_STIFFNESS]
        self._near = ContactCandidates(
            pair=np.stack([i, j], axis=1),
            offset=lattice.centres[j] - lattice.centres[i],
            parameters=parameters,
            first=np.empty(0),
            last=np.empty(0),
        )
        history = self._near.at_rest()
        live = self._live[: self._window[1]]
        live = live[self.detached[self.candidates.pair[live]].any(axis=1)]
        before = np.concatenate([old.pair, self.candidates.pair[live]]) @ np.array([lattice.nodes, 1])
        if len(before):
            sort = np.argsort(before)
            place, same = _find(key, before[sort])
            row = sort[place[same]]
            parameters[same] = np.concatenate([old.parameters, self.candidates.parameters[live]])[row]
            history[same] = np.concatenate([self._near_history, self.history[live]])[row]
        self._near_history, self._within, self._room = history, int(np.sum(keep & ~across)), skin


def _find(key: IntArray, sorted_keys: IntArray) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Where each key stands in a sorted list that is not empty, and whether it does."""
    place = np.minimum(np.searchsorted(sorted_keys, key), len(sorted_keys) - 1)
    return place, sorted_keys[place] == key


def sections(lattice: Lattice) -> FloatArray:
    """1/S [1/mm2] and r/I [1/mm3] of each beam, shape (bonds, 2), from r^2 = 4 (EI/l)/(EA/l)."""
    radius = 2.0 * np.sqrt(lattice.beams[:, 5] / lattice.beams[:, 4])
    return np.stack([1.0 / (np.pi * radius**2), 4.0 / (np.pi * radius**3)], axis=1)
