"""Beams that stand for a solid: what a calibration found, the one that comes with the package, and its beams."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import msgspec

from macrofit.base.files import write_text
from macrofit.base.toml import TomlError, dump_toml, parse_toml

from ..errors import OutputError, SettingsError
from ..material import Beams, Material


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Beams that stand for a Poisson ratio, and how well: Young's modulus scales."""

    poisson_ratio: float
    """nu_M that was asked for [-]."""
    radius_ratio: float
    """Radius ratio r~ of the beams [-]."""
    stiffening: float
    """E_mu / E_M [-]."""
    beams_poisson_ratio: float
    """Poisson ratio nu_mu of the beams [-]."""
    spheres: int
    """In each packing."""
    box: tuple[float, float, float]
    """Edges of the packings [mm]."""
    packings: int
    """Number of them."""
    modulus_scatter: float
    """Standard deviation of E_M over the packings, over its mean [-]."""
    poisson_scatter: float
    """Standard deviation of nu_M over the packings [-]."""
    residual: float
    """|mean nu_M - poisson_ratio| at the end of the search [-]."""

    def beams(self, youngs_modulus: float) -> Beams:
        """The beams for a Young's modulus E_M [MPa]."""
        return Beams(
            youngs_modulus=self.stiffening * youngs_modulus,
            radius_ratio=self.radius_ratio,
            poisson_ratio=self.beams_poisson_ratio,
        )

    def write(self, path: Path) -> None:
        """As TOML.

        Raises:
            OutputError: the file cannot be written.
        """
        text = dump_toml(msgspec.to_builtins(self))
        write_text(path, f"# Written by meso.calibrate; means over packings and over the three axes.\n{text}")


def read_calibration(text: str, source: str = "calibration") -> Calibration:
    """A calibration from TOML.

    Raises:
        OutputError: it is not one.
    """
    try:
        return msgspec.convert(parse_toml(text, source), Calibration)
    except (TomlError, msgspec.ValidationError) as error:
        raise OutputError(f"{source}: not a calibration: {error}; run macrofit-meso calibrate again") from None


def stored_calibration() -> Calibration:
    """The calibration that comes with the package: Poisson ratio 0.3, boxes of 2000 spheres."""
    name = "calibrations/steel.toml"
    return read_calibration((resources.files("meso") / name).read_text(encoding="utf-8"), f"meso/{name}")


def beams_for(material: Material) -> Beams:
    """The beams of the stored calibration, scaled to the material's Young's modulus.

    Raises:
        SettingsError: the material's Poisson ratio is not the stored one.
    """
    stored = stored_calibration()
    if material.poisson_ratio != stored.poisson_ratio:
        raise SettingsError(
            f"material: no beams are stored for poisson_ratio = {material.poisson_ratio:g}, only for "
            f"{stored.poisson_ratio:g}: run macrofit-meso calibrate and set beams.youngs_modulus and beams.radius_ratio"
        )
    return stored.beams(material.youngs_modulus)


def steel() -> Beams:
    """The beams that stand for steel, `Material()`."""
    return beams_for(Material())
