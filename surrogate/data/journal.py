"""The journal of a database: the samples that ended since the HDF5 file was last written, safe against a kill.

A signature, a frame with the header, then a frame for each sample or failure, its content in MessagePack (see
`macrofit.base.log`). A frame is forced onto the disk before the next one; a kill can only tear the last.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from macrofit.base.errors import OutputError
from macrofit.base.files import read_regular
from macrofit.base.log import Log, frame, frames

from ..errors import DatabaseError
from .samples import SCHEMA, Header

KIND = b"macrofit-surrogate journal"
MAGIC = KIND + b" 2\n"
MOST_BYTES = 20_000_000_000
"""Size of a journal; one of a million samples has 10 GB."""


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


def start(path: Path, header: Header) -> Log:
    """A locked journal with its header and nothing else in place of what is there.

    Raises:
        OutputError: another process is filling the database, or it cannot be written.
    """
    return Log.create(path, head(header), durable=True)


def head(header: Header) -> bytes:
    """How a journal starts: the signature, and the header as a frame."""
    return MAGIC + frame(msgspec.msgpack.encode(header))


def encode(entry: Sample | Failure) -> bytes:
    """The content of an entry's frame."""
    return msgspec.msgpack.encode(entry)


def read_journal(path: Path) -> tuple[Header, Content, int]:
    """Header, whole entries, and where the last of them ends [bytes]."""
    try:
        data = read_regular(path, MOST_BYTES)
    except OutputError as error:
        raise DatabaseError(str(error)) from None
    if data.startswith(KIND) and not data.startswith(MAGIC):
        raise DatabaseError(
            f"{path}: is of another version of macrofit; move it away, and its samples are computed again"
        )
    if not data.startswith(MAGIC):
        raise DatabaseError(f"{path}: is not the journal of a database of samples; move it away")
    rows, failures = [], {}
    try:
        text, end = next(frames(data, len(MAGIC)))
        header = msgspec.msgpack.decode(text, type=Header)
        if header.schema != SCHEMA:
            raise DatabaseError(f"{path}: is of schema {header.schema}, not {SCHEMA}; move it away")
        row = header.row()
        for text, place in frames(data, end):
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
