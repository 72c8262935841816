"""The only file that speaks to dolfinx, basix and PETSc: what differs between their versions stays here.

Tried with dolfinx 0.5.2 (Debian 12) and 0.9 (Debian 13); 0.10 and 0.11 by reading their sources.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.metadata
import logging
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import IO, Any, Literal
from weakref import finalize

import numpy as np
import petsc4py
import scipy.sparse as sp
from mpi4py import MPI

from ..base.arrays import FloatArray, IntArray
from ..base.caches import ensure_cache
from ..base.errors import OutputError
from ..base.files import write_text
from .discretisation import Discretisation
from .triangles import MeshData


@contextmanager
def _bare_imports() -> Iterator[None]:
    """Spare dolfinx 0.2 s of imports, and the words of the command, which it would read as its own.

    pkg_resources reads all that is installed to tell ufl and ffcx of 0.5 their version; 0.9 imports numba for
    kernels in Python, and does without it where it is not installed. Words that are no UTF-8, such as an old name of a
    file, are a TypeError to it.
    """
    words, sys.argv = sys.argv, ["macrofit"]
    versions = ModuleType("pkg_resources")
    versions.get_distribution = importlib.metadata.distribution  # type: ignore[attr-defined]
    stand_ins = {"pkg_resources": versions, "llvmlite": None, "numba": None}
    stand_ins = {name: stand_in for name, stand_in in stand_ins.items() if name not in sys.modules}
    sys.modules.update(stand_ins)  # type: ignore[arg-type]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImportWarning)
            yield
    finally:
        sys.argv = words
        for name in stand_ins:
            del sys.modules[name]


ensure_cache()  # dolfinx looks for it when it is imported
# it would take a closed pipe for a crash, and hide real ones; on all ranks it would wait for those that need none of it
petsc4py.init(["macrofit", "-no_signal_handler"], comm=MPI.COMM_SELF)
with _bare_imports():
    import basix
    import ufl
    from dolfinx import fem, mesh
    from dolfinx.fem import petsc as fem_petsc
    from petsc4py import PETSc

logging.captureWarnings(False)  # ffcx, on import, sends all warnings to the log, with their place in the code

WeakForm = Callable[[Any, Any, Any, Any], Any]

LONGEST_WAIT_S = 60.0
"""How long a process waits for others that compile."""


def discretise(data: MeshData, order: int, form: WeakForm, constants: tuple[float, float]) -> Discretisation:
    """Assemble ``form(u, v, x, constants)`` on the mesh; every rank holds the whole body it calls this for."""
    grid, space = _mesh_and_space(data, order)
    values = [fem.Constant(grid, PETSc.ScalarType(value)) for value in constants]
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    weak = form(u, v, ufl.SpatialCoordinate(grid), values)
    matrix = fem_petsc.assemble_matrix(_compiling(lambda: fem.form(weak)))
    _keep_check_sums(order)
    matrix.assemble()
    indptr, indices, entries = matrix.getValuesCSR()
    size = matrix.getSize()
    matrix.destroy()

    count = grid.topology.index_map(2).size_local
    cells = _rows(space.dofmap.list, count).astype(np.int64)
    geometry = grid.geometry
    vertices = _rows(geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap, count)
    original = np.asarray(geometry.input_global_indices, dtype=np.int64)[vertices]
    return Discretisation(
        order=order,
        nodes=np.ascontiguousarray(space.tabulate_dof_coordinates()[:, :2]),
        cells=cells,
        edges=_locate_edges(original, data.edges, len(data.points)),
        stiffness=sp.csr_matrix((entries, indices, indptr), shape=size),
    )


def _mesh_and_space(data: MeshData, order: int) -> tuple[Any, Any]:
    """The mesh and the vectors on it. From 0.7 basix makes the elements; 0.10 swaps create_mesh's last arguments."""
    if hasattr(fem, "functionspace"):
        vertices = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
        grid = mesh.create_mesh(MPI.COMM_SELF, cells=data.triangles, x=data.points, e=ufl.Mesh(vertices))
        return grid, _compiling(lambda: fem.functionspace(grid, ("Lagrange", order, (2,))))
    domain = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.triangle, 1))
    grid = mesh.create_mesh(MPI.COMM_SELF, cells=data.triangles, x=data.points, domain=domain)
    return grid, _compiling(lambda: fem.VectorFunctionSpace(grid, ("Lagrange", order)))


def _rows(dofmap: Any, count: int) -> Any:
    """A map of cells as an array, one row each; dolfinx 0.5 gives it as an adjacency list."""
    return getattr(dofmap, "array", dofmap).reshape(count, -1)


def _compiling(build: Callable[[], Any]) -> Any:
    """What ``build`` makes, compiling code where it must, without the compiler's own messages.

    A compilation that was killed leaves a source without a library, for which later ones wait in vain (ten seconds,
    then TimeoutError), and a library may be damaged or gone: such leftovers are removed, and the code compiled anew.
    """
    enabled = logging.root.manager.disable
    logging.disable(logging.INFO)
    try:
        with _alone():
            _remove_damaged()
            try:
                return build()
            except (TimeoutError, ImportError, AttributeError) as error:
                _remove_leftovers(getattr(error, "path", None))
                return build()
    finally:
        logging.disable(enabled)


@contextmanager
def _alone() -> Iterator[None]:
    """Wait while another process compiles, a rank or another run: it would be in the way, or take ours for leftovers.

    Where files cannot be locked, or the other one takes longer than a minute, it goes on.
    """
    folder, end = _compiled_forms(), time.monotonic() + LONGEST_WAIT_S
    with ExitStack() as opened:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            lock = opened.enter_context((folder / "macrofit.lock").open("w"))
            while not _locked(lock) and time.monotonic() < end:
                time.sleep(0.02)
        yield


