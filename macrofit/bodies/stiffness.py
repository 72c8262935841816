"""The elements and the stiffness of a body: assembled by dolfinx, or as they were kept from an earlier run.

To load dolfinx takes longer than to assemble, and both take longer than to read what they gave. A file is named by all
that decides it: the mesh, the order, the moduli, the packages and the code that assemble it.
"""

from __future__ import annotations

import functools
import hashlib
from importlib import metadata
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..base.arrays import IntArray
from ..base.files import cache_folder
from ..base.kept import keep, read_kept
from ..scene.material import Material
from .discretisation import Discretisation
from .kept import EDGES
from .triangles import MeshData

PACKAGES = ("fenics-dolfinx", "fenics-basix", "fenics-ffcx", "fenics-ufl", "petsc4py")
"""Distributions whose versions may change a stiffness."""
CODE = ("fenics.py", "elasticity.py", "discretisation.py", Path(__file__).name)


def elastic_space(data: MeshData, order: int, material: Material) -> Discretisation:
    """Elements of this order (1 or 2) on a mesh, and their stiffness [N/mm] for the full ring.

    Kept in the cache folder; dolfinx is loaded for those alone that are not there.
    """
    moduli = (material.lame_lambda, material.shear_modulus)
    file = _file(data, order, moduli)
    found = None if file is None else kept_stiffness(file, order)
    if found is None:
        from .elasticity import weak_form
        from .fenics import discretise

        found = discretise(data, order, weak_form, moduli)
        if file is not None:
            keep_stiffness(file, found)
    return found


def _file(data: MeshData, order: int, moduli: tuple[float, float]) -> Path | None:
    """Where a stiffness is kept; None without a cache folder or where dolfinx is missing."""
    folder, assembler = cache_folder(), _assembler()
    if folder is None or not assembler:
        return None
    digest = hashlib.sha256(repr((assembler, order, moduli, [*data.edges])).encode())
    for array in (data.points, data.triangles, *data.edges.values()):
        digest.update(repr((array.dtype.str, array.shape)).encode() + array.tobytes())
    return folder / "stiffness" / f"{digest.hexdigest()[:24]}.npz"


def kept_stiffness(file: Path, order: int) -> Discretisation | None:
    """The elements and the stiffness in a file; None where there is none, or a damaged one, which a warning says."""
    arrays = read_kept(file)
    if arrays is None:
        return None
    nodes, cells, *rows = (arrays.pop(name) for name in ("nodes", "cells", "entries", "indices", "starts"))
    return Discretisation(
        order=order,
        nodes=nodes,
        cells=cells,
        edges={name.removeprefix(EDGES): places for name, places in arrays.items()},
        stiffness=sp.csr_matrix(tuple(rows), shape=(2 * len(nodes), 2 * len(nodes))),
    )


def keep_stiffness(file: Path, space: Discretisation) -> None:
    """Keep what dolfinx gave for later runs; a folder that cannot be written is done without."""
    K = space.stiffness
    edges: dict[str, IntArray] = {f"{EDGES}{name}": places for name, places in space.edges.items()}
    rows = {"entries": K.data, "indices": K.indices, "starts": K.indptr}
    keep(file, {"nodes": space.nodes, "cells": space.cells, **rows, **edges})


@functools.lru_cache(maxsize=1)
def _assembler() -> str:
    """What assembles, in a digest: versions, and the code that asks; "" where dolfinx is missing."""
    try:
        versions = [metadata.version(name) for name in PACKAGES]
    except metadata.PackageNotFoundError:
        return ""
    digest = hashlib.sha256(repr((versions, np.__version__)).encode())
    for name in CODE:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()
