"""What `meso_stability` holds a friction test to: laws that do not depend on how its engines are built.

A slide is run by the package's own path (`prepared`, `slid`), with both engines watched from outside. Judged then:

- the record: finite, losses never negative, residuals within the tolerance, the load that was asked for, the drive's
  work against the curves, and the account of energies, which the package itself calls out beyond `UNBALANCED`;
- equilibrium (quasi-static): the contact forces of some increments are put on the whole lattices, solved anew by
  another solver; the external faces must carry T and N; where two spheres then overlap - all of them, found without
  the package's lists - the contact law must give the force, and where they do not there must be none;
- motion (explicit): one more step must change the momentum of each plate by exactly the forces of contacts, external
  faces and damping; every two spheres that overlap must be known to be near each other;
- friction: each force lies in its Coulomb cone, and so within atan(mu) + tilt of the contact from the vertical; hence
  |T| <= N tan(atan(mu) + largest tilt) at every increment, and the coefficient obeys the same bound. The losses of an
  increment obey W <= sum of mu f_n (means of before and after) times the way of the contact points.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from unittest import mock

import numpy as np
import numpy.typing as npt
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from macrofit.base.arrays import FloatArray
from meso.engines import explicit, quasistatic
from meso.engines.linear import Linear
from meso.errors import MesoError
from meso.friction_test import prepared, slid
from meso.lattice.lattice import Lattice
from meso.plates import Plates
from meso.records import UNBALANCED, Slide
from meso.results.summary import slide_numbers

ROUNDING = 1e-8
"""Of sums over thousands of numbers, solves with stiffnesses of condition 1e6 among them [-]."""


@dataclass
class Verdict:
    """What became of one case."""

    slide: Slide | None = None
    refusal: str = ""
    """The clear error, one line."""
    said: str = ""
    """What the package itself says against its answer."""
    faults: list[str] = field(default_factory=list)
    balance: float = 0.0
    """Worst relative balance of forces and energy among the answers that carry no reservation [-]."""

    @property
    def kind(self) -> str:
        """Wrong, error, said or answered."""
        return "wrong" if self.faults else "error" if self.refusal else "said" if self.said else "answered"


def verdict(plates: Plates, engine: Any = None) -> Verdict:
    """Run the first micro coefficient of these plates, and judge what comes of it."""
    settings = plates.settings
    micro = settings.contact.coefficients[:1]
    try:
        with watched() as runs:
            (slide,) = slid(plates, engine or prepared(plates), micro)
    except MesoError as error:
        return refused(error)
    found = Verdict(slide=slide, said=reservation(slide), faults=record_faults(slide, plates))
    if runs and not found.faults:
        run = runs[-1]
        judge = equilibrium_faults if isinstance(run, WatchedIncrements) else motion_faults
        faults, balance = judge(run)
        found.faults += faults
        found.balance = balance if found.said else max(balance, abs(slide.work.imbalance))
    return found


def refused(error: MesoError) -> Verdict:
    """A clear error is one line of a few words; anything else is a fault."""
    text = str(error)
    faults = [] if text.strip() and "\n" not in text else [f"not one line: {text!r}"]
    return Verdict(refusal=text, faults=faults)


def reservation(slide: Slide) -> str:
    """What the summary of a run says against this slide."""
    if not np.isfinite(slide.curve.coefficient):
        return "the plates do not touch"
    if abs(slide.work.imbalance) > UNBALANCED:
        return f"{abs(slide.work.imbalance):.0%} of the work is unaccounted for"
    return slide.remark


# --- the record ------------------------------------------------------------------------------------------------------


def record_faults(slide: Slide, plates: Plates) -> list[str]:
    """What is wrong in the numbers of a slide, as far as they tell."""
    settings, curve, work = plates.settings, slide.curve, slide.work
    slide_numbers(slide)  # the summary can be made
    arrays = (curve.displacement, curve.normal, curve.tangential, curve.height, slide.squeeze.normal, curve.share)
    accounts = (work.drive, work.friction, work.damping, work.broken, work.elastic, work.contact, work.kinetic)
    if not all(np.isfinite(values).all() for values in (*arrays, accounts, curve.tangential_work)):
        return ["not finite"]
    faults = []
    if min(work.friction, work.damping, work.broken) < 0.0:
        faults.append("a loss is negative")
    if abs(curve.share.sum() - 1.0) > ROUNDING or abs(curve.displacement[-1] - settings.load.slide) > 1e-9:
        faults.append("the curve does not cover the slide")
    if slide.unconverged_increments or slide.largest_residual > settings.engine.tolerance:
        faults.append(f"accepted with a residual of {slide.largest_residual:.1e}")
    if slide.micro_friction == 0.0 and work.friction > 0.0:
        faults.append("friction without friction")
    return faults + load_faults(slide, plates) + work_faults(slide, plates)


def load_faults(slide: Slide, plates: Plates) -> list[str]:
    """Whether the load is the one asked for: to the tolerance, or to 5 % where inertia has a part."""
    target, load = plates.target, plates.settings.load
    loose = 0.05 if slide.engine == "explicit" else 10.0 * plates.settings.engine.tolerance
    if load.interference is not None:
        missed = abs(plates.first_touch - slide.squeeze.height[-1] - load.interference)
        return [f"interference missed by {missed:.2e} mm"] if missed > 1e-9 else []
    faults = []
    reached = slide.squeeze.normal[-1]
    said = f"squeezed to {reached / plates.area:.3g} MPa" in slide.remark
    if not said and abs(reached - target) > loose * target + LEAST_FORCE * largest_stiffness(plates):
        faults.append(f"squeezed to {reached:.4g} N, asked for {target:.4g} N")
    if load.control == "force" and slide.engine == "quasi-static":
        away = np.abs(slide.curve.normal - target).max()
        if away > loose * target + LEAST_FORCE * largest_stiffness(plates):
            faults.append(f"constant force strays by {away:.3g} N")
    return faults


LEAST_FORCE = 1e-8
"""Closure of a contact that nothing resolves [mm]."""


def largest_stiffness(plates: Plates) -> float:
    """k_n of the two largest spheres [N/mm]."""
    settings = plates.settings
    modulus = settings.contact.normal_stiffness * settings.material.youngs_modulus
    return modulus * float(plates.lattice.radii.max())


def work_faults(slide: Slide, plates: Plates) -> list[str]:
    """The drive's work once more from the curves, and the coefficient from the energies."""
    curve, work = slide.curve, slide.work
    faults = []
    if slide.engine == "quasi-static":
        x, z = np.diff(curve.displacement), np.diff(curve.height)
        mean_t = 0.5 * (curve.tangential[1:] + curve.tangential[:-1])
        mean_n = 0.5 * (curve.normal[1:] + curve.normal[:-1])
        drive = float(mean_t @ x - mean_n @ z)
        energies = work.friction + work.elastic + work.contact + float(mean_n @ z)
        scale = max(abs(drive), abs(energies), 1e-300)
        if abs(energies - curve.tangential_work) > ROUNDING * scale:
            faults.append("the coefficient is not that of the energies")
    elif plates.settings.load.control == "displacement":
        drive = float(curve.tangential @ np.diff(curve.displacement, prepend=curve.start))
        scale = max(abs(drive), work.friction, 1e-300)
    else:
        return faults
    exact = ROUNDING if slide.breaks is None else 1e-2  # breaking: trapezoids against sums of jumps
    if abs(drive - work.drive) > exact * max(scale, abs(work.elastic)):
        faults.append(f"the drive's work is {work.drive:.6g}, its curve's {drive:.6g} N mm")
    return faults


