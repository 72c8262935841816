"""A database as a table: one row of text for each sample and micro coefficient, small enough to travel with the code.

    # macrofit-surrogate table {"header": {...}, "content_hash": "...", "sha256": "..."}
    id,wheel_seed,axle_seed,packing_seed,levels,max_height,hurst_exponent,micro_friction,meso_friction,...

It leaves out the heights. Generated faces follow from their seeds when it is read; envelopes of spheres do not, for
they need the plates. One SHA-256 is of all that follows the first line, and one of that
line.
"""

from __future__ import annotations

import csv
import hashlib
import io
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from macrofit.base.errors import OutputError, shortened
from macrofit.base.files import read_regular, replacing

from ..errors import DatabaseError
from .database import Database, read_database
from .faces import generated_face
from .samples import Header, Samples

MOST_BYTES = 200_000_000
"""Size of a table; one of a million samples has about as much."""
SIGNATURE = "# macrofit-surrogate table "
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
    """Write all samples but for their heights.

    Raises:
        OutputError: it cannot be written.
    """
    header, samples = database.header, database.samples
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
    with replacing(path) as draft:
        draft.write_bytes(SIGNATURE.encode() + msgspec.json.encode(about) + b"\n" + body)


def read_table(path: Path) -> Database:
    """Read the samples of a table, their generated faces made anew and their envelopes left empty.

    Raises:
        DatabaseError: there is no such file, or it is foreign, damaged or changed.
    """
    try:
        first, _, body = read_regular(path, MOST_BYTES).partition(b"\n")
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
    """Read a database, or where the name ends in .csv a table of one.

    Raises:
        DatabaseError: as `read_database` and `read_table`.
    """
    return read_table(path) if path.suffix == ".csv" else read_database(path)


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
    faces: dict[str, list[Any]] = {"wheel": [], "axle": []}
    for i in range(len(values["id"])):
        keys = {name: values[name][i].item() for name in ("levels", "max_height", "hurst_exponent")}
        faces["wheel"].append(generated_face("wheel", int(values["wheel_seed"][i]), **keys, points=header.points))
        faces["axle"].append(generated_face("axle", int(values["axle_seed"][i]), **keys, points=header.points))
    values |= {name: np.zeros((len(rows) // k, 0, 0), dtype=np.float32) for name in HEIGHTS[2:]}
    return Samples(**values | {name: np.array(made) for name, made in faces.items()})
