"""The elastic solid of the plates, and the beams that stand for it between the spheres."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from macrofit.base.keys import Keys, Positive, told
from macrofit.base.material import ElasticMaterial
from macrofit.base.steel import DENSITY

from .errors import SettingsError

ExternalModulus = Literal["series", "paper"]
"""Modulus of the bars behind a plate: see `meso.lattice.lattice.build`."""
ExternalFace = Literal["solid", "beams"]
"""How they resist shear: see `meso.lattice.lattice.build`."""

PlateModulus = Literal["material", "beams"]
"""What the beams of a plate are scaled to: see `meso.lattice.modulus`."""


class Material(ElasticMaterial, frozen=True):
    """An isotropic elastic solid, by default axle steel, as in the press-fit solver.

    Raises:
        SettingsError: a modulus or density that is not positive, a Poisson ratio outside -1 ... 0.5.
    """

    density: Annotated[Positive, told("Density rho [t/mm3]."), msgspec.Meta(le=10.0)] = DENSITY

    def __post_init__(self) -> None:
        if not (1.0 <= self.youngs_modulus <= 1e8 and 0.0 < self.density <= 10.0):
            raise SettingsError("material: take youngs_modulus in 1 ... 1e8 MPa and density in 0 ... 10 t/mm3")
        if not -1.0 < self.poisson_ratio < 0.5:
            raise SettingsError(f"material: poisson_ratio = {self.poisson_ratio} is not in -1 ... 0.5")


class Beams(Keys, frozen=True):
    """Microscopic parameters: the beams between the spheres, found by calibration (`meso.calibrate`).

    Raises:
        SettingsError: a modulus or radius ratio that is not positive, a Poisson ratio outside -1 ... 0.5.
    """

    youngs_modulus: Annotated[Positive, told("Young's modulus of the beams E_mu [MPa].")]
    radius_ratio: Annotated[Positive, told("r~, radius of a beam over the mean radius of its two spheres [-].")]
    poisson_ratio: Annotated[
        float, told("Poisson ratio of the beams nu_mu [-]; hardly matters, they twist little."),
        msgspec.Meta(gt=-1.0, lt=0.5),
    ] = 0.3  # fmt: skip

    def __post_init__(self) -> None:
        if not (0.0 < self.youngs_modulus < float("inf") and 0.0 < self.radius_ratio < float("inf")):
            raise SettingsError("beams: youngs_modulus [MPa] and radius_ratio [-] must be > 0")
        if not -1.0 < self.poisson_ratio < 0.5:
            raise SettingsError(f"beams: poisson_ratio = {self.poisson_ratio} is not in -1 ... 0.5")

    @property
    def twist(self) -> float:
        """(G I_o - E I)/(E I) = -nu/(1 + nu) [-], with I_o = 2 I and G = E/(2 (1 + nu))."""
        return -self.poisson_ratio / (1.0 + self.poisson_ratio)
