"""A database as a table: one row of text for each sample and micro coefficient, small enough to travel with the code.

    # macrofit-surrogate table {"header": {...}, "content_hash": "...", "sha256": "..."}
    id,wheel_seed,axle_seed,packing_seed,levels,max_height,hurst_exponent,micro_friction,meso_friction,...

It leaves out the heights. Generated faces follow from their seeds when it is read; envelopes of spheres do not, for
they need the plates. One SHA-256 is of all that follows the first line, and one of that line. A table whose name ends
in .csv.gz is compressed.
"""

from __future__ import annotations

import csv
import gzip
import hashlib
import io
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from macrofit.base.errors import OutputError, shortened
from macrofit.base.files import in_bytes, read_regular, replacing

from ..errors import DatabaseError
from .database import Database, read_database
from .faces import generated_face
from .samples import Header, Samples

MOST_BYTES = 200_000_000
"""Size of a table; one of a million samples has about as much."""
SIGNATURE = "# macrofit-surrogate table "
TABLES = (".csv", ".csv.gz")
"""Endings of names of tables."""
HEIGHTS = ("wheel", "axle", "wheel_envelope", "axle_envelope")
"""Fields of a sample that a table leaves out."""


class _About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """First line of a table, after the signature."""

    header: Header
    content_hash: str  # of the database, heights and all
    sha256: str
    head_sha256: str = ""  # of this line with "" in this place; tables of older versions lack it

    def digest(self) -> str:
        """What head_sha256 must be."""
        return hashlib.sha256(msgspec.json.encode(msgspec.structs.replace(self, head_sha256=""))).hexdigest()


def write_table(database: Database, path: Path) -> None:
    """Write all samples but for their heights, and for those that `Database.whole_pairs` leaves out.

    Raises:
        OutputError: it cannot be written.
    """
    header, samples = database.header, database.whole_pairs
    columns = {name: getattr(samples, name) for name in header.row().names or () if name not in HEIGHTS}
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(columns)
    for i in range(len(samples)):
        for k in range(header.micro_frictions):
            rows.writerow(_as_text(column[i, k] if column.ndim == 2 else column[i]) for column in columns.values())
    body = text.getvalue().encode()
    about = _About(header, database.content_hash, hashlib.sha256(body).hexdigest())
    about = msgspec.structs.replace(about, head_sha256=about.digest())
    whole = SIGNATURE.encode() + msgspec.json.encode(about) + b"\n" + body
    with replacing(path) as draft:
        draft.write_bytes(gzip.compress(whole, mtime=0) if path.suffix.lower() == ".gz" else whole)


def is_table(path: Path) -> bool:
    """Whether a name is that of a table, in small letters or large ones."""
    return path.name.lower().endswith(TABLES)


def read_table(path: Path) -> Database:
    """Read the samples of a table, their generated faces made anew and their envelopes left empty.

    Raises:
        DatabaseError: there is no such file, or it is foreign, damaged or changed.
    """
    try:
        first, _, body = _read_text(path).partition(b"\n")
    except OutputError as error:
        raise DatabaseError(str(error)) from None
    if not first.startswith(SIGNATURE.encode()):
        raise DatabaseError(f"{path}: is no table of samples: its first line is not '{SIGNATURE.strip()} ...'")
    try:
        about = msgspec.json.decode(first[len(SIGNATURE) :], type=_About)
        if hashlib.sha256(body).hexdigest() != about.sha256 or about.head_sha256 not in ("", about.digest()):
            raise DatabaseError(f"{path}: was changed or damaged after it was written: its digest differs; get it anew")
        samples = _samples(about.header, list(csv.DictReader(io.StringIO(body.decode()))))
    except (msgspec.DecodeError, ValueError, KeyError) as error:
        raise DatabaseError(f"{path}: is a damaged table of samples ({shortened(error)}); get it anew") from error
    return Database(about.header, samples, {}, about.content_hash)


def open_samples(path: Path) -> Database:
    """Read a database, or where the name ends in .csv or .csv.gz a table of one.

    Raises:
        DatabaseError: as `read_database` and `read_table`.
    """
    return read_table(path) if is_table(path) else read_database(path)


def _read_text(path: Path) -> bytes:
    """The text of a table, which may be compressed.

    Raises:
        OutputError: it cannot be read, or is larger than `MOST_BYTES`.
        DatabaseError: it is no whole compressed file.
    """
    stored = read_regular(path, MOST_BYTES)
    if path.suffix.lower() != ".gz":
        return stored
    unpacker = zlib.decompressobj(wbits=31)
    try:
        text = unpacker.decompress(stored, MOST_BYTES)
    except zlib.error as error:
        raise DatabaseError(f"{path}: is no compressed table of samples, or a damaged one ({error})") from None
    if not unpacker.eof:
        raise DatabaseError(f"{path}: is cut short, or holds more than {in_bytes(MOST_BYTES)}; get it anew")
    return text


def _as_text(value: Any) -> str:
    """A number so that it comes back to the bit; bytes as text."""
    return value.decode(errors="replace") if isinstance(value, bytes) else repr(value.item())


def _samples(header: Header, rows: list[dict[str, str]]) -> Samples:
    """Samples from rows of text, with their faces made anew."""
    kinds, k = header.row(), header.micro_frictions
    values: dict[str, Any] = {}
    for name in kinds.names or ():
        if name in HEIGHTS:
            continue
        column = np.array([row[name].encode() if kinds[name].base.kind == "S" else row[name] for row in rows])
        column = column.astype(kinds[name].base).reshape(-1, k)
        values[name] = column if kinds[name].shape else column[:, 0]
    values |= {name: np.zeros((len(rows) // k, 0, 0), dtype=np.float32) for name in HEIGHTS}
    samples = header.completed(values)
    faces: dict[str, list[Any]] = {"wheel": [], "axle": []}
    for i in range(len(samples)):
        keys = header.face_keys(samples, i)
        faces["wheel"].append(generated_face("wheel", int(samples.wheel_seed[i]), keys, header.points))
        faces["axle"].append(generated_face("axle", int(samples.axle_seed[i]), keys, header.points))
    return replace(samples, **{name: np.array(made) for name, made in faces.items()})
