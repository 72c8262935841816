"""Sparse Cholesky factor of a stiffness by CHOLMOD, and the dense compliance of its contact nodes.

With the unknowns in the order [interior, contact nodes] the factor of the stiffness, P K P^T = L L^T, ends in the
factor L_cc of the contact nodes' Schur complement, and their compliance needs no solve:

    K_cc - K_ci K_ii^-1 K_ic = L_cc L_cc^T,        C = (K^-1)_cc = L_cc^-T L_cc^-1

The interior is ordered by AMD on the graph of the nodes, whose unknowns stay together: a tenth of METIS's time, and in
the plane no more for the factor. (METIS takes every SIGTERM while it runs for an error of its own and jumps out, and a
lock of the C library that was held then stays so: one such end in twenty never came.) One factor is for one thread at a
time. The library is Debian's libcholmod3 or libcholmod5; the records are those of its headers (3.0.14; they fit
5.3.1 unchanged), so that this module is longer than its purpose.

Reference: Y. Chen, T. A. Davis, W. W. Hager, S. Rajamanickam, "Algorithm 887: CHOLMOD, supernodal sparse Cholesky
factorization and update/downdate", ACM Trans. Math. Software 35(3), 22 (2008).
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import math
import weakref
from collections.abc import Iterator
from ctypes import POINTER, byref, c_double, c_int, c_long, c_size_t, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import lapack

from .errors import MacrofitError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.integer[Any]]

SONAMES = {"libcholmod.so.3": (3, 0), "libcholmod.so.5": (5, 3)}
"""The libraries of Debian 12 and 13, and the versions whose records are known."""
REMEDY = "install Debian's package libcholmod3 (Debian 12) or libcholmod5 (Debian 13)"

SINGULAR = 1e-10
"""A pivot L_jj^2 at or below this part of K_jj is rounding. Of the six null pivots of a free piece of lattice the three
least were below 4e-13 (100 to 300 spheres); the least of a plate held at a single sphere was 7e-6."""

FAILURES = {
    -2: "the factor of the stiffness does not fit in memory",
    -3: "the factor of the stiffness has over 2^31 entries",
}
"""By the status of CHOLMOD, what the user can mend; any other is a bug."""

NOT_POSITIVE_DEFINITE = 1  # a status
PATTERN, REAL = 0, 1  # kinds of values
UPPER = 1  # only the upper triangle is read
GIVEN, SUPERNODAL = 1, 2  # settings of the order and of the factor
SYSTEM = 0  # A x = b, permutation included
TILE = 64  # rows mirrored at once, so that they stay in cache


class FactorError(MacrofitError):
    """The library is missing or another one, or a factor is too large."""


class NotDefiniteError(FactorError):
    """The stiffness is not positive definite: a node is free in one of its components."""

    def __init__(self, node: int, component: int) -> None:
        super().__init__(f"the stiffness is not positive definite: node {node} is free in its component {component}")


def _fields(*declarations: str) -> list[tuple[str, Any]]:
    """The fields of a C struct, from lines like "int a b c[3]"."""
    kinds: dict[str, Any] = {"double": c_double, "int": c_int, "long": c_long, "size_t": c_size_t, "pointer": c_void_p}
    fields = []
    for declaration in declarations:
        kind, *names = declaration.split()
        for name in names:
            name, _, count = name.rstrip("]").partition("[")
            fields.append((name, kinds[kind] * int(count) if count else kinds[kind]))
    return fields


class _Method(ctypes.Structure):
    """One method of ordering: struct cholmod_method_struct."""

    _fields_ = _fields(
        "double lnz fl prune_dense prune_dense2 nd_oksep other_1[4]",
        "size_t nd_small other_2[4]",
        "int aggressive order_for_lu nd_compress nd_camd nd_components ordering",
        "size_t other_3[4]",
    )


class _Common(ctypes.Structure):
    """Settings, workspace and status: cholmod_common. Its tail, statistics and graphics cards, is only given room."""

    _fields_ = (
        *_fields(
            "double dbound grow0 grow1",
            "size_t grow2 maxrank",
            "double supernodal_switch",
            "int supernodal final_asis final_super final_ll final_pack final_monotonic final_resymbol",
            "double zrelax[3]",
            "size_t nrelax[3]",
            "int prefer_zomplex prefer_upper quick_return_if_not_posdef prefer_binary print precise try_catch",
            "pointer error_handler",
            "int nmethods current selected",
        ),
        ("method", _Method * 10),
        *_fields(
            "int postorder default_nesdis",
            "double metis_memory metis_dswitch",
            "size_t metis_nswitch nrow",
            "long mark",
            "size_t iworksize xworksize",
            "pointer flag head xwork iwork",
            "int itype dtype no_workspace_reallocate status",
            "double tail[512]",  # 86 in 3.0.14
        ),
    )


class _Sparse(ctypes.Structure):
    """A matrix by compressed columns: cholmod_sparse."""

    _fields_ = _fields("size_t nrow ncol nzmax", "pointer p i nz x z", "int stype itype xtype dtype sorted packed")


class _Dense(ctypes.Structure):
    """A dense matrix by columns: cholmod_dense."""

    _fields_ = _fields("size_t nrow ncol nzmax d", "pointer x z", "int xtype dtype")


class _Factor(ctypes.Structure):
    """The factor L: cholmod_factor."""

    _fields_ = _fields(
        "size_t n minor",
        "pointer perm colcount iperm",
        "size_t nzmax",
        "pointer p i x z nz next prev",
        "size_t nsuper ssize xsize maxcsize maxesize",
        "pointer super pi px s",
        "int ordering is_ll is_super is_monotonic itype xtype dtype use_gpu",
    )


def _defaults_in_place(common: _Common) -> bool:
    """Do the values that cholmod_start has set stand where the record looks for them?"""
    methods = common.method
    return (
        (common.grow0, common.grow1, common.grow2, common.maxrank) == (1.2, 1.2, 5, 8)
        and (common.supernodal_switch, common.supernodal, common.final_asis) == (40.0, 1, 1)
        and (tuple(common.zrelax), tuple(common.nrelax)) == ((0.8, 0.1, 0.05), (4, 16, 48))
        and (common.print, common.precise, common.nmethods, common.postorder) == (3, 0, 0, 1)
        and [methods[k].ordering for k in range(5)] == [1, 2, 3, 4, 0]
        and [methods[k].nd_small for k in (0, 5, 6)] == [200, 20000, 4]
        and all((method.prune_dense2, method.aggressive) == (-1.0, 1) for method in methods)
        and (common.metis_dswitch, common.metis_nswitch) == (0.66, 3000)
        and (common.nrow, common.flag, common.iwork) == (0, None, None)
        and (common.itype, common.dtype, common.status) == (0, 0, 0)
    )


def _first_library() -> tuple[str, ctypes.CDLL]:
    """The first of `SONAMES` that this machine has."""
    missing = []
    for name in SONAMES:
        try:
            return name, ctypes.CDLL(name)
        except OSError as error:
            missing.append(str(error))
    raise FactorError(f"CHOLMOD is missing: {REMEDY} ({'; '.join(missing)})")


@functools.cache
def _library() -> ctypes.CDLL:
    """Load the library, declare its functions, and check that its records are those above."""
    soname, library = _first_library()
    common, A, B, L = POINTER(_Common), POINTER(_Sparse), POINTER(_Dense), POINTER(_Factor)
    signatures: dict[str, tuple[Any, ...]] = {  # result, arguments
        "version": (c_int, POINTER(c_int)),
        "start": (c_int, common),
        "finish": (c_int, common),
        "amd": (c_int, A, c_void_p, c_size_t, c_void_p, common),
        "analyze_p": (L, A, c_void_p, c_void_p, c_size_t, common),
        "factorize": (c_int, A, L, common),
        "solve": (B, c_int, L, B, common),
        "free_factor": (c_int, POINTER(L), common),
        "free_dense": (c_int, POINTER(B), common),
    }
    for name, (result, *arguments) in signatures.items():
        function = library[f"cholmod_{name}"]
        function.restype, function.argtypes = result, arguments
        setattr(library, f"cholmod_{name}", function)
    version, probe = (c_int * 3)(), _Common()
    library.cholmod_version(version)
    library.cholmod_start(byref(probe))
    if tuple(version)[:2] != SONAMES[soname] or not _defaults_in_place(probe):
        found = ".".join(map(str, version))
        raise FactorError(f"{soname} is CHOLMOD {found}, and its records are not known: {REMEDY}")
    library.cholmod_finish(byref(probe))
    return library


@contextlib.contextmanager
def _one_thread(library: ctypes.CDLL) -> Iterator[None]:
    """Keep CHOLMOD serial: it asks OpenMP for four threads whatever the machine has, which costs a quarter more."""
    try:
        levels, allow = library.omp_get_max_active_levels(), library.omp_set_max_active_levels
    except AttributeError:  # built without OpenMP
        yield
        return
    allow(0)
    try:
        yield
    finally:
        allow(levels)


def free_memory() -> float:
    """What can still be had before the system kills a process [bytes]; infinite where it does not say."""
    free, group = math.inf, Path("/sys/fs/cgroup")
    with contextlib.suppress(OSError, ValueError, IndexError):
        free = 1024.0 * int(Path("/proc/meminfo").read_text().split("MemAvailable:")[1].split()[0])
    with contextlib.suppress(OSError, ValueError):  # "max" where the group has no limit
        limit = int((group / "memory.max").read_text())
        free = min(free, float(limit - int((group / "memory.current").read_text())))
    return free


def _raise_failure(common: _Common) -> None:
    if common.status < 0:
        if common.status in FAILURES:
            raise FactorError(FAILURES[common.status])
        raise RuntimeError(f"CHOLMOD returned the status {common.status}")


def _view(pointer: int, count: int, kind: Any = c_int) -> npt.NDArray[Any]:
    """The C array at an address, not copied."""
    return np.ctypeslib.as_array(ctypes.cast(pointer, POINTER(kind)), (count,))


def _compressed_rows(matrix: Any) -> Any:
    """The symmetric matrix without duplicates, in float64 and int32, not copied where it already is so."""
    K = (matrix.T if matrix.format == "csc" else matrix).tocsr()
    if not K.has_canonical_format:
        K = K.copy()
        K.sum_duplicates()
    values = np.ascontiguousarray(K.data, dtype=np.float64)
    indices, starts = (np.ascontiguousarray(array, dtype=np.int32) for array in (K.indices, K.indptr))
    return sparse.csr_matrix((values, indices, starts), shape=K.shape)


def _columns(A: Any) -> _Sparse:
    """The record of a symmetric matrix in compressed rows, which are its columns; `A` must outlive it."""
    if A.indptr.dtype != np.int32 or A.indices.dtype != np.int32:
        raise TypeError(f"indices of {A.indptr.dtype} and {A.indices.dtype} for a library of int32")
    valued = A.dtype == np.float64
    x, xtype = (A.data.ctypes.data, REAL) if valued else (None, PATTERN)
    p, i = A.indptr.ctypes.data, A.indices.ctypes.data
    return _Sparse(*A.shape, A.nnz, p, i, None, x, None, UPPER, 0, xtype, 0, 0, 1)


def _release(library: ctypes.CDLL, common: _Common, factors: list[Any]) -> None:
    for L in factors:
        library.cholmod_free_factor(byref(L), byref(common))
    library.cholmod_finish(byref(common))


class Factor:
    """P K P^T = L L^T of one stiffness, made by `factor`. It owns the memory of the library and frees it."""

    def __init__(self, K: Any, last: IntArray, block: int) -> None:
        self._library, self._common = _library(), _Common()
        self._factors: list[Any] = []
        self._library.cholmod_start(byref(self._common))
        weakref.finalize(self, _release, self._library, self._common, self._factors)
        self._common.print = 0
        self._common.supernodal, self._common.final_ll = SUPERNODAL, 1
        self._common.nmethods, self._common.method[0].ordering = 1, GIVEN
        self._common.postorder = 0  # a postorder may put contact nodes before the interior; AMD's is one already
        self._common.quick_return_if_not_posdef = 1
        self._block, self._size, self._trailing = block, K.shape[0], block * len(last)
        self._analyse(K, self._order(K, last))
        self._factorize(K)

    def _order(self, K: Any, last: IntArray) -> npt.NDArray[np.int32]:
        """The permutation [interior by AMD, contact nodes as given] of the unknowns."""
        blocks = K.tobsr((self._block, self._block))
        nodes = len(blocks.indptr) - 1
        pattern = np.ones(len(blocks.indices), dtype=np.int8)
        graph = sparse.csr_matrix((pattern, blocks.indices, blocks.indptr), shape=(nodes, nodes))
        interior = np.setdiff1d(np.arange(nodes), last)
        sequence = np.concatenate([interior[self._by_amd(graph[interior][:, interior])], last])
        unknowns = sequence[:, None] * self._block + np.arange(self._block)
        return np.asarray(unknowns.ravel(), dtype=np.int32)

    def _by_amd(self, graph: Any) -> npt.NDArray[np.int32]:
        """The nodes of a graph in AMD's order, which is a postorder of its elimination tree."""
        order = np.empty(graph.shape[0], dtype=np.int32)
        self._library.cholmod_amd(byref(_columns(graph)), None, 0, order.ctypes.data, byref(self._common))
        _raise_failure(self._common)
        return order

    def _analyse(self, K: Any, permutation: npt.NDArray[np.int32]) -> None:
        A = _columns(K)
        L = self._library.cholmod_analyze_p(byref(A), permutation.ctypes.data, None, 0, byref(self._common))
        if L:
            self._factors.append(L)
        _raise_failure(self._common)
        self._permutation = _view(L.contents.perm, self._size)
        first = self._size - self._trailing
        if not np.array_equal(self._permutation[first:], permutation[first:]):
            raise RuntimeError("CHOLMOD has moved the contact nodes from the end of the order")
        # an allocation that is too large succeeds, and the process is killed when it is filled
        needed, free = 8.0 * (L.contents.xsize + L.contents.maxcsize + self._trailing**2), free_memory()
        if needed > free:
            raise FactorError(
                f"the factor of the stiffness and the compliance of {self._trailing // self._block} contact nodes take "
                f"{needed / 2**30:.1f} GiB, and {free / 2**30:.1f} GiB are free"
            )

    def _factorize(self, K: Any) -> None:
        with _one_thread(self._library):
            self._library.cholmod_factorize(byref(_columns(K)), self._factors[0], byref(self._common))
        _raise_failure(self._common)
        L = self._factors[0].contents
        if self._common.status == NOT_POSITIVE_DEFINITE:
            raise self._free_piece(L.minor)
        self._super, self._pi, self._px = (_view(array, L.nsuper + 1) for array in (L.super, L.pi, L.px))
        self._s, self._x = _view(L.s, L.ssize), _view(L.x, L.xsize, c_double)
        columns, rows = np.diff(self._super), np.diff(self._pi)
        diagonal = np.repeat(self._px[:-1], columns) + np.repeat(rows + 1, columns) * (
            np.arange(self._size) - np.repeat(self._super[:-1], columns)
        )
        held = self._x[diagonal] ** 2 > SINGULAR * K.diagonal()[self._permutation]  # False where it is not a number
        if not held.all():
            raise self._free_piece(int(np.argmin(held)))

    def _free_piece(self, pivot: int) -> NotDefiniteError:
        return NotDefiniteError(*divmod(int(self._permutation[pivot]), self._block))

    @property
    def entries(self) -> int:
        """Entries of L as it is stored, by supernodes [-]."""
        return len(self._x)

    @property
    def flops(self) -> float:
        """Operations of the factorisation, the sum of the squared lengths of the columns of L [-]."""
        columns, rows = np.diff(self._super).astype(np.float64), np.diff(self._pi).astype(np.float64)
        below = rows - columns
        whole = columns * (columns + 1.0)
        return float(np.sum(columns * below**2 + below * whole + whole * (2.0 * columns + 1.0) / 6.0))

    @property
    def permutation(self) -> IntArray:
        """The unknown that stands in each row of L (n,)."""
        return np.asarray(self._permutation, dtype=np.int64)

    @property
    def supernodes(self) -> tuple[IntArray, IntArray, IntArray, IntArray, FloatArray]:
        """L by its k supernodes, views of the library's memory: keep the factor as long as they are used.

        Returns:
            The first column of each supernode (k + 1,), where its rows begin (k + 1,) and its values (k + 1,), the rows
            and the values; the columns of a supernode follow each other, each with all rows.
        """
        return self._super, self._pi, self._px, self._s, self._x

    def solve(self, rhs: FloatArray) -> FloatArray:
        """The solution x of K x = rhs.

        Args:
            rhs: right-hand side of shape (n,), or k of them as columns of shape (n, k).

        Returns:
            An array of the shape of `rhs`.

        Raises:
            ValueError: the shape does not fit.
        """
        if rhs.ndim not in (1, 2) or len(rhs) != self._size:
            raise ValueError(f"a right-hand side of shape {rhs.shape} for {self._size} unknowns")
        b = np.asfortranarray(rhs.reshape(self._size, -1), dtype=np.float64)
        B = _Dense(*b.shape, b.size, self._size, b.ctypes.data, None, REAL, 0)
        X = self._library.cholmod_solve(SYSTEM, self._factors[0], byref(B), byref(self._common))
        _raise_failure(self._common)
        x = _view(X.contents.x, b.size, c_double).copy()
        self._library.cholmod_free_dense(byref(X), byref(self._common))
        return x.reshape(b.shape, order="F").reshape(rhs.shape)

    def trailing_block(self) -> FloatArray:
        """L_cc (m, m) in the lower triangle, in the order of `last`; what stands above has no meaning."""
        first = self._size - self._trailing
        block = np.zeros((self._trailing, self._trailing), order="F")
        for k in range(np.searchsorted(self._super, first, side="right") - 1, len(self._super) - 1):
            rows = self._s[self._pi[k] : self._pi[k + 1]]
            stop = self._px[k] + len(rows) * (self._super[k + 1] - self._super[k])
            skipped = max(first - self._super[k], 0)  # the interior's part of the supernode that straddles
            values = self._x[self._px[k] : stop].reshape(-1, len(rows)).T[skipped:, skipped:]
            rows = rows[skipped:] - first
            start, end = rows[0], rows[0] + values.shape[1]
            gaps = np.flatnonzero(np.diff(rows) != 1) + 1
            for i, j in zip([0, *gaps], [*gaps, len(rows)], strict=True):
                block[rows[i] : rows[i] + j - i, start:end] = values[i:j]
        return block

    def compliance(self) -> FloatArray:
        """The dense compliance C = (K^-1)_cc = L_cc^-T L_cc^-1 of the nodes `last`.

        Returns:
            C of shape (m, m), symmetric to the bit, its rows the unknowns of `last` in the order given.
        """
        return inverse_of(self.trailing_block()) if self._trailing else np.zeros((0, 0))


