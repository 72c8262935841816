"""The root of every error a user can mend. A message says what, where, and what to try."""

from __future__ import annotations


class MacrofitError(Exception):
    """Anything the user can mend: the command line prints the message on one line and exits with 2."""


class OutputError(MacrofitError):
    """A file or folder that cannot be written or read back."""
