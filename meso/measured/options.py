"""Options of the commands that take a file of heights: what the file does not say, and what is done with it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ..errors import SettingsError

if TYPE_CHECKING:
    from .keys import ScanKeys

Command = TypeVar("Command", bound=Callable[..., Any])


def _lengths(context: click.Context, option: click.Parameter, text: str | None) -> list[float] | float | None:
    """One length or two between commas."""
    if text is None:
        return None
    try:
        given = [float(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"'{text}' is not a length, or two between commas") from None
    return given[0] if len(given) == 1 else given


OPTIONS = (
    click.option("--spacing", callback=_lengths, metavar="MM[,MM]", help="Of the points, where the file has none."),
    click.option(
        "--unit", type=click.Choice(["m", "mm", "um", "µm", "nm"]), help="Of the heights, where the file has none [mm]."
    ),
    click.option("--along", type=click.Choice(["x", "y"]), help="Axis of the file that runs along the slide [x]."),
    click.option("--invert", is_flag=True, default=None, help="Turn the heights over: the file is of a cast."),
    click.option(
        "--remove", type=click.Choice(["none", "plane", "cylinder", "polynomial"]), help="Form taken away [cylinder]."
    ),
    click.option("--degree", type=int, help="Of the polynomial [2]."),
    click.option("--filter", type=float, metavar="MM", help="Cut-off of a Gaussian filter, such as 0.8 [none]."),
    click.option("--grid", type=int, metavar="N", help="Means over areas of 2^-N mm are taken of a file [4]."),
    click.option(
        "--use", type=click.Choice(["face", "auto", "strip", "patches"]),
        help="The middle of a file is the face; or the tile that the seed has on a strip, or on patches [face].",
    ),
)  # fmt: skip
NAMES = ("spacing", "unit", "along", "invert", "remove", "degree", "filter", "grid", "use")
"""Parameters that these options have in a command."""

GENERATED = ("levels", "max_height", "rms_height", "hurst_exponent", "form", "lay", "generator")
"""Parameters of generated faces; a measured one may be levelled too."""


def scan_options(command: Command) -> Command:
    """Give a command the options of `OPTIONS`; `take_options` makes keys of them."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def take_options(given: dict[str, Any], sources: str, files: bool, generated: bool) -> dict[str, Any]:
    """Take the values of these options out of those of a command: keys of `ScanKeys` that were given.

    Args:
        given: values by their parameters; None where an option is not there. Those of `OPTIONS` are taken out.
        sources: how files are given, for a message.
        files: whether a face comes from a file.
        generated: whether a face is generated.

    Raises:
        click.UsageError: an option without any effect.
    """
    asked = {name: given.pop(name) for name in NAMES}
    found = {name: value for name, value in asked.items() if value is not None}
    if found and not files:
        raise click.UsageError(
            f"{_option(next(iter(found)))}: is for faces from files: leave it out, or give {sources}"
        )
    idle = [name for name in GENERATED if given.get(name) not in (None, "levelled")]
    if idle and not generated:
        raise click.UsageError(f"{_option(idle[0])}: is for generated faces, and there is none: leave it out")
    if "degree" in found and found.get("remove") != "polynomial":
        raise click.UsageError("--degree: is for --remove polynomial: give that too, or leave it out")
    if "grid" in found:
        found["levels"] = found.pop("grid")
    return {"use": "face", **found} if files else {}


def refuse_idle_seed(keys: ScanKeys, option: str, seed: int | None) -> None:
    """Refuse a seed where the face is the middle of a file.

    Raises:
        click.UsageError: a seed is given, and has no effect.
    """
    if seed is not None and keys.use == "face":
        raise click.UsageError(
            f"{option}: the face is the middle of {keys.files[0]} whatever the seed: leave it out, or "
            "take --use strip or --use patches"
        )


def _option(parameter: str) -> str:
    return f"--{parameter.replace('_', '-')}"


def asked_scan(
    files: Path | tuple[Path, ...], options: dict[str, Any], own: tuple[str, ...] = (), where: str = "--"
) -> ScanKeys:
    """The keys of a file, or of several, with these options.

    Args:
        files: one, or several patches.
        options: keys of `ScanKeys`.
        own: more keys, as key=value; they go before the options.
        where: option by which these are given, for a message.

    Raises:
        SettingsError: an option or key that is unknown or out of its bounds.
    """
    from macrofit.base.keys import KeyMistake, decode_tables
    from macrofit.base.toml import errors_as, set_key, split_override

    from .keys import ScanKeys

    keys = {"files": [str(file) for file in ((files,) if isinstance(files, Path) else files)], **options}
    with errors_as(SettingsError):
        for each in own:
            set_key(keys, *split_override(each, "spacing=0.005"))
    try:
        return decode_tables(keys, ScanKeys, "options")
    except KeyMistake as error:
        told = f"{where} {error}" if own else f"--{error}".replace("--levels", "--grid")
        raise SettingsError(told) from None
