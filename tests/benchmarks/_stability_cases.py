"""The cases of the stability sweep: families, each with what varies, all drawn from seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import ClassVar

import numpy as np

from macrofit.friction.contract import FloatArray, TilePairs
from macrofit.scene import Scene, build_scene

BASE: dict[str, object] = {
    "axle.seat_radius": 60.0, "axle.seat_length": 40.0, "axle.taper_length": 8.0, "axle.taper_height": 0.8,
    "axle.taper_blend": 60.0, "axle.tail_length": 20.0,
    "wheel.bore_radius": 59.9, "wheel.hub_length": 36.0, "wheel.hub_outer_radius": 95.0,
    "wheel.chamfer_length": 5.0, "wheel.chamfer_height": 0.5, "wheel.chamfer_blend": 40.0,
    "mesh.seat_facet": 2.0, "mesh.coarse": 20.0, "mesh.growth": 0.8,
    "motion.displacements": (0.0, 1.7, 5.0, 9.3, 14.0, 22.0, 26.9, 30.0),
    "friction.options.coefficient": 0.12,
    "output.fields_at": (),
}  # fmt: skip
"""A ring of 36 mm on a seat of 40 mm, 24 facets; 0.1 mm of interference on the radius."""

DISCS: dict[str, object] = {
    "axle.shape": "disc", "axle.radius": 20.0, "axle.thickness": 20.0, "axle.crown_radius": 0.0,
    "wheel.shape": "disc", "wheel.radius": 20.0, "wheel.thickness": 20.0, "wheel.crown_radius": 200.0,
    "mesh.seat_facet": 1.0, "mesh.growth": 0.8, "friction.options.coefficient": 0.12, "output.fields_at": (),
}  # fmt: skip
"""A cap on a flat disc, which a motion along the gap brings together and apart."""

THERE_AND_BACK = (0.0, 6.0, 17.0, 25.0, 25.1, 24.9, 24.0, 19.0, 19.5, 27.0)
FRICTIONS = (0.0, 0.12, 0.6)
ORDERS = (1, 2)
LENGTHS = frozenset(
    f"{table}.{key}"
    for table, keys in {
        "axle": "seat_radius seat_length taper_length taper_height taper_blend tail_length tail_radius",
        "wheel": "bore_radius hub_length hub_outer_radius chamfer_length chamfer_height chamfer_blend",
        "mesh": "seat_facet bore_facet corner_facet coarse",
        "motion": "displacements",
    }.items()
    for key in keys.split()
)
STEEL = 206e3  # MPa


@dataclass(frozen=True)
class Scatter:
    """Friction without any order: each pair of tiles draws its own, and may change with pressure and sliding."""

    seed: int
    values: tuple[float, ...] = (0.01, 0.9)  # one of these; with `between`, anywhere between the first two
    between: bool = False
    evolving: bool = False

    TABLE: ClassVar[int] = 4096

    @property
    def depends_on(self) -> frozenset[str]:
        """What the coefficient depends on."""
        return frozenset({"tiles", "pressure", "sliding"} if self.evolving else {"tiles"})

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu of each pair."""
        rng = np.random.default_rng(self.seed)
        drawn = rng.uniform(*self.values[:2], self.TABLE) if self.between else rng.choice(self.values, self.TABLE)
        mu = drawn[(pairs.seat * 61 + pairs.bore * 17) % self.TABLE]
        if self.evolving:
            mu = mu * (0.6 + 0.4 * np.exp(-pairs.sliding / 5.0)) / (1.0 + pairs.pressure / 1000.0)
        return np.asarray(mu)


