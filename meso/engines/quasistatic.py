"""The quasi-static engine: both plates condensed on the spheres that may meet, then slid in increments.

Where no beam breaks the lattice is linear. Each plate's stiffness is factored once with its contact candidates last,
which gives the dense compliance of those; an increment is then a small nonlinear system in the contact forces alone,
solved by Newton (`kernels.solve_increment`). An increment that does not converge is halved; one that cannot be halved
further raises `Unsettled`, and nothing that is not in equilibrium is ever reported.
"""

from __future__ import annotations

import time

import numpy as np

from macrofit.base.arrays import FloatArray, IntArray

from .. import kernels
from ..errors import MesoError
from ..lattice.candidates import ContactCandidates
from ..lattice.cholmod import factor
from ..plates import Plates
from ..records import Curve, Slide, Work

ITERATIONS = 30
"""Newton iterations before an increment is halved."""
HALVINGS = 8
"""How often an increment may be halved."""
SQUEEZE_INCREMENTS = 8
"""Number of increments of the approach; the contact law has no memory of it but in friction."""
MARGIN = 0.003
"""How far elastic displacements may bring two spheres towards each other before the candidates are widened [mm]."""
DEEPER = 0.002
"""Approach that the candidates allow for beyond 1.4 times the likely one [mm]."""
CLOSE = 0.0015
"""Gap above which two spheres are left out of an increment [mm]; where they touch in the end, it is done anew."""
STIRRED = 2.0
"""No sphere that is left out moves more within an increment than this times the contact that moves most [-]: under a
load a surface moves most where it is loaded."""


class Unsettled(MesoError):
    """An increment that no halving could bring to equilibrium."""


class QuasiStatic:
    """Two plates condensed for one squeeze and slide, for as many micro coefficients as are asked for."""

    name = "quasi-static"

    def __init__(self, plates: Plates) -> None:
        self.plates = plates
        self.factorisations = 0
        approach = plates.likely_approach()
        self._prepare(1.4 * approach + DEEPER, MARGIN)

    def _prepare(self, depth: float, margin: float) -> None:
        """Condense on the spheres that may meet down to this approach, with this margin [mm]."""
        plates = self.plates
        self.depth, self.margin = depth, margin
        rise = 2.0 * depth if plates.settings.load.control == "force" else 0.0
        touch = plates.first_touch
        self.candidates: ContactCandidates = plates.candidates(touch - depth, touch + rise, margin)
        pair = self.candidates.pair - np.array([0, plates.wheel.nodes])
        self.compliances, self.pair = [], np.empty_like(pair)
        for side, lattice in enumerate((plates.wheel, plates.axle)):
            nodes = np.unique(pair[:, side])
            self.compliances.append(factor(lattice.stiffness(), nodes).compliance())
            self.pair[:, side] = np.searchsorted(nodes, pair[:, side])
        self.factorisations += 2

    def slide(self, micro_friction: float) -> Slide:
        """Squeeze and slide with this micro coefficient of friction.

        Raises:
            Unsettled: no equilibrium was found at some slide.
        """
        while True:
            try:
                return _Run(self, micro_friction).result()
            except _Beyond as beyond:
                self._prepare(max(self.depth, beyond.depth), max(self.margin, beyond.margin))


class _Beyond(Exception):
    """The plates came closer than the candidates allow for."""

    def __init__(self, depth: float, margin: float) -> None:
        self.depth, self.margin = depth, margin


