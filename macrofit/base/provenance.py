"""What made a result: the version of the package, and the hash of the code that computes."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import lru_cache
from importlib import metadata
from pathlib import Path


@lru_cache(maxsize=1)
def version() -> str:
    """The installed version of macrofit, or "unknown"."""
    try:
        return metadata.version("macrofit")
    except metadata.PackageNotFoundError:
        return "unknown"


def code_hash(package: Path, module: str) -> str:
    """Hash of the sources that a module of a package runs, and of every TOML file the package holds.

    Args:
        package: the folder of the package; its name is the package's.
        module: a dotted name in it, for example ``meso.provider``.

    Returns:
        20 hexadecimal digits. A comment counts; a module that is not imported does not (see `reached`).
    """
    files = [source(package, name) for name in sorted(reached(package, module))]
    whole = hashlib.sha256()
    for file in [*files, *sorted(package.rglob("*.toml"))]:
        place = file.relative_to(package).as_posix()
        whole.update(f"{place} {hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    return whole.hexdigest()[:20]


def reached(package: Path, module: str) -> set[str]:
    """The modules of the package that one imports directly or not, at its top or within a function, and itself.

    Dotted names; the packages on the way to a module run with it, and count too.
    """
    found, ahead = {module}, [module]
    while ahead:
        new = {part for name in _imported(package, ahead.pop()) for part in _with_parents(name)} - found
        found |= new
        ahead += new
    return found


def source(package: Path, module: str) -> Path:
    """The file of a module of the package, its ``__init__.py`` where it is a package itself."""
    place = package.joinpath(*module.split(".")[1:])
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def _imported(package: Path, module: str) -> Iterator[str]:
    """The modules of the package that one imports, as dotted names."""
    file = source(package, module)
    parent = module if file.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = parent.rsplit(".", node.level - 1)[0] if node.level else ""
            target = ".".join(filter(None, (base, node.module)))
            named = [target, *(f"{target}.{alias.name}" for alias in node.names)]  # a name may be a module itself
        else:
            continue
        yield from (name for name in named if name.split(".")[0] == package.name and source(package, name).is_file())


def _with_parents(module: str) -> set[str]:
    parts = module.split(".")
    return {".".join(parts[:count]) for count in range(1, len(parts) + 1)}
