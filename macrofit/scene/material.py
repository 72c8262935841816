"""Isotropic linear elasticity: the two constants of a body and what follows from them."""

from __future__ import annotations

import msgspec


class Material(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Isotropic linear elastic material.

    The defaults are those of a railway axle steel (EN 13261, grade EA1N: E 206 GPa, nu 0.3).
    """

    youngs_modulus: float = 206e3  # MPa
    poisson_ratio: float = 0.3

    @property
    def shear_modulus(self) -> float:
        """mu = E / (2 (1 + nu)) [MPa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def lame_lambda(self) -> float:
        """lambda = E nu / ((1 + nu) (1 - 2 nu)) [MPa]."""
        nu = self.poisson_ratio
        return self.youngs_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