@dataclass(frozen=True)
class Case:
    """One run: the keys changed from a base, and what no key can say."""

    family: str
    keys: dict[str, object]
    base: dict[str, object] = field(default_factory=lambda: BASE, repr=False)
    scatter: Scatter | None = None
    numbering: int | None = None  # seed of a random numbering of the points and triangles of both meshes
    units: tuple[float, float] = (1.0, 1.0)  # a mm and a N in the units of the case
    like: tuple[object, ...] = ()  # the first case that has it is the reference of the others
    tolerance: float = 0.0  # of force, normal force and strain energy against the reference

    @property
    def scene(self) -> Scene:
        """The scene. Raises SceneError."""
        length, force = self.units
        tables: dict[str, dict[str, object]] = {}
        for key, value in (self.base | self.keys).items():
            table, _, name = key.partition(".")
            if key in LENGTHS:
                value = tuple(length * u for u in value) if isinstance(value, tuple) else length * value  # type: ignore
            if name.endswith("youngs_modulus"):
                value = value * force / length**2  # type: ignore[operator]
            if key == "contact.penalty_stiffness":
                value = value * force / length**3  # type: ignore[operator]
            place = tables.setdefault(table, {})
            *path, last = name.split(".")
            for part in path:
                place = place.setdefault(part, {})  # type: ignore[assignment]
            place[last] = value
        tables.setdefault("friction", {})["provider"] = "uniform"
        return build_scene(tables)


def moduli(axle: float = STEEL, wheel: float = STEEL) -> dict[str, object]:
    """Young's moduli of both [MPa]."""
    return {"axle.material.youngs_modulus": float(axle), "wheel.material.youngs_modulus": float(wheel)}


def friction() -> Iterator[Case]:
    for order, theta, mu in product(ORDERS, (0, 1, -1), np.linspace(0.0, 0.9, 10)):
        yield Case("friction", {"mesh.order": order, "contact.theta": theta, "friction.options.coefficient": float(mu)})


def interference() -> Iterator[Case]:
    for order, depth, mu in product(ORDERS, np.linspace(0.0, 1.0, 11), FRICTIONS):
        keys = {"mesh.order": order, "wheel.bore_radius": 60.0 - float(depth), "friction.options.coefficient": mu}
        yield Case("interference", keys)


def nitsche() -> Iterator[Case]:
    for order, theta, decade, mu in product(ORDERS, (0, 1, -1), np.linspace(4.0, -1.0, 11), (0.12, 0.5)):
        keys = {"mesh.order": order, "contact.theta": theta, "contact.gamma0": float(10**decade)}
        yield Case("nitsche", keys | {"friction.options.coefficient": mu})


def penalty() -> Iterator[Case]:
    for order, decade, mu, path in product(ORDERS, np.linspace(-3, 3, 13), (0.12, 0.5), (0, 1)):
        keys = {"mesh.order": order, "contact.formulation": "penalty", "friction.options.coefficient": mu}
        keys["contact.penalty_stiffness"] = 10.0 * STEEL * float(10**decade)
        yield Case("penalty", keys | ({"motion.displacements": THERE_AND_BACK} if path else {}))


def stiffness() -> Iterator[Case]:
    for order, formulation, decade, mu in product(ORDERS, ("nitsche", "penalty"), np.linspace(-3, 3, 9), FRICTIONS):
        keys = moduli(STEEL * min(1.0, 10**decade), STEEL * min(1.0, 10**-decade))
        yield Case(
            "stiffness",
            keys | {"mesh.order": order, "contact.formulation": formulation, "friction.options.coefficient": mu},
        )


def poisson() -> Iterator[Case]:
    ratios = (0.0, 0.2, 0.4, 0.45, 0.49, 0.499, 0.4999)
    for order, nu, which, mu in product(ORDERS, ratios, (("axle", "wheel"), ("axle",), ("wheel",)), FRICTIONS):
        keys: dict[str, object] = {f"{body}.material.poisson_ratio": nu for body in which}
        yield Case("poisson", keys | {"mesh.order": order, "friction.options.coefficient": mu})


