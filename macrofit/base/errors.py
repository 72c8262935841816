"""The root of every error a user can mend. A message says what, where, and what to try."""

from __future__ import annotations


class MacrofitError(Exception):
    """Anything the user can mend: the command line prints the message on one line and exits with 2."""


class OutputError(MacrofitError):
    """A file or folder that cannot be written or read back."""


LONGEST = 300
"""Characters of a file's content, at most, that a message repeats."""


def shortened(text: object) -> str:
    """What another library says of a file, on one line and cut where it repeats too much of what is in it."""
    line = " ".join(str(text).split())
    return line if len(line) <= LONGEST else f"{line[:LONGEST]} ..."
