"""One way to read a file of heights, whatever wrote it: by how it begins, or else by its suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from macrofit.base.errors import OutputError
from macrofit.base.files import read_regular

from ..errors import SurfaceError
from .foreign import SUFFIXES, read_foreign
from .formats import AL3D_MAGIC, SDF_MAGICS, SUR_MAGIC, ZIP_MAGIC, read_al3d, read_sdf, read_sur, read_x3p
from .keys import MOST_BYTES
from .raw import RawScan, ScanError
from .tables import read_archive, read_array, read_points, read_text

MAGICS: tuple[tuple[tuple[bytes, ...], Callable[[bytes], RawScan]], ...] = (
    (SDF_MAGICS, read_sdf),
    ((SUR_MAGIC,), read_sur),
    ((AL3D_MAGIC,), read_al3d),
)
"""How instruments' files begin, and who reads them."""
TABLES: dict[str, Callable[[Path], RawScan]] = {
    ".npy": read_array, ".npz": read_archive, ".csv": read_text, ".txt": read_text, ".asc": read_text,
    ".dat": read_text, ".tsv": read_text, ".xyz": read_points,
}  # fmt: skip
"""Files without a mark of their own, by their suffix."""
OWN = ("sdf", "sur", "al3d", "x3p")
"""Suffixes of files that are known by how they begin."""


def read_scan(path: Path) -> RawScan:
    """What a file of heights says.

    Raises:
        SurfaceError: it cannot be read, is damaged, or of a kind that is not read; the message begins with the file.
    """
    suffix = path.suffix.lower()
    try:
        if suffix in TABLES:
            return TABLES[suffix](path)
        data = read_regular(path, MOST_BYTES)
        for starts, reader in MAGICS:
            if data.startswith(starts):
                return reader(data)
        if data.startswith(ZIP_MAGIC) and suffix == ".x3p":
            return read_x3p(data)
        if suffix.removeprefix(".") in OWN:
            raise ScanError(f"it does not begin as a {suffix} file does: it is damaged, or compressed")
        if suffix in SUFFIXES:
            return read_foreign(path)
    except ScanError as error:
        raise SurfaceError(f"{path}: {error}") from None
    except OutputError as error:
        raise SurfaceError(str(error)) from None
    known = ", ".join((*TABLES, *(f".{name}" for name in OWN)))
    raise SurfaceError(f"{path}: files {suffix or 'without a suffix'} are not read; take {known}, or save as .x3p")
