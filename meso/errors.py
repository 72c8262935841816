"""The error tree of the plates. A message says what, where, and what to try."""

from __future__ import annotations

from macrofit.base import errors as base


class MesoError(base.MacrofitError):
    """Anything the user can mend: the command line prints the message on one line and exits with 2."""


class SettingsError(MesoError):
    """Settings that cannot be computed: an unknown key, a wrong type, an impossible size."""


class SurfaceError(MesoError):
    """A rough surface that cannot be used: too few points, heights that are not finite, higher than its plate."""


class PackingError(MesoError):
    """A hull that the spheres do not fill, or a packing that falls apart."""


class StabilityError(MesoError):
    """An explicit run whose time step is above its limit, or that left the realm of finite numbers."""


class OutputError(MesoError, base.OutputError):
    """A result or a cache that cannot be written or read back."""
