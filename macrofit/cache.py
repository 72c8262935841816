"""The folder of what was costly to compute."""

from __future__ import annotations

import os


def cache_folder() -> str | None:
    """MACROFIT_CACHE, or macrofit in the user's cache folder (XDG_CACHE_HOME, ~/.cache); None without a home."""
    own = os.environ.get("MACROFIT_CACHE")
    if own:
        return own
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return None if base.startswith("~") else os.path.join(base, "macrofit")
