"""What measured faces are made of, in numbers: the files, what was done to them, and which part of them a tile has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from ..measured.clean import lay
from ..measured.keys import ScanKeys
from ..settings import FaceKeys
from .filtered import CUTOFF, filtered
from .measured import as_surface, is_strip, laid_pieces, scan_of
from .roughness import measure
from .surface import Body, Surface

KEY: dict[Body, str] = {"axle": "axle", "wheel": "bore"}
"""What the options call the face of a body."""


def measured_origin(keys: FaceKeys, seed: int, counts: Mapping[Body, int], width: float) -> dict[str, Any]:
    """What the measured faces of both bodies are made of; a face that is generated is left out.

    Args:
        keys: how faces are made.
        seed: of a run, which draws the pieces of patches.
        counts: tiles of each body.
        width: of a tile, and its length [mm].

    Raises:
        SurfaceError: a file that cannot be used.
    """
    found: dict[str, Any] = {}
    for body, count in counts.items():
        scan = keys.measured(body)
        if scan is None:
            continue
        found[KEY[body]] = {"files": scan_numbers(scan)}
        if is_strip(scan, width):
            found[KEY[body]]["tile_0_at_mm"] = 0.0
        else:
            found[KEY[body]]["pieces"] = [
                {"from_mm": start, "patch": piece.which, "at_mm": piece.place, "reflected": piece.flipped}
                for start, piece in laid_pieces(scan, body, seed, (count * width, width))
            ]
    return found


def roughness_numbers(surface: Surface) -> dict[str, Any]:
    """Measures of a rough face, keys with their units: about its mean plane, and `filtered`."""
    raw, behind = asdict(measure(surface)), asdict(measure(filtered(surface), level=False))
    del behind["hurst_exponent"]
    return with_units(raw) | {"filtered": with_units(behind) | {"cutoff_mm": CUTOFF}}


def scan_numbers(keys: ScanKeys, doubts: tuple[str, ...] = ()) -> list[dict[str, Any]]:
    """What is kept of the files of a measured face: name, digest, extent, roughness, lay, and what was done.

    Args:
        keys: files, and what is done with them.
        doubts: what may be wrong besides, kept with the first file.
    """
    found = []
    for which, (name, sha256) in enumerate(zip(keys.files, keys.sha256 or keys.found().sha256, strict=True)):
        scan = scan_of(keys, which)
        angle, strength = lay(scan)
        found.append(
            {
                "file": name, "sha256": sha256, "size_mm": scan.size, "spacing_mm": scan.spacing,
                "points": scan.heights.shape, **roughness_numbers(as_surface(scan)), "lay_degrees": angle,
                "lay_strength": strength, "done": scan.done,
                "doubts": (*scan.doubts, *(doubts if which == 0 else ())),
            }
        )  # fmt: skip
    return found


def with_units(measures: dict[str, float]) -> dict[str, Any]:
    """Measures of roughness with their unit, mm, in their names."""
    return {name if name in ("Sdq", "hurst_exponent") else f"{name}_mm": value for name, value in measures.items()}
