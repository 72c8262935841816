"""Plates that go by a name: the keys in which they differ from the defaults, and what a slide of them costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from .errors import SettingsError

DEFAULT = "slow"
"""The preset of whoever asks for none."""


class Preset(NamedTuple):
    """Settings of a friction test that go by a name."""

    told: str
    """What it is, in a few words."""
    tables: Mapping[str, Mapping[str, Any]]
    """Keys that differ from the defaults, by table."""


PRESETS: dict[str, Preset] = {
    "slow": Preset(told="the defaults, slid so slowly that nothing swings", tables={}),
    "as-published": Preset(
        told="plates of 1000 spheres on beams as printed by Lalleman et al., slid near the resonance of these beams: "
        "one reading of the paper, in which a micro coefficient of 0.07 gives 0.11",
        tables={
            "surface": {
                "form": "tiles",
                "generator": "diamond_square",
                "levels": 3,
                "max_height": 0.04,
                "hurst_exponent": 0.8,
            },
            "plates": {"spheres": 1000, "thickness": 0.4, "external_face": "beams", "external_modulus": "paper"},
            "load": {"pressure": 170.0},
            "engine": {"name": "explicit", "speed": 10_000.0},
        },
    ),
}
"""All presets, by name."""


def preset_tables(name: str) -> dict[str, dict[str, Any]]:
    """The keys of a preset by table, as copies.

    Raises:
        SettingsError: there is none of this name.
    """
    if name not in PRESETS:
        raise SettingsError(f"there is no preset '{name}' of plates; take {' or '.join(PRESETS)}")
    return {table: dict(keys) for table, keys in PRESETS[name].tables.items()}


def on_preset(name: str, tables: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of settings laid over those of a preset: a key that is given goes before the preset's.

    Raises:
        SettingsError: there is no preset of this name.
    """
    merged: dict[str, Any] = preset_tables(name)
    engine = tables.get("engine")
    if isinstance(engine, Mapping) and engine.get("resonance") is not None and "engine" in merged:
        merged["engine"].pop("speed", None)  # one of the two says how fast
    for table, keys in tables.items():
        below = merged.get(table)
        merged[table] = {**below, **keys} if isinstance(below, dict) and isinstance(keys, Mapping) else keys
    return merged


def presets_line() -> str:
    """One line for help texts: every preset with what it is."""
    return "; ".join(f"{name}: {preset.told}" for name, preset in PRESETS.items())
