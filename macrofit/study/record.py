"""What a study keeps of a run, and the file that keeps it, safe against a kill."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import msgspec
import numpy as np

from ..acceptance.run import holds
from ..base.arrays import FloatArray
from ..base.files import starts_with
from ..base.log import Log, frames
from ..errors import OutputError
from ..results.doubts import doubts
from ..solution import Extreme, Solution

KIND = b"macrofit study "
MAGIC = KIND + b"2\n"


class RunRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A finished run: its curve and its largest values."""

    digest: str
    displacement_mm: list[float]
    force_N: list[float]  # noqa: N815 - the unit newton
    max_von_mises: dict[str, Extreme]  # "axle", "wheel"
    counters: dict[str, int]
    cutbacks: int
    unconverged: int
    cpu_s: float
    plastic_strain: dict[str, float] = {}  # largest accumulated, of the bodies that may yield
    plastic_work: float = 0.0  # N mm
    holds: float | None = None  # N, see `acceptance.run`
    doubts: list[str] = []  # a sentence each, see `results.doubts`

    @staticmethod
    def of(digest: str, solution: Solution, cpu_s: float) -> RunRecord:
        """What is kept of a solution."""
        return RunRecord(
            digest=digest,
            displacement_mm=solution.displacement.tolist(),
            force_N=solution.force.tolist(),
            max_von_mises=dict(solution.max_von_mises),
            counters=dict(solution.counters),
            cutbacks=sum(record.cutbacks for record in solution.increments),
            unconverged=sum(not record.converged for record in solution.increments),
            cpu_s=cpu_s,
            plastic_strain={body: zone.value for body, zone in solution.flowed.items()},
            plastic_work=float(sum(record.plastic_work for record in solution.increments)),
            holds=holds(solution),
            doubts=doubts(solution),
        )

    @property
    def displacement(self) -> FloatArray:
        """Displacements of the increments [mm]."""
        return np.array(self.displacement_mm)

    @property
    def force(self) -> FloatArray:
        """Pushing force at the increments [N]."""
        return np.array(self.force_N)

    @property
    def peak(self) -> tuple[float, float]:
        """Largest force [N] and its displacement [mm]."""
        top = int(np.argmax(self.force))
        return self.force_N[top], self.displacement_mm[top]


class Named(msgspec.Struct, frozen=True):
    """What every record says of its run."""

    digest: str


class Record(Protocol):
    """What a study keeps of a run."""

    @property
    def digest(self) -> str:
        """That of everything that determines the run."""
        ...


Kept = TypeVar("Kept", bound=Record)


class RecordFile(Generic[Kept]):
    """An append-only file of finished runs, one frame each; a kill can only tear the last one."""

    def __init__(self, path: Path, kind: type[Kept], magic: bytes, *, replace: bool) -> None:
        """Open or make the file of records of a kind, and read what it holds unless it is to be replaced.

        Raises:
            OutputError: it is in use, does not begin with ``magic``, is damaged, or cannot be written.
        """
        self.path, self._kind, self._magic = path, kind, magic
        self.records: dict[str, Kept] = {}
        if replace or not path.exists():
            self._log = Log.create(path, magic)
            return
        self._log = Log.open(path)
        try:
            self._log.cut(self._read(path.read_bytes()))
        except BaseException:
            self.close()
            raise

    def append(self, record: Kept) -> None:
        """Keep one more.

        Raises:
            OutputError: it cannot be written; what was kept before stays.
        """
        self._log.append(msgspec.msgpack.encode(record))
        self.records[record.digest] = record

    def close(self) -> None:
        """Release the file."""
        self._log.close()

    def _read(self, held: bytes) -> int:
        """Fill the records; gives the place where the last whole one ends."""
        if not held.startswith(self._magic):
            raise OutputError(
                f"{self.path}: is of a study of another version of macrofit; start again without --resume"
            )
        end = len(self._magic)
        try:
            for content, place in frames(held, end):
                record = msgspec.msgpack.decode(content, type=self._kind)
                self.records[record.digest] = record
                end = place
        except (ValueError, msgspec.MsgspecError) as error:
            raise OutputError(f"{self.path}: {error}; start again without --resume") from None
        return end


class StudyFile(RecordFile[RunRecord]):
    """The file of a study of press fits."""

    def __init__(self, path: Path, *, replace: bool) -> None:
        """Open or make the file, see `RecordFile`."""
        super().__init__(path, RunRecord, MAGIC, replace=replace)


def is_study(path: Path) -> bool:
    """Whether the file is there and starts as one of a study does."""
    return starts_with(path, KIND)


def held_digests(path: Path) -> set[str]:
    """Digests of the runs in a file of records of any kind, which may be damaged or missing."""
    try:
        data = path.read_bytes()
        first = data.index(b"\n") + 1
        return {msgspec.msgpack.decode(content, type=Named).digest for content, _ in frames(data, first)}
    except (OSError, ValueError, msgspec.MsgspecError):
        return set()


def total(records: Iterable[RunRecord], counter: str) -> int:
    """Sum of a counter over runs."""
    return sum(record.counters.get(counter, 0) for record in records)