class _Run:
    """The state of one slide, and its increments."""

    def __init__(self, engine: QuasiStatic, micro_friction: float) -> None:
        self.engine, self.plates = engine, engine.plates
        self.micro_friction = micro_friction
        count = len(engine.candidates.pair)
        self.history = engine.candidates.at_rest()
        self.trial = self.history.copy()
        self.forces = np.zeros((count, 3))
        self.normals = np.zeros((count, 3))
        self.drive = np.array([0.0, 0.0, self.plates.first_touch])
        self.sums = np.zeros(6)
        self.pressing = np.empty(0, np.int64)
        self.steps, self.largest_residual = 0, 0.0
        self.rows: list[FloatArray] = [np.zeros(9)]
        self.rows[0][2] = self.drive[2]

    def result(self) -> Slide:
        """Squeeze, slide, sum up."""
        started = time.process_time()
        load, keys = self.plates.settings.load, self.plates.settings.engine
        self._squeeze()
        squeezed = len(self.rows)
        target = self.plates.target if load.control == "force" else 0.0
        increments = int(np.ceil(load.slide / keys.increment - 1e-9))
        for x in np.linspace(0.0, load.slide, increments + 1)[1:]:
            self._advance(float(x), self.drive[2], target)
        rows = np.array(self.rows)
        sliding = rows[squeezed - 1 :]
        return Slide(
            micro_friction=self.micro_friction,
            engine=self.engine.name,
            squeeze=_curve(rows[:squeezed], self.plates.first_touch - rows[:squeezed, 2]),
            curve=_curve(sliding, sliding[:, 0]),
            work=_account(sliding),
            steps=self.steps,
            bond_steps=0,
            unconverged_increments=0,
            largest_residual=self.largest_residual,
            cpu_s=time.process_time() - started,
        )

    def _squeeze(self) -> None:
        target, touch = self.plates.target, self.plates.first_touch
        approach = self.plates.likely_approach()
        if target == 0.0:
            for part in np.linspace(0.0, 1.0, SQUEEZE_INCREMENTS + 1)[1:]:
                self._advance(0.0, touch - part * approach, 0.0)
            return
        half = SQUEEZE_INCREMENTS // 2
        for part in np.linspace(0.0, 0.5, half + 1)[1:]:
            self._advance(0.0, touch - part * approach, 0.0)
        reached = min(self.rows[-1][5], 0.9 * target)
        for part in np.linspace(0.0, 1.0, half + 1)[1:]:
            self._advance(0.0, self.drive[2], reached + part * (target - reached))

    def _advance(self, x: float, z: float, target: float) -> None:
        """Go to slide x at height z, or at the normal force `target`; halve the way where it does not settle."""
        here = self.drive.copy()
        start_force = self.rows[-1][5]
        done, part = 0.0, 1.0
        while done < 1.0:
            reach = min(1.0, done + part)
            goal = start_force + reach * (target - start_force) if target > 0.0 else 0.0
            place = np.array([here[0] + reach * (x - here[0]), 0.0, here[2] + reach * (z - here[2])])
            if target > 0.0:
                place[2] = self.drive[2]
            if self._settle(place, goal):
                done = reach
            elif part > 0.5**HALVINGS:
                part *= 0.5
            else:
                raise Unsettled(
                    f"no equilibrium at a slide of {1e3 * place[0]:.1f} um with micro_friction = "
                    f"{self.micro_friction:g}"
                )

    def _settle(self, place: FloatArray, target: float) -> bool:
        engine, keys = self.engine, self.plates.settings.engine
        live = np.flatnonzero((engine.candidates.first <= place[0]) & (engine.candidates.last >= place[0]))
        gone = self.pressing[engine.candidates.last[self.pressing] < place[0]]
        if len(gone):  # carried along sideways, they press where they should long be apart
            raise _Beyond(0.0, 1.3 * float(_gap(engine.candidates, gone, place).max()))
        before, normals = self.forces[live], self.normals[live]
        for close in (CLOSE, np.inf):
            drive = place.copy()
            try:
                _, residual, closing = kernels.solve_increment(
                    *engine.compliances, live, engine.pair, engine.candidates.offset, engine.candidates.parameters,
                    self.history, self.forces, self.micro_friction, drive, target, ITERATIONS, keys.tolerance, close,
                    self.trial, self.normals, self.sums,
                )  # fmt: skip
            except np.linalg.LinAlgError:  # a step of Newton from a state that can go two ways
                residual, closing = np.inf, 0.0
            if close == np.inf or not (residual <= keys.tolerance and self._left_out(live, before, place, drive)):
                break
            self.forces[live], self.normals[live] = before, normals
        self.steps += 1
        if not residual <= keys.tolerance:
            self.forces[live], self.normals[live] = before, normals
            return False
        depth = self.plates.first_touch - drive[2]
        if depth > engine.depth or closing > engine.margin:
            raise _Beyond(1.3 * depth, 1.3 * closing)
        self.history[live] = self.trial[live]
        self.drive, self.pressing = drive, live[self.forces[live].any(axis=1)]
        self.largest_residual = max(self.largest_residual, residual)
        self.rows.append(np.array([*drive, *self.sums]))
        return True

    def _left_out(self, live: IntArray, before: FloatArray, place: FloatArray, drive: FloatArray) -> bool:
        """Whether spheres that were farther apart than CLOSE at `place` press on each other at `drive`."""
        engine, meet = self.engine, self.engine.candidates
        pressed = self.forces[live].any(axis=1)
        if not pressed.any():
            return False
        held = live[pressed & before.any(axis=1)]
        reach = np.inf
        if len(held):
            moved = self.trial[held, 3:6] - self.history[held, 3:6] - (drive - self.drive)
            reach = STIRRED * float(np.sqrt(np.einsum("pa,pa->p", moved, moved).max())) + abs(drive[2] - place[2])
            if reach <= CLOSE:
                return False
        apart = live[~pressed]
        gap = _gap(meet, apart, self.trial[apart, 3:6])
        apart = apart[(gap >= CLOSE) & (gap < reach)]
        if not len(apart):
            return False
        near, (i, j) = np.concatenate([live[pressed], apart]), engine.pair[apart].T
        wheel, axle = (np.empty((len(compliance) // 6, 6)) for compliance in engine.compliances)
        kernels.load_plates(
            *engine.compliances, near, engine.pair, meet.parameters, self.forces, self.normals, wheel, axle
        )
        overlap = -_gap(meet, apart, drive + wheel[i, :3] - axle[j, :3]) * meet.normal_stiffness[apart]
        return bool(overlap.max() > self.plates.settings.engine.tolerance * float(np.abs(self.forces[near]).max()))


def _gap(meet: ContactCandidates, pairs: IntArray, carried: FloatArray) -> FloatArray:
    """Gap of pairs whose wheel sphere has gone this far (p, 3) against the axle's [mm]; negative where they overlap."""
    between, radii = meet.offset[pairs] - carried, meet.parameters[pairs].T
    distance = np.sqrt(np.einsum("pa,pa->p", between, between))
    gap: FloatArray = distance - radii[kernels.WHEEL_RADIUS] - radii[kernels.AXLE_RADIUS]
    return gap


def _curve(rows: FloatArray, displacement: FloatArray) -> Curve:
    step = np.diff(displacement)
    share = np.zeros(len(rows))
    share[:-1] += 0.5 * step
    share[1:] += 0.5 * step
    normal = rows[:, 5]
    # Sampled at increments, T swings with every sphere that is climbed, and its mean with it. What it does is known
    # without that: the losses and the change of what is stored, less the work of N where the height changes.
    raised = float(np.sum(0.5 * (normal[1:] + normal[:-1]) * np.diff(rows[:, 2])))
    work = float(rows[1:, 6].sum() + rows[-1, 7] + rows[-1, 8] - rows[0, 7] - rows[0, 8])
    return Curve(
        displacement=displacement,
        start=float(displacement[0]),
        normal=normal,
        tangential=-rows[:, 3],
        lateral=-rows[:, 4],
        height=rows[:, 2],
        share=share / max(step.sum(), 1e-300),
        tangential_work=work + raised,
    )


def _account(rows: FloatArray) -> Work:
    force, way = 0.5 * (rows[1:, 3:6] + rows[:-1, 3:6]), np.diff(rows[:, :3], axis=0)
    return Work(
        drive=float(-np.sum(force * way)),
        friction=float(rows[1:, 6].sum()),
        elastic=float(rows[-1, 7] - rows[0, 7]),
        contact=float(rows[-1, 8] - rows[0, 8]),
    )
