"""Does a wheelset in service, however loaded, end in a traceback, a hang or a wrong answer without a doubt?

    python -m tests.benchmarks service_fuzz [-n 300] [--seed 1] [--first 0] [--told] [--quick]

`wheelset` on coarse meshes with loads up to gross slip, friction 0 to 0.6, hollow axles, short hubs, light fits that
open, other steels, tapers and orders. Each is pressed, released and turned in a process of its own. Every solved step
is held against Coulomb's law, every moment against the balance of the wheel's forces and moments. Ends with 1 where
one was neither computed soundly, nor doubted, nor refused or ended in one line. A case is told by seed and number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.errors import MacrofitError
from macrofit.scene import load_scene
from macrofit.service import rotation
from macrofit.service.output.numbers import numbers, sentences
from macrofit.service.run import Service, serve
from macrofit.service.slipping import Law, Solved

from ._fuzz import COMPUTED, DOUBTED, REFUSED, SILENT, DrawnCase, Fuzz, Judged

ENDED = "ended in a line"
KINDS = ("solid axle, long hub", "hollow axle", "short hub", "hollow axle, short hub")
FUZZ = Fuzz(
    name="service_fuzz", about=__doc__, count=300, quick=4, column="wheelset", kinds=KINDS,
    good=(COMPUTED, DOUBTED, REFUSED, ENDED), most_cpu_s=60, most_wall_s=600.0,
)  # fmt: skip
ROUNDING = 1e-6
"""Pressure, in the largest one, that counts as none."""
MISSING = 1e-7
"""What may be missing in the balance of the wheel, in its loads."""
REPEATS, WORKS, LEAST_WORK = 1e-2, 1e-3, 100.0
"""Change of traction over a revolution, in the largest; work missing in that of friction, or in as much [N mm]."""
BREAKS: list[str] = []
"""How the steps of this process broke the law."""
REST: list[FloatArray] = []
"""Tractions (K, 3, m) of the released fit, whose balance along the axle is that of the press, by drawn slopes."""


def main(words: Sequence[str]) -> int:
    """Print a row of each kind of wheelset; 1 where any case was wrong."""
    options = FUZZ.options(words)
    judge(["friction.options.coefficient=0.2", "service.steps=3", *short(180.0)])  # all is imported and compiled

    def case(seed: int, number: int) -> DrawnCase:
        kind, overrides = drawn(seed, number)
        return DrawnCase(kind=kind, said=" ".join(overrides), judge=partial(judge, overrides))

    return FUZZ.run(options, case)


def drawn(seed: int, number: int) -> tuple[str, list[str]]:
    """The kind of a wheelset, and what is changed in `wheelset`."""
    rng = np.random.default_rng([seed, number])
    hollow, narrow = rng.random(2) < 0.4
    travel = float(rng.choice([180.0, rng.uniform(25.0, 190.0)]))
    out = [f"wheel.bore_radius={95.0 - 10.0 ** rng.uniform(-2.5, -0.4):.4f}", *short(travel)]
    out += [f"mesh.seat_facet={rng.choice([6.0, 9.0, 14.0])}", f"mesh.order={rng.choice([1, 2], p=[0.2, 0.8])}"]
    out += [f"axle.inner_radius={rng.uniform(5.0, 80.0):.3g}"] if hollow else []
    out += hub(rng) if narrow else []
    out += loads(rng) + rarely(rng)
    return KINDS[int(hollow) + 2 * int(narrow)], out


def short(travel: float) -> list[str]:
    """A coarse mesh, and a press of few increments."""
    motion = (f"motion.start={0.5 * travel:.4g}", f"motion.travel={travel:.4g}", f"motion.increment={travel / 6:.4g}")
    return ["mesh.coarse=60", *motion]


def hub(rng: np.random.Generator) -> list[str]:
    """A short hub, of a plain ring or of a wheel."""
    length = rng.uniform(30.0, 150.0)
    if rng.random() < 0.4:
        return [f"wheel.hub_length={length:.4g}", "wheel.web_thickness=0"]
    web = (f"wheel.web_thickness={0.3 * length:.4g}", f"wheel.web_blend={0.1 * length:.4g}")
    return [f"wheel.hub_length={length:.4g}", *web]


def loads(rng: np.random.Generator) -> list[str]:
    """Friction from none to 0.6, and loads from small ones to those that no fit carries."""
    size = 10.0 ** rng.uniform(-1.5, 1.2)
    friction = rng.choice([rng.uniform(0.0, 0.6), rng.uniform(0.05, 0.25), 0.0], p=[0.5, 0.45, 0.05])
    keys = {"journal_force": 110e3 * size, "journal_moment": 6e7 * size * 10.0 ** rng.normal(0.0, 0.3)}
    if rng.random() < 0.3:
        keys["lateral_force"] = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(3.0, 6.0)
    if rng.random() < 0.3:
        keys["torque"] = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(5.0, 8.5)
    if rng.random() < 0.3:
        keys["rim_offset"] = rng.uniform(-60.0, 60.0)
    out = [f"service.{name}={value:.4g}" for name, value in keys.items()]
    counts = {"harmonics": rng.integers(1, 5), "steps": rng.integers(3, 30), "revolutions": rng.integers(1, 4)}
    out += [f"service.{name}={value}" for name, value in counts.items()]
    return [*out, f"friction.options.coefficient={friction:.4g}"]


def rarely(rng: np.random.Generator) -> list[str]:
    """What few wheelsets have."""
    out = []
    if rng.random() < 0.15:
        out.append("contact.formulation=penalty")
    if rng.random() < 0.15:
        out.append(f"wheel.material.youngs_modulus={206e3 * rng.uniform(0.3, 2.0):.4g}")
    if rng.random() < 0.1:
        out += ["axle.taper=0.0033", "wheel.bore_taper=0.0033"]
    if rng.random() < 0.1:
        steel = ("yield_stress=350", "hardening.law=linear", "hardening.isotropic=5000")
        out += [f"axle.material.{key}" for key in steel]
    if rng.random() < 0.1:
        out.append(f"wheel.temperature={rng.uniform(0.0, 150.0):.3g}")
    if rng.random() < 0.2:
        out.append(f"axle.tail_length={rng.uniform(5.0, 300.0):.4g}")
    return out


def judge(overrides: list[str]) -> Judged:
    """Press, release and turn; what became of it, and why.

    Raises:
        MacrofitError: it was refused before any step broke the law.
    """
    BREAKS.clear()
    REST.clear()
    rotation.solve_step, rotation.search_step = (partial(checked_step, each) for each in STEPS)
    rotation.Rotation.rest = noted_rest  # type: ignore[method-assign]
    try:
        return held(serve(load_scene("wheelset", overrides)))
    except MacrofitError as error:
        if BREAKS:
            return SILENT, BREAKS[0]
        if "of the loads at" not in str(error):
            raise
        return ENDED, str(error)


STEPS, AT_REST = (rotation.solve_step, rotation.search_step), rotation.Rotation.rest


def noted_rest(turning: rotation.Rotation) -> rotation.Moment:
    """The released fit as ever, kept for `out_of_balance`."""
    moment = AT_REST(turning)
    REST.append(moment.traction)
    return moment


def checked_step(step: Callable[..., Solved], kernel: Any, law: Law, still: FloatArray, guess: FloatArray) -> Solved:
    """A step as ever, and what it breaks of the law."""
    solved = step(kernel, law, still, guess)
    if solved.converged:
        BREAKS.extend(broken(law, solved.traction, solved.slip))
    return solved


def broken(law: Law, traction: FloatArray, slip: FloatArray) -> list[str]:
    """What tractions and slips (K, 3, m) break of Coulomb's law: no tension, within the cone, against the slip."""
    if not (np.isfinite(traction).all() and np.isfinite(slip).all()):
        return ["not finite"]
    normal, shear = traction[:, 0], traction[:, 1:]
    tiny = ROUNDING * max(float(np.abs(normal).max()), 1e-6)
    size, bound = np.hypot(shear[:, 0], shear[:, 1]), law.friction * np.maximum(-normal, 0.0)
    step = slip[:, 1:] - law.before[:, 1:]
    way, power = np.hypot(step[:, 0], step[:, 1]), -(step * shear).sum(axis=1)
    slips = (way > 1e-7) & (bound > 100.0 * tiny)
    rules = {
        "tension": normal.max() > tiny,
        "overlap": slip[:, 0].max() > 1e-12,
        "pressure in a gap": np.abs(normal * slip[:, 0]).max() > tiny * max(1e-3, -float(slip[:, 0].min())),
        "beyond friction": (size > bound + tiny).any(),
        "slip below friction": (size[slips] < bound[slips] - tiny).any(),
        "slip not against shear": (power[slips] < 0.999 * (size * way)[slips] - tiny * 1e-6).any(),
    }
    return [name for name, breaks in rules.items() if breaks]


