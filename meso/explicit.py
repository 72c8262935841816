"""The explicit engine: damped leapfrog of both lattices, the wheel carried along.

The wheel's nodes move in the frame of its carriage: u is the displacement from where the carriage alone would have
brought them, so the prescribed motion enters through the contacts only and starts no waves.
"""

from __future__ import annotations

import time
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.sparse.linalg import LinearOperator, eigsh

from . import kernels
from .encounters import Encounters
from .errors import StabilityError
from .lattice import Lattice
from .plates import Plates
from .records import Curve, Slide, Work

FloatArray: TypeAlias = npt.NDArray[np.float64]

MARGIN = 0.004
"""How far elastic displacements may bring two spheres towards each other before the encounters are widened [mm]."""
CONTACTS = 3.0
"""Contacts that a sphere of the rough face is allowed at once, in the estimate of the critical time step."""
CHUNK = 25
"""Steps between two looks at the normal force, while squeezing."""
REST_S = 2e-6
"""Time to come to rest after the squeeze [s]."""
START = 0.02
"""Part of the slide over which the speed is built up [-]."""
CARRIAGE_DAMPING = 0.1
"""Of the carriage at constant normal force, over the critical one [-]: more would work against climbing spheres."""


def critical_time_step(lattice: Lattice, encounters: Encounters | None = None) -> float:
    """Largest stable time step of the undamped leapfrog, 2/sqrt(lambda_max(M^-1 K)) [s].

    lambda_max by Lanczos on the force kernel. The contacts of a sphere of the rough faces count as three springs
    between it and spheres that move against it, 6 k_n on its diagonal.
    """
    scale = np.sqrt(np.repeat(lattice.inverse, 3, axis=1))
    diagonal = np.zeros((lattice.nodes, 6))
    if encounters is not None and len(encounters.pair):
        for side in (0, 1):
            nodes, place = np.unique(encounters.pair[:, side], return_index=True)
            stiffness = 2.0 * CONTACTS * encounters.law[place, 2]
            diagonal[nodes, :3] = stiffness[:, None]
            diagonal[nodes, 3:] = (stiffness * lattice.radii[nodes] ** 2)[:, None]
    force = np.empty((lattice.nodes, 6))

    def apply(x: FloatArray) -> FloatArray:
        u = scale * x.reshape(-1, 6)
        force[:] = 0.0
        kernels.beam_forces(
            u, force, lattice.rows, lattice.cols, lattice.beams, lattice.anchored, lattice.anchors, lattice.twist
        )
        product: FloatArray = (scale * (diagonal * u - force)).ravel()
        return product

    unknowns = 6 * lattice.nodes
    start = np.random.default_rng(0).normal(size=unknowns)
    operator = LinearOperator((unknowns, unknowns), matvec=apply, dtype=np.float64)
    largest = eigsh(operator, k=1, which="LA", tol=5e-3, return_eigenvectors=False, v0=start)
    return float(2.0 / np.sqrt(largest[0]))


class Explicit:
    """Two plates ready to be squeezed and slid by explicit dynamics."""

    name = "explicit"

    def __init__(self, plates: Plates) -> None:
        self.plates = plates
        keys = plates.settings.engine
        depth = 1.4 * plates.likely_approach() + 0.002
        self.range = (plates.first_touch - depth, plates.first_touch + 0.002)
        self.margin = MARGIN
        self.encounters = plates.encounters(*self.range, self.margin)
        self.critical = critical_time_step(plates.lattice, self.encounters)
        self.time_step = keys.safety * self.critical if keys.time_step is None else keys.time_step
        if self.time_step > self.critical:
            raise StabilityError(
                f"engine.time_step = {self.time_step:.3g} s is above the critical one, {self.critical:.3g} s: "
                "leave it out, or take less"
            )

    def slide(self, micro_friction: float) -> Slide:
        """Squeeze and slide with this micro coefficient of friction.

        Raises:
            StabilityError: the run left the realm of finite numbers.
        """
        return _Run(self, micro_friction).result()