def mesh_ratio() -> Iterator[Case]:
    ratios = (0.1, 0.2, 0.37, 0.5, 0.97, 1.0, 1.03, 2.0, 2.718, 5.0, 10.0)
    for order, ratio, mu, step in product(ORDERS, ratios, FRICTIONS, (4.0, 4.1)):
        seat = 2.0 if ratio >= 0.5 else 4.0
        keys = {"mesh.order": order, "mesh.seat_facet": seat, "mesh.bore_facet": seat * ratio}
        path = tuple(float(step * k) for k in range(8))  # whole facets, or never the same phase
        yield Case("mesh ratio", keys | {"motion.displacements": path, "friction.options.coefficient": mu})


def increments() -> Iterator[Case]:
    for order, mu in product(ORDERS, (0.0, 0.05, 0.12, 0.6)):
        for step in (1.0, 0.01, 0.03, 0.1, 0.3, 3.0, 10.0, 30.0):
            count = min(30, round(30.0 / step))
            path = tuple(float(u) for u in 30.0 - step * np.arange(count, -1, -1))
            keys = {"mesh.order": order, "friction.options.coefficient": mu, "motion.displacements": path}
            yield Case("increments", keys)


def substeps() -> Iterator[Case]:
    """A motion that turns back by the same way in ever more increments: stick must hold, however many they are."""
    variants: tuple[dict[str, object], ...] = (
        {}, {"contact.gamma0": 1.0}, {"contact.theta": 1}, {"contact.formulation": "penalty"},
        {"contact.formulation": "penalty", "contact.penalty_stiffness": STEEL},
    )  # fmt: skip
    for order, variant, back in product(ORDERS, range(5), (0.005, 0.03)):
        for mu, count in product((0.05, 0.6), (1, 10, 60)):
            path = (0.0, 8.0, 17.0, 25.0, *(float(25.0 - back * k / count) for k in range(1, count + 1)))
            keys = variants[variant] | {"mesh.order": order, "friction.options.coefficient": mu}
            like = ("substeps", order, variant, back, mu)
            yield Case("substeps", keys | {"motion.displacements": path}, like=like, tolerance=1e-2)


def corners() -> Iterator[Case]:
    for order, taper, chamfer, mu in product(ORDERS, (0.0, 10.0, 70.0), (0.0, 5.0, 50.0), FRICTIONS):
        keys = {"mesh.order": order, "axle.taper_blend": taper, "wheel.chamfer_blend": chamfer}
        yield Case("corners", keys | {"friction.options.coefficient": mu})
    bare = {"axle.taper_length": 0.0, "axle.taper_height": 0.0, "axle.taper_blend": 0.0}
    bare |= {"wheel.chamfer_length": 0.0, "wheel.chamfer_height": 0.0, "wheel.chamfer_blend": 0.0}
    for order, mu in product(ORDERS, FRICTIONS):
        path = (20.0, 20.01, 23.0, 30.0, 29.0, 12.0)
        keys = {"mesh.order": order, "motion.displacements": path, "friction.options.coefficient": mu}
        yield Case("corners", bare | keys)


def wander(rng: np.random.Generator, low: float, high: float, count: int = 12) -> tuple[float, ...]:
    """A path that turns every one to four increments, of 0.01 to 10 mm."""
    path, sense = [float(rng.uniform(low, high))], 1.0
    while len(path) < count:
        for _ in range(rng.integers(1, 5)):
            step = float(10 ** rng.uniform(-2.0, 1.0))
            if not low < path[-1] + sense * step < high:
                break
            path.append(path[-1] + sense * step)
        sense = -sense
    return tuple(path[:count])


def reversals() -> Iterator[Case]:
    for order, formulation in product(ORDERS, ("nitsche", "penalty")):
        for seed, mu in product(range(10), (0.05, 0.12, 0.6)):
            path = (0.0, *wander(np.random.default_rng([1, seed]), 3.0, 38.0))
            keys = {"mesh.order": order, "contact.formulation": formulation, "motion.displacements": path}
            yield Case("reversals", keys | {"friction.options.coefficient": mu})


