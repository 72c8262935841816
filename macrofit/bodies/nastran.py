"""Decks of Nastran as meshio reads them: boundaries are line elements, named by comments on their properties.

The bulk data have numbers alone; names are in comments of the programs that wrote them, or of the user.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MeshError

SUFFIXES = (".bdf", ".fem", ".nas")
"""Endings of the names of such files."""

NAMES = re.compile(
    r'^\$(?:HMNAME\s+(?:COMP|PROP)\s+(?P<hm>\d+)\s*"(?P<hm_name>[^"\n]+)"'
    r"|\s*Femap(?: with NX Nastran)? Property (?P<femap>\d+) : (?P<femap_name>.+)"
    r"|ANSA_NAME_COMMENT;(?P<ansa>\d+);P\w+;(?P<ansa_name>[^;\n]+);"
    r"|\s*(?P<own_name>\w+)\s*=\s*(?P<own>\d+)\s*$)",
    re.MULTILINE,
)
"""Comments that name a property: of HyperMesh, Femap and ANSA, and `$ bore = 2`."""


def check_whole(file: Path) -> None:
    """A deck ends with ENDDATA.

    Raises:
        ValueError: it does not.
    """
    if file.suffix.lower() in SUFFIXES and not re.search(rb"^ENDDATA", file.read_bytes(), re.MULTILINE):
        raise ValueError("it has no ENDDATA; is it cut off? if not, write ENDDATA at its end")


def name_properties(file: Path, mesh: Any, where: str) -> None:
    """Make physical groups of the properties of line elements that a comment names; other files are left alone.

    Raises:
        MeshError: none is named, or there are no line elements; what to write.
    """
    if file.suffix.lower() not in SUFFIXES:
        return
    kinds = [block.type for block in mesh.cells]
    if "line" not in kinds:
        raise MeshError(
            f"{where} has no line elements; lay CBAR elements along its boundaries, a property for each, and name it "
            f"in a comment such as '$ bore = 2'"
        )
    properties = mesh.cell_data.get("nastran:ref", [])
    if [len(each) for each in properties] != [len(block.data) for block in mesh.cells]:
        raise MeshError(f"{where} has elements without a property; give every element one")
    named = {}
    for found in NAMES.finditer(file.read_text("latin-1")):
        for kind in ("hm", "femap", "ansa", "own"):
            if found[kind]:
                named[found[f"{kind}_name"].strip()] = np.array([int(found[kind]), 1])
    used = np.unique(np.concatenate([each for each, kind in zip(properties, kinds, strict=True) if kind == "line"]))
    if not any(number[0] in used for number in named.values()):
        numbers = ", ".join(map(str, used[:6])) + (", ..." if len(used) > 6 else "")
        raise MeshError(
            f"{where} names no boundary; name the properties of its line elements ({numbers}) in comments, a line "
            f"such as '$ bore = {used[0]}' for each"
        )
    mesh.field_data = {**mesh.field_data, **named}
    mesh.cell_data["gmsh:physical"] = properties
