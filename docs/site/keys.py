"""Writes docs/keys.md: every key of a scene, of the providers and of the plates, from the records that read them.

python docs/site/keys.py
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from macrofit.friction.evolving import Evolving
from macrofit.friction.table import Table
from macrofit.friction.uniform import Uniform
from macrofit.scene import json_schema
from meso.provider import DirectDem
from meso.settings import Settings
from surrogate.provider import Surrogate

PAGE = Path(__file__).resolve().parents[1] / "keys.md"
HEAD = """\
# Every key

<!-- written by `python docs/site/keys.py`; do not edit -->

This page is made from the records that read the keys, so that defaults, units and bounds are those of the program.
`macrofit schema` prints the same of a scene as a JSON schema, which editors use to complete and to check.
An empty default means that the key must be given; `-` that it is unset, and the text says what happens then.
A wrong key ends in one line that names it, and exit code 2.
"""
TABLES = {
    "Scene": "Top of the file", "Shaft": "`[axle]`", "Hub": "`[wheel]`", "Disc": "`[axle]` or `[wheel]`",
    "MeshFile": "`[axle]` or `[wheel]`", "Motion": "`[motion]`", "MeshKeys": "`[mesh]`", "ContactKeys": "`[contact]`",
    "FrictionKeys": "`[friction]`", "OutputKeys": "`[output]`", "ServiceKeys": "`[service]`",
    "Material": "`[axle.material]`, `[wheel.material]`",
    "LinearHardening": '`hardening`, law `"linear"`', "VoceHardening": '`hardening`, law `"voce"`',
    "ChabocheHardening": '`hardening`, law `"chaboche"`', "TabulatedHardening": '`hardening`, law `"table"`',
}  # fmt: skip
PROVIDERS = {"uniform": Uniform, "surrogate": Surrogate, "dem": DirectDem, "table": Table, "evolving": Evolving}
PLATES = {
    "SurfaceKeys": "surface", "ScanKeys": "surface.axle]`, `[surface.bore", "PlateKeys": "plates",
    "Material": "material", "Beams": "beams",
    "ContactKeys": "contact", "LoadKeys": "load", "EngineKeys": "engine", "Breakage": "engine.breakage",
}  # fmt: skip
SIGNS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def page() -> str:
    """The page as it should stand in docs/keys.md."""
    scene, plates = json_schema()["$defs"], msgspec.json.schema(Settings)["$defs"]
    lines = [HEAD, "## A scene\n"]
    for name, where in TABLES.items():
        shape = scene[name]["properties"].get("shape", {}).get("enum", [""])[0]
        lines += section(f"{where}: `{shape}`" if shape else where, scene[name], {})
    lines.append("## Providers of friction\n")
    for name, kind in PROVIDERS.items():
        record = msgspec.json.schema(kind)["$defs"][kind.__name__]
        lines += section(f"Options of `{name}`", record, field_docs(kind))
    lines.append("## Settings of the plates\n\nKeys of `macrofit-meso`, and of the tables of the provider `dem`.\n")
    for name, where in PLATES.items():
        lines += section(f"Plates: `[{where}]`", plates[name], {})
    return "\n".join(lines).rstrip() + "\n"


def section(title: str, record: Mapping[str, Any], more: Mapping[str, str]) -> Iterator[str]:
    """One table of keys under its title."""
    first = " ".join(record.get("description", "").partition("\n\n")[0].split())
    yield f"### {title}\n\n{first}\n\n| key | default | values | meaning |\n|---|---|---|---|"
    required = record.get("required", ())
    for key, known in record["properties"].items():
        meaning = known.get("description") or more.get(key) or f"Keys of the plates' table `[{key}]`, below."
        meaning = " ".join(meaning.split()).replace("|", "\\|").replace("] [", "] \\[")
        yield f"| `{key}` | {default(key, known, required)} | {values(known)} | {meaning} |"
    yield ""


def default(key: str, known: Mapping[str, Any], required: Any) -> str:
    """What holds where the key is left out."""
    if key in required:
        return ""
    value = known.get("default")
    if value is None:
        return "-"
    if isinstance(value, dict):
        return "see its table" if value else "`{}`"
    return f"`{msgspec.json.encode(value).decode()}`"


def values(known: Mapping[str, Any]) -> str:
    """What the key may be: type and bounds, or the names to choose from."""
    kinds = [kind for kind in known.get("anyOf", [known]) if kind.get("type") != "null" and kind.get("enum") != [None]]
    return ", or ".join(dict.fromkeys(filter(None, map(one_kind, kinds))))


def one_kind(known: Mapping[str, Any]) -> str:
    """One of the types of a key."""
    if "enum" in known:
        return ", ".join(f"`{value}`" for value in known["enum"] if value is not None)
    if "$ref" in known or "discriminator" in known:
        return "a table"
    if known.get("type") in ("array", "object"):
        inner = known.get("items") or {}
        return "a table" if known["type"] == "object" else f"a list of {one_kind(inner) or 'values'}"
    word = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"}
    bounds = [f"{sign} {known[name]:g}" for name, sign in SIGNS.items() if name in known]
    return " ".join([word.get(known.get("type", ""), ""), ", ".join(bounds)]).strip()


def field_docs(kind: type) -> dict[str, str]:
    """The docstrings that stand below the fields of a record."""
    (record,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(record, ast.ClassDef)
    found = {}
    for field, text in zip(record.body, record.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
            words = ast.literal_eval(text.value) if isinstance(text.value, ast.Constant) else ""
            found[field.target.id] = re.sub(r"``", "`", str(words))
    return found


if __name__ == "__main__":
    PAGE.write_text(page())
