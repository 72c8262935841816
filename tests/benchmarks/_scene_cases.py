"""Scenes drawn by chance: a built-in or mesh scene of few facets with some keys of the schema overridden."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import inspect

from macrofit.base.toml import parse_toml
from macrofit.scene import Scene, build_scene, dump_scene, load_scene
from macrofit.scene.keys import Disc, Hub, MeshFile, Shaft

MESHES = Path(__file__).parents[2] / "meshes"
WHEELSET = ("mesh.seat_facet=8.0", "mesh.coarse=60", "motion.increment=20")
BASES: dict[str, tuple[str, ...]] = {
    "wheelset": WHEELSET,
    "wheelset-en": WHEELSET,
    "press-and-pull": WHEELSET[:2],
    "rough-hub": ("friction.provider=uniform", "mesh.seat_facet=1.0", "motion.increment=2"),
    "lame-rings": ("mesh.seat_facet=4.0", "mesh.coarse=10"),
    "long-fit": ("mesh.seat_facet=12.0",),
    "push-out": ("mesh.seat_facet=8.0",),
    "contact-patch": (),
    "hertz-sphere": ("mesh.seat_facet=0.04", "motion.increment=2.5e-5"),
    "meshes": (),
    "mesh-wheel": (),
}
"""Scenes, and what makes them small."""
FROM_FILES = {
    "meshes": '[mesh]\naxle = "axle.msh"\nwheel = "wheel.msh"\n',
    "mesh-wheel": '[mesh]\nwheel = "wheel.msh"\nseat_facet = 8.0\ncoarse = 60.0\n[axle]\nseat_radius = 95.0\n'
    "seat_length = 190.0\ntaper_length = 10.0\ntaper_height = 1.0\ntaper_blend = 150.0\ntail_length = 100.0\n",
}
"""The scenes with mesh files; both move alike."""
ODD = (
    "0", "-1", "1", "2", "-0.0", "1e-300", "1e300", "1e-9", "1e9", "1e-4", "1e4", "0.5", "nan", "inf", "-inf", "5e-324",
    "9223372036854775807", "-9223372036854775808", "1e-12", "1e5", "1e-2", "100", "0.49999999", "1e-6", "1e15",
    "true", '""', '"x"', "[]", "[1.0]", "[0.0, 1e-12]", "{}", '"a\\u0000b"', "[3.0, 2.0, 1.0]", "[-5.0, 250.0]",
    "1979-05-27", "nothing", "[", "12345678901234567890123", '"' + "ä" * 300 + '"', "[nan]", '[["x"]]',
)  # fmt: skip
"""Values that few would write, some of them right for one key and not for another."""
OPTIONS = {
    "uniform": ("coefficient=0.3", "coefficient=1.99", "coefficient=2", "coefficient=0"),
    "evolving": ('base="uniform"', "flat_coefficient=0.05", "work=1e3", "work=1e-300", "options={coefficient=0.2}"),
    "table": ('file="friction.csv"', 'file="axle.msh"', "coefficient=0.1"),
    "dem": ("micro_friction=9", "seed=-1"),
    "nobody": ("x=1",),
}
"""Providers, and options that they have or have not."""
UNLISTED = ("friction.provider", "mesh.axle", "mesh.wheel", "mesh.unit", "motion.displacements")
"""Keys that seldom take another value by itself, and those of a scene that lists its displacements."""
LISTED = (*UNLISTED[:-1], "motion.start", "motion.travel", "motion.increment")
MOST_INCREMENTS, MOST_FACETS, MOST_SIZES = 12, 150, 40


@dataclass(frozen=True)
class Case:
    """What a user would give: SCENE, and a `--set` each."""

    base: str
    overrides: tuple[str, ...]

    def source(self, folder: Path) -> str:
        """A built-in name, or a file in the folder of `write_files`."""
        return str(folder / f"{self.base}.toml") if self.base in FROM_FILES else self.base

    def __str__(self) -> str:
        """As words of a command."""
        return " ".join([self.base, *(f"--set {text!r:.200}" for text in self.overrides)])


def write_files(folder: Path) -> None:
    """The scenes with mesh files, and what they name."""
    for name in ("axle.msh", "wheel.msh"):
        shutil.copy(MESHES / name, folder)
    for name, text in FROM_FILES.items():
        (folder / f"{name}.toml").write_text(f"{text}[motion]\ntravel = 100.0\nincrement = 20.0\n")
    (folder / "friction.csv").write_text("z_mm,coefficient\n0,0.1\n200,0.2\n")


def drawn(seed: int, number: int, folder: Path) -> Case:
    """A case, the same for the same seed and number."""
    rng = np.random.default_rng([seed, number])
    base = str(rng.choice(list(BASES)))
    odd = 0.0 if rng.random() < 0.6 else 0.4
    changes = [changed(rng, base, folder, sane=bool(rng.random() >= odd)) for _ in range(rng.integers(1, 7))]
    return Case(base, (*BASES[base], *(text for some in changes for text in some)))


def changed(rng: np.random.Generator, base: str, folder: Path, *, sane: bool) -> list[str]:
    """Overrides of a key of the schema, or of the friction."""
    scene, kinds = start(base, folder)
    if rng.random() < 0.1:
        provider = str(rng.choice(list(OPTIONS)))
        least = len(OPTIONS[provider]) if sane or provider == "dem" else 0  # all of the plates', for they take long
        options = rng.choice(OPTIONS[provider], rng.integers(least, 1 + len(OPTIONS[provider])), replace=False)
        return [f"friction.provider={provider}", *(f"friction.options.{text}" for text in options)]
    if not sane and rng.random() < 0.1:
        name = rng.choice([field.name for shape in (Shaft, Hub, Disc) for field in msgspec.structs.fields(shape)])
        return [f"{rng.choice(['axle', 'wheel', 'scene'])}.{name}={rng.choice(ODD)}"]
    if not sane:
        return [f"{rng.choice(list(kinds))}={rng.choice(ODD)}"]
    listed = scene.motion.displacements is not None
    key = str(rng.choice([key for key in kinds if key not in (LISTED if listed else UNLISTED)]))
    return [f"{key}={sensible(rng, kinds[key], value_at(scene, key), scene.displacements)}"]


@cache
def start(base: str, folder: Path) -> tuple[Scene, dict[str, Any]]:
    """The scene that is changed, and the types of its keys by their dotted names."""
    scene = load_scene(Case(base, ()).source(folder), BASES[base])
    return scene, dict(keys_of(scene))


def keys_of(record: msgspec.Struct, place: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and types of the keys of a record and of those within it."""
    info = inspect.type_info(type(record))
    assert isinstance(info, inspect.StructType)
    for field in info.fields:
        value = getattr(record, field.name)
        if isinstance(value, msgspec.Struct):
            yield from keys_of(value, f"{place}{field.encode_name}.")
        elif field.encode_name != "options":
            yield f"{place}{field.encode_name}", field.type


