"""The database of friction tests the network learns from: an HDF5 file, and a journal while it is being filled.

    FILE.h5           root attributes (see `Header`); group `samples`, a dataset for each field of `Samples`, one row
                      per sample in the order of their end; group `failures`, `id` and `reason`
    FILE.h5.journal   the samples that ended since: a signature, a frame with the header, a frame for each sample

A sample that ends is appended to the journal and forced onto the disk. When the journal has grown, a copy of the HDF5
file takes its samples and then the place of the file; a new journal follows. A kill at any moment leaves a whole HDF5
file, and a journal of which at most the last frame is torn; what both hold is counted once. `read` gives the samples
of both at any time, also while they are written. Nothing is ever unpickled.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import msgspec
import numpy as np
import numpy.typing as npt

from .errors import DatabaseError

FloatArray: TypeAlias = npt.NDArray[np.float64]
HeightArray: TypeAlias = npt.NDArray[np.float32]
IntArray: TypeAlias = npt.NDArray[np.int64]

SCHEMA = 1
FORMAT = "macrofit-surrogate database"
MAGIC = b"macrofit-surrogate journal\n"
JOURNALLED = 500
"""Samples in the journal, at least, before the HDF5 file takes them; later a tenth of what the file holds."""
LONGEST_REASON = 400
"""Bytes of the reason of a failure that the HDF5 file keeps."""
LONGEST_ENTRY = 65536
"""Bytes of an entry of the journal beside the heights and numbers of its sample."""
BLOCK = 256
"""Samples whose digests are checked at a time."""
_FRAME = struct.Struct("<Q32s")  # length and SHA-256 of the content that follows
_DAMAGED = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, IndexError, MemoryError)
"""What h5py raises on a file that is not what it should be."""


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What all samples of a database share."""

    design: str
    """Options of the design, as JSON."""
    settings: str
    """Settings of the plates, as TOML; for what the design varies see the samples."""
    code: str
    """Hash of the code that computed the samples."""
    version: str
    """Of the package."""
    micro_frictions: int
    """k, micro coefficients per sample."""
    squares: int
    """Length of the axle's plate over that of the wheel's."""
    points: int = 33
    """Of a surface along the edge of the wheel's plate; an envelope has 2 points - 1."""
    schema: int = SCHEMA

    def row(self) -> np.dtype[Any]:
        """The type of one sample: the fields of `Samples`."""
        k, n = self.micro_frictions, self.points - 1
        per_coefficient = {
            name: np.dtype(("<f8", (k,)))
            for name in (
                "micro_friction", "meso_friction", "meso_friction_mean_of_ratio", "uncertainty", "mean_normal",
                "mean_tangential", "minimum_normal", "stored_energy", "friction_loss", "approach",
            )
        }  # fmt: skip
        special = {
            "wheel": np.dtype(("<f4", (n + 1, n + 1))),
            "axle": np.dtype(("<f4", (self.squares * n + 1, n + 1))),
            "wheel_envelope": np.dtype(("<f4", (2 * n + 1, 2 * n + 1))),
            "axle_envelope": np.dtype(("<f4", (2 * self.squares * n + 1, 2 * n + 1))),
            "engine": np.dtype(("S16", (k,))),
            "remark": np.dtype("S240"),
            "max_height": np.dtype("<f8"),
            "hurst_exponent": np.dtype("<f8"),
            "cpu_s": np.dtype("<f8"),
        }
        known = per_coefficient | special
        return np.dtype([(field.name, known.get(field.name, np.dtype("<i8"))) for field in fields(Samples)])


