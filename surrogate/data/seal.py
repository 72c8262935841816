"""The seal of a database: a check sum of the whole HDF5 file, in a block at its start that HDF5 leaves to others.

    bytes 0 to 511    signature, SHA-256 of all that follows, zeros
    from byte 512 on  the HDF5 file

It is looked at before HDF5 opens the file: a flipped bit there may end the process, and HDF5 keeps no check sum of what
it needs to find the data. Other programs that read HDF5 read a sealed file as any other.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import BinaryIO

HDF5 = b"\x89HDF\r\n\x1a\n"
"""How an HDF5 file starts: a database of an older version, which has no seal."""
SIGNATURE = b"macrofit-surrogate database\n"
SIZE = 512
"""Bytes of the block; HDF5 looks for itself at the powers of two from here on."""


def seal(path: Path) -> None:
    """Write the seal of a file whose block is free; OSError where that fails."""
    with path.open("r+b") as file:
        block = _block(file)
        file.seek(0)
        file.write(block)


def is_sealed(path: Path) -> bool:
    """Whether a file has a seal, rather than being of an older version.

    Raises:
        ValueError: it has one, and was damaged; or it has none, and is no HDF5 file.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(SIZE)
        if head.startswith(HDF5):
            return False
        if not head.startswith(SIGNATURE):
            raise ValueError("not an HDF5 file")
        if head != _block(file):
            raise ValueError("its check sum is wrong")
    return True


def _block(file: BinaryIO) -> bytes:
    """The block that belongs to an open file."""
    file.seek(SIZE)
    digest = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    return (SIGNATURE + digest.encode() + b"\n").ljust(SIZE, b"\0")
