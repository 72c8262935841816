"""Writing files so that none is ever half there, and the folder of what was costly to compute."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import OutputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name of this process to write to, which takes the place of `path` when all went well.

    Raises:
        OutputError: the file cannot be written; what was there before is then intact.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror} (choose another folder with -o)") from error
    draft = Path(name)
    try:
        yield draft
        umask = os.umask(0)
        os.umask(umask)
        draft.chmod(0o666 & ~umask)
        os.replace(draft, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error} (make room)") from error
    finally:
        draft.unlink(missing_ok=True)


def cache_folder() -> Path:
    """MACROFIT_CACHE, or macrofit in the user's cache folder (XDG_CACHE_HOME, ~/.cache)."""
    own = os.environ.get("MACROFIT_CACHE")
    if own:
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path("~/.cache").expanduser()) / "macrofit"
