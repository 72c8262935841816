"""Ranks that compute together must be of one mind: the same scene, files, code and versions, compared by digest."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from ..base.ranks import raise_together
from ..errors import SceneError
from ..friction.registry import provider_package
from ..scene import Scene
from .journal import file_digest, named_files
from .versions import versions

if TYPE_CHECKING:
    from mpi4py import MPI

SHOWN = 4
"""How many differences a message names."""
COMPILED = {".pyc", ".nbi", ".nbc"}
"""Endings of files that are made from others, and may differ."""


def agree(comm: MPI.Comm, scenes: Iterable[Scene]) -> None:
    """Make sure that all ranks would compute the same, before anything is assembled. Collective; one rank agrees.

    Compared are the scenes, the content of the files they name, the sources of macrofit and of the packages of their
    friction providers with all they ship, and the versions of what computes.

    Raises:
        SceneError: on every rank, with what differs and between which ranks.
    """
    if comm.size == 1:
        return
    mine: dict[str, str] = {}
    with raise_together(comm):
        mine = digests(list(scenes))
    everyone = comm.allgather(mine)
    for rank, theirs in enumerate(everyone):
        different = sorted(key for key in everyone[0].keys() | theirs.keys() if everyone[0].get(key) != theirs.get(key))
        if different:
            more = f" and {len(different) - SHOWN} more" if len(different) > SHOWN else ""
            raise SceneError(
                f"ranks 0 and {rank} have another {', '.join(different[:SHOWN])}{more}; let every rank see the same "
                f"scene, files and installation (a shared folder, one environment)"
            )


def digests(scenes: list[Scene]) -> dict[str, str]:
    """What determines the results of scenes, by what messages call it."""
    found = {f"version of {name}": version for name, version in versions().items()}
    found["code of macrofit"] = package_digest("macrofit")
    if len(scenes) == 1:
        found |= {f"[{table}]": _digest(_encoded(keys)) for table, keys in msgspec.to_builtins(scenes[0]).items()}
    else:
        found["list of scenes"] = _digest(_encoded(scenes))
    for key, file in sorted({item for scene in scenes for item in named_files(scene).items()}):
        found[f"content of {key}, {file}"] = file_digest(file)
    for name in {name for scene in scenes for name in named_providers(scene.friction.provider, scene.friction.options)}:
        package = provider_package(name)
        if package not in ("", "macrofit"):
            found[f"package of friction provider '{name}'"] = package_digest(package)
    return found


def named_providers(name: str, options: Mapping[str, object]) -> list[str]:
    """A provider, and those that it wraps by its option ``base``."""
    base, inner = options.get("base"), options.get("options")
    if not isinstance(base, str):
        return [name]
    return [name, *named_providers(base, inner if isinstance(inner, Mapping) else {})]


def package_digest(name: str) -> str:
    """SHA-256 of the files of an importable package or module; "" where there is none."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        spec = None
    if spec is None or not (spec.submodule_search_locations or spec.origin):
        return ""
    whole = hashlib.sha256()
    for place in spec.submodule_search_locations or [str(spec.origin)]:
        folder = Path(place)
        files = [folder] if folder.is_file() else sorted(folder.rglob("*"))
        for file in files:
            if file.is_file() and file.suffix not in COMPILED:
                named = file.name if file == folder else file.relative_to(folder).as_posix()
                whole.update(f"{named} {_digest(file.read_bytes())}\n".encode())
    return whole.hexdigest()


def _encoded(content: object) -> bytes:
    return msgspec.json.encode(content, order="deterministic")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
