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


def scan_options(command: Command) -> Command:
    """Give a command the options of `OPTIONS`; `take_options` makes keys of them."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def take_options(given: dict[str, Any]) -> dict[str, Any]:
    """Take the values of these options out of those of a command: keys of `ScanKeys` that were given."""
    found = {name: given.pop(name) for name in NAMES}
    found["levels"] = found.pop("grid")
    found["use"] = found["use"] or "face"
    return {name: value for name, value in found.items() if value is not None}


def asked_scan(files: Path | tuple[Path, ...], options: dict[str, Any]) -> ScanKeys:
    """The keys of a file, or of several, with these options.

    Raises:
        SettingsError: an option that is out of its bounds.
    """
    from macrofit.base.keys import KeyMistake, decode_tables

    from .keys import ScanKeys

    names = [str(file) for file in ((files,) if isinstance(files, Path) else files)]
    try:
        return decode_tables({"files": names, **options}, ScanKeys, "options")
    except KeyMistake as error:
        raise SettingsError(f"--{error}".replace("--levels", "--grid")) from None
