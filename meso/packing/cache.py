"""Flat packings, made once: kept in memory, and on disk in a form that a kill or a second process cannot spoil."""

from __future__ import annotations

import functools
import hashlib
import warnings
from pathlib import Path

import numpy as np

from macrofit.base.arrayfile import read_npz
from macrofit.base.files import cache_folder, replacing

from ..errors import OutputError
from ..surfaces import surface
from ..surfaces.surface import Surface, generator
from . import kernels as packing_kernels
from . import pack as packing
from .pack import Packing, pack

MOST_BYTES = 1_000_000_000
"""Size of a file; a sphere has 32 bytes."""


@functools.lru_cache(maxsize=32)
def flat_packing(spheres: int, size: tuple[float, float], thickness: float, seed: int) -> Packing:
    """The flat packing of these numbers: from memory, from the cache on disk, or made and stored there.

    A file that is damaged is made again, and a folder that cannot be written is done without; both say so in a
    warning. The file's name holds a hash of the arguments and of the code that packs.

    Raises:
        PackingError: as `meso.packing.pack.pack`.
    """
    folder = cache_folder()
    file = None if folder is None else folder / "packings" / f"{_key(spheres, size, thickness, seed)}.npz"
    stored = None if file is None else _read(file, size, thickness)
    if stored is not None:
        return stored
    made = pack(generator("packing", seed, spheres), spheres=spheres, size=size, thickness=thickness)
    if file is None:
        return made
    try:
        with replacing(file) as draft:
            np.savez(draft, centres=made.centres, radii=made.radii)
    except OutputError as error:
        warnings.warn(f"packings are not kept, MACROFIT_CACHE may name another folder: {error}", stacklevel=2)
    return made


def _read(file: Path, size: tuple[float, float], thickness: float) -> Packing | None:
    if not file.exists():
        return None
    try:
        arrays = read_npz(file, MOST_BYTES)
        centres, radii = arrays["centres"], arrays["radii"]
        if centres.shape != (len(radii), 3) or not (np.isfinite(centres).all() and np.all(radii > 0.0)):
            raise ValueError("not a packing")
        if len(radii) == 0 or np.any(centres < 0.0) or np.any(centres > np.array([*size, thickness])):
            raise ValueError("spheres outside their box")
    except (OutputError, ValueError, KeyError, TypeError) as error:
        warnings.warn(f"{file} is damaged and is made again ({error})", stacklevel=3)
        return None
    return Packing(centres, radii, Surface.flat(size), thickness)


def _key(*numbers: object) -> str:
    return hashlib.sha256(repr((numbers, _code())).encode()).hexdigest()[:24]


@functools.lru_cache(maxsize=1)
def _code() -> str:
    files = [Path(str(module.__file__)) for module in (packing, packing_kernels, surface)]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