@dataclass(frozen=True)
class Samples:
    """Friction tests, one row each, sorted by id: n pairs of plates, each slid with k micro coefficients.

    Heights are measured outward from the nominal face of each body, in single precision (1e-7 of the height). Row i
    of a matrix lies at x = i dx along the slide, column j at y = j dy across it. The wheel is turned over about no
    axis but mirrored in z: its point (x, y) faces (x + s, y) of the axle when it has slid by s.
    """

    id: IntArray
    """Number in the design, shape (n,)."""
    wheel_seed: IntArray
    axle_seed: IntArray
    packing_seed: IntArray
    levels: IntArray
    max_height: FloatArray
    """R [mm]."""
    hurst_exponent: FloatArray
    wheel: HeightArray
    """Surface of the wheel [mm], shape (n, 33, 33) on 1 x 1 mm; exact, for grids of 2^levels + 1 points nest."""
    axle: HeightArray
    """Surface of the axle [mm], shape (n, 65, 33) on 2 x 1 mm."""
    wheel_envelope: HeightArray
    """Upper envelope of the wheel's spheres [mm], shape (n, 65, 65)."""
    axle_envelope: HeightArray
    """Upper envelope of the axle's spheres [mm], shape (n, 129, 65)."""
    micro_friction: FloatArray
    """Shape (n, k), rising in each row; so are all that follow."""
    meso_friction: FloatArray
    """Mean T over mean N."""
    meso_friction_mean_of_ratio: FloatArray
    """Mean of T/N."""
    uncertainty: FloatArray
    """Standard error of `meso_friction` along the slide."""
    mean_normal: FloatArray
    """Mean N over the slide [N]."""
    mean_tangential: FloatArray
    """Mean T over the slide [N]."""
    minimum_normal: FloatArray
    """Smallest N along the slide [N]."""
    stored_energy: FloatArray
    """Energy in beams and contacts at the end of the slide less that at its start [N mm]."""
    friction_loss: FloatArray
    """Work lost in the contacts along the slide [N mm]."""
    approach: FloatArray
    """From the first touch to the end of the squeeze [mm]."""
    engine: npt.NDArray[np.bytes_]
    """The engine that answered, shape (n, k)."""
    remark: npt.NDArray[np.bytes_]
    """Why another engine than the one asked for, if so; shape (n,)."""
    cpu_s: FloatArray
    """Time of the processor [s], shape (n,); the last field, and no part of a sample's digest."""

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True)
class Database:
    """What `read` found."""

    header: Header
    samples: Samples
    failures: dict[int, str]
    """Reason of each sample that could not be computed, by id."""
    content_hash: str
    """Of all samples by id, but for the time they took; the same however they were computed and stored."""


class _Sample(msgspec.Struct, frozen=True, array_like=True, tag="sample"):
    row: bytes


class _Failure(msgspec.Struct, frozen=True, array_like=True, tag="failure"):
    id: int
    reason: str


_Entry: TypeAlias = _Sample | _Failure
_ENTRIES = msgspec.msgpack.Decoder(_Sample | _Failure)


@dataclass
class _Content:
    """Entries as they are stored: rows with their digests, and failures."""

    rows: npt.NDArray[Any]
    failures: dict[int, str]


def journal_of(path: Path) -> Path:
    """The journal of a database."""
    return path.with_name(path.name + ".journal")


def read(path: Path) -> Database:
    """All samples of a database and its journal, also of one that is being filled.

    Raises:
        DatabaseError: there is none, or it is foreign, damaged, or of another schema.
    """
    # the journal first: what leaves it meanwhile is found in the HDF5 file
    journal = _read_journal(journal_of(path)) if journal_of(path).exists() else None
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
    taken = Samples(**{name: np.ascontiguousarray(stored[order]) for name, stored in samples.items()})
    if len(taken) > 1 and np.any(np.diff(taken.id) == 0):
        raise DatabaseError(f"{path}: sample {taken.id[:-1][np.diff(taken.id) == 0][0]} is there twice; make it anew")
    return Database(header, taken, dict(sorted(failures.items())), content_hash(taken))


def content_hash(samples: Samples) -> str:
    """Hash of all samples by id, but for the time they took."""
    whole = hashlib.sha256()
    for sample in _digests({field.name: getattr(samples, field.name) for field in fields(Samples)}):
        whole.update(sample)
    return whole.hexdigest()


