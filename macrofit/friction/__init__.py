"""Where the solver's coefficient of friction comes from: the contract, the installed providers, the field."""

from macrofit.errors import ProviderError
from macrofit.friction.answer import checked_answer
from macrofit.friction.conformance import ConformanceError
from macrofit.friction.contract import (
    BuildContext,
    FloatArray,
    FrictionProvider,
    IntArray,
    ProviderOptions,
    TilePairs,
)
from macrofit.friction.field import FieldState, FrictionField, ask_directly
from macrofit.friction.registry import InstalledProvider, build, load, names
from macrofit.friction.tiles import TileOverlaps, tile_overlaps
from macrofit.friction.uniform import Uniform

__all__ = [
    "BuildContext",
    "ConformanceError",
    "FieldState",
    "FloatArray",
    "FrictionField",
    "FrictionProvider",
    "InstalledProvider",
    "IntArray",
    "ProviderError",
    "ProviderOptions",
    "TileOverlaps",
    "TilePairs",
    "Uniform",
    "ask_directly",
    "build",
    "checked_answer",
    "load",
    "names",
    "tile_overlaps",
]