def random_friction() -> Iterator[Case]:
    for order, facet in product(ORDERS, (1.0, 2.0)):
        for seed, path in product(range(6), (0, 1)):
            for scatter in (Scatter(seed), Scatter(seed, (0.0, 1.2), True), Scatter(seed, (0.01, 0.9), False, True)):
                keys: dict[str, object] = {"mesh.order": order, "mesh.seat_facet": facet}
                keys |= {"motion.displacements": THERE_AND_BACK} if path else {}
                yield Case("random friction", keys, scatter=scatter)


def lost_contact() -> Iterator[Case]:
    open_end = {"axle.tail_length": 60.0, "axle.tail_radius": 59.0}
    for order, seed, mu in product(ORDERS, range(14), FRICTIONS):
        path = tuple(float(u) for u in np.random.default_rng([2, seed]).uniform(-12.0, 95.0, 10))
        keys = {"mesh.order": order, "motion.displacements": path, "friction.options.coefficient": mu}
        yield Case("lost contact", open_end | keys)
    for order, crown, theta in product(ORDERS, (0.0, 200.0), (0, -1, 1)):
        for seed, mu in product(range(3), FRICTIONS):
            path = tuple(float(u) for u in np.random.default_rng([3, seed]).uniform(-0.05, 0.05, 10))
            keys = {"mesh.order": order, "wheel.crown_radius": crown, "contact.theta": theta}
            keys |= {"motion.displacements": path, "friction.options.coefficient": mu}
            yield Case("lost contact", keys, DISCS)


def units() -> Iterator[Case]:
    variants: tuple[dict[str, object], ...] = (
        {}, {"contact.theta": 1}, {"contact.formulation": "penalty", "contact.penalty_stiffness": 2e6},
    )  # fmt: skip
    systems = (
        (1.0, 1.0),
        (1e-3, 1.0),
        (0.1, 1e-3),
        (1 / 25.4, 1 / 4.448),
        (1e3, 1e9),
    )  # mm-N, m-N, cm-kN, inch-lbf, um
    for order, variant, system in product(ORDERS, range(3), systems):
        for mu, path in product(FRICTIONS, (None, THERE_AND_BACK)):
            keys = moduli() | variants[variant] | {"mesh.order": order, "friction.options.coefficient": mu}
            keys |= {} if path is None else {"motion.displacements": path}
            like = ("units", order, variant, mu, path)
            yield Case("units", keys, units=system, like=like, tolerance=1e-9)


def numbering() -> Iterator[Case]:
    for order, theta, seed in product(ORDERS, (0, 1), (None, *range(5))):
        for mu, path in product(FRICTIONS, (None, THERE_AND_BACK)):
            keys = {"mesh.order": order, "contact.theta": theta, "friction.options.coefficient": mu}
            keys |= {} if path is None else {"motion.displacements": path}
            like = ("numbering", order, theta, mu, path)
            yield Case("numbering", keys, numbering=seed, like=like, tolerance=1e-9)


def combined(scenes: int = 300) -> Iterator[Case]:
    """Everything at once: each scene with two frictions and paths."""
    for seed in range(scenes):
        rng = np.random.default_rng([4, seed])
        keys, number = _drawn(rng), int(rng.integers(1000))
        for _ in range(2):
            path = wander(rng, -3.0, 39.0, 10) if rng.random() < 0.6 else _insertion(rng)
            mu = float(rng.choice([0.0, rng.uniform(0.0, 0.9)], p=[0.15, 0.85]))
            scatter = Scatter(seed, *_kinds(rng)) if rng.random() < 0.4 else None
            own = keys | {"motion.displacements": path, "friction.options.coefficient": mu}
            yield Case("combined", own, scatter=scatter, numbering=number)


def _kinds(rng: np.random.Generator) -> tuple[tuple[float, float], bool, bool]:
    return (0.01, 0.9), bool(rng.random() < 0.5), bool(rng.random() < 0.5)


