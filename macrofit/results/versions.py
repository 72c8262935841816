"""The versions of what computes, for the record of a run."""

from __future__ import annotations

import platform
import sys
from importlib import metadata


def versions() -> dict[str, str]:
    """Versions of what computes; nothing is imported for it, and what is not installed is left out."""
    found = {"macrofit": sys.modules["macrofit"].__version__, "python": platform.python_version()}
    for name, distribution in (("numpy", "numpy"), ("scipy", "scipy"), ("dolfinx", "fenics-dolfinx")):
        version = getattr(sys.modules.get(name), "__version__", None)
        try:
            found[name] = version or metadata.version(distribution)
        except metadata.PackageNotFoundError:
            continue
    petsc = sys.modules.get("petsc4py.PETSc")
    if petsc is not None:
        found["petsc"] = ".".join(str(part) for part in petsc.Sys.getVersion())
    return found
