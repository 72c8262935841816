"""What a file of heights says, before anything is mended."""

from __future__ import annotations

import re
from typing import NamedTuple

from macrofit.base.arrays import FloatArray
from macrofit.base.errors import shortened
from macrofit.base.units import LENGTHS, known_unit

from ..errors import SurfaceError


class Remarks(NamedTuple):
    """What a reader has to say of a file, in words."""

    done: tuple[str, ...] = ()
    """What it took for what."""
    doubts: tuple[str, ...] = ()
    """What may be wrong."""
    unclear: tuple[str, ...] = ()
    """What speaks of the spacing and is not understood: refused unless a key says the spacing."""
    assumed: str = ""
    """What the spacing was taken for without being told; a key goes before it."""
    turned: tuple[str, ...] = ()
    """Doubts whether heights are positive out of the metal, unless they are to be turned over."""


class RawScan(NamedTuple):
    """Heights as a file has them; a point stands for the cell around it."""

    heights: FloatArray
    """Heights in `unit`, first axis x, second axis y, shape (nx, ny); NaN where nothing was measured."""
    unit: float | None
    """Unit of the heights [mm]; None where the file does not say it."""
    spacing: tuple[float, float] | None
    """Distances of the points along x and y [mm]; None where the file does not say them."""
    remarks: Remarks = Remarks()
    """What its reader has to say."""


class ScanError(SurfaceError):
    """A file of heights that is damaged, of a kind that is not read, or contradicts itself."""


def length_unit(written: str) -> float | None:
    """A unit of length [mm] by the name that instruments write; None where it names none.

    Raises:
        ScanError: it is no unit of length.
    """
    written = _unmangled(written.strip("\x00 []()"))
    if not written:
        return None
    found = LENGTHS.get(known_unit(written) or "", FINER.get(written.lower().removesuffix("s")))
    if found is None:
        raise ScanError(f"unit '{shortened(written)}' is not one of length; known are {', '.join((*LENGTHS, *FINER))}")
    return found


def unmangled(line: str) -> str:
    """A line of text whose µ was read in an old code page, or lost, as it was meant."""
    return re.sub(r"Âµ|Î¼|Â\?|[?\ufffd]+(?=m(?![^\W_]))", "µ", line)


def _unmangled(written: str) -> str:
    """A unit whose UTF-8 was read in an old code page, "Âµm", as it was meant; what stands for a lost sign is µ."""
    for code in ("latin-1", "cp1252"):
        try:
            written = written.encode(code).decode("utf-8")
            break
        except UnicodeError:
            continue
    return "µm" if written in LOST else written


FINER = {
    "nm": 1e-6, "pm": 1e-9, "å": 1e-7, "~m": 1e-3, "micrometer": 1e-3, "micrometre": 1e-3, "nanometer": 1e-6,
    "nanometre": 1e-6, "mikrometer": 1e-3, "mikron": 1e-3,
}  # fmt: skip
"""Units of length [mm] besides `LENGTHS`, in small letters; "~m" is what an old code page makes of µm."""
LOST = ("?m", "\ufffdm", "\ufffd\ufffdm", "\xe6m")
"""What is left of µm where its sign was lost, or came from the code page of DOS."""