def _insertion(rng: np.random.Generator) -> tuple[float, ...]:
    steps = np.minimum(10 ** rng.uniform(-2.0, 1.5, 10), 30.0)
    path = np.cumsum(steps) - steps[0]
    return tuple(float(u) for u in path[path < 40.0])


def _drawn(rng: np.random.Generator) -> dict[str, object]:
    seat = float(rng.choice([1.0, 1.7, 2.0, 4.0]))
    ratio = float(rng.choice([1.0, 10 ** rng.uniform(-1.0, 1.0)]))
    decade = rng.uniform(-3.0, 3.0)
    keys = moduli(STEEL * min(1.0, 10**decade), STEEL * min(1.0, 10**-decade)) | {
        "mesh.order": int(rng.integers(1, 3)), "mesh.seat_facet": seat,
        "mesh.bore_facet": float(np.clip(seat * ratio, 0.4, 12.0)),
        "wheel.bore_radius": 60.0 - float(rng.uniform(0.0, 1.0)),
        "axle.taper_blend": float(rng.choice([0.0, 10.0, 70.0])),
        "wheel.chamfer_blend": float(rng.choice([0.0, 5.0, 50.0])),
        "axle.material.poisson_ratio": float(rng.choice([0.0, 0.3, 0.49, 0.4999])),
        "wheel.material.poisson_ratio": float(rng.choice([0.0, 0.3, 0.49, 0.4999])),
    }  # fmt: skip
    if rng.random() < 0.3:
        stiffness = 10.0 * STEEL * float(10 ** rng.uniform(-3.0, 3.0))
        return keys | {"contact.formulation": "penalty", "contact.penalty_stiffness": stiffness}
    theta = int(rng.choice([-1, 0, 1]))
    gamma0 = float(10 ** rng.uniform(1.5 if theta == 1 else -1.0, 4.0))
    return keys | {"contact.theta": theta, "contact.gamma0": gamma0}


FAMILIES: dict[str, tuple[str, Callable[[], Iterator[Case]]]] = {
    "friction": ("coefficient 0 to 0.9; theta -1, 0, 1", friction),
    "interference": ("0 to 1 mm on the radius", interference),
    "nitsche": ("gamma0 0.1 to 1e4; theta -1, 0, 1", nitsche),
    "penalty": ("stiffness over six decades", penalty),
    "stiffness": ("moduli of axle and wheel 1e-3 to 1e3", stiffness),
    "poisson": ("0 to 0.4999, of either body or both", poisson),
    "mesh ratio": ("bore over seat facets 0.1 to 10, matching or not; steps of whole facets or not", mesh_ratio),
    "increments": ("0.01 to 30 mm", increments),
    "substeps": ("0.005 and 0.03 mm back in 1, 10 and 60 increments", substeps),
    "corners": ("sharp to blended, and none", corners),
    "reversals": ("paths that turn every 1-4 increments of 0.01-10 mm", reversals),
    "random friction": ("each pair of tiles its own, jumps from 0.01 to 0.9; evolving", random_friction),
    "lost contact": ("on and off the seat at either end; discs that part and meet", lost_contact),
    "units": ("mm, m, cm, inch, um; N, kN, lbf, nN", units),
    "numbering": ("random numbers of points and triangles", numbering),
    "combined": ("all of them, drawn at random", combined),
}
"""Name, what varies, and the cases."""

MENDED = {
    "penalty": "contact that spread to the facet beyond the last near node was lost",
    "substeps": "stick forgot its traction from one increment to the next",
    "combined": "a single near node was an exception; Newton's method stopped on a broken law, or one kappa late",
}
"""What a family brought to light in the solver, and what was then mended there."""


def cases(name: str, keep: int = 1) -> Sequence[Case]:
    """Every ``keep``-th case of a family."""
    return list(FAMILIES[name][1]())[::keep]
