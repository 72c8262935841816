"""Drawn meshes that are kept on disk: what was meshed before needs no gmsh, whose loading takes longer than meshing.

A file is named by all that decides the mesh: outline, sizes, gmsh with the user's settings of it, and the code that
asks it. It is written whole or not at all, checked when it is read, and made again where it is damaged.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.arrayfile import read_npz
from ..base.errors import OutputError
from ..base.files import cache_folder, replacing
from ..errors import MacrofitError
from ..scene.keys import MeshFile, Scene
from .geometry import Drawing, Sizes, draw_body
from .triangles import MeshData

MOST_BYTES = 200_000_000
"""Size of all meshes that are kept; the oldest go first."""
EDGES = "edges of "
"""What the names of the arrays of a boundary begin with in a file."""


def mesh_file(drawing: Drawing, coarse: float, growth: float) -> Path | None:
    """Where the mesh of a drawing is kept; None without a cache folder or where gmsh is missing."""
    folder, mesher = cache_folder(), _mesher()
    if folder is None or not mesher:
        return None
    places = np.array([(*edge.start, *edge.end, edge.corner) for edge in drawing.edges], dtype=np.float64)
    words = repr((drawing.contact, [edge.name for edge in drawing.edges], mesher))
    sizes = drawing.sizes
    numbers = np.array([sizes.facet, sizes.corner, sizes.growth, coarse, growth], dtype=np.float64)
    key = hashlib.sha256(words.encode() + numbers.tobytes() + places.tobytes()).hexdigest()[:24]
    return folder / "meshes" / f"{key}.npz"


def read_kept(file: Path) -> MeshData | None:
    """The mesh in a file; None where there is none, or a damaged one, which a warning says."""
    if not os.path.exists(file):  # it raises nothing, whatever the name
        return None
    try:
        arrays = read_npz(file, MOST_BYTES)
        if not np.array_equal(arrays.pop("digest"), _digest(file, arrays)):
            raise ValueError
        points, triangles = arrays.pop("points"), arrays.pop("triangles")
    except (OutputError, ValueError, KeyError):
        warnings.warn(f"{file} is damaged and is made again", stacklevel=3)
        return None
    edges = {name.removeprefix(EDGES): pairs for name, pairs in arrays.items()}
    return MeshData(points=points, triangles=triangles, edges=edges)


def keep(file: Path, data: MeshData) -> None:
    """Keep a mesh for later runs; a folder that cannot be written is done without."""
    arrays = {"points": data.points, "triangles": data.triangles}
    arrays |= {f"{EDGES}{name}": pairs for name, pairs in data.edges.items()}
    with suppress(OutputError, OSError):
        with replacing(file) as draft:
            np.savez(draft, digest=_digest(file, arrays), **arrays)
        _remove_oldest(file.parent)


def _digest(file: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[np.uint8]:
    """SHA-256 of a file's name and arrays with their names, types and shapes: an archive checks bytes of each alone."""
    digest = hashlib.sha256(file.stem.encode())
    for name in sorted(arrays):
        digest.update(repr((name, arrays[name].dtype.str, arrays[name].shape)).encode() + arrays[name].tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)


def all_kept(scene: Scene) -> bool:
    """Whether the meshes of all drawn bodies of a scene are kept, so that no gmsh is needed."""
    keys = scene.mesh
    for spec, contact in ((scene.axle, "seat"), (scene.wheel, "bore")):
        if isinstance(spec, MeshFile):
            continue
        try:
            file = mesh_file(draw_body(spec, contact, Sizes.of(keys, contact)), keys.coarse, keys.growth)
        except MacrofitError:
            return False  # whoever meshes it will say so
        if file is None or not os.path.exists(file):
            return False
    return True


def _remove_oldest(folder: Path) -> None:
    """Keep the newest meshes alone; another process may remove them too."""
    kept = []
    for file in folder.glob("*.npz"):
        with suppress(OSError):
            about = file.stat()
            kept.append((about.st_mtime_ns, about.st_size, file))
    total = 0
    for _, size, file in sorted(kept, reverse=True):
        total += size
        if total > MOST_BYTES:
            with suppress(OSError):
                file.unlink(missing_ok=True)


@functools.lru_cache(maxsize=1)
def _mesher() -> str:
    """What gmsh, its settings and the code that asks it are, in a digest; "" where gmsh is missing."""
    found = importlib.util.find_spec("gmsh")
    if found is None or found.origin is None:
        return ""
    own = Path(os.environ.get("GMSH_HOME") or os.path.expanduser("~"))
    files = [Path(found.origin), own / ".gmshrc", own / ".gmsh-options"]
    files += [Path(__file__).with_name(name) for name in ("mesh.py", "triangles.py", Path(__file__).name)]
    digest = hashlib.sha256()
    for file in files:
        with suppress(OSError):
            digest.update(file.read_bytes())
        digest.update(b"\0")
    return digest.hexdigest()
