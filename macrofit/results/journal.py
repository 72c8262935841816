"""The journal of a run: every accepted increment with the state to go on from, safe against a kill.

The file starts with a signature and a frame that holds the scene; then comes one frame per increment, written
by one call once the increment is accepted. A kill can only tear the last one, and reading drops it. The data
go to the operating system at once but are not forced onto the disk: a power cut may cost the last increments.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from ..base.arrays import FloatArray, IntArray
from ..base.files import read_regular, starts_with
from ..base.log import Log, frame, frames, lock_free
from ..errors import OutputError
from ..scene import Scene
from ..solution import Increment
from .encoding import State, decode, encode

MAGIC = b"macrofit journal\n"
VERSION = 6
"""Version of the frames and of what is in them; 5 had no deviation of the friction, 4 no thermal strain, torque and
shear, 3 increments without plastic work, 2 frames of another form."""


class _Header(msgspec.Struct, array_like=True):
    version: int
    digest: str  # sha256 of the scene
    scene: bytes  # the resolved scene, as JSON
    meshes: dict[str, str]  # key of a file, of a mesh or of a provider's option -> sha256 of its content


class _Content(NamedTuple):
    header: _Header
    records: list[tuple[Increment, State]]
    end: int  # where the last whole record ends [bytes]


class Journal:
    """An append-only file of increments; made by `start` or `resume`, closed by leaving the `with` block."""

    def __init__(self, log: Log | None, records: list[tuple[Increment, State]]) -> None:
        self._log = log
        self._records = records

    @classmethod
    def start(cls, path: Path, scene: Scene, *, replace: bool = False) -> Journal:
        """A new journal in place of whatever journal is there.

        Raises:
            OutputError: a run is writing it; or, unless ``replace``, it holds increments of this very scene, which
                `resume` could go on from; or it cannot be written.
        """
        if path.exists():
            _refuse_to_lose(path, scene, replace)
        return cls(Log.create(path, MAGIC + frame(msgspec.msgpack.encode(_header(scene)))), [])

    @classmethod
    def resume(cls, path: Path, scene: Scene) -> Journal:
        """The journal that is there, to go on after its last whole record.

        Raises:
            OutputError: not a journal, damaged, of another version or scene, in use, or not writable.
        """
        log = Log.open(path)
        try:
            content = _read(path)
            _same_scene(path, content.header, scene)
            log.cut(content.end)
        except BaseException:
            log.close()
            raise
        return cls(log, content.records)

    @classmethod
    def elsewhere(cls) -> Journal:
        """A journal without a file, for the ranks that do not write: empty, and it keeps nothing."""
        return cls(None, [])

    def records(self) -> list[tuple[Increment, State]]:
        """The increments found when the journal was opened, each with the state after it."""
        return list(self._records)

    def append(self, record: Increment, state: Mapping[str, FloatArray | IntArray]) -> None:
        """Write an accepted increment and the state after it.

        Raises:
            OutputError: it cannot be written; the increments written before stay readable.
        """
        if self._log is not None:
            self._log.append(encode(record, state))

    def close(self) -> None:
        """Release the file."""
        if self._log is not None:
            self._log.close()
            self._log = None

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def is_journal(path: Path) -> bool:
    """Whether the file is there and starts as a journal does."""
    return starts_with(path, MAGIC)


def _refuse_to_lose(path: Path, scene: Scene, replace: bool) -> None:
    lock_free(path)
    if replace or not is_journal(path):
        return
    try:
        content = _read(path)
        _same_scene(path, content.header, scene)
    except OutputError:
        return  # another scene, or nothing that could be resumed
    if content.records:
        raise OutputError(
            f"{path.parent}: holds an unfinished run of this scene, {len(content.records)} increments; "
            f"continue it with --resume, choose another folder with -o, or delete this one"
        )


LARGEST_FILE = 1_000_000_000
"""Size of a file that a scene names; a mesh of a million nodes has 0.1 GB."""


def _header(scene: Scene) -> _Header:
    return _Header(VERSION, scene_digest(scene), _encoded(scene), file_digests(scene))


def _encoded(scene: Scene) -> bytes:
    return msgspec.json.encode(scene, order="deterministic")


def scene_digest(scene: Scene) -> str:
    """SHA-256 of a resolved scene, in hexadecimal."""
    return hashlib.sha256(_encoded(scene)).hexdigest()


def file_digests(scene: Scene) -> dict[str, str]:
    """SHA-256 of the content of each file that a scene names, by its key."""
    return {key: file_digest(file) for key, file in named_files(scene).items()}


def file_digest(file: str) -> str:
    """SHA-256 of a file's content, in hexadecimal.

    Raises:
        OutputError: see `read_regular`.
    """
    return hashlib.sha256(read_regular(Path(file), LARGEST_FILE)).hexdigest()


def named_files(scene: Scene) -> dict[str, str]:
    """The files that a scene names and that are there, by their keys: meshes, profiles, files in friction options."""
    named = {f"mesh.{body}": getattr(scene.mesh, body) for body in ("axle", "wheel")}
    named |= {f"{key}.profile": getattr(getattr(scene, key), "profile", None) for key in ("axle", "wheel")}
    named |= _flat(scene.friction.options, "friction.options")
    return {key: value for key, value in named.items() if isinstance(value, str) and os.path.isfile(value)}


def _same_scene(path: Path, header: _Header, scene: Scene) -> None:
    now = _header(scene)
    if header.digest == now.digest and header.meshes == now.meshes:
        return
    old, new = _flat(msgspec.json.decode(header.scene), ""), _flat(msgspec.json.decode(now.scene), "")
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    files = sorted(header.meshes.keys() | now.meshes.keys())
    others = [f"content of {key}" for key in files if header.meshes.get(key) != now.meshes.get(key)]
    back = "put the file back as it was" if others else "run with the scene.toml beside it"
    if others and changed:
        back = f"{back} and run with the scene.toml beside it"
    changed += others
    listed = ", ".join(changed[:6]) + (", ..." if len(changed) > 6 else "")
    raise OutputError(f"{path}: is of another scene (changed: {listed}); {back}, or run without --resume")


def _flat(value: Any, where: str) -> dict[str, Any]:
    if isinstance(value, list | tuple) and any(isinstance(item, str) for item in value):
        value = {str(number): item for number, item in enumerate(value)}  # names of files among them
    if not isinstance(value, dict):
        return {where: value}
    return {
        name: item
        for key, child in value.items()
        for name, item in _flat(child, f"{where}.{key}" if where else key).items()
    }


def _read(path: Path) -> _Content:
    """Header and whole records; raises OutputError for a file that is no journal, is damaged or too new."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error.strerror}") from None
    header, end = _read_header(path, data)
    records: list[tuple[Increment, State]] = []
    try:
        for content, place in frames(data, end):
            records.append(decode(content))
            end = place
    except ValueError as error:
        raise OutputError(
            f"{path}: {error}, after {len(records)} increments; it may be of another version of macrofit; "
            f"run without --resume"
        ) from None
    return _Content(header, records, end)


def _read_header(path: Path, data: bytes) -> tuple[_Header, int]:
    if not data.startswith(MAGIC):
        raise OutputError(f"{path}: is not a journal of macrofit; choose another folder with -o")
    try:
        content, end = next(frames(data, len(MAGIC)))
        header = msgspec.msgpack.decode(content, type=_Header)
    except (StopIteration, ValueError, msgspec.MsgspecError):
        raise OutputError(
            f"{path}: its header is damaged, or of an older version of macrofit; run without --resume"
        ) from None
    if header.version != VERSION:
        raise OutputError(f"{path}: is of journal version {header.version}, not {VERSION}; run without --resume")
    return header, end