def _locked(file: IO[str]) -> bool:
    """Whether a file is ours alone now, until it is closed or the process ends.

    Raises:
        OSError: this file system knows no locks.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _compiled_forms() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser() / "fenics"


@lru_cache(maxsize=1)
def _remove_damaged() -> None:
    """Remove libraries that are not what they were, which to load may kill the process, and traces of lost ones."""
    for ready in _compiled_forms().glob("libffcx_*.c.cached"):
        name = ready.name.removesuffix(".c.cached")
        libraries = list(ready.parent.glob(f"{name}.*.so"))
        if not libraries or not all(map(is_sound_library, libraries)):
            _remove_compiled(ready.parent, name)


def is_sound_library(path: Path) -> bool:
    """Whether a library has the check sum that was kept when it was first used, or else its whole length."""
    try:
        return _check_sum(path).read_text() == hashlib.sha256(path.read_bytes()).hexdigest()
    except FileNotFoundError:
        return is_whole_library(path)
    except (OSError, UnicodeDecodeError):
        return False


@lru_cache(maxsize=2)
def _keep_check_sums(order: int) -> None:
    """Write down the check sums of the libraries in use, once for each order of elements (Linux alone tells them)."""
    with suppress(OSError, OutputError):
        lines = Path("/proc/self/maps").read_text().splitlines()
        for path in {Path(line[line.index("/") :]) for line in lines if "/libffcx_" in line and line.endswith(".so")}:
            if not _check_sum(path).exists():
                write_text(_check_sum(path), hashlib.sha256(path.read_bytes()).hexdigest())


def _check_sum(library: Path) -> Path:
    return library.with_name(f"{library.name.partition('.')[0]}.sha256")


def is_whole_library(path: Path) -> bool:
    """Whether a library has the length that its head (ELF, 64 bit) says; one of another kind counts as whole."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
            length = os.fstat(file.fileno()).st_size
    except OSError:
        return False
    if head[:5] != b"\x7fELF\x02":
        return len(head) == 64 and any(head)
    if len(head) < 64:
        return False
    order: Literal["little", "big"] = "little" if head[5] == 1 else "big"
    sections, size, count = (int.from_bytes(head[a:b], order) for a, b in ((40, 48), (58, 60), (60, 62)))
    return length >= sections + size * count


def _remove_leftovers(library: str | None) -> None:
    """Remove sources without a library, and a library that could not be loaded."""
    cache = _compiled_forms()
    for source in cache.glob("libffcx_*.c"):
        if not source.with_suffix(".c.cached").exists():
            source.unlink(missing_ok=True)
    if library is not None and Path(library).name.startswith("libffcx_"):
        _remove_compiled(cache, Path(library).name.partition(".")[0])


def _remove_compiled(cache: Path, name: str) -> None:
    with suppress(OSError):  # of another user, or removed meanwhile
        for file in cache.glob(f"{name}.*"):
            file.unlink(missing_ok=True)


def _locate_edges(triangles: IntArray, edges: dict[str, IntArray], points: int) -> dict[str, IntArray]:
    """For each named edge the cell that owns it and the local indices of its ends, in the order given."""
    pairs = [(0, 1), (1, 2), (2, 0)]
    keys = np.concatenate([np.sort(triangles[:, pair], axis=1) @ np.array([points, 1]) for pair in pairs])
    order = np.argsort(keys, kind="stable")
    found = {}
    for name, ends in edges.items():
        place = np.searchsorted(keys[order], np.sort(ends, axis=1) @ np.array([points, 1]))
        cell = order[np.minimum(place, len(order) - 1)] % len(triangles)
        local = [np.argmax(triangles[cell] == ends[:, [k]], axis=1) for k in (0, 1)]
        found[name] = np.stack([cell, *local], axis=1).astype(np.int64)
    return found


class Factor:
    """A sparse matrix factored by MUMPS (through PETSc), and its solves; ``solves`` counts right-hand sides."""

    def __init__(self, matrix: sp.csr_matrix) -> None:
        self._matrix, self._pc = _prepare(matrix)
        self._pc.setUp()
        self._factor = self._pc.getFactorMatrix()
        finalize(self, _destroy, self._pc, self._factor, self._matrix)
        self.solves = 0

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve for one right-hand side (n,) or many (n, k)."""
        block = np.asfortranarray(rhs.reshape(len(rhs), -1))
        out = np.zeros_like(block, order="F")
        dense = [PETSc.Mat().createDense(block.shape, array=array, comm=PETSc.COMM_SELF) for array in (block, out)]
        self._factor.matSolve(*dense)
        for mat in dense:
            mat.destroy()
        self.solves += block.shape[1]
        return out.reshape(rhs.shape) if rhs.ndim == 1 else out


def _prepare(matrix: sp.csr_matrix) -> tuple[Any, Any]:
    matrix = sp.csr_matrix(matrix)
    matrix.sort_indices()
    wrapped = PETSc.Mat().createAIJ(
        matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=PETSc.COMM_SELF
    )
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setType("lu")
    pc.setOperators(wrapped)
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    return wrapped, pc


def _destroy(*objects: Any) -> None:
    """Free PETSc's objects; where Python drops the last reference, petsc4py 3.18 keeps a factor in memory for ever."""
    for each in objects:
        each.destroy()
