"""Write a scene to begin with: the drawings of this folder, with the meaning and unit of every key from the schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ..base.files import replacing, write_text
from ..base.toml import dump_toml, parse_toml
from ..errors import OutputError

SHAPES = {"axle": "Shaft", "wheel": "Hub"}
FIRST = ("motion", "friction", "mesh")
"""The tables that come first after the bodies; the others as the schema has them."""
WIDTH = 110
"""Characters of a line of a comment."""
HEAD = """\
{title}

Lengths in mm, forces in N (of the full ring), moduli in MPa. A key behind a # is not set: it stands there with its \
default, `...` where that follows from others. What to do with it:

    macrofit check {file} -o section.svg    the drawing with every key on it
    macrofit run {file}                     the fitting curve and the stresses
"""
REFINED = "    macrofit converge {file}                how exact they are\n"
"""What meshes from files cannot have."""


def write_draft(kind: str, target: Path) -> list[Path]:
    """Write the draft of a kind, and for `meshes` two mesh files beside it; gives what was written.

    Raises:
        OutputError: one of the files is there already, or cannot be written.
    """
    meshes = {body: target.with_name(f"{target.stem}-{body}.msh") for body in ("axle", "wheel")}
    files = [target, *(meshes.values() if kind == "meshes" else ())]
    for file in files:
        if file.exists() or file.is_symlink():
            raise OutputError(f"{file}: is there already, and is not overwritten; choose another name with -o")
    tables = drawing(kind)
    if kind == "meshes":
        write_meshes(meshes)
        tables["mesh"] |= {body: file.name for body, file in meshes.items()}
    write_text(target, draft(tables, target.name))
    return files


def drawing(kind: str) -> dict[str, Any]:
    """The tables of a draft as they stand in this folder."""
    return parse_toml((resources.files("macrofit.drafts") / f"{kind}.toml").read_text(), kind)


def draft(tables: Mapping[str, Any], name: str) -> str:
    """The tables as a scene in which every key has its meaning, its unit and, where it is not set, its default."""
    from ..scene import json_schema

    schema = json_schema()["$defs"]
    from_files = bool(tables["mesh"].get("axle"))
    shapes = dict.fromkeys(SHAPES, "MeshFile") if from_files else SHAPES
    head = (HEAD + ("" if from_files else REFINED)).format(title=tables["title"], file=name)
    lines = [*_comment(head), dump_toml({"title": tables["title"]}).rstrip()]
    for body, shape in shapes.items():
        lines += _table(body, schema[shape], tables[body])
        lines += _table(f"{body}.material", schema["Material"], {})
    others = {key: str(known["$ref"]) for key, known in schema["Scene"]["properties"].items() if "$ref" in known}
    for table in dict.fromkeys((*FIRST, *others)):
        lines += _table(table, schema[others[table].rpartition("/")[2]], tables.get(table, {}))
        if table == "friction":
            options = dump_toml(tables[table]["options"]).rstrip()
            lines += ["", "[friction.options]", "# Coefficient of friction mu [-].", options]
    return "\n".join(lines) + "\n"


def _table(name: str, record: Mapping[str, Any], given: Mapping[str, Any]) -> Iterator[str]:
    """A table of keys, each behind what it means; those that are not given behind a #."""
    yield ""
    yield from _comment(record.get("description", "").partition("\n\n")[0])
    yield f"[{name}]"
    for key, known in record["properties"].items():
        default = known.get("default")
        if key in ("shape", "options") or isinstance(default, dict):
            continue
        yield from _comment(known.get("description", "") + _choices(known))
        if key in given:
            yield dump_toml({key: given[key]}).rstrip()
        else:
            yield f"# {key} = ..." if default is None else f"# {_one_line({key: default})}"


def _choices(known: Mapping[str, Any]) -> str:
    """The values that a key may have, as a sentence; none where it may have any."""
    kinds = (known, *known.get("anyOf", ()))
    values = [str(value) for kind in kinds for value in kind.get("enum", ()) if value is not None]
    return f" One of {', '.join(values)}." if values else ""


def _one_line(table: Mapping[str, Any]) -> str:
    """A key and its value, a list too on one line."""
    ((key, value),) = table.items()
    if isinstance(value, list | tuple):
        return f"{key} = [{', '.join(dump_toml({'x': each}).strip().removeprefix('x = ') for each in value)}]"
    return dump_toml(table).rstrip()


def _comment(text: str) -> Iterator[str]:
    """A text as comment lines that are not too long; lines that are indented stay as they are."""
    import textwrap

    for line in text.splitlines():
        parts = [line] if line.startswith("    ") else textwrap.wrap(line, WIDTH) or [""]
        yield from (f"# {part}".rstrip() for part in parts)


def write_meshes(files: Mapping[str, Path]) -> None:
    """The bodies of the draft `wheel` as gmsh files with the boundaries that a scene asks for.

    Raises:
        OutputError: a file cannot be written.
    """
    import meshio

    from ..bodies.geometry import Sizes, draw_body
    from ..bodies.mesh import mesh_drawing
    from ..scene import build_scene

    scene = build_scene(drawing("wheel"))
    for body, contact in (("axle", "seat"), ("wheel", "bore")):
        shape = scene.axle if body == "axle" else scene.wheel
        data = mesh_drawing(
            draw_body(shape, contact, Sizes.of(scene.mesh, contact)), scene.mesh.coarse, scene.mesh.growth
        )
        names, whole = list(data.edges), len(data.edges) + 1
        numbers = [np.full(len(data.edges[name]), k + 1) for k, name in enumerate(names)]
        tags = [np.concatenate(numbers), np.full(len(data.triangles), whole)]
        mesh = meshio.Mesh(
            np.column_stack([data.points, np.zeros(len(data.points))]),
            [("line", np.concatenate(list(data.edges.values()))), ("triangle", data.triangles)],
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={name: np.array([k + 1, 1]) for k, name in enumerate(names)} | {body: np.array([whole, 2])},
        )
        with replacing(files[body]) as place:
            meshio.write(place, mesh, file_format="gmsh22", binary=False)
