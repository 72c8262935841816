"""What a file of heights says, before anything is mended."""

from __future__ import annotations

from typing import NamedTuple

from macrofit.base.arrays import FloatArray
from macrofit.base.units import LENGTHS, known_unit

from ..errors import SurfaceError


class RawScan(NamedTuple):
    """Heights as a file has them; a point stands for the cell around it."""

    heights: FloatArray
    """Heights in `unit`, first axis x, second axis y, shape (nx, ny); NaN where nothing was measured."""
    unit: float | None
    """Unit of the heights [mm]; None where the file does not say it."""
    spacing: tuple[float, float] | None
    """Distances of the points along x and y [mm]; None where the file does not say them."""


class ScanError(SurfaceError):
    """A file of heights that is damaged, of a kind that is not read, or contradicts itself."""


def length_unit(written: str) -> float | None:
    """A unit of length [mm] by the name that instruments write; None where it names none.

    Raises:
        ScanError: it is no unit of length.
    """
    written = written.strip("\x00 []()")
    if not written:
        return None
    found = LENGTHS.get(known_unit(written) or "", FINER.get(written.lower().removesuffix("s")))
    if found is None:
        raise ScanError(f"unit '{written}' is not one of length; known are {', '.join((*LENGTHS, *FINER))}")
    return found


FINER = {
    "nm": 1e-6, "pm": 1e-9, "å": 1e-7, "~m": 1e-3, "micrometer": 1e-3, "micrometre": 1e-3, "nanometer": 1e-6,
    "nanometre": 1e-6,
}  # fmt: skip
"""Units of length [mm] besides `LENGTHS`, in small letters; "~m" is what an old code page makes of µm."""
