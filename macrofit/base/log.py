"""Append-only files of frames, under a lock, safe against a kill: journals of runs, studies and databases.

    magic, frame of the header, frame, frame, ...

A frame is a head (length of the content, CRC-32 of that length, SHA-256 of the content), the content, and one byte that
is not zero. Check and last byte tell a frame that was torn while it was written, which can only be the last, from one
that is damaged.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from .errors import OutputError
from .files import append_whole, force_to_disk, writing

_LENGTH = struct.Struct("<Q")
_HEAD = struct.Struct("<QI32s")
_END = b"\xff"
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK)


class Log:
    """An append-only file that this process alone writes; made by `create` or `open`.

    Args:
        path: the file, for messages.
        descriptor: the open and locked file.
        durable: force every frame onto the disk before `append` returns.
    """

    def __init__(self, path: Path, descriptor: int, *, durable: bool) -> None:
        self.path, self._descriptor, self._durable = path, descriptor, durable

    @classmethod
    def create(cls, path: Path, head: bytes, *, durable: bool = False) -> Log:
        """A file that holds ``head`` alone, in place of what is there; it never lacks its head.

        Raises:
            OutputError: another process is writing it, or it cannot be written.
        """
        old = _locked(path, os.O_RDWR) if path.exists() else None
        try:
            return cls(path, _fresh(path, head, new=old is None, durable=durable), durable=durable)
        finally:
            if old is not None:
                os.close(old)

    @classmethod
    def open(cls, path: Path, *, durable: bool = False) -> Log:
        """The file that is there.

        Raises:
            OutputError: another process is writing it, or it cannot be written.
        """
        return cls(path, _locked(path, os.O_RDWR | os.O_APPEND), durable=durable)

    def append(self, content: bytes) -> None:
        """Write one frame.

        Raises:
            OutputError: it cannot be written; all before it stay readable.
        """
        with writing(self.path):
            append_whole(self._descriptor, frame(content))
            if self._durable:
                os.fsync(self._descriptor)

    def restart(self, head: bytes) -> None:
        """Put a file that holds ``head`` alone in the place of this one, without letting go of the lock.

        Raises:
            OutputError: it cannot be written; the file is then what it was.
        """
        fresh = _fresh(self.path, head, new=False, durable=self._durable)
        os.close(self._descriptor)
        self._descriptor = fresh

    def cut(self, end: int) -> None:
        """Drop what stands behind this place [bytes], such as a torn frame.

        Raises:
            OutputError: it cannot be written.
        """
        with writing(self.path):
            os.ftruncate(self._descriptor, end)

    def close(self) -> None:
        """Release the file."""
        os.close(self._descriptor)


def frame(content: bytes) -> bytes:
    """The content as one frame."""
    length = len(content)
    return _HEAD.pack(length, zlib.crc32(_LENGTH.pack(length)), hashlib.sha256(content).digest()) + content + _END


def frames(data: bytes, start: int) -> Iterator[tuple[bytes, int]]:
    """Contents of the frames from ``start`` on, each with the place where its frame ends [bytes].

    Stops before a last frame that was torn while it was written, by a kill or (zeros) by a power cut.

    Raises:
        ValueError: a frame is damaged.
    """
    place = start
    while place + _HEAD.size <= len(data):
        length, check, digest = _HEAD.unpack_from(data, place)
        if check != zlib.crc32(_LENGTH.pack(length)):
            if not any(data[place:]):
                return
            raise ValueError(f"damaged at byte {place}")
        end = place + _HEAD.size + length + len(_END)
        if end > len(data):
            return
        content, mark = data[place + _HEAD.size : end - 1], data[end - 1 : end]
        if mark != _END or hashlib.sha256(content).digest() != digest:
            if end == len(data) and mark == b"\0":
                return
            raise ValueError(f"damaged at byte {place}")
        yield content, end
        place = end


def lock_free(path: Path) -> None:
    """Make sure that no process is writing a log.

    Raises:
        OutputError: one is, or the file cannot be opened.
    """
    os.close(_locked(path, os.O_RDWR))


def _locked(path: Path, flags: int) -> int:
    """A descriptor of the file that is there, which no other process may have."""
    with writing(path):
        descriptor = os.open(path, flags | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        own = path.exists() and os.path.samestat(os.fstat(descriptor), path.stat())  # or it was replaced meanwhile
    except BlockingIOError:
        own = False
    except OSError:  # a file system without locks
        own = True
    if not own:
        os.close(descriptor)
        raise in_use(path)
    return descriptor


def in_use(path: Path) -> OutputError:
    """The error of a file that another process is writing."""
    return OutputError(f"{path}: another process is writing it; wait for it, or choose another place with -o")


def _fresh(path: Path, head: bytes, *, new: bool, durable: bool) -> int:
    """A locked file with this content under its final name; ``new``: nothing may have that name yet."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.new")
    with writing(path):
        descriptor = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND | os.O_CLOEXEC, 0o666)
        try:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            append_whole(descriptor, head)
            if durable:
                os.fsync(descriptor)
            _put_in_place(draft, path, new=new)
            if durable:
                force_to_disk(path.parent)
        except BaseException:
            os.close(descriptor)
            raise
        finally:
            draft.unlink(missing_ok=True)
    return descriptor


def _put_in_place(draft: Path, path: Path, *, new: bool) -> None:
    """Give the draft its name; where nothing was there, nothing may have come meanwhile."""
    if new:
        try:
            os.link(draft, path)
        except FileExistsError:
            raise in_use(path) from None
        except OSError as error:
            if error.errno not in _NO_LINKS:
                raise
        else:
            return
    os.replace(draft, path)
