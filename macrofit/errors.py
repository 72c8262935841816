"""The one error tree. A message says what, where, and what to try."""

from __future__ import annotations


class MacrofitError(Exception):
    """Anything the user can mend: the command line prints the message on one line and exits with 2."""


class SceneError(MacrofitError):
    """A scene that cannot be computed: an unknown key, a wrong type, an impossible geometry."""


class MeshError(MacrofitError):
    """A mesh that cannot be used: a missing physical group, an unreadable file, an unordered contact line."""


class ProviderError(MacrofitError):
    """A friction provider that is missing, refuses its options, or gives an unusable answer."""


class ConvergenceError(MacrofitError):
    """An increment that no cutback could solve."""


class OutputError(MacrofitError):
    """A result that cannot be written or read back."""
