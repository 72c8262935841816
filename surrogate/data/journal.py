"""The journal of a database: the samples that ended since the HDF5 file was last written, safe against a kill.

A signature, a frame with the header, then a frame for each sample or failure: length and SHA-256 of its content, and
the content as MessagePack. A frame is forced onto the disk before the next one; a kill can only tear the last.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from ..errors import DatabaseError
from .samples import SCHEMA, Header

MAGIC = b"macrofit-surrogate journal\n"
LONGEST_ENTRY = 65536
"""Bytes of an entry beside the heights and numbers of its sample."""
_FRAME = struct.Struct("<Q32s")  # length and SHA-256 of the content that follows


class Sample(msgspec.Struct, frozen=True, array_like=True, tag="sample"):
    """A sample, laid out as `Header.row`."""

    row: bytes


class Failure(msgspec.Struct, frozen=True, array_like=True, tag="failure"):
    """Why there is no sample of this id."""

    id: int
    reason: str


_ENTRIES = msgspec.msgpack.Decoder(Sample | Failure)


@dataclass
class Content:
    """Entries as they are stored: rows with their digests, and failures."""

    rows: npt.NDArray[Any]
    failures: dict[int, str]


def journal_of(path: Path) -> Path:
    """The journal of a database."""
    return path.with_name(path.name + ".journal")


def start(path: Path, header: Header, *, new: bool = False) -> int:
    """A locked journal with its header and nothing else in place of what is there; `new`: nothing may be there."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    with writing(path):
        descriptor = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND | os.O_CLOEXEC, 0o666)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with writing(path):
            os.write(descriptor, MAGIC + frame(msgspec.msgpack.encode(header)))
            os.fsync(descriptor)
            if new:
                os.link(draft, path)
            else:
                os.replace(draft, path)
            force(path.parent)
    except BaseException:
        os.close(descriptor)
        raise
    finally:
        draft.unlink(missing_ok=True)
    return descriptor


def lock(path: Path) -> int:
    """The journal that is there, for this process alone."""
    with writing(path):
        descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        taken = path.exists() and os.path.samestat(os.fstat(descriptor), path.stat())
    except BlockingIOError:
        taken = False
    except OSError:  # a file system without locks
        taken = True
    if not taken:
        os.close(descriptor)
        raise DatabaseError(f"{path}: another process is filling this database; wait for it, or choose another -o")
    return descriptor


def read_journal(path: Path) -> tuple[Header, Content, int]:
    """Header, whole entries, and where the last of them ends [bytes]."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatabaseError(f"{path}: cannot be read: {error.strerror}") from None
    if not data.startswith(MAGIC):
        raise DatabaseError(f"{path}: is not the journal of a database of samples; move it away")
    rows, failures = [], {}
    try:
        text, end = next(frames(data, len(MAGIC), len(data)))
        header = msgspec.msgpack.decode(text, type=Header)
        if header.schema != SCHEMA:
            raise DatabaseError(f"{path}: is of schema {header.schema}, not {SCHEMA}; move it away")
        row = header.row()
        for text, place in frames(data, end, row.itemsize + LONGEST_ENTRY):
            end, entry = place, _ENTRIES.decode(text)
            if isinstance(entry, Failure):
                failures[entry.id] = entry.reason
            elif len(entry.row) == row.itemsize:
                rows.append(entry.row)
            else:
                raise ValueError(f"a sample of {len(entry.row)} bytes")
    except (StopIteration, ValueError) as error:  # msgspec's errors are ValueErrors
        told = f"{error}, after {len(rows)} whole samples" if rows or failures else "its header is not whole"
        raise DatabaseError(f"{path}: is damaged ({told}); move it away, and what it held is computed again") from None
    return header, Content(np.frombuffer(b"".join(rows), row), failures), end


def frame(content: bytes) -> bytes:
    """The content with its length and checksum before it."""
    return _FRAME.pack(len(content), hashlib.sha256(content).digest()) + content


def frames(data: bytes, start: int, longest: int) -> Iterator[tuple[bytes, int]]:
    """Contents of the frames and where each ends, but for a last one that was torn while it was written.

    Raises ValueError for one that is damaged otherwise. No frame is longer than `longest`.
    """
    place = start
    while place + _FRAME.size <= len(data):
        length, expected = _FRAME.unpack_from(data, place)
        end = place + _FRAME.size + length
        content = data[place + _FRAME.size : end]
        if end > len(data) or hashlib.sha256(content).digest() != expected:
            cut_short = end >= len(data) and len(data) - place <= longest
            if cut_short or not any(data[place:]):  # after a power cut the tail may be zeros
                return
            raise ValueError(f"a wrong checksum at byte {place}")
        yield content, end
        place = end


def append(descriptor: int, path: Path, entry: Sample | Failure) -> None:
    """Write an entry at the end and force it onto the disk.

    Raises:
        DatabaseError: it cannot be written; all before it are safe.
    """
    with writing(path):
        rest = memoryview(frame(msgspec.msgpack.encode(entry)))
        while rest:
            rest = rest[os.write(descriptor, rest) :]
        os.fsync(descriptor)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn a failure to write into a DatabaseError that names the file."""
    try:
        yield
    except FileExistsError:
        raise DatabaseError(f"{path}: another process began to fill this database; choose another -o") from None
    except OSError as error:
        raise DatabaseError(
            f"{path}: cannot be written: {error.strerror or error} (make room or mend it, then give the same command)"
        ) from error


def force(path: Path) -> None:
    """Onto the disk, file or folder."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