def stock(path: Path) -> list[str]:
    """What a whole database holds, in words.

    Raises:
        DatabaseError: as `read`.
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

    def __init__(self, path: Path, header: Header, descriptor: int, content: _Content, stored: int) -> None:
        self.path, self.header = path, header
        self._descriptor = descriptor
        self._row = header.row()
        self._rows: list[bytes] = [row.tobytes() for row in content.rows]
        self._failures = content.failures
        self._stored = stored  # samples in the HDF5 file

    def append(self, row: bytes) -> None:
        """Keep a sample, laid out as `Header.row`.

        Raises:
            DatabaseError: it cannot be written; all before it are safe.
        """
        if len(row) != self._row.itemsize:
            raise ValueError(f"a sample of {len(row)} bytes, not {self._row.itemsize}")
        self._write(_Sample(row))
        self._rows.append(row)
        if len(self._rows) >= max(JOURNALLED, self._stored // 10):
            self.compact()

    def fail(self, number: int, reason: str) -> None:
        """Keep the reason of a sample that cannot be computed."""
        self._write(_Failure(number, reason))
        self._failures[number] = reason

    def compact(self) -> None:
        """Move what the journal holds into the HDF5 file."""
        if not self._rows and not self._failures and self.path.exists():
            return
        draft = self.path.with_name(f".{self.path.name}.draft")  # one writer: a kill leaves one draft at most
        with _writing(self.path):
            if self.path.exists():
                shutil.copyfile(self.path, draft)
            else:
                _create(draft, self.header)
            with h5py.File(draft, "r+") as file:
                _extend(file, np.frombuffer(b"".join(self._rows), self._row), self._failures)
                self._stored = len(file["samples/id"])
            _force(draft)
            os.replace(draft, self.path)
            _force(self.path.parent)
        old, self._descriptor = self._descriptor, _start_journal(journal_of(self.path), self.header)
        os.close(old)
        self._rows, self._failures = [], {}

    def close(self) -> None:
        """Move what the journal holds into the HDF5 file, and take the journal away."""
        self.compact()
        with _writing(self.path):
            journal_of(self.path).unlink(missing_ok=True)
        self.abandon()

    def abandon(self) -> None:
        """Let go of the journal as it is."""
        os.close(self._descriptor)

    def _write(self, entry: _Entry) -> None:
        with _writing(self.path):
            rest = memoryview(_frame(msgspec.msgpack.encode(entry)))
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            os.fsync(self._descriptor)


@contextmanager
def open_database(path: Path, header: Header) -> Iterator[tuple[Writer, set[int]]]:
    """Fill a database, new or begun before with the same header; gives the ids that are there already too.

    When the block ends without an error the journal is gone and the HDF5 file has all.

    Raises:
        DatabaseError: another header; foreign, damaged or being filled by another process; cannot be written.
    """
    journal = journal_of(path)
    with _writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():  # refuse before anything is made
        header = _same(path, _read_ids(path)[0], header)
    descriptor = _lock(journal) if journal.exists() else _start_journal(journal, header, new=True)
    try:
        _, stored, failed = _read_ids(path) if path.exists() else (header, set[int](), set[int]())
        found, content, end = _read_journal(journal)
        header = _same(journal, found, header)
        with _writing(journal):
            os.ftruncate(descriptor, end)
        # a kill between the replacement of the two files leaves the same in both
        content.rows = content.rows[~np.isin(content.rows["id"], sorted(stored))]
        content.failures = {number: why for number, why in content.failures.items() if number not in failed}
        done = stored | failed | set(content.rows["id"].tolist()) | set(content.failures)
    except BaseException:
        os.close(descriptor)
        raise
    writer = Writer(path, header, descriptor, content, len(stored))
    try:
        yield writer, done
    except BaseException:
        writer.abandon()
        raise
    writer.close()


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


def _digests(arrays: Mapping[str, npt.NDArray[Any]]) -> Iterator[bytes]:
    """SHA-256 of each sample as `Header.row` lays it out, but for its time."""
    row = np.dtype([(name, stored.dtype, stored.shape[1:]) for name, stored in arrays.items()])
    count = len(arrays["id"])
    for start in range(0, count, BLOCK):
        block = np.empty(min(BLOCK, count - start), row)
        for name, stored in arrays.items():
            block[name] = stored[start : start + BLOCK]
        yield from (hashlib.sha256(sample.tobytes()[:-8]).digest() for sample in block)


# --- the HDF5 file


def _create(path: Path, header: Header) -> None:
    with h5py.File(path, "w") as file:
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
                chunks=(8 if heights else 128, *kind.shape),
                dtype=kind.base,
                **({"compression": "gzip", "shuffle": True} if heights else {}),
            )
        for name, kind in (("id", np.dtype("<i8")), ("reason", np.dtype(f"S{LONGEST_REASON}"))):
            file.create_dataset(f"failures/{name}", shape=(0,), maxshape=(None,), chunks=(64,), dtype=kind)


def _extend(file: Any, rows: npt.NDArray[Any], failures: dict[int, str]) -> None:
    columns = {name: rows[name] for name in rows.dtype.names or ()}
    digests = np.frombuffer(b"".join(_digests(columns)), "u1").reshape(-1, 32)
    reasons = [why.encode()[:LONGEST_REASON] for why in failures.values()]
    more = {f"samples/{name}": values for name, values in columns.items()}
    more |= {"samples/sha256": digests, "failures/id": np.array(list(failures), "<i8")}
    more |= {"failures/reason": np.array(reasons, f"S{LONGEST_REASON}")}
    for name, values in more.items():
        if len(values):
            dataset = file[name]
            old = len(dataset)
            dataset.resize(old + len(values), axis=0)
            dataset[old:] = values


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Header]]:
    """An HDF5 file that says it is a database of this schema; what h5py finds wrong in it names the file."""
    try:
        with path.open("rb") as start:
            if start.read(8) != b"\x89HDF\r\n\x1a\n":
                raise DatabaseError(f"{path}: is not a database of samples (not an HDF5 file)")
        with h5py.File(path, "r") as file:
            if str(file.attrs.get("format", "")) != FORMAT:
                raise DatabaseError(f"{path}: is an HDF5 file, but not a database of samples")
            if int(file.attrs["schema"]) != SCHEMA:
                raise DatabaseError(f"{path}: is of schema {file.attrs['schema']}, not {SCHEMA}; make it anew")
            kinds = {field.name: field.type for field in msgspec.structs.fields(Header)}
            yield file, Header(**{name: kind(file.attrs[name]) for name, kind in kinds.items()})
    except DatabaseError:
        raise
    except PermissionError as error:
        raise DatabaseError(f"{path}: cannot be read: {error.strerror}") from None
    except _DAMAGED as error:
        raise DatabaseError(f"{path}: is damaged or cut short ({error}); move it away and make it anew") from error


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
        for number, expected, is_now in zip(samples["id"], whole, _digests(samples), strict=True):
            if expected != is_now:
                raise ValueError(f"sample {number} does not match its checksum")
        reasons = [bytes(why).decode(errors="replace") for why in file["failures/reason"][:]]
        return header, samples, dict(zip(file["failures/id"][:].tolist(), reasons, strict=True))


# --- the journal


def _start_journal(path: Path, header: Header, *, new: bool = False) -> int:
    """A locked journal with its header and nothing else in place of what is there; `new`: nothing may be there."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    with _writing(path):
        descriptor = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND | os.O_CLOEXEC, 0o666)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with _writing(path):
            os.write(descriptor, MAGIC + _frame(msgspec.msgpack.encode(header)))
            os.fsync(descriptor)
            if new:
                os.link(draft, path)
            else:
                os.replace(draft, path)
            _force(path.parent)
    except BaseException:
        os.close(descriptor)
        raise
    finally:
        draft.unlink(missing_ok=True)
    return descriptor


