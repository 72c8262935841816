"""Isotropic linear elasticity."""

from __future__ import annotations

from typing import Annotated

import msgspec

from .keys import Keys, Positive, told
from .steel import POISSON_RATIO, YOUNGS_MODULUS


class ElasticMaterial(Keys, frozen=True):
    """Isotropic linear elasticity: two constants, and what follows from them. By default axle steel."""

    youngs_modulus: Annotated[Positive, told("Young's modulus E [MPa].")] = YOUNGS_MODULUS
    poisson_ratio: Annotated[float, msgspec.Meta(description="Poisson ratio nu [-].", gt=-1.0, lt=0.5)] = POISSON_RATIO

    @property
    def shear_modulus(self) -> float:
        """mu = E / (2 (1 + nu)) [MPa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def lame_lambda(self) -> float:
        """lambda = E nu / ((1 + nu) (1 - 2 nu)) [MPa]."""
        nu = self.poisson_ratio
        return self.youngs_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