# --- watching --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class State:
    """One increment that the quasi-static engine accepted."""

    place: FloatArray
    forces: FloatArray
    normals: FloatArray
    sums: FloatArray


class WatchedIncrements(quasistatic._Run):
    """Keeps some states, the largest tilt of a contact and the most that friction may have taken."""

    EVERY = 48

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.states: list[State] = []
        self.tilts: list[float] = [0.0]
        self.overspent = 0.0

    def _settle(self, place: FloatArray, target: float) -> bool:
        before = self.history.copy()
        if not super()._settle(place, target):
            return False
        law = self.engine.candidates.parameters
        touching = np.flatnonzero(self.forces.any(axis=1))
        now, old = self.history[touching], before[touching]
        upright = -self.normals[touching, 2]
        self.tilts.append(float(np.arccos(np.clip(upright.min(initial=1.0), -1.0, 1.0))))
        moved = np.flatnonzero((before != self.history).any(axis=1) & np.isfinite(before[:, 0]))
        now, old, kt = self.history[moved], before[moved], law[moved, 3]
        held = self.micro_friction * self._pressed(moved)
        size, was = np.linalg.norm(now[:, :3], axis=1), np.linalg.norm(old[:, :3], axis=1)
        way = np.linalg.norm(now[:, 3:6] - old[:, 3:6], axis=1) + np.linalg.norm(now[:, 6:] - old[:, 6:], axis=1)
        most = float(np.sum(0.5 * (np.minimum(size, held * (1.0 + ROUNDING)) + was) * (way + np.abs(size - was) / kt)))
        self.overspent = max(self.overspent, self.rows[-1][6] - most)
        at_ends = len(self.rows) == quasistatic.SQUEEZE_INCREMENTS + 1 or place[0] >= self.plates.settings.load.slide
        if at_ends or len(self.rows) % self.EVERY == 0:
            self.keep()
        return True

    def _pressed(self, pairs: npt.NDArray[np.int64]) -> FloatArray:
        pressed: FloatArray = -np.einsum("pa,pa->p", self.forces[pairs], self.normals[pairs])
        return pressed

    def keep(self) -> None:
        """Keep the present state."""
        live = self.engine.candidates
        now = (live.first <= self.drive[0]) & (live.last >= self.drive[0])
        self.states.append(
            State(self.drive.copy(), np.where(now[:, None], self.forces, 0.0), self.normals.copy(), self.rows[-1][3:])
        )


