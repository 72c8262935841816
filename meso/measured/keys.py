"""Which files hold the measured face of a body, and what is done with them before a tile is cut."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import msgspec

from macrofit.base.files import read_regular
from macrofit.base.keys import Keys, Positive, told

MOST_BYTES = 200_000_000
"""Size of a file of heights; 190 x 1 mm at 2 um have 190 MB in single precision."""

HeightUnit: TypeAlias = Literal["m", "mm", "um", "µm", "nm"]
Form: TypeAlias = Literal["none", "plane", "cylinder", "polynomial"]


class ScanKeys(Keys, frozen=True):
    """Measured face of one body, heights positive out of the metal: files, what they do not say, how it is cleaned."""

    files: Annotated[tuple[str, ...], told("Files of heights; one strip, or patches."), msgspec.Meta(min_length=1)]
    use: Annotated[
        Literal["auto", "strip", "patches", "face"],
        told(
            "One strip along the body, tile i at i mm; or patches dealt to the tiles; auto: a strip where it is long."
        ),
    ] = "auto"
    spacing: Annotated[
        Positive | Annotated[tuple[Positive, ...], msgspec.Meta(min_length=2, max_length=2)] | None,
        told("Distance of the points along and across the slide, where no file says it [mm]."),
    ] = None
    unit: Annotated[HeightUnit | None, told("Unit of the heights, where no file says it; mm if left out.")] = None
    along: Annotated[
        Literal["x", "y"], told("Axis of the file that runs along the slide: x are the rows of a table's heights.")
    ] = "x"
    invert: Annotated[
        bool, told("Heights turned over: the file is of a cast (replica), whose heights go into the metal.")
    ] = False
    remove: Annotated[Form, told("Form taken away: a plane, and the curvature across, or all of a degree.")] = (
        "cylinder"
    )
    degree: Annotated[int, told("Degree of the polynomial [-]."), msgspec.Meta(ge=1, le=6)] = 2
    filter: Annotated[Positive | None, told("Cut-off of a Gaussian filter; left out: none [mm].")] = None
    levels: Annotated[
        int, told("Heights are means over areas of 2^-n mm: 2^n + 1 points along 1 mm [-]."), msgspec.Meta(ge=1, le=8)
    ] = 4
    sha256: Annotated[tuple[str, ...], told("Digests of the files; found when they are first read.")] = ()

    def __post_init__(self) -> None:
        if self.degree != 2 and self.remove != "polynomial":
            raise ValueError("degree: is for remove = 'polynomial': give that too, or leave it out")

    @property
    def spacings(self) -> tuple[float, float] | None:
        """Distances of the points along and across the slide, where they are given [mm]."""
        if self.spacing is None:
            return None
        return (self.spacing[0], self.spacing[1]) if isinstance(self.spacing, tuple) else (self.spacing, self.spacing)

    def found(self) -> ScanKeys:
        """The same with the digests of the files.

        Raises:
            OutputError: a file that cannot be read.
        """
        return msgspec.structs.replace(self, sha256=tuple(digest(Path(name)) for name in self.files))


Measured: TypeAlias = (
    Annotated[str, msgspec.Meta(min_length=1)] | Annotated[tuple[str, ...], msgspec.Meta(min_length=1)] | ScanKeys
)


def digest(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal.

    Raises:
        OutputError: it cannot be read, or is too large.
    """
    return hashlib.sha256(read_regular(path, MOST_BYTES)).hexdigest()


def scan_keys(given: Measured) -> ScanKeys:
    """The keys of a measured face that may be given by the name of its file, or of its files, alone."""
    if isinstance(given, ScanKeys):
        return given
    return ScanKeys(files=(given,) if isinstance(given, str) else given)
