"""Arrays in .npy and .npz files, whose heads and check sums are weighed before their content."""

from __future__ import annotations

import io
import tokenize
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import OutputError
from .files import read_regular

DAMAGED = (
    ValueError, EOFError, SyntaxError, TypeError, KeyError, OverflowError, RecursionError, MemoryError,
    tokenize.TokenError,
)  # fmt: skip
"""What numpy raises on a file that is not what it should be."""


def read_npy(path: Path, most_bytes: int) -> npt.NDArray[Any]:
    """A whole array; objects are never loaded.

    Raises:
        OutputError: it cannot be read, is no .npy file, or does not hold as much as its head says.
    """
    data = read_regular(path, most_bytes)
    file = io.BytesIO(data)
    try:
        form: Any = np.lib.format  # it has no types
        major, _ = form.read_magic(file)
        shape, _, kind = (form.read_array_header_1_0 if major == 1 else form.read_array_header_2_0)(file)
        if kind.hasobject:
            raise ValueError("it holds objects, which are not loaded")
        stated, held = kind.itemsize, len(data) - file.tell()
        for count in shape:
            stated *= count
        if stated != held:
            raise ValueError(f"its head states {'x'.join(map(str, shape))} of {kind}, and {held} bytes follow")
        file.seek(0)
        return np.asarray(np.load(file, allow_pickle=False))
    except DAMAGED as error:
        raise OutputError(f"{path}: is no .npy array of numbers, or a damaged one ({error})") from None


def read_npz(path: Path, most_bytes: int) -> dict[str, npt.NDArray[Any]]:
    """All arrays of an archive by name, once the check sums of all are seen to be right; objects are never loaded.

    Raises:
        OutputError: it cannot be read, is no .npz file, or a damaged one.
    """
    import zipfile
    import zlib

    data = read_regular(path, most_bytes)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            wrong = archive.testzip()
        if wrong is not None:
            raise ValueError(f"the check sum of {wrong} is wrong")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return {name: np.asarray(arrays[name]) for name in arrays.files}
    except (*DAMAGED, OSError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise OutputError(f"{path}: is no .npz archive of arrays, or a damaged one ({error})") from None