def _lock(path: Path) -> int:
    """The journal that is there, for this process alone."""
    with _writing(path):
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


def _read_journal(path: Path) -> tuple[Header, _Content, int]:
    """Header, whole entries, and where the last of them ends [bytes]."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatabaseError(f"{path}: cannot be read: {error.strerror}") from None
    if not data.startswith(MAGIC):
        raise DatabaseError(f"{path}: is not the journal of a database of samples; move it away")
    rows, failures = [], {}
    try:
        text, end = next(_frames(data, len(MAGIC), len(data)))
        header = msgspec.msgpack.decode(text, type=Header)
        if header.schema != SCHEMA:
            raise DatabaseError(f"{path}: is of schema {header.schema}, not {SCHEMA}; move it away")
        row = header.row()
        for text, place in _frames(data, end, row.itemsize + LONGEST_ENTRY):
            end, entry = place, _ENTRIES.decode(text)
            if isinstance(entry, _Failure):
                failures[entry.id] = entry.reason
            elif len(entry.row) == row.itemsize:
                rows.append(entry.row)
            else:
                raise ValueError(f"a sample of {len(entry.row)} bytes")
    except (StopIteration, ValueError) as error:  # msgspec's errors are ValueErrors
        told = f"{error}, after {len(rows)} whole samples" if rows or failures else "its header is not whole"
        raise DatabaseError(f"{path}: is damaged ({told}); move it away, and what it held is computed again") from None
    return header, _Content(np.frombuffer(b"".join(rows), row), failures), end


def _frame(content: bytes) -> bytes:
    return _FRAME.pack(len(content), hashlib.sha256(content).digest()) + content


def _frames(data: bytes, start: int, longest: int) -> Iterator[tuple[bytes, int]]:
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


# --- files


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn a failure to write into a DatabaseError that names the file."""
    try:
        yield
    except FileExistsError:
        raise DatabaseError(f"{path}: another process began to fill this database; choose another -o") from None
    except OSError as error:
        raise DatabaseError(
            f"{path}: cannot be written: {error.strerror or error} (make room or mend it, then give the same command)"
        ) from error


def _force(path: Path) -> None:
    """Onto the disk, file or folder."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
