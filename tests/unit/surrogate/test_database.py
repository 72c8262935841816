"""The database: whole after any kill, readable at any time, and a clear word about what is not one."""

from __future__ import annotations

import json
import os
import pickle
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest

from macrofit.base.errors import OutputError
from macrofit.base.log import frame
from surrogate.data import database, journal
from surrogate.data.database import Header, Samples, content_hash, describe_database, open_database, read_database
from surrogate.data.journal import journal_of
from surrogate.data.seal import HDF5, seal
from surrogate.errors import DatabaseError

HEADER = Header(
    design=json.dumps({"seed": 0, "levels": [3, 4]}),
    settings='title = "Two"\n\n[plates]\nspheres = 500\n',
    code="c0de",
    version="0.1.0",
    micro_frictions=2,
    squares=2,
    points=5,
)


def row(number: int, header: Header = HEADER) -> bytes:
    """A sample of numbers drawn from its id; some time went by, whatever the id."""
    rng = np.random.default_rng(number)
    made = np.zeros((), header.row())
    for name in header.row().names:
        kind = header.row()[name].base.kind
        if kind == "f":
            made[name] = rng.standard_normal(made[name].shape)
        elif kind == "i":
            made[name] = rng.integers(2**32)
    made["id"], made["engine"], made["remark"] = number, [b"quasi-static", b"explicit"], b"no equilibrium"
    made["cpu_s"] = time.perf_counter()
    return made.tobytes()


def fill(path: Path, numbers: list[int], header: Header = HEADER) -> set[int]:
    """Add what is not there; gives what was."""
    with open_database(path, header) as (writer, done):
        for number in numbers:
            if number not in done:
                writer.append(row(number))
    return done


def begun(path: Path, numbers: list[int]) -> None:
    """A database whose writer was ended early: all in the journal."""
    with suppress(KeyboardInterrupt), open_database(path, HEADER) as (writer, _):
        for number in numbers:
            writer.append(row(number))
        raise KeyboardInterrupt


def ids(path: Path) -> list[int]:
    return read_database(path).samples.id.tolist()


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "folder" / "a.h5"
    numbers = [5, 2, 9, 0]
    with open_database(path, HEADER) as (writer, done):
        assert done == set()
        for number in numbers:
            writer.append(row(number))
        writer.fail(3, "too few spheres")
        from_journal = read_database(path)
        writer.compact()
        writer.append(row(7))
        from_both = read_database(path)
    whole = read_database(path)
    assert not journal_of(path).exists()
    assert os.listdir(path.parent) == ["a.h5"]
    assert from_journal.samples.id.tolist() == [0, 2, 5, 9]
    assert from_both.samples.id.tolist() == whole.samples.id.tolist() == [0, 2, 5, 7, 9]
    assert from_both.content_hash == whole.content_hash != from_journal.content_hash
    assert whole.failures == from_journal.failures == {3: "too few spheres"}
    assert whole.header == HEADER
    expected = np.frombuffer(b"".join(row(number) for number in sorted([*numbers, 7])), HEADER.row())
    for field in fields(Samples):
        values = getattr(whole.samples, field.name)
        assert values.flags.c_contiguous
        if field.name != "cpu_s":
            assert values.dtype == expected[field.name].dtype
            assert np.array_equal(values, expected[field.name]), field.name


def test_the_hash_is_of_the_content_not_of_the_order_nor_the_time(tmp_path):
    fill(tmp_path / "a.h5", [0, 1, 2, 3])
    fill(tmp_path / "b.h5", [3, 1])
    fill(tmp_path / "b.h5", [0, 2, 3])
    a, b = read_database(tmp_path / "a.h5"), read_database(tmp_path / "b.h5")
    assert a.content_hash == b.content_hash == content_hash(a.samples)
    assert not np.array_equal(a.samples.cpu_s, b.samples.cpu_s)
    assert a.content_hash[:20] in describe_database(tmp_path / "a.h5")[1]
    a.samples.meso_friction[2, 1] += 1e-15
    assert content_hash(a.samples) != b.content_hash


