"""Files of heights that SurfaceTopography reads, where it is installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from macrofit.base.errors import shortened

from .raw import RawScan, ScanError, length_unit

SUFFIXES = (
    ".opd", ".opdx", ".nms", ".plu", ".plux", ".gwy", ".datx", ".zon", ".vk4", ".vk6", ".vk7", ".lext", ".oir",
    ".ezd", ".frt", ".mi", ".mdt", ".nmm", ".zmg", ".mnt", ".ibw", ".bcr", ".bcrf", ".dzi", ".tmd", ".os3d", ".spm",
    ".nc", ".mat", ".h5", ".stp", ".jpk", ".qep",
)  # fmt: skip
"""Suffixes of files that are left to it."""


MARKLESS = {"hgt", "asc", "txt", "csv", "xyz"}
"""Suffixes of kinds without a mark of their own, whose readers take other files too: any block of bytes, as heights."""


def read_foreign(path: Path) -> RawScan:
    """The default channel of a file.

    Raises:
        ScanError: SurfaceTopography is not there or does not read the file; or the file has no unit.
    """
    try:
        from SurfaceTopography import open_topography
    except ImportError as error:
        raise ScanError(
            f"files {path.suffix} are read by SurfaceTopography, which is not there ({error}); install it as "
            "docs/surfaces.md says, or save the file as .x3p or .sur by the instrument's program"
        ) from None
    try:
        with open_topography(str(path)) as reader:
            kinds = set(getattr(reader, "_file_extensions", None) or ())
            if kinds & MARKLESS:
                raise ValueError(
                    f"it has no mark of a {path.suffix} file, and would be taken for {', '.join(sorted(kinds))}"
                )
            found = reader.topography()
        heights = np.ma.filled(np.ma.asarray(found.heights(), dtype=np.float64), np.nan)
        sizes, unit = found.physical_sizes, found.unit
    except Exception as error:  # whatever a stranger's reader raises at a stranger's file
        raise ScanError(f"SurfaceTopography does not read it ({type(error).__name__}: {shortened(error)})") from None
    if heights.ndim != 2:
        raise ScanError("it is a line, no surface")
    scale = None if unit is None else length_unit(unit)
    if sizes is None or scale is None:
        return RawScan(heights, scale, None)
    return RawScan(heights, scale, (sizes[0] * scale / heights.shape[0], sizes[1] * scale / heights.shape[1]))
