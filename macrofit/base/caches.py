"""A place for what is compiled once: the user's cache folder, or a temporary one where there is none to write to."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path

RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
"""Variables by which a launcher tells a process its rank."""


@lru_cache(maxsize=1)
def ensure_cache() -> None:
    """Let compilers and matplotlib find folders they can write to; call it before they are imported.

    Where the user's cache folder (XDG_CACHE_HOME, ~/.cache) cannot be written, all caches of this process and of those
    it starts go to a temporary folder, which is private and removed in the end; the first rank says so in a warning.
    """
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if not _writable(Path(cache)):
        own = tempfile.mkdtemp(prefix="macrofit-cache-")
        atexit.register(_remove, own, os.getpid())
        os.environ["XDG_CACHE_HOME"] = own
        if os.path.expanduser("~").startswith("~"):  # neither HOME nor an entry of this user
            os.environ["HOME"] = own
        if _is_first():
            warnings.warn(
                f"{cache}: cannot be written; what is compiled is kept in a temporary folder for this run alone. "
                f"Set XDG_CACHE_HOME to a folder of yours",
                stacklevel=2,
            )
    config = Path(os.environ.get("XDG_CONFIG_HOME") or os.path.expanduser("~/.config"))
    if "MPLCONFIGDIR" not in os.environ and not _writable(config):
        os.environ["MPLCONFIGDIR"] = str(Path(os.environ.get("XDG_CACHE_HOME") or cache) / "matplotlib")


def _writable(folder: Path) -> bool:
    """Whether a file can be made in a folder, which is made itself where it is missing."""
    if str(folder).startswith("~"):
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_first() -> bool:
    return all(os.environ.get(name, "0") == "0" for name in RANKS)


def _remove(folder: str, process: int) -> None:
    """Remove the folder, in the process that made it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)
