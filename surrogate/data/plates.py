"""What all plates of a database have in common, and by which key others differ from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import msgspec

from macrofit.base.arrays import FloatArray
from macrofit.base.steel import POISSON_RATIO, YOUNGS_MODULUS

Faces = Literal["generated", "envelope"]
"""Surfaces as generated, or as the envelopes of their spheres."""
YOUNGS_MODULUS_SLACK = 0.03
"""Largest relative distance from the plates' modulus [-]. Between 206 and 210 GPa the coefficient moves by less than
0.1 %: half the pressure is worth 1.8 %."""
POISSON_RATIO_SLACK = 0.005
"""Largest distance from the plates' Poisson's ratio [-]."""
PLACES = {
    "spheres": ("plates", "spheres"),
    "edge": ("plates", "edge"),
    "slide": ("load", "slide"),
    "pressure": ("load", "pressure"),
    "youngs_modulus": ("material", "youngs_modulus"),
    "poisson_ratio": ("material", "poisson_ratio"),
    "thickness": ("plates", "thickness"),
    "cube": ("plates", "cube"),
    "external_face": ("plates", "external_face"),
    "external_modulus": ("plates", "external_modulus"),
    "modulus": ("plates", "modulus"),
    "normal_stiffness": ("contact", "normal_stiffness"),
    "tangential_ratio": ("contact", "tangential_ratio"),
    "control": ("load", "control"),
    "engine": ("engine", "name"),
    "speed": ("engine", "speed"),
    "resonance": ("engine", "resonance"),
    "form": ("surface", "form"),
    "lay": ("surface", "lay"),
}
"""Table and key of each field of `Plates` in the settings of a friction test."""


OLDER = {"form": "tiles", "lay": "isotropic", "modulus": "beams", "resonance": 0.0}
"""Values of keys that settings may not say: older ones do not know them."""
DYNAMIC = ("time_step", "breakage", "resonance")
"""Keys of the engine that ask for the explicit one."""


class Plates(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What all plates of a database have in common, and a network that learns from it cannot know otherwise.

    The defaults are the values of networks that do not say a key.
    """

    spheres: int = 3000
    """Spheres of both plates together."""
    edge: float = 1.0
    """Edge of the wheel's plate [mm]."""
    slide: float = 1.0
    """Length of the slide [mm]."""
    pressure: float = 170.0
    """Mean pressure before the slide [MPa]."""
    youngs_modulus: float = YOUNGS_MODULUS
    """Young's modulus [MPa]."""
    poisson_ratio: float = POISSON_RATIO
    """Poisson's ratio [-]."""
    thickness: float = 0.3
    """Thickness of a plate [mm]."""
    cube: float = 1.0
    """Height of the solid that a plate and its external face stand for [mm]."""
    external_face: str = "solid"
    """How the bars behind a plate resist shear."""
    external_modulus: str = "series"
    """Modulus of the bars behind a plate."""
    modulus: str = "beams"
    """Whether the beams of a plate are scaled to the material's modulus."""
    normal_stiffness: float = 1.0
    """Normal stiffness of a contact over E_M (r_i + r_j)/2 [-]."""
    tangential_ratio: float = 0.8
    """Tangential over normal stiffness of a contact [-]."""
    control: str = "displacement"
    """What is held while sliding."""
    engine: str = "quasi-static"
    """Engine asked for; "auto" counts as the quasi-static one."""
    speed: float = 0.0
    """Speed of the explicit engine's slide [mm/s]; 0 for the quasi-static one, and where `resonance` says it."""
    resonance: float = 0.0
    """Speed over the plates' f d [-]; 0 where it is not given so."""
    form: str = "tiles"
    """Form of the faces: pieces of strips, or tiles by themselves."""
    lay: str = "isotropic"
    """Lay of the faces."""

    @property
    def load(self) -> float:
        """Normal force before the slide [N]."""
        return self.pressure * self.edge**2

    def on_steel(self, pressure: FloatArray) -> FloatArray:
        """Normal force on steel that presses plates as this pressure does these [N]: it goes with 1/E."""
        return pressure * (self.edge**2 * YOUNGS_MODULUS / self.youngs_modulus)

    @property
    def dynamic(self) -> bool:
        """Whether the slide has a speed."""
        return self.engine == "explicit"

    @classmethod
    def of_settings(cls, tables: Mapping[str, Any]) -> Plates:
        """Read the plates from all keys of the settings of a friction test.

        Raises:
            KeyError: a table is missing.
            msgspec.ValidationError: a key is missing, or has a value of another type.
        """
        engine = tables["engine"]
        keys = {name: tables[table].get(key) for name, (table, key) in PLACES.items()}
        keys = {name: OLDER.get(name) if value is None else value for name, value in keys.items()}
        if keys["engine"] == "auto":
            asked = any(engine.get(key) is not None for key in DYNAMIC)
            keys["engine"] = "explicit" if asked else "quasi-static"
        if keys["engine"] != "explicit" or keys["resonance"]:
            keys["speed"] = 0.0
        return msgspec.convert(keys, cls)

    def unlike(self, asked: Plates) -> list[str]:
        """In which keys the plates of a run are others than these, in words.

        The solid may differ a little. The faces are no matter of the plates: a network sees them. Nor does it matter
        whether beams were scaled to the material's modulus: that is worth 0.1 to 0.4 % of a coefficient.
        """
        low, high = ((1.0 + sign * YOUNGS_MODULUS_SLACK) * self.youngs_modulus for sign in (-1.0, 1.0))
        findings = []
        if not _same(asked.edge, self.edge):
            findings.append(f"tile_size = {asked.edge:g} is not {self.edge:g} mm")
        if not low <= asked.youngs_modulus <= high:
            findings.append(f"youngs_modulus = {asked.youngs_modulus:g} is outside {low:g} ... {high:g} MPa")
        if not abs(asked.poisson_ratio - self.poisson_ratio) <= POISSON_RATIO_SLACK:
            findings.append(f"poisson_ratio = {asked.poisson_ratio:g} is not {self.poisson_ratio:g}")
        for name, place in PLACES.items():
            if name in ("edge", "slide", "youngs_modulus", "poisson_ratio", "form", "lay", "modulus"):
                continue
            if name == "speed" and not (self.dynamic and asked.dynamic and self.resonance == asked.resonance):
                continue  # told by the engine, or by the resonance
            ours, theirs = getattr(self, name), getattr(asked, name)
            if not _same(ours, theirs):
                findings.append(f"{'.'.join(place)} = {_shown(theirs)} is not {_shown(ours)}")
        return findings


def _same(ours: float | str, theirs: float | str) -> bool:
    """Whether two values of a key are the same, but for rounding."""
    if isinstance(ours, str) or isinstance(theirs, str):
        return ours == theirs
    return math.isclose(ours, theirs, rel_tol=1e-9)


def _shown(value: float | str) -> str:
    """The value of a key, for a message."""
    return f"'{value}'" if isinstance(value, str) else f"{value:g}"
