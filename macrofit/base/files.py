"""Writing files so that none is ever half there, and so that a failure names the file."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import OutputError


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn a failure to write ``path`` (disk full, no permission) into an OutputError that names it."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        remedy = "make room, then go on with --resume" if full else "choose another folder with -o"
        raise OutputError(f"{path}: cannot be written: {reason} ({remedy})") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name to write to, which takes the place of ``path`` when all went well.

    Raises OutputError when the file cannot be written; what was there before is then intact.
    """
    draft = path.with_name(f".{path.stem}.new{path.suffix}")
    try:
        with writing(path):
            yield draft
            os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def append_whole(descriptor: int, data: bytes) -> None:
    """Write at the end of an open file either all of ``data`` or, where that fails (OSError), nothing."""
    end = os.lseek(descriptor, 0, os.SEEK_END)
    rest = memoryview(data)
    try:
        while rest:
            rest = rest[os.write(descriptor, rest) :]
    except BaseException:
        os.ftruncate(descriptor, end)
        raise