class WatchedSteps(explicit._Run):
    """Looks now and then whether two spheres overlap that the engine does not know of."""

    EVERY = 16

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.missed, self.stretches = 0.0, 0

    def _widen(self) -> None:
        self.stretches += 1
        if self.stretches % self.EVERY == 0 and not _has_broken(self.body):
            self.missed = max(self.missed, unknown_overlap(self))
        super()._widen()


@contextmanager
def watched() -> Iterator[list[Any]]:
    """Runs of both engines within are listed, the last one last."""
    runs: list[Any] = []

    def noted(kind: Any) -> Any:
        def make(*arguments: Any) -> Any:
            runs.append(kind(*arguments))
            return runs[-1]

        return make

    with (
        mock.patch.object(quasistatic, "_Run", noted(WatchedIncrements)),
        mock.patch.object(explicit, "_Run", noted(WatchedSteps)),
    ):
        yield runs


# --- equilibrium -----------------------------------------------------------------------------------------------------


class Solid:
    """One plate, solved whole."""

    def __init__(self, lattice: Lattice) -> None:
        self.lattice = lattice

    @cached_property
    def factors(self) -> Any:
        """Of its stiffness, by SuperLU."""
        return splu(
            self.lattice.stiffness(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )

    def displaced(self, load: FloatArray) -> FloatArray:
        """u (n, 6) under a load (n, 6)."""
        u: FloatArray = self.factors.solve(load.ravel()).reshape(-1, 6)
        return u


def held(lattice: Lattice, u: FloatArray) -> FloatArray:
    """Force (3) of the external face on a plate displaced by u (n, 6) [N]."""
    w, (kn, ks, kc) = u[lattice.anchored], lattice.anchors.T[:3]
    across = -np.sum(ks * w[:, 0] + kc * w[:, 4]), -np.sum(ks * w[:, 1] - kc * w[:, 3])
    return np.array([*across, -np.sum(kn * w[:, 2])])


_SOLIDS: dict[int, tuple[Lattice, Solid]] = {}


def solid(lattice: Lattice) -> Solid:
    """The plate's factors, kept for its next slides."""
    if id(lattice) not in _SOLIDS:
        while len(_SOLIDS) > 3:
            del _SOLIDS[next(iter(_SOLIDS))]
        _SOLIDS[id(lattice)] = lattice, Solid(lattice)
    return _SOLIDS[id(lattice)][1]


def equilibrium_faults(run: WatchedIncrements) -> tuple[list[str], float]:
    """Faults of the states that were kept, and the worst relative balance of force."""
    mu, worst = run.micro_friction, 0.0
    rows = np.array(run.rows)
    lean = np.arctan(mu) + np.array(run.tilts[: len(rows)])
    bound = np.where(lean < 0.5 * np.pi, np.tan(np.minimum(lean, 1.57)), np.inf)
    across, normal = np.hypot(rows[:, 3], rows[:, 4]), rows[:, 5]
    tolerance = run.plates.settings.engine.tolerance
    slack = tolerance * np.abs(rows[:, 3:6]).max() + ROUNDING
    with np.errstate(invalid="ignore"):
        beyond = np.where(np.isfinite(bound), across > bound * normal + slack, False)
    if beyond.any():
        return [f"T/N = {np.max(across[beyond] / normal[beyond]):.3g} outside every Coulomb cone"], worst
    if run.overspent > ROUNDING * max(1e-9, float(np.sum(rows[:, 6]))):
        return ["friction took more than mu f_n times the way"], worst
    for state in run.states:
        fault, balance = state_fault(run, state)
        worst = max(worst, balance)
        if fault:
            return [f"{fault} at a slide of {1e3 * state.place[0]:.1f} um"], worst
    return [], worst


def state_fault(run: WatchedIncrements, state: State) -> tuple[str, float]:
    """The first thing wrong with one state, and its relative balance of force."""
    plates, mu = run.plates, run.micro_friction
    meet = run.engine.candidates
    touching = np.flatnonzero(state.forces.any(axis=1))
    force, normal = state.forces[touching], state.normals[touching]
    if not len(touching):
        return ("forces out of nothing" if np.abs(state.sums[:3]).max() > 0.0 else ""), 0.0
    pressed = -np.einsum("pa,pa->p", force, normal)
    tangential = np.linalg.norm(force + pressed[:, None] * normal, axis=1)
    if np.any(pressed < 0.0) or np.any(tangential > mu * pressed * (1.0 + ROUNDING) + ROUNDING * pressed.max()):
        return "a force outside its Coulomb cone", 0.0
    displaced, unbalanced, stored = [], 0.0, 0.0
    for side, (lattice, sign) in enumerate(((plates.wheel, 1.0), (plates.axle, -1.0))):
        load = np.zeros((lattice.nodes, 6))
        node = meet.pair[touching, side] - side * plates.wheel.nodes
        np.add.at(load[:, :3], node, sign * force)
        np.add.at(load[:, 3:], node, meet.parameters[touching, side][:, None] * np.cross(normal, force))
        u = solid(lattice).displaced(load)
        displaced.append(u)
        stored += 0.5 * float(np.sum(load * u))
        unbalanced = max(unbalanced, float(np.abs(held(lattice, u) + sign * state.sums[:3]).max()))
    balance = unbalanced / float(np.abs(force).max())
    if balance > ROUNDING * len(touching):
        return f"the external faces miss T and N by {balance:.1e}", balance
    tolerance = plates.settings.engine.tolerance
    if abs(stored - state.sums[4]) > 20.0 * tolerance * max(stored, state.sums[5]):
        return f"stored {state.sums[4]:.6g} N mm, the whole lattice {stored:.6g}", balance
    # a residual of tolerance x largest force at every contact moves the spheres by about this much
    largest, middle = float(pressed.max()), float(pressed.mean())
    slack = 3.0 * tolerance * largest / middle * max(float(np.abs(u[:, :3]).max()) for u in displaced) + 1e-9
    slack += 3.0 * tolerance * largest / float(meet.normal_stiffness[touching].min())
    return overlap_fault(plates, state, meet.pair, pressed, touching, displaced, slack), balance


def overlap_fault(plates, state, pair, pressed, touching, displaced, slack) -> str:  # type: ignore[no-untyped-def]
    """Overlap of all spheres that overlap against the force between them over k_n; `slack` [mm] is let pass."""
    settings = plates.settings
    wheel, axle = plates.wheel, plates.axle
    at_wheel, at_axle = wheel.centres + state.place + displaced[0][:, :3], axle.centres + displaced[1][:, :3]
    known = {(int(i), int(j) - wheel.nodes): f for (i, j), f in zip(pair[touching], pressed, strict=True)}
    modulus = settings.contact.normal_stiffness * settings.material.youngs_modulus
    near = overlapping(at_wheel, wheel.radii, at_axle, axle.radii)
    for (i, j), overlap in {**dict.fromkeys(known, 0.0), **near}.items():
        closure = known.get((i, j), 0.0) / (modulus * 0.5 * (wheel.radii[i] + axle.radii[j]))
        if overlap == 0.0:
            overlap = min(0.0, wheel.radii[i] + axle.radii[j] - float(np.linalg.norm(at_axle[j] - at_wheel[i])))
        if abs(overlap - closure) > slack:
            return f"spheres overlap by {1e3 * overlap:.4f} um and press for {1e3 * closure:.4f} um"
    return ""


def overlapping(one: FloatArray, radii: FloatArray, other: FloatArray, others: FloatArray) -> dict[Any, float]:
    """Overlap [mm] of every sphere of one set with every one of the other."""
    reach = float(radii.max() + others.max())
    pairs = cKDTree(one).sparse_distance_matrix(cKDTree(other), reach, output_type="coo_matrix")
    overlap = radii[pairs.row] + others[pairs.col] - pairs.data
    return {(int(i), int(j)): float(d) for i, j, d in zip(pairs.row, pairs.col, overlap, strict=True) if d > 0.0}


# --- motion ----------------------------------------------------------------------------------------------------------


def _has_broken(body: Any) -> bool:
    return not isinstance(body, Linear) and bool(body.detached.any())


def _positions(run: WatchedSteps, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    split, centres = run.plates.wheel.nodes, run.plates.lattice.centres
    return centres[:split] + run.body.drive + u[:split, :3], centres[split:] + u[split:, :3]


def unknown_overlap(run: WatchedSteps) -> float:
    """Largest overlap of two spheres that are not among the live candidates [mm]."""
    split, radii, body = run.plates.wheel.nodes, run.plates.lattice.radii, run.body
    known = {(int(i), int(j) - split) for i, j in body.candidates.pair[body.live]}
    at_wheel, at_axle = _positions(run, body.u)
    found = overlapping(at_wheel, radii[:split], at_axle, radii[split:])
    return max((overlap for pair, overlap in found.items() if pair not in known), default=0.0)


def motion_faults(run: WatchedSteps) -> tuple[list[str], float]:
    """Balance of momentum of each plate over one more step, and overlaps nobody knew of."""
    body, plates, dt = run.body, run.plates, run.dt
    lattice, split = plates.lattice, plates.wheel.nodes
    slack = 1e-3 * run.plates.likely_approach() + 1e-9
    if run.missed > slack:
        return [f"spheres overlap by {1e3 * run.missed:.3f} um unknown to the engine"], 0.0
    keys = plates.settings.engine
    u, v = body.u.copy(), body.v.copy()
    damping = keys.speed / keys.damping_length
    force = body.advance(1, (keys.speed, 0.0, 0.0), damping=damping, target=0.0, carriage=(1.0, 0.0)).force
    momentum = lattice.masses[:, None] * (body.v - v)[:, :3] / dt
    viscous = 0.5 * damping * lattice.masses[:, None] * (body.v + v)[:, :3]
    parts = (slice(None, split), 1.0, plates.wheel), (slice(split, None), -1.0, plates.axle)
    scale = float(np.abs(momentum).sum() + np.abs(force).sum()) + 1e-300
    worst = 0.0
    for part, sign, plate in parts:
        rest = momentum[part].sum(axis=0) + viscous[part].sum(axis=0) - sign * force - held(plate, u[part])
        worst = max(worst, float(np.abs(rest).max()) / scale)
    if worst > ROUNDING:
        return [f"momentum is off by {worst:.1e} of the forces"], worst
    return [], worst
