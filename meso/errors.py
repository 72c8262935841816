"""The error tree of the plates. A message says what, where, and what to try."""

from __future__ import annotations

from macrofit.base.errors import MacrofitError, OutputError

__all__ = ["MesoError", "OutputError", "PackingError", "SettingsError", "StabilityError", "SurfaceError"]


class MesoError(MacrofitError):
    """Anything about the plates that the user can mend."""


class SettingsError(MesoError):
    """Settings that cannot be computed: an unknown key, a wrong type, an impossible size."""


class SurfaceError(MesoError):
    """A rough surface that cannot be used: too few points, heights that are not finite, higher than its plate."""


class PackingError(MesoError):
    """A hull that the spheres do not fill, or a packing that falls apart."""


class StabilityError(MesoError):
    """An explicit run whose time step is above its limit, or that left the realm of finite numbers."""