class _Run:
    """The state of one slide, advanced in chunks of time steps."""

    def __init__(self, engine: Explicit, micro_friction: float) -> None:
        self.plates, self.settings, self.dt = engine.plates, engine.plates.settings, engine.time_step
        self.micro_friction = micro_friction
        self.range, self.margin = engine.range, engine.margin
        lattice = self.plates.lattice
        self.u, self.v, self.f = (np.zeros((lattice.nodes, 6)) for _ in range(3))
        self.drive = np.array([0.0, 0.0, self.plates.first_touch])
        self.speed = np.zeros(3)
        self.steps = 0
        self.kinetic = 0.0
        self._meet(engine.encounters)

    def _meet(self, encounters: Encounters) -> None:
        self.encounters = encounters
        self.history = encounters.at_rest()
        self.window = np.zeros(2, dtype=np.int64)
        self.live = np.zeros(len(encounters.pair), dtype=np.int64)

    def result(self) -> Slide:
        """Squeeze, slide, sum up."""
        started = time.process_time()
        squeeze = self._squeeze()
        before = self._stored()
        curve, total = self._slide()
        after = self._stored()
        lattice = self.plates.lattice
        return Slide(
            micro_friction=self.micro_friction,
            engine=Explicit.name,
            squeeze=squeeze,
            curve=curve,
            work=Work(
                drive=total[5],
                friction=total[3],
                damping=total[4],
                elastic=after[0] - before[0],
                contact=after[1] - before[1],
                kinetic=after[2] - before[2],
            ),
            steps=self.steps,
            bond_steps=self.steps * (len(lattice.cols) + len(lattice.anchored)),
            unconverged_increments=0,
            largest_residual=0.0,
            cpu_s=time.process_time() - started,
        )

    def advance(
        self, steps: int, speed: tuple[float, float], damping: float, target: float = 0.0, ratio: float = 1.0
    ) -> FloatArray:
        """March; with a target the height falls freely under it. Returns the sums of `kernels.march`: the force on the wheel as a mean over the steps [N]."""
        lattice = self.plates.lattice
        total = np.zeros(7)
        self.speed[0], self.speed[1] = speed[0], 0.0
        if target == 0.0:
            self.speed[2] = speed[1]
        kernels.march(
            self.u, self.v, self.f, lattice.rows, lattice.cols, lattice.beams, lattice.anchored, lattice.anchors,
            lattice.twist, lattice.inverse, self.dt, damping,
            self.encounters.first, self.encounters.last, self.encounters.pair, self.encounters.apart,
            self.encounters.law, self.history, self.micro_friction, self.window, self.live,
            self.drive, self.speed, target, self._carriage(ratio), steps, total,
        )  # fmt: skip
        self.steps += steps
        self.kinetic = 0.5 * total[6]
        total[:3] /= steps
        if not np.isfinite(total).all():
            raise StabilityError(
                f"the explicit run diverged at a slide of {self.drive[0]:.3g} mm: take a smaller engine.safety"
            )
        self._widen()
        return total

    def _carriage(self, ratio: float) -> FloatArray:
        """Mass [t] and damping [N s/mm] of the carriage at constant force: the wheel's share of the solid cube."""
        material, keys = self.settings.material, self.settings.plates
        mass = material.density * self.plates.area * keys.cube
        stiffness = material.youngs_modulus * self.plates.area / (2.0 * keys.cube)
        return np.array([mass, 2.0 * ratio * np.sqrt(stiffness * mass)])

    def _squeeze(self) -> Curve:
        keys, touch = self.settings.engine, self.plates.first_touch
        target, speed = self.plates.target, keys.approach_speed
        rows = [(0.0, 0.0, 0.0, touch)]

        def press(steps: int, velocity: float, until: float = 0.0) -> FloatArray:
            total = self.advance(steps, (0.0, velocity), keys.squeeze_damping, until)
            rows.append((touch - self.drive[2], total[2], -total[0], self.drive[2]))
            return total

        rest = max(CHUNK, int(REST_S / self.dt))
        if target > 0.0:
            slowest = 0.02 * self.plates.settings.plates.edge
            while press(CHUNK, -speed)[2] < 0.95 * target:
                if touch - self.drive[2] > slowest + 4.0 * self.plates.likely_approach():
                    raise StabilityError("the plates do not carry the pressure asked for: take a smaller load.pressure")
            approached, carried = np.array(rows[-4:])[:, :2].T
            settled = press(rest, 0.0)[2]
            missing = (target - settled) * np.ptp(approached) / np.ptp(carried)  # by the stiffness just seen
            press(4 * CHUNK, -missing / (4 * CHUNK * self.dt))
            press(rest // 2, 0.0)
            press(CHUNK, 0.0)
        else:
            approach = self.plates.likely_approach()
            steps = max(1, round(approach / speed / self.dt))
            for _ in range(10):
                press(max(1, steps // 10), -approach / (10 * max(1, steps // 10) * self.dt))
            press(2 * rest, 0.0)
        return _curve(np.array(rows), 0.0)

    def _slide(self) -> tuple[Curve, FloatArray]:
        keys, slide = self.settings.engine, self.settings.load.slide
        target = self.plates.target if self.settings.load.control == "force" else 0.0
        rows, total = [], np.zeros(7)
        ends = np.linspace(0.0, slide, keys.samples + 1)[1:]
        for end in ends:
            speed = keys.speed * min(1.0, (end / (START * slide)) ** 0.5)
            steps = max(1, round((end - self.drive[0]) / speed / self.dt))
            speed = (end - self.drive[0]) / (steps * self.dt)
            sums = self.advance(steps, (speed, 0.0), speed / keys.damping_length, target, CARRIAGE_DAMPING)
            total[3:6] += sums[3:6]
            rows.append((end, sums[2], -sums[0], self.drive[2]))
        return _curve(np.array(rows), 0.0), total

    def _stored(self) -> tuple[float, float, float]:
        """Energy in the beams, in the contacts, and kinetic energy [N mm]."""
        lattice = self.plates.lattice
        force = np.zeros_like(self.u)
        kernels.beam_forces(
            self.u, force, lattice.rows, lattice.cols, lattice.beams, lattice.anchored, lattice.anchors, lattice.twist
        )
        live = self.live[: self.window[1]]
        contact = kernels.contact_energy(
            self.u, live, self.encounters.pair, self.encounters.apart, self.encounters.law, self.history, *self.drive
        )
        return float(-0.5 * np.sum(self.u * force)), float(contact), self.kinetic

    def _widen(self) -> None:
        """Look farther for encounters when the wheel or a sphere has gone beyond what they allow for."""
        live = self.live[: self.window[1]]
        pair = self.encounters.pair[live]
        between = self.encounters.apart[live] - self.drive
        moved = self.u[pair[:, 0], :3] - self.u[pair[:, 1], :3]
        closing = float(np.max(np.einsum("pa,pa->p", moved, between) / np.linalg.norm(between, axis=1), initial=0.0))
        low, high = self.range
        if low <= self.drive[2] <= high and closing <= self.margin:
            return
        reach = 0.3 * (high - low)
        self.range = (min(low, self.drive[2] - reach), max(high, self.drive[2] + reach))
        self.margin = max(self.margin, 1.5 * closing)
        old, history = self.encounters, self.history
        self._meet(self.plates.encounters(*self.range, self.margin))
        nodes = self.plates.lattice.nodes
        keys = self.encounters.pair @ np.array([nodes, 1])
        order = np.argsort(keys)
        known = old.pair @ np.array([nodes, 1])
        place = order[np.minimum(np.searchsorted(keys[order], known), len(order) - 1)]
        same = keys[place] == known
        self.history[place[same]] = history[same]


def _curve(rows: FloatArray, start: float) -> Curve:
    """Rows of displacement at the end of a stretch, mean N and T over it, height at its end."""
    step = np.diff(rows[:, 0], prepend=start)
    return Curve(
        displacement=rows[:, 0],
        start=start,
        normal=rows[:, 1],
        tangential=rows[:, 2],
        height=rows[:, 3],
        share=step / max(step.sum(), 1e-300),
        tangential_work=float(step @ rows[:, 2]),
    )
