"""Friction from a script: an object in place of an installed provider, so that a law is tried without packaging it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias, cast

import msgspec

from macrofit.base.foreign import foreign_code
from macrofit.errors import ProviderError
from macrofit.friction.answer import declared_dependence
from macrofit.friction.contract import BuildContext, FrictionProvider, ProviderOptions
from macrofit.friction.registry import decode_options

GivenFriction: TypeAlias = FrictionProvider | ProviderOptions | Callable[..., FrictionProvider | ProviderOptions]
"""What a script may pass as friction: a provider; options with `build(context)`; or what makes one of the two from
`[friction.options]` as keyword arguments, for example the class of the options."""


class ScriptFriction:
    """The friction that a script passes in, with the name that scenes and messages have for it.

    The name is "module:Class", which no installed provider has. A scene that names it has as its options those of the
    object (a Struct's fields, nothing for another object), or those that the callable is to be given.

    Args:
        given: a provider, options with `build(context)`, or a callable that makes one of them from keyword arguments.

    Raises:
        ProviderError: it is none of these.
    """

    def __init__(self, given: GivenFriction) -> None:
        self.given = given
        usable = any(callable(getattr(given, method, None)) for method in ("build", "coefficients"))
        self.makes = isinstance(given, type) or not usable
        """Whether it is a callable, so that options may vary."""
        if self.makes and not callable(given):
            raise ProviderError(
                f"friction = {given!r}: is no provider; give an object with depends_on and coefficients(pairs), "
                f"options with build(context), or a callable that makes one of them"
            )
        named = given if hasattr(given, "__name__") else type(given)
        self.name = f"{named.__module__}:{named.__name__}"

    @property
    def digest(self) -> str | None:
        """What the object states as `digest`, to be told from others of its name; None where it states nothing."""
        stated = getattr(self.given, "digest", None)
        return stated if isinstance(stated, str) and stated else None

    @property
    def options(self) -> dict[str, Any]:
        """The options of the object, for the record: the fields of a Struct."""
        if self.makes or not isinstance(self.given, msgspec.Struct):
            return {}
        try:
            return cast(dict[str, Any], msgspec.to_builtins(self.given))
        except TypeError:  # it holds what no file could
            return {}

    def fingerprint(self, options: Mapping[str, object]) -> str:
        """SHA-256 of name, digest and options, in hexadecimal: what a journal knows the friction by.

        Raises:
            ProviderError: the object states no digest.
        """
        stated = [self.name, self.required_digest(), dict(options)]
        return hashlib.sha256(msgspec.json.encode(stated, order="deterministic")).hexdigest()

    def required_digest(self) -> str:
        """The digest, where a run is kept to be resumed.

        Raises:
            ProviderError: the object states none.
        """
        if self.digest is None:
            raise ProviderError(
                f"friction provider {self.name!r} is an object without a digest, and a run with it could be resumed "
                f"with another; give its class an attribute digest, a text that changes whenever its answers do"
            )
        return self.digest

    def load(self, options: Mapping[str, object]) -> FrictionProvider | ProviderOptions:
        """The object itself, or what the callable makes of the options.

        Raises:
            ProviderError: the callable refuses the options.
        """
        if not self.makes:
            return cast(FrictionProvider | ProviderOptions, self.given)
        if isinstance(self.given, type) and issubclass(self.given, msgspec.Struct):
            return decode_options(self.name, self.given, options)
        try:
            with foreign_code():
                return cast(Callable[..., FrictionProvider | ProviderOptions], self.given)(**options)
        except ProviderError:
            raise
        except Exception as error:
            raise ProviderError(
                f"options of friction provider {self.name!r}: {type(error).__name__}: {error}"
            ) from error

    def build(self, options: Mapping[str, object], context: BuildContext) -> FrictionProvider:
        """The provider, ready to be asked.

        Raises:
            ProviderError: it cannot be built, or breaks the contract.
        """
        loaded = self.load(options)
        try:
            with foreign_code():
                provider = loaded.build(context) if hasattr(loaded, "build") else loaded
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
            raise ProviderError(f"friction provider {self.name!r} cannot be built: {told}") from error
        declared_dependence(provider, self.name)
        return provider
