"""The inputs of a page: the section to scale, and every key of the scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
from markupsafe import Markup

from ..base.progress import printable
from ..errors import MacrofitError
from ..scene import Scene
from .page import inline


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
