"""The providers that are installed, found by entry points; only the module of the asked one is imported."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple

import msgspec

from macrofit.base.errors import MacrofitError
from macrofit.base.foreign import foreign_code
from macrofit.base.keys import KeyMistake, decode_tables
from macrofit.errors import ProviderError
from macrofit.friction.answer import declared_dependence
from macrofit.friction.contract import BuildContext, FrictionProvider, ProviderOptions

GROUP = "macrofit.friction"
"""The entry-point group of friction providers."""

BUILT_IN = {
    "uniform": "macrofit.friction.uniform:Uniform",
    "table": "macrofit.friction.table:Table",
    "evolving": "macrofit.friction.evolving:Evolving",
}
"""Providers that need no package metadata. Their names are reserved: no plugin can take them over."""


WHOLE = "options"
"""What a mistake that no key alone makes begins with."""


class InstalledProvider(NamedTuple):
    """A provider that a scene may name."""

    name: str
    """What `[friction] provider` says."""
    source: str
    """The distribution it comes from, with its version."""
    target: str
    """The options class, as `module:Class`."""


def installed_providers() -> list[InstalledProvider]:
    """The installed providers in alphabetical order, and where they come from; none of them is imported."""
    return [InstalledProvider(entry.name, _source(entry), entry.value) for entry in _entries()]


def load_options(name: str, options: Mapping[str, object]) -> ProviderOptions:
    """The options of provider `name`, decoded strictly from the table `[friction.options]`.

    Raises:
        ProviderError: no such provider, two of that name, a plugin that cannot be imported or breaks the
            contract, an option that is unknown, missing, of the wrong type or refused.
    """
    entry = _entry(name)
    return decode_options(name, _options_class(entry), options)


def options_record(name: str) -> type[msgspec.Struct]:
    """The record that holds the options of provider `name`.

    Raises:
        ProviderError: as `load_options`.
    """
    return _options_class(_entry(name))


def build_provider(name: str, options: Mapping[str, object], context: BuildContext) -> FrictionProvider:
    """The provider `name` with these options, ready to be asked.

    Raises:
        ProviderError: as `load_options`; or its `build` fails; or what it builds breaks the contract.
    """
    loaded = load_options(name, options)
    try:
        with foreign_code():
            provider = loaded.build(context)
    except Exception as error:
        raise ProviderError(f"friction provider {name!r} cannot be built: {_said(error)}") from error
    declared_dependence(provider, name)
    return provider


def try_provider(
    build: Callable[[BuildContext], FrictionProvider],
    youngs_modulus: float,
    poisson_ratio: float,
    tiles: tuple[int, int] = (1, 1),
) -> list[str]:
    """Build a provider, by default for one tile of each body, so that what it refuses is known before anything runs.

    Args:
        build: makes the provider.
        youngs_modulus: of the axle [MPa].
        poisson_ratio: of the axle [-].
        tiles: number of tiles of the seat and of the bore.

    Returns:
        what it warned of.

    Raises:
        ProviderError: as `build_provider`.
    """
    seat, bore = tiles
    context = BuildContext(seat_tiles=seat, bore_tiles=bore, youngs_modulus=youngs_modulus, poisson_ratio=poisson_ratio)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        build(context)
    return [str(warning.message) for warning in said]


def provider_package(name: str) -> str:
    """The top-level package or module that provider `name` comes from; "" where there is no such provider, or several.

    Nothing of it is imported.
    """
    targets = [entry.value for entry in _entries() if entry.name == name]
    return targets[0].partition(":")[0].partition(".")[0] if len(targets) == 1 else ""


names, load, build = installed_providers, load_options, build_provider
"""The short names of earlier versions, which plugins import."""


def _entries() -> list[EntryPoint]:
    own = [EntryPoint(name, target, GROUP) for name, target in BUILT_IN.items()]
    plugins = (entry for entry in entry_points(group=GROUP) if entry.name not in BUILT_IN)
    found = {(entry.name, entry.value): entry for entry in plugins}
    return sorted([*own, *found.values()], key=lambda entry: (entry.name, entry.value))


def _entry(name: str) -> EntryPoint:
    if name in BUILT_IN:  # answered without reading the metadata of every installed distribution
        return EntryPoint(name, BUILT_IN[name], GROUP)
    installed = _entries()
    matches = [entry for entry in installed if entry.name == name]
    if len(matches) == 1:
        return matches[0]
    if matches:
        owners = " and ".join(f"{_source(entry)} ({entry.value})" for entry in matches)
        raise ProviderError(f"friction provider {name!r} is claimed by {owners}: uninstall all but one")
    known = ", ".join(f"{entry.name!r} from {_source(entry)}" for entry in installed)
    if ":" in name:
        raise ProviderError(
            f"friction provider {name!r} is an object of a script, not installed: give it again with friction=, "
            f"or set friction.provider to one of {known}"
        )
    raise ProviderError(
        f"no friction provider {name!r} is installed. Installed: {known}. "
        f"Set friction.provider to one of these, or install the package that brings {name!r}"
    )


def _options_class(entry: EntryPoint) -> type[Any]:
    who = f"friction provider {entry.name!r} of {_source(entry)}"
    try:
        with foreign_code():
            loaded = entry.load()
    except Exception as error:
        raise ProviderError(
            f"{who} is broken: loading {entry.value!r} fails with {_said(error)}. "
            "Install what it needs, or reinstall or remove it"
        ) from error
    if not (isinstance(loaded, type) and issubclass(loaded, msgspec.Struct)):
        raise ProviderError(f"{who} breaks the contract: {entry.value!r} is not a subclass of msgspec.Struct")
    if not loaded.__struct_config__.frozen:
        raise ProviderError(f"{who} breaks the contract: {entry.value!r} must be declared with frozen=True")
    if not callable(getattr(loaded, "build", None)):
        raise ProviderError(f"{who} breaks the contract: {entry.value!r} has no method build(context)")
    return loaded


def decode_options(name: str, kind: type[Any], options: Mapping[str, object]) -> ProviderOptions:
    """The options of provider `name` as the Struct `kind`, strictly: no unknown key, no wrong type.

    Raises:
        ProviderError: an option is unknown, missing, of the wrong type or refused.
    """
    known = [field.encode_name for field in msgspec.structs.fields(kind)]
    for key in options:
        if key not in known:
            accepted = ", ".join(known) if known else "none"
            raise ProviderError(
                f"friction.options.{key}: unknown option of friction provider {name!r}. Its options: {accepted}"
            )
    try:
        with foreign_code():
            decoded: ProviderOptions = decode_tables(options, kind, WHOLE)
    except KeyMistake as error:
        told = str(error)
        if told.startswith(f"{WHOLE}: "):
            raise ProviderError(f"{WHOLE} of friction provider {name!r}{told.removeprefix(WHOLE)}") from error
        raise ProviderError(f"friction.options.{told}, of friction provider {name!r}") from error
    except Exception as error:
        raise ProviderError(f"options of friction provider {name!r}: {error}") from error
    return decoded


def _source(entry: EntryPoint) -> str:
    if entry.name in BUILT_IN:
        return "macrofit (built in)"
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unnamed distribution"


def _said(error: BaseException) -> str:
    """What an error says; one that is meant for the user needs no name of its class."""
    return str(error) if isinstance(error, MacrofitError) else f"{type(error).__name__}: {error}"
