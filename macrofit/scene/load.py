"""Scenes: read strictly from TOML, changed by overrides, checked across their keys, written back.

This is the only reader of TOML in the package; the tables themselves are in ``scene_keys``.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from ..errors import SceneError
from .checks import check
from .keys import ContactKeys, Disc, Drawn, FrictionKeys, Hub, Keys, MeshKeys, Motion, OutputKeys, Scene, Shaft
from .material import Material
from .refine import refined

PROVIDER, PRESET = "friction.provider", "preset"


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
    raw, folder = _read(source)
    parts = [(text.partition("=")[0].strip(), text) for text in overrides]
    named = [text.partition("=")[2].strip() for key, text in parts if key == PRESET]
    for name in named[-1:] or ([] if preset is None else [preset]):
        raw = refined(raw, name)
    for _, override in sorted((part for part in parts if part[0] != PRESET), key=lambda part: part[0] != PROVIDER):
        _override(raw, override)
    return build_scene(raw, folder)


def build_scene(raw: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Decode and check the tables of a scene; mesh files and tables of friction are looked for beside ``folder``."""
    tables = {key: dict(value) if isinstance(value, Mapping) else value for key, value in raw.items()}
    _name_shapes(tables, folder)
    if isinstance(tables.get("friction"), dict):
        tables["friction"] = _place_tables(tables["friction"], "provider", folder or Path())
    try:
        scene = msgspec.convert(tables, Scene)
    except msgspec.ValidationError as error:
        raise SceneError(_one_line(error, tables)) from None
    _check_numbers(msgspec.to_builtins(scene), "")
    check(scene)
    return scene


def dump_scene(scene: Scene) -> str:
    """The scene as TOML, every default written out; ``load_scene`` reads it back to the same scene."""
    tables = msgspec.to_builtins(scene)
    for body in ("axle", "wheel"):
        if tables[body].get("shape") == "mesh":
            tables[body].pop("shape")
    return "\n".join(_toml_lines(tables, ())) + "\n"


def json_schema() -> dict[str, Any]:
    """JSON schema of a scene, for editors."""
    return msgspec.json.schema(Scene)


def _read(source: str | Path) -> tuple[dict[str, Any], Path | None]:
    name = str(source)
    folder: Path | None = None
    if name in scene_names():
        text = (resources.files("macrofit.scene") / "library" / f"{name}.toml").read_text()
    else:
        path = Path(source)
        if not path.is_file():
            known = ", ".join(scene_names())
            raise SceneError(f"no scene '{name}': neither a file nor one of the built-in scenes ({known})")
        try:
            text, folder = path.read_text(encoding="utf-8"), path.parent
        except (OSError, UnicodeDecodeError) as error:
            raise SceneError(f"{name}: cannot be read as text: {error}") from None
    try:
        return tomllib.loads(text), folder
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{name}: not valid TOML: {error}") from None


def _override(raw: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals or not key.strip():
        raise SceneError(f"'{override}': an override is written key=value, for example motion.travel=20")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value
    *path, last = key.strip().split(".")
    table = raw
    for part in path:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SceneError(f"{key}: '{part}' is not a table")
    if key.strip() == PROVIDER and table.get(last, "uniform") != parsed:
        table.pop("options", None)
    table[last] = parsed


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
_SHAPES: dict[str, type[Keys]] = {"shaft": Shaft, "wheel": Hub, "disc": Disc, "mesh": Drawn}


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
        known = _known_keys(where, tables)
        close = difflib.get_close_matches(key, known, n=1)
        remedy = f"did you mean '{close[0]}'?" if close else f"known keys: {', '.join(known)}"
        return f"{_join(where, key)}: unknown key ({remedy})"
    if missing:
        return f"{_join(where, missing.group(1))}: missing"
    if "Invalid value" in message and where.endswith(".shape"):
        return f"{where}: {message} (try shaft, wheel or disc; a mesh file goes under [mesh])"
    return f"{where or 'scene'}: {message[0].lower()}{message[1:]}"


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


def _toml_lines(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [
        f"{key} = {_toml_value(value)}"
        for key, value in table.items()
        if value is not None and not isinstance(value, Mapping)
    ]
    for key, value in table.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{'.'.join((*path, key))}]", *_toml_lines(value, (*path, key))]
    return lines


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
    if isinstance(value, str):
        return msgspec.json.encode(value).decode()
    return repr(value)
