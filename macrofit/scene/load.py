"""Scenes: read strictly from TOML, changed by overrides, checked across their keys, written back.

The tables themselves are in ``keys``.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from ..base.errors import nearest
from ..base.files import placed_names
from ..base.keys import KeyMistake, decode_tables
from ..base.toml import dump_toml, errors_as, parse_toml, read_toml, set_key, split_override
from ..errors import SceneError
from .checks import check_scene
from .keys import AXLE_TEMPERATURE, Scene
from .refine import refined

PROVIDER, OPTIONS, PRESET = ("friction", "provider"), ("friction", "options"), ("preset",)


def scene_names() -> list[str]:
    """Names of the scenes shipped with the package."""
    folder = resources.files("macrofit.scene") / "library"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_scene(source: str | Path, overrides: Iterable[str] = (), preset: str | None = None) -> Scene:
    """Read a scene: a built-in name or a TOML file, changed by ``key=value`` overrides (dotted keys).

    A ``preset`` (see `presets`), which an override ``preset=name`` names too, scales the mesh sizes that the scene has
    before any override changes them. Another friction provider starts without the options of the one it replaces,
    wherever in the order it is named; a warning names those that no other override sets.

    Raises:
        SceneError: one line that names the key.
    """
    with errors_as(SceneError):
        raw, folder = _read(source)
        changes = [split_override(text) for text in overrides]
        named = [value for path, value in changes if path == PRESET]
        for name in named[-1:] or ([] if preset is None else [preset]):
            raw = refined(raw, str(name))
        others = [change for change in changes if change[0] != PRESET]
        for path, value in sorted(others, key=lambda change: change[0] != PROVIDER):
            if path == PROVIDER:
                _drop_options(raw, value, {path[:3] for path, _ in others})
            set_key(raw, path, value)
    return build_scene(raw, folder)


def _drop_options(raw: Mapping[str, Any], provider: Any, changed: AbstractSet[tuple[str, ...]]) -> None:
    """Take away the options of another provider than this one, and name them; those of uniform friction are its own."""
    friction = raw.get("friction")
    if not isinstance(friction, dict) or friction.get("provider", "uniform") == provider:
        return
    before = friction.get("provider", "uniform")
    options = friction.pop("options", None)
    given = options.items() if isinstance(options, Mapping) and OPTIONS not in changed else ()
    lost = [f"{key} = {value!r}" for key, value in given if (*OPTIONS, key) not in changed]
    if lost and "uniform" not in (before, provider):
        warnings.warn(
            f"friction.provider = {provider!r} starts without the options of {before!r}: "
            f"set again with --set friction.options.KEY=... what is meant of {', '.join(lost)}",
            stacklevel=3,
        )


def build_scene(raw: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Decode and check the tables of a scene; the files that it names are looked for beside ``folder``."""
    tables = {key: dict(value) if isinstance(value, Mapping) else value for key, value in raw.items()}
    _name_shapes(tables, folder)
    _place_profiles(tables, folder or Path())
    if isinstance(tables.get("friction"), dict):
        tables["friction"] = _place_tables(tables["friction"], "provider", folder or Path())
    try:
        scene = decode_tables(tables, Scene, "scene")
    except KeyMistake as error:
        raise SceneError(_advice(str(error), tables)) from None
    check_scene(scene)
    return scene


def dump_scene(scene: Scene) -> str:
    """The scene as TOML, every default written out; ``load_scene`` reads it back to the same scene."""
    tables = msgspec.to_builtins(scene)
    for body in ("axle", "wheel"):
        if tables[body].get("shape") == "mesh":
            tables[body].pop("shape")
    return dump_toml(tables)


def json_schema() -> dict[str, Any]:
    """JSON schema of a scene, for editors: every key with its meaning, its unit and its bounds."""
    schema = msgspec.json.schema(Scene)
    for table in schema["$defs"].values():
        if "shape" in table["properties"]:  # the tag of the bodies, which may be left out
            table["properties"]["shape"]["description"] = "Shape of the body; left out: shaft, wheel, or a mesh file."
            table["required"] = [key for key in table["required"] if key != "shape"]
        if "law" in table["properties"]:  # the tag of the ways of hardening
            table["properties"]["law"]["description"] = "How the steel hardens."
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A scene of macrofit", **schema}


def _read(source: str | Path) -> tuple[dict[str, Any], Path | None]:
    name = str(source)
    if name in scene_names():
        return parse_toml((resources.files("macrofit.scene") / "library" / f"{name}.toml").read_text(), name), None
    path = Path(source)
    if not path.exists():
        remedy = nearest(name, scene_names(), "which are", also=map(str, path.parent.glob("*.toml")))
        raise SceneError(f"no scene '{name}': neither a file nor one of the built-in scenes ({remedy})")
    return read_toml(path), path.parent


def _name_shapes(tables: dict[str, Any], folder: Path | None) -> None:
    """Give each body the tag of its shape, and make the mesh files' paths absolute."""
    mesh = tables.get("mesh")
    for body, default in (("axle", "shaft"), ("wheel", "wheel")):
        file = mesh.get(body) if isinstance(mesh, dict) else None
        file = file if isinstance(file, str) else None
        if file is not None and isinstance(mesh, dict):
            tables.setdefault(body, {})
            if folder is not None:
                mesh[body] = str((folder / file).resolve())
        if isinstance(tables.get(body), dict):
            if file is not None and tables[body].get("shape", "mesh") != "mesh":
                raise SceneError(f"{body}.shape: not used where mesh.{body} gives a file; leave one of them out")
            tables[body].setdefault("shape", default if file is None else "mesh")


def _place_profiles(tables: Mapping[str, Any], folder: Path) -> None:
    """Make the paths of measured profiles absolute."""
    for body in ("axle", "wheel"):
        keys = tables.get(body)
        if isinstance(keys, dict) and isinstance(keys.get("profile"), str):
            keys["profile"] = str((folder / keys["profile"]).resolve())


def _place_tables(friction: Mapping[str, Any], named: str, folder: Path) -> dict[str, Any]:
    """The table [friction] with the paths of its files made absolute, also where another provider wraps it.

    They are a table's file, and the measured faces of axle and bore.
    """
    placed = dict(friction)
    options = placed.get("options")
    if isinstance(options, Mapping):
        if placed.get(named) == "table" and isinstance(options.get("file"), str):
            options = {**options, "file": str((folder / options["file"]).resolve())}
        surface = options.get("surface")
        if isinstance(surface, Mapping):
            faces = {key: placed_names(value, folder) for key, value in surface.items() if key in ("axle", "bore")}
            options = {**options, "surface": {**surface, **faces}}
        placed["options"] = _place_tables(options, "base", folder)
    return placed


def _advice(said: str, tables: Mapping[str, Any]) -> str:
    """What is wrong with a key, and what to try where the shape of a body is concerned."""
    body, _, key = said.partition(": ")[0].partition(".")
    if body not in ("axle", "wheel"):
        return said
    if key == "shape" and "nvalid value" in said:
        return f"{said.partition(' (one of')[0]} (try shaft, wheel or disc; a mesh file goes under [mesh])"
    if (body, key) == ("axle", "temperature"):
        return AXLE_TEMPERATURE
    if ": unknown key" in said and tables[body].get("shape") == "mesh":
        return f"{body}.{key}: not used where mesh.{body} gives a file; leave one of them out"
    return said
