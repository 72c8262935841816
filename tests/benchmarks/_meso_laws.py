"""Families of `meso_stability` that compare two runs, or hold lattice and time stepping to a law of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Any, TypeAlias
from unittest import mock

import numpy as np

from macrofit.base.arrays import FloatArray
from meso.engines import quasistatic
from meso.engines.explicit import Explicit
from meso.engines.fracture import Breaking
from meso.engines.linear import Linear
from meso.engines.quasistatic import QuasiStatic
from meso.engines.time_step import critical_time_step
from meso.errors import MesoError
from meso.lattice.lattice import Lattice, build
from meso.material import Material
from meso.packing.pack import Packing, pack
from meso.plates import Plates, make_plates
from meso.records import Curve
from meso.settings import Breakage, load

from ._measure import alone
from ._meso_checks import Verdict, held, refused, verdict

Case: TypeAlias = Callable[[], Verdict]
Rng: TypeAlias = np.random.Generator

PLATES = ("plates.spheres=600", "engine.samples=100")


def impossible(key: str, keys: Sequence[str]) -> Case:
    """Settings that must be refused."""

    def judged() -> Verdict:
        try:
            plates = make_plates(load(None, [*keys, key]))
            Explicit(plates) if plates.settings.engine.name == "explicit" else QuasiStatic(plates)
        except MesoError as error:
            return refused(error)
        return Verdict(faults=[f"{key} is not refused"])

    return judged


def diverging(plates: Plates, above: float, *, forced: bool) -> Case:
    """A time step above the limit: refused as a key, and told where it is forced upon the engine."""

    def judged() -> Verdict:
        step = above * critical_time_step(plates.lattice)
        keys = plates.settings.engine
        try:
            if forced:
                engine = Explicit(plates)
                engine.time_step = step
            else:
                within = Explicit(plates).critical
                table = {f: getattr(keys, f) for f in keys.__struct_fields__} | {"time_step": above * within}
                engine = Explicit(replace(plates, settings=_with(plates.settings, engine=type(keys)(**table))))
            engine.slide(0.07)
        except MesoError as error:
            return refused(error)
        return Verdict(faults=[f"{above} of the limit runs to an answer"])

    return judged


def _with(settings: Any, **tables: Any) -> Any:
    return type(settings)(**({f: getattr(settings, f) for f in settings.__struct_fields__} | tables))


# --- a million steps -------------------------------------------------------------------------------------------------


def million(rng: Rng, steps: int = 1_000_000) -> Iterator[Case]:
    """a million steps of a free lattice at 0.5, 0.9, 0.99 of the limit; a fifth of them co-rotational"""
    lattice = build(pack(rng, spheres=100, size=(0.4, 0.4), thickness=0.4), Material(), load_beams())
    for safety in (0.5, 0.9, 0.99):
        yield lambda safety=safety: drifting(lattice, safety, steps, large=False)
    yield lambda: drifting(lattice, 0.8, steps // 5, large=True)


def load_beams() -> Any:
    """The beams of steel."""
    from meso.lattice.calibration import steel

    return steel()


def drifting(lattice: Lattice, safety: float, steps: int, *, large: bool) -> Verdict:
    """Energy and momenta of a free lattice, struck at random, at the start and at the end.

    Leapfrog keeps E = sum m v-.v+ / 2 + U of a linear lattice exactly; rounding of 1e-16 each step, adding up like a
    random walk at best and steadily at worst, leaves 1e-13 to 1e-10 after a million. That holds for displacements that
    stay as they are: there is no rigid motion at the start, which would add up without end in a linear lattice, and the
    torque of its rounding, 1e-16 of it, with its square. A co-rotational lattice is not
    linear: E then swings by the square of the step times the strains, and must not drift.
    """
    dt = safety * critical_time_step(lattice)
    body: Any = Linear(lattice, dt=dt)
    if large:
        strong = Breakage(tensile_strength=1e12, shear_strength=1e12)
        body = Breaking(lattice, strong, dt=dt, contact_modulus=206e3)
    body.v[:] = np.random.default_rng(5).normal(size=body.v.shape) * (1.0, 1.0, 1.0, 20.0, 20.0, 20.0)
    inertia, modes = np.repeat(1.0 / lattice.inverse, 3, axis=1).ravel(), rigid_motions(lattice).reshape(6, -1)
    body.v -= (modes.T @ np.linalg.solve(inertia * modes @ modes.T, modes @ (inertia * body.v.ravel()))).reshape(-1, 6)

    still = (0.0, 0.0, 0.0)

    def account() -> FloatArray:
        u, v = body.u.copy(), body.v.copy()
        if large:
            energy = body.advance(1, still).stored
        else:
            before = body.stored()[0]
            body.advance(1, still)
            mass = np.repeat(1.0 / lattice.inverse, 3, axis=1)
            energy = before + 0.5 * float(np.sum(mass * v * body.v))
        momentum = lattice.masses @ v[:, :3]
        place = lattice.centres + (u[:, :3] if large else 0.0)
        spin = lattice.masses @ np.cross(place, v[:, :3]) + (1.0 / lattice.inverse[:, 1]) @ v[:, 3:]
        return np.array([energy, *momentum, *spin])

    start = account()
    body.advance(steps, still)
    end = account()
    mass, speed = float(lattice.masses.sum()), float(np.sqrt(2.0 * start[0] / lattice.masses.sum()))
    scales = np.array([start[0], *[mass * speed] * 3, *[mass * speed * 0.4] * 3])
    drift = np.abs(end - start) / scales
    bound = np.array([1e-4 if large else 1e-9, *[1e-9] * 3, *[1e-5 if large else 1e-9] * 3])
    faults = [] if np.all(drift < bound) else [f"energy, momentum, spin drift by {np.array2string(drift, precision=1)}"]
    return Verdict(faults=faults, balance=float(drift[0]))


# --- one engine against the other ------------------------------------------------------------------------------------


def engines(rng: Rng) -> Iterator[Case]:
    """quasi-static against explicit at 5 m/s: micro friction 0-0.3, stiffness, loads"""
    for _ in range(12):
        keys = [f"surface.{body}_seed={rng.integers(1, 9999)}" for body in ("wheel", "axle")]
        mu, height = rng.uniform(0.0, 0.3), rng.choice([0.01, 0.02, 0.04])
        keys += [f"surface.max_height={height}", f"contact.normal_stiffness={rng.choice([0.5, 1.0, 4.0])}"]
        keys += [f"load.interference={rng.uniform(0.003, 0.01)}", f"contact.micro_friction={mu}", "engine.speed=5000"]
        yield lambda keys=keys: agreeing(make_plates(load(None, [*PLATES, *keys])))


AGREE = 0.004
"""Of both engines' coefficients [-]; the explicit one at 5 m/s is off by 0.5 % of 0.07 on plates of 600 spheres."""


