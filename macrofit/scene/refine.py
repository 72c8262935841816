"""What a preset does to the mesh sizes of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from ..errors import SceneError
from ..presets import PRESETS
from .keys import MeshKeys


def refined(tables: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The tables of a scene with [mesh] as a preset has it; what they say wrongly is left for the scene's checks.

    Discs keep one size all along the line: their whole contact line may be an arc.

    Raises:
        SceneError: no such preset, or nothing it could do because the meshes come from files.
    """
    if name not in PRESETS:
        raise SceneError(f"no preset '{name}'; there are {', '.join(PRESETS)}")
    preset = PRESETS[name]
    try:
        keys = msgspec.convert(tables.get("mesh", {}), MeshKeys)
    except msgspec.ValidationError:
        return dict(tables)
    if keys.axle is not None and keys.wheel is not None:
        raise SceneError(f"mesh.axle, mesh.wheel: the preset '{name}' cannot refine meshes from files; leave it out")
    sizes = {"seat_facet": preset.facet * keys.seat_facet, "growth": preset.growth * keys.growth}
    if keys.bore_facet is not None:
        sizes["bore_facet"] = preset.facet * keys.bore_facet
    discs = any(isinstance(body := tables.get(b), Mapping) and body.get("shape") == "disc" for b in ("axle", "wheel"))
    if keys.corner_facet is not None:
        sizes["corner_facet"] = preset.corner / PRESETS["balanced"].corner * keys.corner_facet
    elif not discs:
        sizes["corner_facet"] = preset.corner * keys.seat_facet
    return {**tables, "mesh": {**tables.get("mesh", {}), **sizes}}
