"""What made a result, for the record of a run: versions, digests, date and command."""

from __future__ import annotations

import platform
import shlex
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from ..base.progress import printable
from ..friction import GivenFriction, ScriptFriction, load
from ..scene import Scene
from .journal import file_digests, scene_digest

COMMAND = "macrofit"
"""What the program is called where it was started as a module."""


def provenance(scene: Scene, given: GivenFriction | None = None) -> dict[str, Any]:
    """Date, command and digests of what decides a run: the resolved scene, the files it names, its friction.

    ``friction_digest`` is what the provider's options state as ``digest``; None where they state nothing.
    """
    named = scene.friction
    stated = _stated(named.provider, named.options) if given is None else ScriptFriction(given).digest
    return session() | {
        "scene_sha256": scene_digest(scene),
        "files_sha256": file_digests(scene),
        "friction_digest": stated,
    }


def session() -> dict[str, str]:
    """Date and command."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": printable(shlex.join([_program(sys.argv[0]), *sys.argv[1:]])),
    }


def _program(path: str) -> str:
    return COMMAND if path.endswith("__main__.py") else Path(path).name


def _stated(name: str, options: Mapping[str, Any]) -> str | None:
    """What a provider's options, or those of the provider they wrap by ``base``, state as their digest."""
    base, inner = options.get("base"), options.get("options", {})
    if isinstance(base, str) and isinstance(inner, Mapping):
        return _stated(base, inner)
    stated = getattr(load(name, options), "digest", None)
    return stated if isinstance(stated, str) else None


def versions() -> dict[str, str]:
    """Versions of what computes; nothing is imported for it, and what is not installed is left out."""
    found = {"macrofit": sys.modules["macrofit"].__version__, "python": platform.python_version()}
    named = (("numpy", "numpy"), ("scipy", "scipy"), ("dolfinx", "fenics-dolfinx"), ("petsc", "petsc4py"))
    for name, distribution in named:
        version = getattr(sys.modules.get(name), "__version__", None)
        try:
            found[name] = version or metadata.version(distribution)
        except metadata.PackageNotFoundError:
            continue
    return found
