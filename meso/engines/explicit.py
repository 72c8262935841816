"""The explicit engine: damped leapfrog of both lattices, the wheel carried along.

What is advanced is either linear (`linear`) or, where beams may break, co-rotational (`fracture`).
The wheel's nodes move in the frame of its carriage: u is the displacement from where the carriage alone would have
brought them, so the prescribed motion enters through the contacts only and starts no waves.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from macrofit.base.arrays import FloatArray, IntArray

from ..errors import StabilityError
from ..lattice.candidates import STILL, ContactCandidates
from ..plates import Plates
from ..records import Breaks, Curve, Slide, Sums, Work
from .linear import Linear
from .time_step import critical_time_step

MARGIN = 0.004
"""How far elastic displacements may bring two spheres towards each other before the candidates are widened [mm]."""
CHUNK = 25
"""Steps between two looks at the normal force, while squeezing."""
REST_S = 2e-6
"""Time to come to rest after the squeeze [s]."""
MISSED = 0.05
"""Difference of N from the pressure asked for at which the squeeze is corrected once more [-]."""
CORRECTIONS = 20
"""How often the squeeze is corrected before it is given up."""
STRAYING = 0.2
"""Rms difference of N from a constant load above which a slide carries a remark [-]."""
START = 0.02
"""Part of the slide over which the speed is built up [-]."""
CARRIAGE_MASS = 0.03
"""Mass of the carriage in force control, over the solid block's [-]; small, so that the plate follows valleys."""
CARRIAGE_DAMPING = 0.1
"""Damping of the carriage in force control, over the critical one [-]; more would work against climbing spheres."""


class Explicit:
    """Two plates ready to be squeezed and slid by explicit dynamics."""

    name = "explicit"

    def __init__(self, plates: Plates) -> None:
        self.plates = plates
        keys = plates.settings.engine
        depth = 1.4 * plates.likely_approach() + 0.002
        self.range = (plates.first_touch - depth, plates.first_touch + 0.002)
        self.margin = MARGIN
        self.candidates = plates.candidates(*self.range, self.margin)
        self.critical = critical_time_step(plates.lattice, self.candidates)
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


class _Body(Protocol):
    """What is advanced in time: `linear.Linear`, or `fracture.Breaking` where beams may break."""

    drive: FloatArray
    steps: int
    u: FloatArray
    candidates: ContactCandidates

    @property
    def live(self) -> IntArray: ...
    def meet(self, candidates: ContactCandidates) -> None: ...
    def advance(
        self, steps: int, speed: Sequence[float], *, damping: float, target: float, carriage: Sequence[float]
    ) -> Sums: ...
    def stored(self) -> tuple[float, float, float]: ...


