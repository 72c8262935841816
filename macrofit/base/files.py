"""Writing files so that none is ever half there, reading those of strangers within bounds; a failure names the file."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from .errors import OutputError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the errors that more room would mend."""


KINDS = (
    (stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"), (stat.S_ISBLK, "a device"),
)  # fmt: skip
"""What a name may stand for besides a file that can be read to its end."""


def check_regular(path: Path, most_bytes: int) -> int:
    """The size of a file [bytes], once it is seen to be a regular one of at most ``most_bytes``.

    Nothing is opened: a pipe or a device would keep its reader waiting.

    Raises:
        OutputError: there is no such file, it is something else than a file, or a larger one.
    """
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    return _bounded(path, found, most_bytes)


def read_regular(path: Path, most_bytes: int) -> bytes:
    """All bytes of a regular file, whose size is bounded before it is read. The one way to open a stranger's file.

    Raises:
        OutputError: as `check_regular`, or it cannot be read.
    """
    check_regular(path, most_bytes)
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(descriptor, "rb") as file:
            size = _bounded(path, os.fstat(descriptor), most_bytes)  # another file may stand there by now
            data = _read_up_to(file, size, most_bytes + 1)
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(data) > most_bytes:
        raise OutputError(_too_large(path, "more", most_bytes))
    return data


def _read_up_to(file: BinaryIO, size: int, most: int) -> bytes:
    """All that an open file of about ``size`` bytes holds, at most so much: only what is there takes memory."""
    parts: list[bytes] = []
    while most > 0 and (part := file.read(min(most, max(size + 1, 4096)))):
        parts.append(part)
        most -= len(part)
    return b"".join(parts)


def _bounded(path: Path, found: os.stat_result, most_bytes: int) -> int:
    if not stat.S_ISREG(found.st_mode):
        kind = next((name for test, name in KINDS if test(found.st_mode)), "something else")
        raise OutputError(f"{path}: cannot be read: is {kind}, not a file")
    if found.st_size > most_bytes:
        raise OutputError(_too_large(path, in_bytes(found.st_size), most_bytes))
    return found.st_size


def _too_large(path: Path, size: str, most_bytes: int) -> str:
    return f"{path}: cannot be read: is larger than {in_bytes(most_bytes)}, the most for a file of its kind ({size})"


def placed_names(given: Any, folder: Path) -> Any:
    """A file's name, several, or a table with `files`, made absolute: relative names begin in a folder."""
    if isinstance(given, str):
        return str((folder / given).resolve()) if given else given
    if isinstance(given, list | tuple):
        return [placed_names(each, folder) if isinstance(each, str) else each for each in given]
    if isinstance(given, Mapping) and "files" in given:
        return {**given, "files": placed_names(given["files"], folder)}
    return given


def keep_inputs(targets: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Refuse to write over what is read.

    Raises:
        OutputError: an output is one of the inputs, by this name or another.
    """
    read = {path.resolve() for path in inputs}
    for target in targets:
        if target.resolve() in read:
            raise OutputError(f"{target}: is read by this command, and would be written over: give -o another name")


def in_bytes(size: int) -> str:
    """A size in bytes, kB, MB or GB."""
    for factor, unit in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size} bytes"


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn a failure to write ``path`` (disk full, no permission) into one line that names it.

    Raises:
        OutputError: it cannot be written.
    """
    try:
        yield
    except OSError as error:
        room = "make room, then give the same command, with --resume where it has that"
        remedy = room if error.errno in FULL else "choose another place with -o"
        raise OutputError(f"{path}: cannot be written: {error.strerror or error} ({remedy})") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name of this process to write to, which takes the place of ``path`` when all went well.

    Folders on the way are made. Processes may write the same file at once: the last one to end wins, and the file is
    whole at any moment.

    Raises:
        OutputError: the file cannot be written; what was there before is then intact.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        draft = Path(name)
        try:
            yield draft
            draft.chmod(0o666 & ~_umask())  # mkstemp makes files that only the user may read
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)


DRAFT = re.compile(r"\.\w[\w.-]*\.[a-z0-9_]{8}\.(?:csv|h5|json|npz|png|pvd|toml|vtk|vtu)")
"""Names of drafts, see `replacing`."""


def remove_drafts(*folders: Path) -> None:
    """Remove the drafts of a process that was killed; call it where no other process may write into the folders."""
    for folder in folders:
        with suppress(OSError):
            for path in folder.iterdir():
                if DRAFT.fullmatch(path.name):
                    path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a whole text file, in UTF-8.

    Raises:
        OutputError: it cannot be written.
    """
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file for people and programs: indented by two, NaN as null.

    Raises:
        OutputError: it cannot be written.
    """
    import msgspec

    with replacing(path) as draft:
        draft.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")


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


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep a folder, which is made, from other processes that ask for the same.

    Raises:
        OutputError: another process has it, or it cannot be made.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"{folder}: another process is writing into it; wait for it, or choose another place with -o"
            ) from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(descriptor)


def force_to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def starts_with(path: Path, magic: bytes) -> bool:
    """Whether the file is there and starts with these bytes."""
    try:
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError:
        return False


def cache_folder() -> Path | None:
    """MACROFIT_CACHE, or macrofit in the user's cache folder (XDG_CACHE_HOME, ~/.cache); None without a home."""
    own = os.environ.get("MACROFIT_CACHE")
    if own:
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return None if base.startswith("~") else Path(base) / "macrofit"


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
