"""Arguments and options that several commands share, and what a shell completes them with."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from ..base.commands import Positive, set_option
from ..presets import PRESETS, summary

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

POSITIVE = Positive()


def completes_scene(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Scenes and TOML files, for a shell."""
    from ..base.completion import names_and_files
    from ..scene import scene_names

    return names_and_files(scene_names(), incomplete)


def completes_standard(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Standards and TOML files, for a shell."""
    from ..acceptance import standard_names
    from ..base.completion import names_and_files

    return names_and_files(standard_names(), incomplete)


def completes_key(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Keys of the scene and their values, for a shell."""
    from ..base.completion import keys_and_values, values_given
    from ..scene.completion import known_keys

    scene = context.params.get("scene") or next(iter(context.args), None)  # there behind an option without its value
    return keys_and_values(known_keys(incomplete, scene, values_given(context, "friction.provider")), incomplete)


scene_argument = click.argument("scene", shell_complete=completes_scene)


def changes(command: Callable[..., None]) -> Callable[..., None]:
    """The options that change a scene; the command gets both as ``overrides``."""

    @set_option("the scene", completes_key)
    @click.option(
        "--preset",
        type=click.Choice(list(PRESETS)),
        help=f"Scale the mesh sizes of the scene; a --set of one counts more. For wheelset: {summary()}.",
    )
    @wraps(command)
    def changed(*given: Any, overrides: tuple[str, ...], preset: str | None, **named: Any) -> None:
        command(*given, overrides=overrides if preset is None else (f"preset={preset}", *overrides), **named)

    return changed


standard_option = click.option(
    "--standard",
    metavar="NAME|FILE",
    shell_complete=completes_standard,
    help="Judge by this built-in standard, or by a TOML file of your own [en-13260].",
)


def reads_curves(command: Callable[..., None]) -> Callable[..., None]:
    """The options that say how a measured curve is read; the command gets them by the names of `Reading`."""
    for option in (
        click.option("--shift", type=float, default=0.0, metavar="MM", help="Add this to the displacements."),
        click.option("--to", "end", type=float, metavar="MM", help="Use it up to this one."),
        click.option(
            "--from", "start", type=float, metavar="MM", help="Use the record from this displacement in it on."
        ),
        click.option(
            "--columns", metavar="D,F", help="Columns of displacement and force, by number or name [found by units]."
        ),
    ):
        command = option(command)
    return command