def held(found: Service) -> Judged:
    """A rotation against what any must be, whatever its wheelset."""
    assert found.turned is not None
    told = numbers(found)
    sentences(told)
    doubts: list[str] = told["doubts"]
    wrong = list(BREAKS)
    for revolution in found.turned.revolutions:
        wrong += [text for moment in revolution.moments for text in out_of_balance(found, moment, REST[0])]
        if not revolution.friction_work >= -1e-6:
            wrong.append(f"friction gives {revolution.friction_work:.3g} N mm")
    if not doubts:
        wrong += unsteady(found.turned.revolutions[-1])
    if wrong:
        return SILENT, wrong[0]
    return (DOUBTED, "; ".join(doubts)) if doubts else (COMPUTED, "")


def unsteady(last: rotation.Revolution) -> list[str]:
    """What a revolution that nobody doubts does not repeat."""
    ends = [last.moments[k].traction for k in (0, -1)]
    change, pressure = float(np.abs(ends[1] - ends[0]).max()), float(np.abs(ends[0]).max())
    out = [f"tractions change by {change:.3g} MPa of {pressure:.3g}"] if change > REPEATS * pressure else []
    missing = abs(last.load_work - last.friction_work)
    if missing > WORKS * max(last.friction_work, LEAST_WORK):
        out.append(f"work of the loads {last.load_work:.4g}, of friction {last.friction_work:.4g} N mm")
    return out


