"""The database of friction tests the network learns from: an HDF5 file, and a journal while it is being filled.

    FILE.h5           a check sum of the whole (see `seal`), then HDF5: root attributes (see `Header`); group `samples`,
                      a dataset for each field of `Samples`, one row per sample in the order of their end; group
                      `failures`, `id` and `reason`
    FILE.h5.journal   the samples that ended since: a signature, a frame with the header, a frame for each sample

A sample that ends is appended to the journal and forced onto the disk. When the journal has grown, a copy of the HDF5
file takes its samples and then the place of the file; a new journal follows. A kill at any moment leaves a whole HDF5
file, and a journal of which at most the last frame is torn; what both hold is counted once. `read_database` gives the
samples of both at any time, also while they are written. Nothing is ever unpickled.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import msgspec
import numpy as np
import numpy.typing as npt

from macrofit.base.errors import OutputError
from macrofit.base.files import check_regular, force_to_disk, in_bytes, writing
from macrofit.base.log import Log

from ..errors import DatabaseError
from .journal import Content, Failure, Sample, encode, head, journal_of, read_journal, start
from .samples import SCHEMA, Header, Samples, content_hash, sample_digests
from .seal import SIZE, is_sealed, seal

__all__ = [
    "Database", "Header", "Samples", "Writer", "content_hash", "describe_database", "open_database", "read_database",
]  # fmt: skip

FORMAT = "macrofit-surrogate database"
JOURNALLED = 500
"""Samples in the journal, at least, before the HDF5 file takes them; later a tenth of what the file holds."""
LONGEST_REASON = 400
"""Bytes of the reason of a failure that the HDF5 file keeps."""
MOST_BYTES = 100_000_000_000
"""Size of a database; one of a million samples has 10 GB."""
MOST_COMPRESSED = 1100
"""How much smaller than its content a column may be stored: deflate reaches 1032."""
CHUNK_TREES = 2**16
"""Bytes that the trees of an HDF5 file may take beside its chunks."""
_DAMAGED = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, IndexError, MemoryError)
"""What h5py raises on a file that is not what it should be."""


@dataclass(frozen=True)
class Database:
    """All samples of a database with what they share."""

    header: Header
    samples: Samples
    failures: dict[int, str]
    """Reason of each sample that could not be computed, by id."""
    content_hash: str
    """Hash of all samples by id, but for the time they took; the same however they were stored.

    (Code that numba has just compiled may round another way than the same code from its cache: 1e-15 of a coefficient,
    and another hash.)
    """

    @property
    def whole_pairs(self) -> Samples:
        """The samples without pairs of surfaces of which a packing failed, so that all that are left have as many."""
        packings = json.loads(self.header.design).get("packings", 1)
        lost = {number // packings for number in self.failures}
        kept = np.array([number // packings not in lost for number in self.samples.id.tolist()], dtype=np.bool_)
        return Samples(**{name: column[kept] for name, column in vars(self.samples).items()})


def read_database(path: Path) -> Database:
    """All samples of a database and its journal, also of one that is being filled.

    Raises:
        DatabaseError: there is none, or it is foreign, damaged, or of another schema.
    """
    # the journal first: what leaves it meanwhile is found in the HDF5 file
    journal = read_journal(journal_of(path)) if journal_of(path).exists() else None
    if not path.exists():
        if journal is None:
            raise DatabaseError(f"{path}: there is no such database; macrofit-surrogate generate makes one")
        header, content, _ = journal
        samples = {name: content.rows[name] for name in header.row().names or ()}
        failures = content.failures
    else:
        header, samples, failures = _read_file(path)
        if journal is not None:
            if journal[0] != header:
                raise DatabaseError(f"{journal_of(path)}: is the journal of another database; move it away")
            content = journal[1]
            new = content.rows[~np.isin(content.rows["id"], samples["id"])]
            samples = {name: np.concatenate([stored, new[name]]) for name, stored in samples.items()}
            failures |= content.failures
    order = np.argsort(samples["id"], kind="stable")
    taken = header.completed({name: samples.pop(name)[order] for name in list(samples)})  # one column twice in memory
    if len(taken) > 1 and np.any(np.diff(taken.id) == 0):
        raise DatabaseError(f"{path}: sample {taken.id[:-1][np.diff(taken.id) == 0][0]} is there twice; make it anew")
    return Database(header, taken, dict(sorted(failures.items())), content_hash(taken))


def describe_database(path: Path) -> list[str]:
    """Describe what a whole database holds, in lines of text.

    Raises:
        DatabaseError: as `read_database`.
    """
    with _opened(path) as (file, header):
        order = np.argsort(file["samples/id"][:], kind="stable")
        content = hashlib.sha256(file["samples/sha256"][:][order].tobytes()).hexdigest()
        reasons = Counter(bytes(why).decode(errors="replace") for why in file["failures/reason"][:])
    lines = [
        f"Database        {path}, {path.stat().st_size / 1e6:.1f} MB: {len(order)} samples of "
        f"{header.micro_frictions} micro coefficients",
        f"Content         {content[:20]}",
    ]
    return lines + [f"Failed          {count}: {why}" for why, count in reasons.most_common(5)]


class Writer:
    """The one process that fills a database; made by `open_database`."""

    def __init__(self, path: Path, header: Header, log: Log, content: Content, stored: int) -> None:
        self.path, self.header = path, header
        self._log = log
        self._row = header.row()
        self._rows: list[bytes] = [row.tobytes() for row in content.rows]
        self._failures = content.failures
        self._stored = stored  # samples in the HDF5 file

    def append(self, row: bytes) -> None:
        """Keep a sample, laid out as `Header.row`.

        Raises:
            OutputError: it cannot be written; all before it are safe.
        """
        if len(row) != self._row.itemsize:
            raise ValueError(f"a sample of {len(row)} bytes, not {self._row.itemsize}")
        self._log.append(encode(Sample(row)))
        self._rows.append(row)
        if len(self._rows) >= max(JOURNALLED, self._stored // 10):
            self.compact()

    def fail(self, number: int, reason: str) -> None:
        """Keep the reason of a sample that cannot be computed."""
        self._log.append(encode(Failure(number, reason)))
        self._failures[number] = reason

    def compact(self) -> None:
        """Move what the journal holds into the HDF5 file."""
        if not self._rows and not self._failures and self.path.exists():
            return
        draft = self.path.with_name(f".{self.path.name}.draft")  # one writer: a kill leaves one draft at most
        with writing(self.path):
            try:
                self._extend(draft)
                force_to_disk(draft)
                os.replace(draft, self.path)
            finally:
                draft.unlink(missing_ok=True)
            force_to_disk(self.path.parent)
        self._log.restart(head(self.header))
        self._rows, self._failures = [], {}

    def _extend(self, draft: Path) -> None:
        """Make a copy of the HDF5 file with what the journal holds; OSError where there is no room."""
        rows = np.frombuffer(b"".join(self._rows), self._row)
        sealed = not self.path.exists() or _is_sealed(self.path)
        if self.path.exists():
            shutil.copyfile(self.path, draft)
        else:
            draft.touch()
        with draft.open("ab") as file:
            reserve(file.fileno(), _room(rows, self._failures))
        if not self.path.exists():
            _create(draft, self.header)
        with h5py.File(draft, "r+") as file:
            _extend(file, rows, self._failures)
            self._stored = len(file["samples/id"])
        if sealed:
            seal(draft)

    def close(self) -> None:
        """Move what the journal holds into the HDF5 file, and take the journal away."""
        self.compact()
        with writing(self.path):
            journal_of(self.path).unlink(missing_ok=True)
        self.abandon()

    def abandon(self) -> None:
        """Let go of the journal as it is."""
        self._log.close()


@contextmanager
def open_database(path: Path, header: Header) -> Iterator[tuple[Writer, set[int]]]:
    """Fill a database, new or begun before with the same header; gives the ids that are there already too.

    When the block ends without an error the journal is gone and the HDF5 file has all.

    Raises:
        DatabaseError: another header; foreign or damaged.
        OutputError: being filled by another process; cannot be written.
    """
    journal = journal_of(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():  # refuse before anything is made
        header = _same(path, _read_ids(path)[0], header)
    log = Log.open(journal, durable=True) if journal.exists() else start(journal, header)
    try:
        _, stored, failed = _read_ids(path) if path.exists() else (header, set[int](), set[int]())
        found, content, end = read_journal(journal)
        header = _same(journal, found, header)
        log.cut(end)
        # a kill between the replacement of the two files leaves the same in both
        content.rows = content.rows[~np.isin(content.rows["id"], sorted(stored))]
        content.failures = {number: why for number, why in content.failures.items() if number not in failed}
        done = stored | failed | set(content.rows["id"].tolist()) | set(content.failures)
    except BaseException:
        log.close()
        raise
    writer = Writer(path, header, log, content, len(stored))
    try:
        yield writer, done
    except BaseException:
        writer.abandon()
        raise
    writer.close()


def reserve(descriptor: int, room: int) -> None:
    """Make sure that an open file could grow by so much [bytes]: where HDF5 meets a full disk, it ends the process.

    Raises:
        OSError: there is no room.
    """
    end = os.lseek(descriptor, 0, os.SEEK_END)
    try:
        os.posix_fallocate(descriptor, end, room)
    finally:
        os.ftruncate(descriptor, end)


def _room(rows: npt.NDArray[Any], failures: dict[int, str]) -> int:
    """What an HDF5 file may grow by [bytes]: the entries, a chunk of each dataset that is begun, and its trees."""
    kinds = [rows.dtype[name] for name in rows.dtype.names or ()]
    chunks = sum(_chunk(kind) * kind.itemsize for kind in kinds) + 128 * 32 + 64 * (LONGEST_REASON + 8)
    return int(1.1 * (rows.nbytes + 32 * len(rows) + len(failures) * (LONGEST_REASON + 8))) + chunks + CHUNK_TREES


def _chunk(kind: np.dtype[Any]) -> int:
    """Samples in a chunk of a dataset of this kind: heights are large, and compressed."""
    return 8 if kind.base == np.float32 else 128


def require_samples(path: Path) -> None:
    """Make sure that not every sample of a whole database failed.

    Raises:
        DatabaseError: all did; it has the most common reason.
    """
    with _opened(path) as (file, _):
        count = len(file["samples/id"])
        reasons = Counter(bytes(why).decode(errors="replace") for why in file["failures/reason"][:])
    if reasons and not count:
        raise DatabaseError(
            f"{path}: not one of {reasons.total()} samples could be computed, most of them because: "
            f"{reasons.most_common(1)[0][0]}; change the settings of the plates or the range of the design, and choose "
            f"another file with -o"
        )


def _same(path: Path, found: Header, asked: Header) -> Header:
    """The header found, where what is asked for may be added to its samples."""
    if found.schema != asked.schema:
        raise DatabaseError(f"{path}: is of schema {found.schema}, not {asked.schema}; choose another file with -o")
    old, new = json.loads(found.design), json.loads(asked.design)
    changed = [f"{key} was {old.get(key)}, now {new.get(key)}" for key in new if old.get(key) != new.get(key)]
    if found.settings != asked.settings:
        lines = sorted(set(found.settings.splitlines()) - set(asked.settings.splitlines()))
        changed += [f"the plates had {', '.join(lines) or 'fewer keys'}"]
    if found.code != asked.code:
        changed += [f"the code of the plates was {found.code[:8]}, now {asked.code[:8]}"]
    if changed:
        raise DatabaseError(f"{path}: was begun otherwise: {'; '.join(changed)}. Choose another file with -o")
    if msgspec.structs.replace(found, version=asked.version) != asked:
        raise DatabaseError(f"{path}: has samples of another shape; choose another file with -o")
    return found


def _create(path: Path, header: Header) -> None:
    with h5py.File(path, "w", userblock_size=SIZE) as file:
        file.attrs["format"] = FORMAT
        for name, value in msgspec.structs.asdict(header).items():
            file.attrs[name] = value
        row = header.row()
        columns = {name: row[name] for name in row.names or ()} | {"sha256": np.dtype(("u1", (32,)))}
        for name, kind in columns.items():
            heights = kind.base == np.float32
            file.create_dataset(
                f"samples/{name}",
                shape=(0, *kind.shape),
                maxshape=(None, *kind.shape),
                chunks=(_chunk(kind), *kind.shape),
                dtype=kind.base,
                **({"compression": "gzip", "shuffle": True} if heights else {}),
            )
        for name, kind in (("id", np.dtype("<i8")), ("reason", np.dtype(f"S{LONGEST_REASON}"))):
            file.create_dataset(f"failures/{name}", shape=(0,), maxshape=(None,), chunks=(64,), dtype=kind)


def _extend(file: Any, rows: npt.NDArray[Any], failures: dict[int, str]) -> None:
    columns = {name: rows[name] for name in rows.dtype.names or ()}
    checksums = np.frombuffer(b"".join(sample_digests(columns)), "u1").reshape(-1, 32)
    reasons = [why.encode()[:LONGEST_REASON] for why in failures.values()]
    more = {f"samples/{name}": values for name, values in columns.items()}
    more |= {"samples/sha256": checksums, "failures/id": np.array(list(failures), "<i8")}
    more |= {"failures/reason": np.array(reasons, f"S{LONGEST_REASON}")}
    for name, values in more.items():
        if len(values):
            dataset = file[name]
            old = len(dataset)
            dataset.resize(old + len(values), axis=0)
            dataset[old:] = values


def _is_sealed(path: Path) -> bool:
    """Whether a file has a seal, which is right, or is of an older version.

    Raises:
        DatabaseError: neither.
    """
    try:
        check_regular(path, MOST_BYTES)
        return is_sealed(path)
    except OutputError as error:
        raise DatabaseError(str(error)) from None
    except OSError as error:
        raise DatabaseError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise DatabaseError(
            f"{path}: is not a database of samples, or a damaged one ({error}); move it away and make it anew"
        ) from None


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Header]]:
    """An HDF5 file that says it is a database of this schema; what h5py finds wrong in it names the file."""
    _is_sealed(path)
    try:
        with h5py.File(path, "r") as file:
            if str(file.attrs.get("format", "")) != FORMAT:
                raise DatabaseError(f"{path}: is an HDF5 file, but not a database of samples")
            if not 1 <= int(file.attrs["schema"]) <= SCHEMA:
                raise DatabaseError(f"{path}: is of schema {file.attrs['schema']}, not {SCHEMA}; make it anew")
            _check_stored(file)
            kinds = {field.name: field.type for field in msgspec.structs.fields(Header)}
            header = Header(**{name: kind(file.attrs[name]) for name, kind in kinds.items()})
            msgspec.json.encode(header)  # a ValueError where it is no text
            yield file, header
    except DatabaseError:
        raise
    except _DAMAGED as error:
        raise DatabaseError(f"{path}: is damaged or cut short ({error}); move it away and make it anew") from error


def _check_stored(file: Any) -> None:
    """Refuse columns that claim more rows than are stored: reading them would fill the memory with nothing.

    Raises:
        ValueError: which column does.
    """
    for group in ("samples", "failures"):
        for name, column in file[group].items():
            claimed, stored = column.size * column.dtype.itemsize, column.id.get_storage_size()
            if claimed > MOST_COMPRESSED * stored:
                raise ValueError(f"{group}/{name} claims {in_bytes(claimed)} and stores {in_bytes(stored)}")


def _read_ids(path: Path) -> tuple[Header, set[int], set[int]]:
    """Header, and ids of samples and of failures."""
    with _opened(path) as (file, header):
        return header, set(file["samples/id"][:].tolist()), set(file["failures/id"][:].tolist())


def _read_file(path: Path) -> tuple[Header, dict[str, npt.NDArray[Any]], dict[int, str]]:
    with _opened(path) as (file, header):
        row = header.row()
        samples = {name: file[f"samples/{name}"][:] for name in row.names or ()}
        count = len(samples["id"])
        for name, stored in samples.items():
            if stored.dtype != row[name].base or stored.shape != (count, *row[name].shape):
                raise ValueError(f"samples/{name} is {stored.dtype} {stored.shape}")
        whole = [bytes(stored) for stored in file["samples/sha256"][:]]
        for number, expected, is_now in zip(samples["id"], whole, sample_digests(samples), strict=True):
            if expected != is_now:
                raise ValueError(f"sample {number} does not match its checksum")
        reasons = [bytes(why).decode(errors="replace") for why in file["failures/reason"][:]]
        return header, samples, dict(zip(file["failures/id"][:].tolist(), reasons, strict=True))
