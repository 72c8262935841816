"""The root of every error a user can mend. A message says what, where, and what to try."""

from __future__ import annotations

from collections.abc import Iterable


class MacrofitError(Exception):
    """Anything the user can mend: the command line prints the message on one line and exits with 2."""


class OutputError(MacrofitError):
    """A file or folder that cannot be written or read back."""


LONGEST = 300
"""Characters of a file's content, at most, that a message repeats."""


def nearest(word: str, known: Iterable[str], listed: str = "known", also: Iterable[str] = ()) -> str:
    """What to try in place of a word that is not known: the one that is most like it, or a list of all.

    Args:
        word: what was written.
        known: what may be written.
        listed: what the list is called.
        also: what may be written too, and is not listed.
    """
    import difflib

    names = list(known)
    close = difflib.get_close_matches(word, [*names, *also], n=1)
    return f"did you mean '{close[0]}'?" if close else f"{listed}: {', '.join(names)}"


def shortened(text: object) -> str:
    """What another library says of a file, on one printable line and cut where it repeats too much of what is in it."""
    line = "".join(sign if sign.isprintable() else "?" for sign in " ".join(str(text).split()))
    return line if len(line) <= LONGEST else f"{line[:LONGEST]} ..."