def out_of_balance(found: Service, moment: rotation.Moment, rest: FloatArray) -> list[str]:
    """Which forces and moments of the wheel the tractions do not carry beyond those at ``rest`` (K, 3, m)."""
    whole, fit, keys = found.whole, found.whole.fit, found.whole.loads.keys
    angle = 2.0 * np.pi * (np.arange(len(rest)) / len(rest) - moment.time)[:, None]  # loads stand still at the angle 0
    n_r, n_z = fit.normals.T
    normal, along, around = np.moveaxis(moment.traction - rest, 1, 0)
    radial, axial = n_r * normal - n_z * along, n_z * normal + n_r * along
    bore = fit.coupling.bore
    radius, z = (bore.matrix[fit.chosen] @ fit.lines[1].nodes[bore.span]).T  # where they act on the wheel
    across = np.cos(angle) * radial - np.sin(angle) * around, np.sin(angle) * radial + np.cos(angle) * around
    lever = np.cos(angle) * radius, np.sin(angle) * radius
    carried = {
        "force down": (across[0], -keys.journal_force),
        "force aside": (across[1], 0.0),
        "force along": (axial, keys.lateral_force),
        "torque": (radius * around, keys.torque),
        "tilt": (
            across[0] * z - axial * lever[0],
            -keys.journal_force * (whole.loads.rail_z - whole.displacement)
            - keys.lateral_force * whole.loads.rail_radius,
        ),
        "tilt aside": (across[1] * z - axial * lever[1], 0.0),
    }
    pressed = float(np.abs(rest[:, 0]).mean(axis=0) @ fit.weight)
    size = float(radius.mean())
    scale = keys.journal_force + abs(keys.lateral_force) + abs(keys.torque) / size + 1e-4 * pressed
    out = []
    for name, (density, load) in carried.items():
        missing = float(density.mean(axis=0) @ fit.weight) - load
        least = MISSING * scale if name.startswith("force") else MISSING * scale * size
        if abs(missing) > least:
            out.append(f"{name} {missing:.3g} missing of {load:.3g} at {moment.time:.3f}")
    return out
