"""The kinds of folders that commands of macrofit write, and how each is told by its files."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ..base.files import starts_with


class Kind(NamedTuple):
    """A kind of folder."""

    what: str  # it holds
    command: str  # that writes it
    mark: str  # name of the file that is there from the beginning
    numbers: str  # name of the file that is written last: it says that all is there


RUN = Kind("a run", "macrofit run", "journal.bin", "summary.json")
STUDY = Kind("a study", "macrofit study", "study.bin", "study.json")
SERVICE = Kind("a wheelset in service", "macrofit service", "press.bin", "service.json")
SERVICE_STUDY = Kind(
    "a study of wheelsets in service", "macrofit study --service", "service-study.bin", "service-study.json"
)
IDENTIFICATION = Kind("an identification", "macrofit identify", "identification.json", "identification.json")
CONVERGENCE = Kind("an estimate of convergence", "macrofit converge", "convergence.json", "convergence.json")
KINDS = (RUN, STUDY, SERVICE, SERVICE_STUDY, IDENTIFICATION, CONVERGENCE)


def kind_of(folder: Path) -> Kind | None:
    """What a command of macrofit has begun or finished in a folder; None where there is nothing of it."""
    return next((kind for kind in KINDS if _begun(folder, kind) or (folder / kind.numbers).is_file()), None)


def _begun(folder: Path, kind: Kind) -> bool:
    return kind.mark.endswith(".bin") and starts_with(folder / kind.mark, b"macrofit ")
