"""Drawn meshes that are kept on disk: what was meshed before needs no gmsh, whose loading takes longer than meshing.

A file is named by all that decides the mesh: outline, sizes, gmsh with the user's settings of it, and the code that
asks it.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..base.files import cache_folder
from ..base.kept import keep, read_kept
from ..errors import MacrofitError
from ..scene.keys import MeshFile, Scene
from .geometry import Drawing, Sizes, draw_body
from .triangles import MeshData

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


def kept_mesh(file: Path) -> MeshData | None:
    """The mesh in a file; None where there is none, or a damaged one, which a warning says."""
    arrays = read_kept(file)
    if arrays is None:
        return None
    points, triangles = arrays.pop("points"), arrays.pop("triangles")
    edges = {name.removeprefix(EDGES): pairs for name, pairs in arrays.items()}
    return MeshData(points=points, triangles=triangles, edges=edges)


def keep_mesh(file: Path, data: MeshData) -> None:
    """Keep a mesh for later runs; a folder that cannot be written is done without."""
    edges = {f"{EDGES}{name}": pairs for name, pairs in data.edges.items()}
    keep(file, {"points": data.points, "triangles": data.triangles, **edges})


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
