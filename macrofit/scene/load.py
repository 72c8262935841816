"""Scenes: read strictly from TOML, changed by overrides, checked across their keys, written back.

The tables themselves are in ``keys``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from ..base.toml import dump_toml, errors_as, parse_toml, read_toml, set_key, split_override, unknown_key
from ..errors import SceneError
from .checks import check_scene
from .keys import ContactKeys, Disc, FrictionKeys, Hub, Keys, MeshFile, MeshKeys, Motion, OutputKeys, Scene, Shaft
from .material import Material
from .refine import refined

PROVIDER, PRESET = ("friction", "provider"), ("preset",)


def scene_names() -> list[str]:
    """Names of the scenes shipped with the package."""
    folder = resources.files("macrofit.scene") / "library"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_scene(source: str | Path, overrides: Iterable[str] = (), preset: str | None = None) -> Scene:
    """Read a scene: a built-in name or a TOML file, changed by ``key=value`` overrides (dotted keys).

    A ``preset`` (see `presets`), which an override ``preset=name`` names too, scales the mesh sizes that the scene has
    before any override changes them. Another friction provider starts without the options of the one it replaces,
    wherever in the order it is named. Raises SceneError with one line that names the key.
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
                _drop_options(raw, value)
            set_key(raw, path, value)
    return build_scene(raw, folder)


def _drop_options(raw: Mapping[str, Any], provider: Any) -> None:
    """Take away the options of another provider than this one."""
    friction = raw.get("friction")
    if isinstance(friction, dict) and friction.get("provider", "uniform") != provider:
        friction.pop("options", None)


def build_scene(raw: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Decode and check the tables of a scene; mesh files and tables of friction are looked for beside ``folder``."""
    tables = {key: dict(value) if isinstance(value, Mapping) else value for key, value in raw.items()}
    _name_shapes(tables, folder)
    if isinstance(tables.get("friction"), dict):
        tables["friction"] = _place_tables(tables["friction"], "provider", folder or Path())
    _check_numbers(tables, "")
    try:
        scene = msgspec.convert(tables, Scene)
    except msgspec.ValidationError as error:
        raise SceneError(_one_line(error, tables)) from None
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
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A scene of macrofit", **schema}


def _read(source: str | Path) -> tuple[dict[str, Any], Path | None]:
    name = str(source)
    if name in scene_names():
        return parse_toml((resources.files("macrofit.scene") / "library" / f"{name}.toml").read_text(), name), None
    path = Path(source)
    if not path.is_file():
        known = ", ".join(scene_names())
        raise SceneError(f"no scene '{name}': neither a file nor one of the built-in scenes ({known})")
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


def _place_tables(friction: Mapping[str, Any], named: str, folder: Path) -> dict[str, Any]:
    """The table [friction] with the path of a table's file made absolute, also where another provider wraps it."""
    placed = dict(friction)
    options = placed.get("options")
    if isinstance(options, Mapping):
        if placed.get(named) == "table" and isinstance(options.get("file"), str):
            options = {**options, "file": str((folder / options["file"]).resolve())}
        placed["options"] = _place_tables(options, "base", folder)
    return placed


_FIELDS: dict[str, type[Keys]] = {
    "": Scene,
    "mesh": MeshKeys,
    "contact": ContactKeys,
    "motion": Motion,
    "friction": FrictionKeys,
    "output": OutputKeys,
}
_SHAPES: dict[str, type[Keys]] = {"shaft": Shaft, "wheel": Hub, "disc": Disc, "mesh": MeshFile}


def _one_line(error: msgspec.ValidationError, tables: Mapping[str, Any]) -> str:
    """Turn msgspec's message into 'table.key: what is wrong (what to try)'."""
    message, _, place = str(error).partition(" - at `$")
    where = place.rstrip("`").lstrip(".").replace("[...]", "")
    unknown = re.search(r"unknown field `(.+)`", message)
    missing = re.search(r"missing required field `(.+)`", message)
    if unknown:
        key = unknown.group(1)
        if where in ("axle", "wheel") and tables[where].get("shape") == "mesh":
            return f"{_join(where, key)}: not used where mesh.{where} gives a file; leave one of them out"
        return unknown_key(_join(where, key), _known_keys(where, tables))
    if missing:
        return f"{_join(where, missing.group(1))}: missing"
    if "Invalid value" in message and where.endswith(".shape"):
        return f"{where}: {message} (try shaft, wheel or disc; a mesh file goes under [mesh])"
    bound = re.fullmatch(r"Expected `\w+` (>=?|<=?) (\S+)", message)
    if bound:
        return f"{where}: {_value_at(tables, where)} must {_bound(*bound.groups())}"
    if "of length >= 1" in message:
        return f"{where}: is empty"
    return f"{where or 'scene'}: {message[0].lower()}{message[1:]}"


_BOUNDS = {">": "be above", ">=": "not be below", "<": "be below", "<=": "not exceed"}


def _bound(sign: str, limit: str) -> str:
    """What a value must do, after "must"."""
    if float(limit) == 0.0 and sign in (">", ">="):
        return "be positive" if sign == ">" else "not be negative"
    return f"{_BOUNDS[sign]} {float(limit):g}"


def _value_at(tables: Mapping[str, Any], where: str) -> Any:
    value: Any = tables
    for key in where.split("."):
        value = value[key]
    return value


def _known_keys(where: str, tables: Mapping[str, Any]) -> list[str]:
    struct: type[Any] | None = _FIELDS.get(where)
    if where.endswith(".material"):
        struct = Material
    elif where in ("axle", "wheel"):
        struct = _SHAPES.get(tables[where].get("shape", ""))
    return [] if struct is None else list(struct.__struct_fields__)


def _join(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _check_numbers(value: Any, where: str) -> None:
    """No NaN or infinity anywhere."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            _check_numbers(item, _join(where, key))
    elif isinstance(value, list | tuple):
        for item in value:
            _check_numbers(item, where)
    elif isinstance(value, float) and not math.isfinite(value):
        raise SceneError(f"{where}: {value} is not a finite number")
