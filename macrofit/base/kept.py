"""Arrays that are kept on disk from one run to the next: whole, or not there.

A file is named by all that decides its content. It is written whole or not at all, checked when it is read, and made
again where it is damaged.
"""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .arrayfile import read_npz
from .errors import OutputError
from .files import replacing

MOST_BYTES = 200_000_000
"""Size of all files that a folder keeps; the oldest go first."""
LARGEST = 25_000_000
"""Arrays of more bytes are not kept: they would drive out all others."""


def read_kept(file: Path) -> dict[str, npt.NDArray[Any]] | None:
    """The arrays in a file; None where there is none, or a damaged one, which a warning says."""
    if not os.path.exists(file):  # it raises nothing, whatever the name
        return None
    try:
        arrays = read_npz(file, MOST_BYTES)
        if not np.array_equal(arrays.pop("digest"), _digest(file, arrays)):
            raise ValueError
    except (OutputError, ValueError, KeyError):
        warnings.warn(f"{file} is damaged and is made again", stacklevel=4)
        return None
    return arrays


def keep(file: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """Keep arrays for later runs; a folder that cannot be written is done without."""
    if sum(array.nbytes for array in arrays.values()) > LARGEST:
        return
    with suppress(OutputError, OSError):
        with replacing(file) as draft:
            np.savez(draft, digest=_digest(file, arrays), **arrays)
        _remove_oldest(file.parent)


def _digest(file: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[np.uint8]:
    """SHA-256 of a file's name and arrays with their names, types and shapes: an archive checks bytes of each alone."""
    digest = hashlib.sha256(file.stem.encode())
    for name in sorted(arrays):
        digest.update(repr((name, arrays[name].dtype.str, arrays[name].shape)).encode())
        digest.update(np.ascontiguousarray(arrays[name]).data)
    return np.frombuffer(digest.digest(), dtype=np.uint8)


def _remove_oldest(folder: Path) -> None:
    """Keep the newest files alone; another process may remove them too."""
    kept = []
    for file in folder.glob("*.npz"):
        with suppress(OSError):
            about = file.stat()
            kept.append((about.st_mtime_ns, about.st_size, file))
    total = 0
    for _, size, file in sorted(kept, reverse=True):
        total += size
        if total > MOST_BYTES:
            with suppress(OSError):
                file.unlink(missing_ok=True)
