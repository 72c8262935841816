"""What numba compiled, checked before it is loaded: damaged files are removed, and compiled anew.

Beside the files of a module lies one with their check sums, written when the process ends. What has none yet, for its
process was killed, is taken where it looks whole.
"""

from __future__ import annotations

import atexit
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

from .errors import MacrofitError
from .files import write_text

ENDINGS = ("*.nbi", "*.nbc")
"""Index of what there is for a function, and the code."""

START, STOP = b"\x80", b"."
"""First and last byte of a pickled record, which both are."""


def check_compiled(kernel: Any) -> None:
    """Check what is compiled of the module of a kernel; call it where the module ends, before any kernel is called.

    Args:
        kernel: a function that numba compiles with ``cache=True``; a plain one, under NUMBA_DISABLE_JIT, has no files.
    """
    if not hasattr(kernel, "py_func"):
        return
    folder, stem = Path(kernel.stats.cache_path), Path(kernel.py_func.__code__.co_filename).stem
    known = _read_sums(folder, stem)
    for name, found in _sums(folder, stem).items():
        if known is None or found is None or known.get(name, found) != found:
            with suppress(OSError):
                (folder / name).unlink(missing_ok=True)
    atexit.register(_write_sums, folder, stem)


def _sums(folder: Path, stem: str) -> dict[str, str | None]:
    """Check sum of each file of a module; None for one that is no whole record."""
    found: dict[str, str | None] = {}
    for ending in ENDINGS:
        for file in folder.glob(f"{stem}.{ending}"):
            with suppress(OSError):
                data = file.read_bytes()
                whole = data.startswith(START) and data.endswith(STOP)
                found[file.name] = _sum(data) if whole else None
    found.pop(_sums_file(folder, stem).name, None)
    return found


def _sums_file(folder: Path, stem: str) -> Path:
    """The file of check sums; by its ending it is one of those that are made, and no part of the package."""
    return folder / f"{stem}.sums.nbi"


def _read_sums(folder: Path, stem: str) -> dict[str, str] | None:
    """The check sums that were written; None where they are damaged themselves: then nothing can be trusted."""
    try:
        own, _, text = _sums_file(folder, stem).read_text().partition("\n")
    except OSError:
        return {}
    except ValueError:
        return None
    if own != _sum(text.encode()):
        return None
    return {name: found for name, _, found in (line.rpartition(" ") for line in text.splitlines())}


def _write_sums(folder: Path, stem: str) -> None:
    """Write the check sums where they changed; a cache that cannot be written has no new files either."""
    found = {name: each for name, each in _sums(folder, stem).items() if each is not None}
    if found != _read_sums(folder, stem):
        text = "".join(f"{name} {found[name]}\n" for name in sorted(found))
        with suppress(MacrofitError):
            write_text(_sums_file(folder, stem), f"{_sum(text.encode())}\n{text}")


def _sum(data: bytes) -> str:
    return f"{zlib.crc32(data):08x}-{len(data)}"
