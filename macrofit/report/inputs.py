"""What pages share: their numbers, pictures and provenance; the section and every key, or the table of a study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from markupsafe import Markup

from ..base.progress import printable
from ..errors import MacrofitError
from ..scene import Scene
from .page import Numbers, inline, pictures

MOST_PICTURES, MOST_OF_STUDY = 900_000, 1_050_000
"""Bytes of all pictures, beside what the slider of a run needs; beside the table and the curves of a study."""
MOST_ROWS = 200
"""Runs in the table of a study, and curves in its overlay; all are in the files."""
NO_PROVENANCE: dict[str, Any] = {"date": "not recorded", "command": "not recorded", "scene_sha256": "not recorded",
                 "files_sha256": {}, "friction_digest": None}  # fmt: skip
"""What a run of an older version has."""


def computed(folder: Path, scene: Scene, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """What the template `computed.html` is filled with, of the numbers of a folder."""
    section, no_section = drawn_section(scene)
    return _of_all(folder, scene.title, numbers, MOST_PICTURES) | {
        "section": section,
        "no_section": no_section,
        "keys": list(keys_of(scene)),
    }


def studied(
    folder: Path, numbers: Mapping[str, Any], rows: Sequence[Any], columns: Mapping[str, Any], spread: Mapping[str, Any]
) -> dict[str, Any]:
    """What the template of any study is filled with: ``columns`` of each run, and the ``spread`` of all."""
    return _of_all(folder, numbers["title"], numbers, MOST_OF_STUDY) | {
        "rows": rows[:MOST_ROWS],
        "more": max(0, len(rows) - MOST_ROWS),
        "columns": columns,
        "keys": numbers["keys"],
        "statistics": {key: said for key, said in spread.items() if key in numbers["statistics"]},
    }


def _of_all(folder: Path, title: str, numbers: Mapping[str, Any], most: int) -> dict[str, Any]:
    shown, left_out = pictures(folder, most)
    return {
        "title": printable(title) or folder.resolve().name,
        "folder": printable(str(folder)),
        "number": Numbers(numbers),
        "numbers": numbers,
        "pictures": shown,
        "left_out": left_out,
        "provenance": NO_PROVENANCE | numbers.get("provenance", {}),
    }


def drawn_section(scene: Scene) -> tuple[Markup, str]:
    """The section drawn, or why it is not."""
    from ..figures.section import section

    try:
        return inline(section(scene)), ""
    except MacrofitError as error:
        return Markup(""), str(error)


def keys_of(scene: Scene) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """The tables of the scene, each with its keys and their values."""
    tables = msgspec.to_builtins(scene)
    plain = [(key, _said(value)) for key, value in tables.items() if not isinstance(value, dict) and key != "title"]
    yield "scene", plain
    for table, keys in tables.items():
        if isinstance(keys, dict):
            yield table, [(key, _said(value)) for key, value in _flat(keys, "")]


def _flat(tables: Mapping[str, Any], before: str) -> Iterator[tuple[str, Any]]:
    for key, value in tables.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        elif value is not None:
            yield f"{before}{key}", value


def _said(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        shown = ", ".join(_said(each) for each in value[:8])
        return f"{shown}, ... ({len(value)} in all)" if len(value) > 8 else shown
    return f"{value:.10g}" if isinstance(value, float) else printable(str(value))