def agreeing(plates: Plates) -> Verdict:
    """The same slide by both engines."""
    found, other = verdict(plates, QuasiStatic(plates)), verdict(plates, Explicit(plates))
    found.faults += other.faults
    found.balance = max(found.balance, other.balance)
    if found.slide and other.slide and not found.said and not other.said:
        away = found.slide.curve.coefficient - other.slide.curve.coefficient
        if abs(away) > AGREE + 0.02 * found.slide.micro_friction:
            found.faults.append(f"engines differ by {away:+.4f} at micro {found.slide.micro_friction:.3f}")
    return found


# --- what must not matter --------------------------------------------------------------------------------------------


def invariances(rng: Rng) -> Iterator[Case]:
    """order of spheres, shift, mirror, bodies exchanged, units of force and length"""
    for k in range(6):
        keys = [f"surface.{body}_seed={rng.integers(1, 9999)}" for body in ("wheel", "axle")]
        keys += ["engine.tolerance=1e-7", f"contact.micro_friction={rng.uniform(0.01, 0.3)}", "load.interference=0.005"]
        keys += [
            "engine.samples=100",
            *(["plates.external_face=beams", "engine.name=quasi-static"] if k % 3 == 2 else []),
        ]
        plates = make_plates(load(None, ["plates.spheres=600", *keys]))
        for change in (reordered, shifted, mirrored, exchanged, stiffer, larger):
            yield lambda plates=plates, change=change: alike(plates, change(plates), QuasiStatic, change.__name__)
        if k < 3:
            for change in (reordered, shifted, mirrored, exchanged):
                yield lambda plates=plates, change=change: alike(plates, change(plates), Explicit, change.__name__)


