"""The material of a body."""

from __future__ import annotations

from ..base.material import ElasticMaterial


class Material(ElasticMaterial, frozen=True):
    """Isotropic linear elastic material of a body; by default axle steel."""
