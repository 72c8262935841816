"""What a file of heights says, before anything is mended."""

from __future__ import annotations

from typing import NamedTuple

from macrofit.base.arrays import FloatArray

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
    written = written.strip("\x00 []()").replace("\xb5", "µ").replace("μ", "µ")
    if not written:
        return None
    try:
        return UNITS[written if written in UNITS else written.lower()]
    except KeyError:
        raise ScanError(f"unit '{written}' is not one of length; known are {', '.join(UNITS)}") from None


UNITS = {
    "m": 1e3, "cm": 10.0, "mm": 1.0, "µm": 1e-3, "um": 1e-3, "nm": 1e-6, "pm": 1e-9, "Å": 1e-7,
    "in": 25.4, "micron": 1e-3, "microns": 1e-3, "micrometer": 1e-3, "micrometers": 1e-3, "~m": 1e-3,
    "millimeter": 1.0, "nanometer": 1e-6, "meter": 1e3,
}  # fmt: skip
"""Units of length [mm]; "~m" is what an old code page makes of µm."""