LENGTHS = ("MARGIN", "DEEPER", "CLOSE")
"""Of `quasistatic`. Where spheres left out of an increment were at its end is known to a fraction of CLOSE, so the
first slip of those that touch next, and the coefficient with it, depends on it a little: by 5e-5 in this family."""


def alike(one: Plates, other: Plates, engine: Any, change: str) -> Verdict:
    """Both give the same coefficient, N(t) and T(t), to what the tolerance of the increments leaves.

    The explicit engine takes the same time step for both: its limit is an eigenvalue found to 0.5 % from a start that
    depends on the order of the spheres. The lengths that the quasi-static engine has of its own grow with the plates.
    """
    first, scale = engine(one), 2.0 if change == "larger" else 1.0
    a = verdict(one, first)
    with mock.patch.multiple(quasistatic, **{name: scale * getattr(quasistatic, name) for name in LENGTHS}):
        second = engine(other)
        if isinstance(second, Explicit):
            second.time_step = first.time_step
        b = verdict(other, second)
    found = Verdict(faults=a.faults + b.faults, balance=max(a.balance, b.balance), said=a.said or b.said, slide=a.slide)
    if a.slide and b.slide and a.slide.steps == b.slide.steps:
        mean = [slide.curve.mean_normal for slide in (a.slide, b.slide)]
        for name in ("normal", "tangential"):
            values = [getattr(v.slide.curve, name) / n for v, n in zip((a, b), mean, strict=True)]  # type: ignore[union-attr]
            away = float(np.abs(values[0] - values[1]).max())
            if away > 1e-4:
                found.faults.append(f"{change}: {name} differs by {away:.1e} of the mean N")
    if a.slide and b.slide and abs(a.slide.curve.coefficient - b.slide.curve.coefficient) > 1e-5:
        found.faults.append(f"{change}: {a.slide.curve.coefficient:.8f} and {b.slide.curve.coefficient:.8f}")
    return found


def _turned(lattice: Lattice, signs: tuple[float, float, float]) -> Lattice:
    """Mirrored in planes through the origin; what couples shift and rotation on the back changes sign with z."""
    mirror = np.array(signs)
    beams = lattice.beams * np.array([*signs, 1.0, 1.0, 1.0])
    anchors = lattice.anchors * np.array([1.0, 1.0, signs[2], 1.0, 1.0])
    return replace(lattice, centres=lattice.centres * mirror, beams=beams, anchors=anchors)


def mirrored(plates: Plates) -> Plates:
    """y <- -y."""
    return replace(plates, wheel=_turned(plates.wheel, (1, -1, 1)), axle=_turned(plates.axle, (1, -1, 1)))


def exchanged(plates: Plates) -> Plates:
    """Half a turn about y, after which the axle's plate is carried over the wheel's: the same relative motion."""
    return replace(plates, wheel=_turned(plates.axle, (-1, 1, -1)), axle=_turned(plates.wheel, (-1, 1, -1)))


def shifted(plates: Plates) -> Plates:
    """Both plates elsewhere."""
    way = np.array([0.3, -1.7, 0.0])
    return replace(
        plates,
        wheel=replace(plates.wheel, centres=plates.wheel.centres + way),
        axle=replace(plates.axle, centres=plates.axle.centres + way),
    )


def reordered(plates: Plates) -> Plates:
    """The spheres of both plates numbered at random."""
    rng = np.random.default_rng(3)
    return replace(plates, wheel=_renumbered(plates.wheel, rng), axle=_renumbered(plates.axle, rng))


