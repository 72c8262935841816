"""The material of a body: its elastic constants, and where and how it yields."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Annotated, Literal, TypeAlias

import msgspec

from ..base.keys import Keys, NotNegative, Positive, told
from ..base.material import ElasticMaterial
from ..base.steel import EXPANSION

Grade = Literal["EA1N", "EA4T", "ER7", "ER8", "ER9"]
"""Steels with a card, see `steels.toml`."""

Isotropic: TypeAlias = Annotated[NotNegative, told("Linear growth of the yield stress by plastic strain [MPa].")]
Saturation: TypeAlias = Annotated[NotNegative, told("Q of Voce: growth of the yield stress at large strains [MPa].")]
Rate: TypeAlias = Annotated[NotNegative, told("b of Voce: how soon Q is reached [-].")]
Column: TypeAlias = Annotated[tuple[NotNegative, ...], msgspec.Meta(min_length=2)]
Backs: TypeAlias = Annotated[tuple[NotNegative, ...], msgspec.Meta(min_length=1, max_length=3)]


class LinearHardening(Keys, frozen=True, tag="linear", tag_field="law"):
    """Straight lines: R = yield_stress + isotropic p, and a back-stress that grows by kinematic per plastic strain."""

    isotropic: Isotropic = 0.0
    kinematic: Annotated[NotNegative, told("Linear growth of the uniaxial back-stress by plastic strain [MPa].")] = 0.0


class VoceHardening(Keys, frozen=True, tag="voce", tag_field="law"):
    """Isotropic hardening that saturates: R = yield_stress + isotropic p + saturation (1 - exp(-rate p))."""

    saturation: Saturation
    rate: Rate
    isotropic: Isotropic = 0.0


class ChabocheHardening(Keys, frozen=True, tag="chaboche", tag_field="law"):
    """Up to three back-stresses, dX = 2/3 C d eps_p - g X dp each, with isotropic hardening of Voce's."""

    moduli: Annotated[Backs, told("C of each back-stress: its growth by plastic strain at the start [MPa].")]
    recalls: Annotated[Backs, told("g of each back-stress: C / g is its limit; 0: none [-].")]
    saturation: Saturation = 0.0
    rate: Rate = 0.0
    isotropic: Isotropic = 0.0


class TabulatedHardening(Keys, frozen=True, tag="table", tag_field="law"):
    """Isotropic hardening by a measured curve, linear between its points, constant behind the last."""

    plastic_strain: Annotated[Column, told("Plastic strains, from 0 on and growing [-].")]
    stress: Annotated[Column, told("Stresses there, from the yield stress on and never falling [MPa].")]


Hardening: TypeAlias = LinearHardening | VoceHardening | ChabocheHardening | TabulatedHardening


class Material(ElasticMaterial, frozen=True):
    """Isotropic material of a body; by default axle steel that never yields."""

    grade: Annotated[Grade | None, told("Steel whose card states yield stress and expansion; left out: none.")] = None
    yield_stress: Annotated[
        Positive | None, told("Yield stress [MPa]; left out: of the grade, or the body never yields.")
    ] = None
    hardening: Annotated[
        Hardening | None, told("How the yield stress grows with plastic strain; left out: it does not.")
    ] = None
    expansion: Annotated[
        Annotated[float, msgspec.Meta(gt=0.0, lt=1e-3)] | None,
        told(f"Linear coefficient of thermal expansion [1/K]; left out: of the grade, or {EXPANSION:g}."),
    ] = None
    elastic: Annotated[
        bool, told("Whether the body stays elastic all the same; the run then says how far beyond yield it is.")
    ] = False


@cache
def cards() -> dict[str, dict[str, float | str]]:
    """The cards of the steels, by their grades."""
    import tomllib

    return tomllib.loads((resources.files("macrofit.scene") / "steels.toml").read_text())


def expansion(material: Material) -> float:
    """Coefficient of thermal expansion [1/K]: that of the keys, of the grade's card, or of axle steel."""
    if material.expansion is not None:
        return material.expansion
    return EXPANSION if material.grade is None else float(cards()[material.grade]["expansion"])


def yield_stress(material: Material) -> float | None:
    """Where the material starts to yield [MPa]; None where it never does."""
    table = material.hardening
    if material.yield_stress is not None:
        return material.yield_stress
    if isinstance(table, TabulatedHardening):
        return table.stress[0]
    return None if material.grade is None else float(cards()[material.grade]["yield_stress"])