def value_at(record: Any, key: str) -> Any:
    """The value at a dotted key."""
    for name in key.split("."):
        record = getattr(record, name)
    return record


def plain(kind: Any) -> Any:
    """A type without what is said about it and without None."""
    while isinstance(kind, inspect.Metadata | inspect.UnionType):
        kind = kind.type if isinstance(kind, inspect.Metadata) else kind.types[0]
    return kind


def sensible(rng: np.random.Generator, kind: Any, value: Any, places: tuple[float, ...]) -> str:
    """A value that a user might give, as TOML."""
    kind = plain(kind)
    if isinstance(kind, inspect.LiteralType):
        return str(rng.choice([str(choice) for choice in kind.values]))
    if isinstance(kind, inspect.BoolType):
        return str(rng.choice(["true", "false"]))
    if isinstance(kind, inspect.IntType):
        return str(rng.integers(0, 9))
    if isinstance(kind, inspect.FloatType):
        return repr(number(rng, value))
    if isinstance(kind, inspect.VarTupleType) and isinstance(plain(kind.item_type), inspect.LiteralType):
        return f"[{', '.join(repr(name) for name in rng.permutation(plain(kind.item_type).values).tolist()[:2])}]"
    if isinstance(kind, inspect.VarTupleType):
        low, high = min(places), max(places)
        return f"[{', '.join(f'{place!r}' for place in rng.uniform(low, high, rng.integers(1, 5)).tolist())}]"
    return "a title"


def number(rng: np.random.Generator, value: float | None) -> float:
    """A number near the one that is there, or one of a length that may be."""
    if value and rng.random() < 0.95:
        return float(value) * float(10 ** rng.normal(0.0, rng.choice([0.001, 0.02, 0.3], p=[0.5, 0.3, 0.2])))
    return float(f"{10 ** rng.uniform(-2.0, 2.3):.4g}")


def small(scene: Scene) -> Scene:
    """The scene with at most so many increments, facets and elements, where it has more."""
    places = scene.displacements
    if len(places) > MOST_INCREMENTS:
        kept = np.unique(np.linspace(0, len(places) - 1, MOST_INCREMENTS).round().astype(int))
        motion = msgspec.structs.replace(scene.motion, start=0.0, travel=0.0, increment=1.0)
        places = tuple(places[k] for k in kept)
        scene = msgspec.structs.replace(scene, motion=msgspec.structs.replace(motion, displacements=places))
    line, size = lengths(scene)
    if line > 0.0:
        mesh = scene.mesh
        facet = max(mesh.seat_facet, line / MOST_FACETS)
        bore = None if mesh.bore_facet is None else max(mesh.bore_facet, line / MOST_FACETS)
        corner = None if mesh.corner_facet is None else max(mesh.corner_facet, 0.1 * facet)
        sizes = {"seat_facet": facet, "bore_facet": bore, "corner_facet": corner}
        sizes |= {"coarse": max(mesh.coarse, size / MOST_SIZES), "growth": max(mesh.growth, 0.2)}
        scene = msgspec.structs.replace(scene, mesh=msgspec.structs.replace(mesh, **sizes))
    return build_scene(parse_toml(dump_scene(scene), "the small scene"))


def lengths(scene: Scene) -> tuple[float, float]:
    """Length of the longer contact line and size of the larger body as drawn [mm]; 0 for files."""
    lines, sizes = [0.0], [0.0]
    for body in (scene.axle, scene.wheel):
        if isinstance(body, Shaft):
            lines.append(body.seat_length + body.taper_length)
            sizes.append(body.seat_length + body.taper_length + body.tail_length + body.lead_length + body.seat_radius)
        elif isinstance(body, Hub):
            lines.append(body.hub_length)
            sizes.append(body.hub_length + max(body.hub_outer_radius, body.rim_outer_radius) - body.bore_radius)
        elif isinstance(body, Disc):
            lines.append(body.radius if body.contact_radius is None else body.contact_radius)
            sizes.append(body.radius + body.thickness)
        else:
            assert isinstance(body, MeshFile)
    return max(lines), max(sizes)