def _renumbered(lattice: Lattice, rng: Rng) -> Lattice:
    order = rng.permutation(lattice.nodes)
    new = np.argsort(order)
    i, j = new[lattice.first], new[lattice.cols]
    beams = lattice.beams * np.where(i < j, 1.0, -1.0)[:, None] ** np.array([1, 1, 1, 0, 0, 0])
    i, j = np.minimum(i, j), np.maximum(i, j)
    bonds = np.lexsort((j, i))
    back = np.argsort(new[lattice.anchored])
    return Lattice(
        centres=lattice.centres[order],
        radii=lattice.radii[order],
        masses=lattice.masses[order],
        rows=np.concatenate([[0], np.cumsum(np.bincount(i, minlength=lattice.nodes))]),
        cols=np.ascontiguousarray(j[bonds]),
        beams=np.ascontiguousarray(beams[bonds]),
        anchored=new[lattice.anchored][back],
        anchors=np.ascontiguousarray(lattice.anchors[back]),
        twist=lattice.twist,
    )


def stiffer(plates: Plates) -> Plates:
    """All stiffnesses four times as large: as if newtons were counted four to one."""
    scale = np.array([1.0, 1.0, 1.0, 1.0, 4.0, 4.0])
    material = replace_struct(plates.settings.material, youngs_modulus=4.0 * plates.settings.material.youngs_modulus)
    return replace(
        plates,
        settings=_with(plates.settings, material=material),
        wheel=replace(plates.wheel, beams=plates.wheel.beams * scale, anchors=4.0 * plates.wheel.anchors),
        axle=replace(plates.axle, beams=plates.axle.beams * scale, anchors=4.0 * plates.axle.anchors),
    )


def larger(plates: Plates) -> Plates:
    """All lengths twice as large: forces four times as large, the same coefficient."""

    def grown(lattice: Lattice) -> Lattice:
        return replace(
            lattice,
            centres=2.0 * lattice.centres,
            radii=2.0 * lattice.radii,
            masses=8.0 * lattice.masses,
            beams=lattice.beams * np.array([1.0, 1.0, 1.0, 0.5, 2.0, 8.0]),
            anchors=lattice.anchors * np.array([2.0, 2.0, 4.0, 8.0, 8.0]),
        )

    keys = plates.settings
    twice = _with(
        keys,
        load=replace_struct(keys.load, slide=2.0 * keys.load.slide, interference=2.0 * (keys.load.interference or 0.0)),
        engine=replace_struct(keys.engine, increment=2.0 * keys.engine.increment),
    )
    return replace(plates, settings=twice, wheel=grown(plates.wheel), axle=grown(plates.axle))


def replace_struct(table: Any, **values: Any) -> Any:
    """A table of settings with other values."""
    return _with(table, **values)


# --- the same bits ---------------------------------------------------------------------------------------------------


def determinism(rng: Rng) -> Iterator[Case]:
    """the same seeds twice: the same bits, also in a process of its own"""
    for k in range(8):
        keys = [f"surface.wheel_seed={rng.integers(1, 9999)}", f"plates.packing_seed={k}"]
        keys += ["engine.name=explicit", "engine.speed=40000"] if k % 2 else []
        if k % 4 > 1:
            keys += ["load.control=force"]
        yield lambda keys=keys, k=k: repeated([*PLATES, *keys], fresh=k < 4)


def bits(curve: Curve) -> str:
    """Hash of a curve."""
    whole = sha256()
    for values in (curve.displacement, curve.normal, curve.tangential, curve.height):
        whole.update(np.ascontiguousarray(values).tobytes())
    return whole.hexdigest()


def repeated(keys: Sequence[str], *, fresh: bool) -> Verdict:
    """Run twice here, and with ``fresh`` twice in processes of their own, which find the kernels compiled.

    A kernel that was compiled by the process that runs it may round otherwise than the same from the cache (1 ulp), so
    that this process is compared with itself, and processes that come later with each other.
    """
    from meso.friction_test import run

    found = verdict(make_plates(load(None, keys)))
    if found.slide is None:
        return found
    hashes = {bits(found.slide.curve), bits(run(load(None, keys)).slides[0].curve)}
    if fresh:
        code = f"""
from meso.friction_test import run
from meso.settings import load
from tests.benchmarks._meso_laws import bits
print(bits(run(load(None, {list(keys)!r})).slides[0].curve))
"""
        alone(code)  # compiles what is not in the cache
        if alone(code)[0] != alone(code)[0]:
            found.faults.append("not the same bits in two processes")
    if len(hashes) > 1:
        found.faults.append("not the same bits twice")
    return found