class _Run:
    """One squeeze and slide of a body, in chunks of time steps."""

    def __init__(self, engine: Explicit, micro_friction: float) -> None:
        self.plates, self.settings, self.dt = engine.plates, engine.plates.settings, engine.time_step
        self.micro_friction = micro_friction
        self.range, self.margin, self.sway = engine.range, engine.margin, STILL
        self.swayed = np.full((2, 3), np.nan)  # least and largest mean displacement at which candidates were looked for
        self.unmet = ""
        self.body: _Body
        if self.settings.engine.breakage is None:
            self.body = Linear(
                self.plates.lattice, dt=self.dt, micro_friction=micro_friction, candidates=engine.candidates
            )
        else:
            self.body = _fragile(self.plates, self.dt, micro_friction, engine.candidates)
        self.body.drive[2] = self.plates.first_touch

    def result(self) -> Slide:
        """Squeeze, slide, sum up."""
        started = time.process_time()
        squeeze = self._squeeze()
        before = self.body.stored()
        curve, work, friction, damping, released = self._slide()
        elastic, contact, kinetic = np.subtract(self.body.stored(), before)
        lattice = self.plates.lattice
        return Slide(
            micro_friction=self.micro_friction,
            engine=Explicit.name,
            squeeze=squeeze,
            curve=curve,
            work=Work(
                drive=work,
                friction=friction,
                damping=damping,
                broken=released,
                elastic=float(elastic),
                contact=float(contact),
                kinetic=float(kinetic),
            ),
            steps=self.body.steps,
            bond_steps=self.body.steps * len(lattice.cols),
            unconverged_increments=0,
            largest_residual=0.0,
            cpu_s=time.process_time() - started,
            breaks=_breaks(self.body),
            remark="; ".join(filter(None, (self.unmet, self._straying(curve)))),
        )

    def _straying(self, curve: Curve) -> str:
        """A remark where inertia keeps N far from the load it should be."""
        if self.settings.load.control != "force":
            return ""
        away = float(np.sqrt(curve.share @ (curve.normal / self.plates.target - 1.0) ** 2))
        return f"N strays from the load by {away:.0%} rms: take a smaller engine.speed" if away > STRAYING else ""

    def advance(self, steps: int, speed: tuple[float, float], damping: float, target: float = 0.0) -> Sums:
        """Carry the wheel at this speed along and upwards [mm/s]; with a target [N] it falls freely under that load."""
        sums = self.body.advance(
            steps, (speed[0], 0.0, speed[1]), damping=damping, target=target, carriage=self._carriage()
        )
        with np.errstate(over="ignore", invalid="ignore"):  # spheres that flew away touch nothing, and leave no force
            left = float(np.abs(sums.force).sum() + np.abs(self.body.u).sum())
        if not np.isfinite(left):
            raise StabilityError(
                f"the explicit run diverged at a slide of {self.body.drive[0]:.3g} mm: take a smaller engine.safety"
            )
        self._widen()
        return sums

    def _carriage(self) -> tuple[float, float]:
        """Mass [t] and damping [N s/mm] of the carriage at constant force."""
        material, keys = self.settings.material, self.settings.plates
        mass = CARRIAGE_MASS * material.density * self.plates.area * keys.cube
        stiffness = material.youngs_modulus * self.plates.area / (2.0 * keys.cube)
        return mass, 2.0 * CARRIAGE_DAMPING * float(np.sqrt(stiffness * mass))

    def _squeeze(self) -> Curve:
        keys, touch = self.settings.engine, self.plates.first_touch
        target, speed = self.plates.target, keys.approach_speed
        rows = [(0.0, 0.0, 0.0, touch, 0.0)]

        def press(steps: int, velocity: float) -> float:
            sums = self.advance(steps, (0.0, velocity), keys.squeeze_damping)
            height = float(self.body.drive[2])
            rows.append((touch - height, sums.force[2], -sums.force[0], height, -sums.force[1]))
            return float(sums.force[2])

        rest = max(CHUNK, int(REST_S / self.dt))
        if target > 0.0:
            slowest = 0.02 * self.plates.settings.plates.edge
            while press(CHUNK, -speed) < 0.95 * target:
                if touch - self.body.drive[2] > slowest + 4.0 * self.plates.likely_approach():
                    raise StabilityError("the plates do not carry the pressure asked for: take a smaller load.pressure")
            approached, carried = np.array(rows[-4:])[:, :2].T
            settled = press(rest, 0.0)
            missing = (target - settled) * np.ptp(approached) / np.ptp(carried)  # by the stiffness just seen
            press(4 * CHUNK, -missing / (4 * CHUNK * self.dt))
            press(rest // 2, 0.0)
            reached = press(CHUNK, 0.0)
            if abs(reached - target) > MISSED * target:
                self._correct(press, rest, rows)
        else:
            approach = self.plates.likely_approach()
            steps = max(1, round(approach / speed / self.dt))
            for _ in range(10):
                press(max(1, steps // 10), -approach / (10 * max(1, steps // 10) * self.dt))
            press(2 * rest, 0.0)
        return _curve(np.array(rows), 0.0)

    def _correct(
        self, press: Callable[[int, float], float], rest: int, rows: list[tuple[float, float, float, float, float]]
    ) -> None:
        """Come to rest at the pressure asked for, between an approach that gave less of it and one that gave more.

        A light load is passed by far within one chunk, and few spheres touch: one correction by the stiffness just
        seen may then lift the wheel off. Where beams have broken no approach gives again what it gave before: the
        squeeze is left as it is, and the slide carries a remark.
        """
        target, speed, edge = self.plates.target, self.settings.engine.approach_speed, self.settings.plates.edge
        below, above = 0.0, min((approach for approach, carried, *_ in rows if carried > target), default=float("inf"))
        for correction in range(CORRECTIONS + 1):
            approach, reached = rows[-1][:2]
            if abs(reached - target) <= MISSED * target:
                return
            breaks = _breaks(self.body)
            if breaks is not None and breaks.time:
                self.unmet = (
                    f"squeezed to {reached / self.plates.area:.3g} MPa, where {len(breaks.time)} beams broke, not to "
                    f"load.pressure = {self.settings.load.pressure:g} MPa"
                )
                return
            if correction == CORRECTIONS:
                break
            if reached < target:
                below, above = max(0.0, approach), above if above > approach else float("inf")
            else:
                below, above = min(below, approach), approach
            goal = 0.5 * (below + above) if above < float("inf") else 1.3 * below + 1e-5 * edge
            steps = max(4 * CHUNK, int(abs(goal - approach) / (speed * self.dt)))
            press(steps, (approach - goal) / (steps * self.dt))
            press(rest, 0.0)
            press(CHUNK, 0.0)
        raise StabilityError(
            f"the squeeze does not come to rest at load.pressure = {self.settings.load.pressure:g} MPa but at "
            f"{rows[-1][1] / self.plates.area:.3g} MPa: take a smaller engine.approach_speed, or a load.interference"
        )

    def _slide(self) -> tuple[Curve, float, float, float, float]:
        keys, slide = self.settings.engine, self.settings.load.slide
        target = self.plates.target if self.settings.load.control == "force" else 0.0
        rows, stretches = [], []
        for end in np.linspace(0.0, slide, keys.samples + 1)[1:]:
            way = end - self.body.drive[0]
            steps = max(1, round(way / (self.plates.speed * min(1.0, (end / (START * slide)) ** 0.5)) / self.dt))
            speed = way / (steps * self.dt)
            sums = self.advance(steps, (speed, 0.0), speed / keys.damping_length, target)
            rows.append((end, sums.force[2], -sums.force[0], self.body.drive[2], -sums.force[1]))
            stretches.append((sums.work, sums.friction, sums.damping, sums.released))
        work, friction, damping, released = (float(total) for total in np.sum(stretches, axis=0))
        return _curve(np.array(rows), 0.0), work, friction, damping, released

    def _widen(self) -> None:
        """Look for candidates anew when the wheel or a sphere has gone beyond what they allow for.

        A plate that sways as a whole takes all its spheres along: the middle of that is taken into the way of the
        wheel, and the margin is for how far it swings and for the rest. Without this it grew to the whole of the sway,
        and the candidates with its cube.
        """
        meet, live, height = self.body.candidates, self.body.live, self.body.drive[2]
        pair = meet.pair[live]
        between = meet.offset[live] - self.body.drive
        towards = between / np.linalg.norm(between, axis=1)[:, None]
        moved = self.body.u[pair[:, 0], :3] - self.body.u[pair[:, 1], :3]
        low, high = self.range
        if low <= height <= high and _closing(moved - self.sway, towards) <= self.margin:
            return
        reach = 0.3 * (high - low)
        self.range = (min(low, height - reach), max(high, height + reach))
        half = 0.0
        if len(moved):
            mean = moved.mean(axis=0)
            self.swayed = np.array([np.fmin(self.swayed[0], mean), np.fmax(self.swayed[1], mean)])
            self.sway = 0.5 * self.swayed.sum(axis=0)
            half = 0.5 * float(np.linalg.norm(np.diff(self.swayed, axis=0)))
            moved = moved - mean
        self.margin = max(self.margin, 1.5 * (_closing(moved, towards) + half))
        self.body.meet(self.plates.candidates(*self.range, self.margin, sway=self.sway))


def _closing(moved: FloatArray, towards: FloatArray) -> float:
    """Largest displacement of the wheel's spheres (p, 3) towards the axle's [mm]."""
    return float(np.max(np.einsum("pa,pa->p", moved, towards), initial=0.0))


def _fragile(plates: Plates, dt: float, micro_friction: float, candidates: ContactCandidates) -> _Body:
    from .fracture import Breaking

    contact, strengths = plates.settings.contact, plates.settings.engine.breakage
    assert strengths is not None
    return Breaking(
        plates.lattice,
        strengths,
        dt=dt,
        contact_modulus=contact.normal_stiffness * plates.settings.material.youngs_modulus,
        tangential_ratio=contact.tangential_ratio,
        micro_friction=micro_friction,
        candidates=candidates,
        wheel_nodes=plates.wheel.nodes,
    )


def _breaks(body: _Body) -> Breaks | None:
    if isinstance(body, Linear):
        return None
    from .fracture import TENSION, Breaking

    assert isinstance(body, Breaking)
    broken = body.broken
    return Breaks(
        time=broken.time.tolist(),
        slide=broken.slide.tolist(),
        mode=["tension" if mode == TENSION else "shear" for mode in broken.mode],
        place=[tuple(place) for place in broken.place.tolist()],
    )


def _curve(rows: FloatArray, start: float) -> Curve:
    """Rows of displacement at the end of a stretch, mean N and T over it, height at its end, mean T_y."""
    step = np.diff(rows[:, 0], prepend=start)
    return Curve(
        displacement=rows[:, 0],
        start=start,
        normal=rows[:, 1],
        tangential=rows[:, 2],
        height=rows[:, 3],
        lateral=rows[:, 4],
        share=step / max(step.sum(), 1e-300),
        tangential_work=float(step @ rows[:, 2]),
    )
