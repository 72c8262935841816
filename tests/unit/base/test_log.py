"""Append-only logs: torn frames are dropped, damaged ones are said, one process writes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from macrofit.base.errors import OutputError
from macrofit.base.log import Log, frame, frames, lock_free

HEAD = b"a log of tests\n"
CONTENTS = [b"first", b"", bytes(range(256)) * 3, b"\0" * 40]


def written(path: Path) -> bytes:
    log = Log.create(path, HEAD)
    for content in CONTENTS:
        log.append(content)
    log.close()
    return path.read_bytes()


def contents(data: bytes) -> list[bytes]:
    return [content for content, _ in frames(data, len(HEAD))]


def test_frames_come_back(tmp_path: Path) -> None:
    data = written(tmp_path / "log")
    assert contents(data) == CONTENTS
    assert [end for _, end in frames(data, len(HEAD))][-1] == len(data)


def test_a_torn_end_is_dropped_at_every_byte(tmp_path: Path) -> None:
    data = written(tmp_path / "log")
    ends = [len(HEAD), *(end for _, end in frames(data, len(HEAD)))]
    for cut in range(len(HEAD), len(data)):
        assert len(contents(data[:cut])) == sum(end <= cut for end in ends) - 1, cut


def test_no_flipped_bit_goes_unseen(tmp_path: Path) -> None:
    """A length that was damaged must not pass for a torn end."""
    data = written(tmp_path / "log")
    for place in range(len(HEAD), len(data)):
        flipped = bytearray(data)
        flipped[place] ^= 1 << place % 8
        with pytest.raises(ValueError, match="damaged at byte"):
            contents(bytes(flipped))


def test_zeros_of_a_power_cut_are_dropped(tmp_path: Path) -> None:
    data = written(tmp_path / "log")
    assert contents(data + b"\0" * 200) == CONTENTS
    last = frame(b"never reached the disk")
    for written_bytes in range(44, len(last)):
        assert contents(data + last[:written_bytes] + b"\0" * (len(last) - written_bytes)) == CONTENTS


HOLD = """
import sys, time
from pathlib import Path
from macrofit.base.log import Log
log = Log.{how}
print("held", flush=True)
time.sleep(60)
"""


@pytest.mark.parametrize("how", ["create(Path(sys.argv[1]), b'a log of tests\\n')", "open(Path(sys.argv[1]))"])
def test_one_process_writes(how: str, tmp_path: Path) -> None:
    path = tmp_path / "log"
    if how.startswith("open"):
        written(path)
    program = [sys.executable, "-c", HOLD.format(how=how), str(path)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        before = path.read_bytes()
        for attempt in (lambda: Log.create(path, HEAD), lambda: Log.open(path), lambda: lock_free(path)):
            with pytest.raises(OutputError, match="another process is writing it"):
                attempt()
        assert path.read_bytes() == before
        holder.kill()
    Log.open(path).close()


def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log"
    monkeypatch.setattr(Path, "exists", lambda self: False)
    path.write_bytes(b"of another")
    with pytest.raises(OutputError, match="another process is writing it"):
        Log.create(path, HEAD)
    assert path.read_bytes() == b"of another"
    assert os.listdir(tmp_path) == ["log"]


def test_a_log_that_was_replaced_meanwhile_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log"
    written(path)
    monkeypatch.setattr(os.path, "samestat", lambda *_: False)
    with pytest.raises(OutputError, match="another process is writing it"):
        Log.open(path)


def test_restart_keeps_the_lock(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = Log.create(path, HEAD)
    log.append(b"old")
    log.restart(HEAD)
    log.append(b"new")
    with pytest.raises(OutputError):
        lock_free(path)
    log.close()
    lock_free(path)
    assert contents(path.read_bytes()) == [b"new"]


def test_a_full_disk_leaves_what_was_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log"
    log = Log.create(path, HEAD)
    log.append(b"first")
    real = os.write

    def half(descriptor: int, data: bytes) -> int:
        if len(data) > 10:
            return real(descriptor, bytes(data[:10]))
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", half)
    with pytest.raises(OutputError, match=r"log: cannot be written: No space left on device \(make room"):
        log.append(b"second")
    monkeypatch.undo()
    log.append(b"third")
    log.close()
    assert contents(path.read_bytes()) == [b"first", b"third"]