def inverse_of(lower: FloatArray) -> FloatArray:
    """(L L')^-1 of a lower triangle L (m, m), whatever stands above it; symmetric to the bit.

    L is overwritten where it is stored by columns.
    """
    C, info = lapack.dpotri(lower, lower=1, overwrite_c=1)
    if info:
        raise RuntimeError(f"dpotri returned {info}")
    for k in range(0, len(C), TILE):
        tile = C[k : k + TILE, k : k + TILE]
        tile[:] = np.tril(tile) + np.tril(tile, -1).T
        C[k : k + TILE, k + TILE :] = C[k + TILE :, k : k + TILE].T
    return C.T  # type: ignore[no-any-return]


def factor(matrix: Any, last: IntArray | None = None, block: int = 1) -> Factor:
    """Factor a stiffness, its contact nodes ordered last.

    Args:
        matrix: stiffness K, sparse of shape (n, n), symmetric positive definite; one of its triangles is read.
        last: numbers of the contact nodes, shape (m / block,), in any order; none by default.
        block: unknowns of a node, consecutive in K.

    Returns:
        The factor, for solutions and for the compliance of `last`.

    Raises:
        FactorError: the library is missing or another one, or the factor is too large.
        NotDefiniteError: K is not positive definite.
        ValueError: shapes do not fit, or `last` names a node twice or one that is not there.
    """
    n = matrix.shape[0]
    if n == 0 or matrix.shape != (n, n) or n % block:
        raise ValueError(f"a matrix of shape {matrix.shape} in blocks of {block}")
    nodes = np.zeros(0, dtype=np.int64) if last is None else np.asarray(last)
    if nodes.ndim != 1 or not np.isin(nodes, np.arange(n // block)).all() or len(np.unique(nodes)) < len(nodes):
        raise ValueError(f"the last nodes must be different ones of the {n // block}")
    return Factor(_compressed_rows(matrix), nodes, block)
