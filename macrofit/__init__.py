"""Press-fit of a railway wheel onto its axle.

>>> import macrofit
>>> solution = macrofit.solve(macrofit.load_scene("wheelset"))  # doctest: +SKIP

The public names are resolved on first use, so that importing the package loads no solver.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from macrofit.scene import Scene, load_scene
    from macrofit.solve import Solution, solve

__version__ = "0.1.0"

__all__ = ["Scene", "Solution", "__version__", "load_scene", "solve"]

_HOME = {
    "Scene": "macrofit.scene",
    "Solution": "macrofit.solve",
    "load_scene": "macrofit.scene",
    "solve": "macrofit.solve",
}


def __getattr__(name: str) -> object:
    """Import the module a public name lives in, and return the name."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """Keeps `macrofit.solve` the function.

    Importing a submodule binds it in its package, and `macrofit.solve` is the name of both a module and the
    function in it: the function wins.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name in _HOME and isinstance(value, ModuleType):
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
