"""Where the solver's coefficient of friction comes from: the contract, the installed providers, the field."""

from macrofit.errors import ProviderError
from macrofit.friction.answer import PairFriction, answered, checked_answer, checked_uncertainty
from macrofit.friction.conformance import ConformanceError
from macrofit.friction.contract import (
    BuildContext,
    FloatArray,
    FrictionProvider,
    HearsAhead,
    IntArray,
    KnowsItsRange,
    ProviderOptions,
    StatesUncertainty,
    TilePairs,
)
from macrofit.friction.field import FieldState, FrictionField, Question, announce
from macrofit.friction.outside import Outside, outside_range
from macrofit.friction.registry import (
    InstalledProvider,
    build,
    build_provider,
    installed_providers,
    load,
    load_options,
    names,
    try_provider,
)
from macrofit.friction.script import GivenFriction, ScriptFriction
from macrofit.friction.tiles import FacingPairs, TileOverlaps, tile_overlaps
from macrofit.friction.uniform import Uniform

__all__ = [
    "BuildContext",
    "ConformanceError",
    "FacingPairs",
    "FieldState",
    "FloatArray",
    "FrictionField",
    "FrictionProvider",
    "GivenFriction",
    "HearsAhead",
    "InstalledProvider",
    "IntArray",
    "KnowsItsRange",
    "Outside",
    "PairFriction",
    "ProviderError",
    "ProviderOptions",
    "Question",
    "ScriptFriction",
    "StatesUncertainty",
    "TileOverlaps",
    "TilePairs",
    "Uniform",
    "announce",
    "answered",
    "build",
    "build_provider",
    "checked_answer",
    "checked_uncertainty",
    "installed_providers",
    "load",
    "load_options",
    "names",
    "outside_range",
    "tile_overlaps",
    "try_provider",
]