def test_a_torn_tail_costs_one_sample_and_is_written_again(tmp_path):
    path = tmp_path / "a.h5"
    with open_database(path, HEADER) as (writer, _):
        for number in range(3):
            writer.append(row(number))
            whole = journal_of(path).read_bytes()
        before = len(whole) - len(frame(journal.encode(journal.Sample(row(2)))))
    fill(tmp_path / "b.h5", [0, 1, 2])
    cuts = [before, before + 1, before + 39, before + 40, before + 41, (before + len(whole)) // 2, len(whole) - 1]
    for cut in cuts:
        path.unlink(missing_ok=True)
        journal_of(path).write_bytes(whole[:cut])
        assert ids(path) == [0, 1]
        begun(path, [2])  # after the last whole frame, not after the torn one
        assert ids(path) == [0, 1, 2]
        journal_of(path).write_bytes(whole[:cut])
        assert fill(path, [0, 1, 2]) == {0, 1}
        assert read_database(path).content_hash == read_database(tmp_path / "b.h5").content_hash
    path.unlink()
    journal_of(path).write_bytes(whole[: before + 100] + bytes(len(whole) - before - 100))  # a power cut
    assert ids(path) == [0, 1]
    journal_of(path).write_bytes(whole[:before] + bytes(50_000))
    assert ids(path) == [0, 1]


def test_a_damaged_journal_is_told_of(tmp_path):
    path = tmp_path / "a.h5"
    begun(path, list(range(400)))
    whole = journal_of(path).read_bytes()
    assert len(ids(path)) == 400
    frame = len(journal.frame(msgspec.msgpack.encode(journal.Sample(row(0)))))
    first = len(whole) - 400 * frame
    for place in (
        first,
        first + 7,
        first + 12,
        first + 60,
        30,
    ):  # low and high byte of a length, checksum, content, header
        garbled = bytearray(whole)
        garbled[place] ^= 0x40
        journal_of(path).write_bytes(garbled)
        with pytest.raises(DatabaseError, match=r"a\.h5\.journal: is damaged.*move it away"):
            read_database(path)
        with pytest.raises(DatabaseError, match="damaged"):
            fill(path, [0])
        assert journal_of(path).read_bytes() == garbled
    journal_of(path).write_bytes(b"something else")
    with pytest.raises(DatabaseError, match="is not the journal"):
        read_database(path)


def test_a_kill_between_file_and_journal_doubles_nothing(tmp_path):
    path = tmp_path / "a.h5"
    with open_database(path, HEADER) as (writer, _):
        writer.append(row(0))
        writer.fail(1, "why")
        old = journal_of(path).read_bytes()
        writer.compact()
    journal_of(path).write_bytes(old)
    (tmp_path / ".a.h5.draft").write_bytes(b"half a file")
    found = read_database(path)
    assert found.samples.id.tolist() == [0]
    assert fill(path, [0, 2]) == {0, 1}
    with h5py.File(path) as file:
        assert file["samples/id"][:].tolist() == [0, 2]
        assert file["failures/id"][:].tolist() == [1]
    assert read_database(path).failures == {1: "why"}
    assert os.listdir(tmp_path) == ["a.h5"]


@contextmanager
def changed(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file to be changed, whose seal is then made anew: what else is wrong with it must be told."""
    with h5py.File(path, "r+") as file:
        yield file
    seal(path)


def foreign_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["samples"] = np.zeros(3)


def other_schema(path: Path) -> None:
    fill(path, [0])
    with changed(path) as file:
        file.attrs["schema"] = 99


def lacks_a_field(path: Path) -> None:
    fill(path, [0])
    with changed(path) as file:
        del file["samples/uncertainty"]


def another_number(path: Path) -> None:
    fill(path, [0, 1])
    with changed(path) as file:
        file["samples/meso_friction"][1, 1] += 1e-9


def doubled(path: Path) -> None:
    fill(path, [0])
    with changed(path) as file:
        database._extend(file, np.frombuffer(row(0), HEADER.row()), {})


def other_plates(path: Path) -> None:
    fill(path, [0])
    with h5py.File(path, "r+") as file:
        file.attrs["settings"] = HEADER.settings.replace("500", "501")


def another_reason(path: Path) -> None:
    with open_database(path, HEADER) as (writer, _):
        writer.append(row(0))
        writer.fail(1, "no equilibrium")
    with h5py.File(path, "r+") as file:
        file["failures/id"][0] = 2


def header_that_is_no_text(path: Path) -> None:
    fill(path, [0])
    with changed(path) as file:
        file.attrs["settings"] = b"\xff\xfe"


def another_time(path: Path) -> None:
    fill(path, [0])
    with h5py.File(path, "r+") as file:
        file["samples/cpu_s"][0] *= 2.0


def cut_in_half(path: Path) -> None:
    fill(path, [0, 1])
    os.truncate(path, path.stat().st_size // 2)


def cut_in_its_head(path: Path) -> None:
    fill(path, [0, 1])
    os.truncate(path, 100)


def pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps(pytest.fail))


BAD = {
    foreign_hdf5: "not a database",
    other_schema: "schema 99",
    lacks_a_field: "damaged",
    another_number: "does not match its checksum",
    doubled: "twice",
    other_plates: "its check sum is wrong",
    another_reason: "its check sum is wrong",
    header_that_is_no_text: "damaged",
    another_time: "its check sum is wrong",
    cut_in_half: "its check sum is wrong",
    cut_in_its_head: "its check sum is wrong",
    pickled: "not an HDF5 file",
    Path.touch: "not an HDF5 file",
    Path.mkdir: "cannot be read",
}


@pytest.mark.parametrize(("spoil", "message"), BAD.items(), ids=[spoil.__name__ for spoil in BAD])
def test_what_is_no_whole_database_is_refused_by_name(spoil, message, tmp_path):
    path = tmp_path / "a.h5"
    spoil(path)
    with pytest.raises(DatabaseError, match=rf"a\.h5: .*{message}"):
        read_database(path)
    if spoil in (foreign_hdf5, other_schema, pickled, Path.touch, Path.mkdir, cut_in_half):
        before = None if path.is_dir() else path.read_bytes()
        with pytest.raises(DatabaseError, match=r"a\.h5: "):
            fill(path, [0])
        assert path.is_dir() or path.read_bytes() == before
        assert os.listdir(tmp_path) == ["a.h5"]


def test_flipped_bits_of_the_layout_end_in_a_line(tmp_path: Path) -> None:
    """Where HDF5 opened the file first, one in 300 ended the process in HDF5 itself."""
    fill(tmp_path / "a.h5", list(range(3)))
    whole = (tmp_path / "a.h5").read_bytes()
    rng = np.random.default_rng(3)
    for place in [*rng.integers(0, 12_000, 200), *rng.integers(0, len(whole), 20)]:
        spoilt = bytearray(whole)
        spoilt[place] ^= 1 << int(rng.integers(8))
        (tmp_path / "a.h5").write_bytes(spoilt)
        with pytest.raises(DatabaseError, match=r"check sum|not an HDF5 file"):
            read_database(tmp_path / "a.h5")


def test_a_database_of_an_older_version_is_read_and_filled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has no seal, and gets none."""
    with monkeypatch.context() as before:
        before.setattr(database, "SIZE", 0)
        before.setattr(database, "seal", lambda path: None)
        fill(tmp_path / "a.h5", [0, 1])
    assert (tmp_path / "a.h5").read_bytes().startswith(HDF5)
    assert fill(tmp_path / "a.h5", [0, 1, 2]) == {0, 1}
    assert ids(tmp_path / "a.h5") == [0, 1, 2]


def test_none_there(tmp_path):
    with pytest.raises(DatabaseError, match=r"none\.h5: there is no such database"):
        read_database(tmp_path / "none.h5")


CHANGES = {
    "design": (json.dumps({"seed": 1, "levels": [3, 4]}), "seed was 0, now 1"),
    "settings": (HEADER.settings.replace("500", "600"), "spheres = 500"),
    "code": ("another", "code of the plates was c0de, now another"),
    "squares": (3, "another shape"),
}


@pytest.mark.parametrize("ended", [True, False])
@pytest.mark.parametrize("key", CHANGES)
def test_another_header_is_refused(key, ended, tmp_path):
    path = tmp_path / "a.h5"
    (fill if ended else begun)(path, [0])
    before = sorted(os.listdir(tmp_path))
    value, message = CHANGES[key]
    with pytest.raises(DatabaseError, match=message):
        fill(path, [0], msgspec.structs.replace(HEADER, **{key: value}))
    assert ids(path) == [0]
    assert sorted(os.listdir(tmp_path)) == before


def test_another_version_of_the_same_code_goes_on(tmp_path):
    path = tmp_path / "a.h5"
    fill(path, [0])
    later = msgspec.structs.replace(HEADER, version="0.2.0")
    with open_database(path, later) as (writer, done):
        assert done == {0}
        writer.append(row(1))
        assert ids(path) == [0, 1]
    assert read_database(path).header.version == "0.1.0"


def test_one_writer_at_a_time(tmp_path):
    path = tmp_path / "a.h5"
    with open_database(path, HEADER) as (writer, _):
        for _ in range(2):
            with pytest.raises(OutputError, match="another process is writing it"):
                fill(path, [1])
            writer.fail(0, "why")
            writer.compact()  # the new journal is as locked as the first
    assert fill(path, [1]) == {0}


def test_a_full_disk_keeps_what_was_there(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"

    def half(descriptor: int, data: bytes) -> int:
        real(descriptor, data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    real = os.write
    begun(path, [0])
    monkeypatch.setattr(os, "write", half)
    with pytest.raises(OutputError, match=r"a\.h5\.journal: cannot be written: No space left"):
        fill(path, [1])
    monkeypatch.undo()
    assert ids(path) == [0]
    assert fill(path, [0, 1]) == {0}
    assert ids(path) == [0, 1]


WRITER = """
import sys, time
sys.path.insert(0, {folder!r})
from pathlib import Path
import test_database as here
here.database.JOURNALLED = 4
with here.open_database(Path(sys.argv[1]), here.HEADER) as (writer, done):
    print("ready", flush=True)
    for number in range(int(sys.argv[2])):
        if number not in done:
            writer.append(here.row(number))
            if number % 10 == 9:
                writer.fail(10**6 + number, "why")
"""


def writing(path: Path, count: int) -> subprocess.Popen[str]:
    script = WRITER.format(folder=str(Path(__file__).parent))
    return subprocess.Popen([sys.executable, "-c", script, str(path), str(count)], stdout=subprocess.PIPE, text=True)


def test_killed_at_any_moment_and_gone_on_with(tmp_path):
    """The journal is emptied every fourth sample, so that many kills fall into that."""
    path, count, delays = tmp_path / "a.h5", 1500, random.Random(1)
    seen: set[int] = set()
    for _ in range(10):
        process = writing(path, count)
        assert process.stdout.readline() == "ready\n"
        time.sleep(delays.uniform(0.0, 0.12))
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
        there = ids(path)
        assert len(there) == len(set(there))
        assert seen <= set(there)  # nothing that was there is lost
        seen = set(there)
    assert 0 < len(seen) < count
    whole = list(range(max(seen) + 10))
    fill(path, whole)
    assert ids(path) == whole
    expected = np.frombuffer(b"".join(map(row, whole)), HEADER.row())
    assert read_database(path).content_hash == content_hash(
        Samples(**{name: expected[name] for name in expected.dtype.names})
    )
    with h5py.File(path) as file:
        assert len(set(file["failures/id"][:])) == len(file["failures/id"])
    assert os.listdir(tmp_path).count(".a.h5.draft") == 0


def test_read_while_it_is_written(tmp_path):
    path, count = tmp_path / "a.h5", 60
    process = writing(path, count)
    assert process.stdout.readline() == "ready\n"
    lengths = []
    while process.poll() is None:
        there = ids(path)
        assert there == list(range(len(there)))
        lengths.append(len(there))
    process.stdout.close()
    assert process.returncode == 0
    assert lengths == sorted(lengths)
    assert len(set(lengths)) > 3
    assert ids(path) == list(range(count))


FULL = """
import resource, sys
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from test_database import HEADER, open_database, row
from macrofit.base.errors import OutputError

with_room = int(sys.argv[3])
try:
    with open_database(Path(sys.argv[1]), HEADER) as (writer, done):
        for number in range(8):
            if number not in done:
                writer.append(row(number))
        resource.setrlimit(resource.RLIMIT_FSIZE, (with_room, resource.RLIM_INFINITY))
except OutputError as error:
    print(error)
"""


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9])
def test_a_disk_that_fills_under_hdf5(share: float, tmp_path: Path) -> None:
    """HDF5 ended the process (SIGSEGV) where it met a full disk; now it is asked for room first."""
    begun(tmp_path / "whole.h5", list(range(8)))
    fill(tmp_path / "whole.h5", [])
    room = int(share * (tmp_path / "whole.h5").stat().st_size)
    path, here = tmp_path / "a.h5", Path(__file__).parent
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path), str(here), str(room)],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "cannot be written: File too large (make room" in done.stdout
    assert set(os.listdir(tmp_path)) == {
        "whole.h5",
        "a.h5.journal",
    }
    assert fill(path, []) == set(range(8))
    assert content_hash(read_database(path).samples) == content_hash(read_database(tmp_path / "whole.h5").samples)
