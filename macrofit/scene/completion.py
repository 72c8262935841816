"""The keys of a scene for a shell that completes them, those of its friction provider among them."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from ..base.keys import dotted_keys
from ..errors import MacrofitError
from ..friction import registry
from ..presets import PRESETS
from .keys import FrictionKeys, Scene
from .load import load_scene

OPTIONS = "friction.options"


def known_keys(begun: str, source: str | None = None, providers: Iterable[str] = ()) -> dict[str, list[str]]:
    """Dotted keys of a scene with their values where these are few.

    Args:
        begun: what is written of a key; a provider, which may be slow to load, is loaded for one of its options only.
        source: the scene, for its friction provider.
        providers: friction providers that overrides name; the last one counts.
    """
    found = dotted_keys(Scene)
    del found[OPTIONS]
    found["preset"] = list(PRESETS)
    found["friction.provider"] = [name for name, *_ in registry.names()]
    if begun and (begun.startswith(OPTIONS) or OPTIONS.startswith(begun)):
        with suppress(MacrofitError):
            name = [_provider(source), *providers][-1]
            options = dotted_keys(registry.options_record(name))
            found |= {f"{OPTIONS}.{key}": values for key, values in options.items()}
    return found


def _provider(source: str | None) -> str:
    with suppress(MacrofitError):
        if source is not None:
            return load_scene(source).friction.provider
    return FrictionKeys().provider
