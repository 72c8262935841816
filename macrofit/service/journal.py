"""What a service computation keeps as it goes: its press, the released fit, and every step of its rotation.

press.bin is the journal of increments that a run has too. rotation.bin begins with the digest of the scene; then come a
frame of the released fit and one of each step, written by one call as soon as it is solved. A step that is there is
not solved again, so that a computation goes on to the same bits.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..base.arrays import FloatArray, IntArray
from ..base.files import read_regular, remove_drafts, writing
from ..base.log import Log, frame, frames
from ..errors import OutputError
from ..results.encoding import PackedArray, State, packed, unpacked
from ..results.folder import prepare, remove_page, write_scene
from ..results.journal import Journal, file_digests, is_journal, scene_digest
from ..results.kinds import SERVICE
from ..scene import Scene
from ..scene.keys import ServiceKeys
from .output import NUMBERS, RESULTS
from .rotation import Moment, Rotation
from .wheelset import service_keys

PRESS, ROTATION = SERVICE.mark, "rotation.bin"
MAGIC = b"macrofit rotation 1\n"
LARGEST_FILE = 100_000_000_000
"""Size of a file of steps; a thousand revolutions of a fine mesh have 4 GB."""

Scalars = dict[str, float | int | bool]


class _Frame(msgspec.Struct, array_like=True):
    scalars: Scalars
    arrays: dict[str, PackedArray]


class Kept:
    """The journals of a folder, closed by leaving the `with` block; without a folder they keep nothing."""

    def __init__(self, press: Journal | None = None, log: Log | None = None, held: Iterable[_Frame] = ()) -> None:
        self.press, self._log, self._held = press or Journal.elsewhere(), log, deque(held)

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, *_: object) -> None:
        self.press.close()
        if self._log is not None:
            self._log.close()

    def next(self) -> tuple[Scalars, State] | None:
        """Scalars and arrays of the next frame that an earlier computation left; None after the last."""
        if not self._held:
            return None
        found = self._held.popleft()
        return found.scalars, unpacked(found.arrays)

    def append(self, scalars: Scalars, arrays: Mapping[str, FloatArray | IntArray]) -> None:
        """Keep one more frame.

        Raises:
            OutputError: it cannot be written; those before stay readable.
        """
        if self._log is not None:
            self._log.append(msgspec.msgpack.encode(_Frame(scalars, packed(arrays))))


class KeptRotation(Rotation):
    """A rotation whose steps are kept, and taken from there where an earlier one has solved them already."""

    def __init__(self, *given: Any, kept: Kept) -> None:
        """What a rotation is given, and where its steps are kept."""
        super().__init__(*given)
        self._kept = kept
        self.moments = deque([self.rest()], maxlen=self.steps + 1)  # as many as a revolution has

    def advance(self, start: Moment, time: float) -> Moment:
        """The fit at a later time, see `Rotation.advance`.

        Raises:
            ConvergenceError: no halved step helps.
            OutputError: the step cannot be kept.
        """
        found = self._kept.next()
        if found is None:
            after = super().advance(start, time)
            scalars: Scalars = {"time": time, "iterations": self.iterations, "turns": self._turns}
            self._kept.append(scalars, {"traction": after.traction, "slip": after.slip})
        else:
            scalars, arrays = found
            after = Moment(time=time, **arrays)  # type: ignore[arg-type]
            self.iterations, self._turns = int(scalars["iterations"]), bool(scalars["turns"])
        self.moments.append(after)
        return after


def open_folder(folder: Path, scene: Scene, *, resume: bool) -> Kept:
    """Make a folder ready for a service computation; its journals, and what a resumed one has in them.

    Raises:
        OutputError: it is of something else or in use, its journals are damaged or of another scene; or, unless
            ``resume``, it holds an unfinished computation of this one.
    """
    press, rotation, lasting = folder / PRESS, folder / ROTATION, _lasting(scene)
    held = is_journal(press)
    prepare(folder, owned=held or (folder / NUMBERS).is_file())
    if resume and held:
        journal = Journal.resume(press, lasting)
        make = _resumed
    else:
        journal = Journal.start(press, lasting, replace=has_ended(folder))
        make = _started
    try:
        remove_drafts(folder)
        write_scene(folder, scene)
        log, found = make(rotation, _head(lasting))
    except BaseException:
        journal.close()
        raise
    return Kept(journal, log, found)


def _lasting(scene: Scene) -> Scene:
    """The scene without what says how long it turns, so that a wheel may turn on."""
    keys, default = service_keys(scene), ServiceKeys()
    keys = msgspec.structs.replace(keys, revolutions=default.revolutions, periodicity=default.periodicity)
    return msgspec.structs.replace(scene, service=keys)


def has_ended(folder: Path) -> bool:
    """Whether the folder holds all results of a computation, which a new one may replace."""
    try:
        numbers = msgspec.json.decode(read_regular(folder / NUMBERS, LARGEST_FILE))
    except (OutputError, msgspec.MsgspecError):
        return False
    return isinstance(numbers, dict) and numbers.get("ended", "") is None


def _head(scene: Scene) -> bytes:
    return MAGIC + frame(msgspec.msgpack.encode([__version__, scene_digest(scene), file_digests(scene)]))


def _started(path: Path, head: bytes) -> tuple[Log, list[_Frame]]:
    remove_page(path.parent)
    with writing(path.parent):
        for stale in RESULTS:
            (path.parent / stale).unlink(missing_ok=True)
    return Log.create(path, head), []


def _resumed(path: Path, head: bytes) -> tuple[Log, list[_Frame]]:
    """The file that is there with its frames; a new one where there is none of this scene and version.

    Raises:
        OutputError: it is damaged, in use or not writable.
    """
    data = read_regular(path, LARGEST_FILE) if path.exists() else b""
    if not data.startswith(head):
        return _started(path, head)
    log, found, end = Log.open(path), [], len(head)
    try:
        for content, place in frames(data, end):
            found.append(msgspec.msgpack.decode(content, type=_Frame))
            end = place
        log.cut(end)
    except (ValueError, msgspec.MsgspecError) as error:
        log.close()
        raise OutputError(f"{path}: {error}, after {len(found)} steps; run without --resume") from None
    except BaseException:
        log.close()
        raise
    return log, found