# --- lattices --------------------------------------------------------------------------------------------------------


def lattices(rng: Rng) -> Iterator[Case]:
    """packings and their stiffness: connected, symmetric, no rigid motion resisted, mass, forces of the face"""
    for k in range(24):
        keys = [
            f"surface.wheel_seed={k}",
            f"surface.max_height={rng.uniform(0.0, 0.1)}",
            f"plates.packing_seed={k % 4}",
        ]
        keys += [f"plates.external_face={('solid', 'beams')[k % 2]}", f"surface.levels={1 + k % 6}"]
        keys += ["engine.name=quasi-static"]
        yield lambda keys=keys: lattice_laws(make_plates(load(None, [*PLATES, *keys])))


def lattice_laws(plates: Plates) -> Verdict:
    """Laws of both plates."""
    found = Verdict()
    bodies = (plates.wheel_packing, plates.wheel), (plates.axle_packing, plates.axle)
    for packing, lattice in bodies:
        faults, balance = one_lattice(packing, lattice, plates)
        found.faults += faults
        found.balance = max(found.balance, balance)
    return found


def likely_largest(packing: Packing) -> float:
    """Largest overlap over mean radius if overlaps were exponentially distributed [-].

    The forces between harmonic spheres that jam fall off at least as fast: the largest of n is below mean times ln n.
    """
    i, j = packing.contacts.T
    reach = packing.radii[i] + packing.radii[j]
    overlap = 2.0 * (1.0 - np.linalg.norm(packing.centres[j] - packing.centres[i], axis=1) / reach)
    return float(overlap.mean() * np.log(len(overlap)))


def rigid_motions(lattice: Lattice) -> FloatArray:
    """Three shifts and three rotations about the middle, shape (6, n, 6)."""
    x = lattice.centres - lattice.centres.mean(axis=0)
    rigid = np.zeros((6, lattice.nodes, 6))
    for axis in range(3):
        rigid[axis, :, axis] = 1.0
        rigid[3 + axis, :, 3 + axis] = 1.0
        rigid[3 + axis, :, :3] = np.cross(np.eye(3)[axis], x)
    return rigid


def one_lattice(packing: Packing, lattice: Lattice, plates: Plates) -> tuple[list[str], float]:
    """What is wrong with a plate, and how far rigid motions and the forces of the face are from balance."""
    K = lattice.stiffness()
    scale = float(np.abs(K.data).max())
    asymmetry = float(np.abs(K - K.T).max()) / scale
    free = replace(lattice, anchored=np.empty(0, np.int64), anchors=np.empty((0, 5)))
    resisted = float(np.abs(free.stiffness() @ rigid_motions(lattice).reshape(6, -1).T).max()) / scale
    u = np.random.default_rng(1).normal(size=(lattice.nodes, 6)) * 1e-6
    pulled = (K @ u.ravel()).reshape(-1, 6)[:, :3].sum(axis=0)  # beams are internal: all of it is the face's
    unbalanced = float(np.abs(pulled + held(lattice, u)).max() / np.abs(K @ u.ravel()).sum())
    worst = max(asymmetry, resisted, unbalanced)
    mass = plates.settings.material.density * packing.volume
    heights = packing.surface.at(packing.centres[:, 0], packing.centres[:, 1]) + packing.thickness
    checks = {
        "stiffness not symmetric": asymmetry < 1e-14,
        "rigid motion resisted": resisted < 1e-12,
        "the face's forces are not those of the stiffness": unbalanced < 1e-12,
        "energy not positive": float(u.ravel() @ (K @ u.ravel())) > 0.0,
        "mass": abs(float(lattice.masses.sum()) / mass - 1.0) < 1e-9,
        "coordination": packing.coordination > 5.5,
        "spheres overlap": packing.largest_overlap < min(0.5, likely_largest(packing)),
        "a sphere outside of its plate": bool(np.all(packing.centres[:, 2] < heights) and packing.centres.min() > 0.0),
        "nothing holds the back": len(lattice.anchored) > 3 and bool(np.all(lattice.anchors[:, :2] > 0.0)),
    }
    return [text for text, right in checks.items() if not right], worst
