"""The error tree of the press-fit solver. A message says what, where, and what to try."""

from __future__ import annotations

from .base.errors import MacrofitError, OutputError

__all__ = [
    "ConvergenceError",
    "MacrofitError",
    "MeshError",
    "OutputError",
    "ProviderError",
    "SceneError",
    "StandardError",
]


class SceneError(MacrofitError):
    """A scene that cannot be computed: an unknown key, a wrong type, an impossible geometry."""


class MeshError(MacrofitError):
    """A mesh that cannot be used: a missing physical group, an unreadable file, an unordered contact line."""


class ProviderError(MacrofitError):
    """A friction provider that is missing, refuses its options, or gives an unusable answer."""


class ConvergenceError(MacrofitError):
    """An increment that no cutback could solve."""


class StandardError(MacrofitError):
    """A standard that a press fit cannot be held against: a file that is none, numbers that contradict each other."""
