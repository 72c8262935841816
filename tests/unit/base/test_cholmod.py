"""The sparse factor: against dense inverses and SuperLU, candidates in any order, loud failures, no memory kept."""

from __future__ import annotations

import ctypes
import gc
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from macrofit.base import cholmod
from macrofit.base.arrays import FloatArray, IntArray
from macrofit.base.cholmod import Factor, FactorError, NotDefiniteError

# The condition of these lattices is below 400, so that two backward-stable ways part by some 400 eps = 1e-13.
TOLERANCE = 1e-12


def factor(matrix: Any, last: IntArray | None = None, block: int = 6) -> Factor:
    """A factor of lattices, whose nodes have six unknowns."""
    return cholmod.factor(matrix, last, block)


def lattice(nodes: int, block: int, seed: int = 0, held: bool = True) -> sparse.csr_matrix:
    """Scattered nodes bound to their neighbours, energy k (Q_j u_j - Q_i u_i)^2 / 2; springs may hold one in ten.

    Not held, it moves freely by u_i = Q_i^-1 c, in `block` ways.
    """
    rng = np.random.default_rng(seed)
    tree = cKDTree(rng.random((nodes, 3)) * [2.0, 1.0, 0.3])
    pairs = {(i, i + 1) for i in range(nodes - 1)}  # so that it is in one piece
    if nodes > 5:
        _, near = tree.query(tree.data, 5)
        pairs |= {(min(i, j), max(i, j)) for i, row in enumerate(near.tolist()) for j in row if i != j}
    Q = np.eye(block) + 0.1 * rng.standard_normal((nodes, block, block))
    K = np.zeros((nodes, block, nodes, block))
    for i, j in sorted(pairs):
        strain, stiffness = np.hstack([-Q[i], Q[j]]), np.diag(rng.uniform(0.5, 2.0, block))
        element = (strain.T @ stiffness @ strain).reshape(2, block, 2, block)
        for a, row in enumerate((i, j)):
            for b, column in enumerate((i, j)):
                K[row, :, column] += element[a, :, b]
    dense = K.reshape(2 * (nodes * block,))
    springs = np.repeat(held * (np.arange(nodes) % 10 == 0), block).astype(float)
    return sparse.csr_matrix((dense + dense.T) / 2 + np.diag(springs))


def unknowns(last: IntArray, block: int) -> IntArray:
    return (np.asarray(last)[:, None] * block + np.arange(block)).ravel()


def assert_close(got: FloatArray, wanted: FloatArray) -> None:
    assert got.shape == wanted.shape
    assert np.abs(got - wanted).max() <= TOLERANCE * np.abs(wanted).max()


CANDIDATES = {
    "one": [37],
    "first": [0],
    "few": [3, 40, 41, 99],
    "unordered": [80, 3, 119, 40, 0, 77, 12],
    "half": list(range(119, 0, -2)),
    "all but one": list(range(1, 120)),
    "all": list(range(120)),
}


@pytest.mark.parametrize("last", CANDIDATES.values(), ids=CANDIDATES.keys())
@pytest.mark.parametrize("block", [1, 3, 6])
def test_compliance_is_the_dense_inverse(block: int, last: list[int]) -> None:
    K = lattice(120, block)
    C = factor(K, np.array(last), block).compliance()
    rows = unknowns(np.array(last), block)
    assert_close(C, np.linalg.inv(K.toarray())[np.ix_(rows, rows)])
    assert np.array_equal(C, C.T)


@pytest.mark.parametrize("last", [None, np.zeros(0, dtype=int), np.array([5, 2])])
def test_without_candidates_nothing_is_left(last: IntArray | None) -> None:
    size = 0 if last is None else 6 * len(last)
    assert factor(lattice(30, 6), last).compliance().shape == (size, size)


def test_the_interior_is_ordered() -> None:
    """A square grid, numbered by rows, fills a band as wide as its side; in a good order half of that."""
    side = 60
    row = sparse.diags([-1.0, 2.1, -1.0], [-1, 0, 1], shape=(side, side))
    made = factor(sparse.kronsum(row, row).tocsr(), np.array([0, side**2 - 1]), 1)
    assert made.entries < 0.7 * side**3


def test_the_trailing_block_may_span_supernodes() -> None:
    """Candidates in two far pieces of the lattice: L_cc has a gap, and the interior of one piece may straddle it."""
    K = sparse.block_diag([lattice(60, 6, seed=1), lattice(50, 6, seed=2)]).tocsr()
    last = np.array([3, 70, 71, 4, 90, 5, 33, 100])
    L = factor(K, last)
    assert np.count_nonzero(L._super[1:] > K.shape[0] - 48) > 1
    rows = unknowns(last, 6)
    assert_close(L.compliance(), np.linalg.inv(K.toarray())[np.ix_(rows, rows)])


def test_candidates_that_touch_only_candidates_stay_last() -> None:
    """A chain 0 - 1 - ... - 9 with its end last: a postorder of the tree would put that end before the interior."""
    K = sparse.diags([np.full(9, -1.0), np.full(10, 2.0), np.full(9, -1.0)], [-1, 0, 1]).tocsr()
    last = np.array([9, 0, 8, 7, 1])
    L = factor(K, last, block=1)
    assert np.array_equal(L._permutation[5:], last)
    assert_close(L.compliance(), np.linalg.inv(K.toarray())[np.ix_(last, last)])


def test_a_moved_candidate_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    library = cholmod._library()
    analyse = library.cholmod_analyze_p

    def postordered(*arguments: Any) -> Any:
        arguments[-1]._obj.postorder = 1
        return analyse(*arguments)

    monkeypatch.setattr(library, "cholmod_analyze_p", postordered)
    K = sparse.diags([np.full(9, -1.0), np.full(10, 2.0), np.full(9, -1.0)], [-1, 0, 1]).tocsr()
    with pytest.raises(RuntimeError, match="moved the contact nodes"):
        factor(K, np.array([9, 0, 8, 7, 1]), block=1)


@pytest.mark.parametrize("shape", [(), (1,), (7,)])
def test_solution_is_that_of_superlu(shape: tuple[int, ...]) -> None:
    K = lattice(300, 6)
    rhs = np.random.default_rng(4).standard_normal((1800, *shape))
    for last in (None, np.arange(40, 80)):
        assert_close(factor(K, last).solve(rhs), splu(K.tocsc()).solve(rhs))


def test_right_hand_sides_of_any_layout_are_left_alone() -> None:
    K, rhs = lattice(30, 6), np.arange(720.0).reshape(180, 4)
    rhs.setflags(write=False)
    L = factor(K)
    x = L.solve(rhs)
    layouts: list[Any] = [np.asfortranarray(rhs), rhs.astype(np.int64), np.repeat(rhs, 2, axis=1)[:, ::2]]
    for layout in layouts:
        assert np.array_equal(L.solve(layout), x)
    assert np.array_equal(L.solve(rhs[:, 2]), L.solve(rhs[:, 2].copy()))
    for wrong in (rhs[1:], rhs[None], np.float64(1.0)):
        with pytest.raises(ValueError, match="right-hand side"):
            L.solve(np.asarray(wrong))


@pytest.mark.parametrize("form", ["csr", "csc", "coo", "bsr"])
def test_any_sparse_form_will_do(form: str) -> None:
    """Zeros stored in the blocks of the last may change the order, and so the rounding."""
    K, last = lattice(60, 6), np.array([7, 1, 30])
    other = K.tobsr((6, 6)) if form == "bsr" else K.asformat(form)
    assert_close(factor(other, last).compliance(), factor(K, last).compliance())


def test_other_types_and_layouts_of_the_arrays_will_do() -> None:
    K, last = lattice(40, 6), np.array([7, 1])
    wide = K.copy()
    wide.indices, wide.indptr = K.indices.astype(np.int64), K.indptr.astype(np.int64)
    spread = K.copy()
    spread.data, spread.indices = np.repeat(K.data, 2)[::2], np.repeat(K.indices, 2)[::2]
    for other in (wide, spread):
        assert np.array_equal(factor(other, last).compliance(), factor(K, last).compliance())
    with pytest.raises(TypeError, match="int64"):
        cholmod._columns(wide)
    whole = sparse.csr_matrix(np.array([[2, -1], [-1, 2]]))
    assert factor(whole, np.array([0]), block=1).compliance() == pytest.approx(2 / 3)


def test_a_matrix_with_duplicates_is_summed_in_a_copy() -> None:
    K, last = lattice(40, 6), np.array([7, 1])
    doubled = sparse.csr_matrix((np.repeat(K.data / 2, 2), np.repeat(K.indices, 2), 2 * K.indptr), shape=K.shape)
    before = doubled.data.copy()
    assert_close(factor(doubled, last).compliance(), factor(K, last).compliance())
    assert np.array_equal(doubled.data, before)


def test_the_matrix_may_go_before_the_factor() -> None:
    K, rhs = lattice(100, 6), np.ones(600)
    wanted = np.linalg.solve(K.toarray(), rhs)
    L = factor(K, np.array([9]))
    K.data[:] = np.nan
    del K
    gc.collect()
    assert_close(L.solve(rhs), wanted)


def test_same_bits_twice() -> None:
    K, last = lattice(400, 6), np.arange(100, 160)
    one, two = factor(K, last), factor(K, last)
    assert np.array_equal(one.compliance(), two.compliance())
    assert np.array_equal(one.compliance(), one.compliance())
    assert np.array_equal(one.solve(np.ones(2400)), two.solve(np.ones(2400)))


@pytest.mark.parametrize("piece", [1, 2, 50])
@pytest.mark.parametrize("last", [None, np.array([2, 60])])
def test_a_free_piece_is_named(piece: int, last: IntArray | None) -> None:
    K = sparse.block_diag([lattice(80, 6), lattice(piece, 6, seed=3, held=False)]).tocsr()
    with pytest.raises(NotDefiniteError, match=r"definite: node \d+ is free in its component \d") as caught:
        factor(K, last)
    assert 80 <= int(str(caught.value).split("node ")[1].split()[0]) < 80 + piece


def test_a_singular_stiffness_whose_pivots_stay_positive_is_refused() -> None:
    """[[a, -b], [-b, b^2/a]] with the last pivot rounded up to 4 eps of its diagonal: dpotrf finds nothing wrong."""
    K = sparse.csr_matrix(np.array([[1.0, -1.0], [-1.0, 1.0 + 4 * np.finfo(float).eps]]))
    assert np.linalg.cholesky(K.toarray())[1, 1] > 0.0
    with pytest.raises(NotDefiniteError, match="free"):
        factor(K, block=1)


def test_weak_but_held_is_accepted() -> None:
    """A cantilever of 40 springs with its pivots near 1/40: far from the bound on a null pivot."""
    K = sparse.diags([np.full(39, -1.0), np.append(np.full(39, 2.0), 1.0), np.full(39, -1.0)], [-1, 0, 1]).tocsr()
    assert factor(K, np.array([39]), block=1).compliance() == pytest.approx(40.0, rel=1e-12)


@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan])
def test_other_than_positive_definite_is_refused(value: float) -> None:
    K = lattice(40, 6)
    K[25, 25] = value
    with pytest.raises(NotDefiniteError, match="not positive definite"):
        factor(K)


@pytest.mark.parametrize("last", [[-1], [20], [3, 4, 3], [[3], [4]], [2.5]])
def test_candidates_that_are_not_there(last: list[Any]) -> None:
    with pytest.raises(ValueError, match="different ones of the 20"):
        factor(lattice(20, 3), np.array(last), block=3)


@pytest.mark.parametrize("shape", [(0, 0), (6, 12), (7, 7)])
def test_shapes_that_do_not_fit(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="shape"):
        factor(sparse.csr_matrix(shape))


@pytest.fixture
def unloaded() -> Iterator[None]:
    cholmod._library.cache_clear()
    yield
    cholmod._library.cache_clear()


@pytest.mark.usefixtures("unloaded")
def test_without_the_library_the_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cholmod, "SONAMES", {"libcholmod.so.0": (0, 0), "libcholmod.so.1": (1, 0)})
    with pytest.raises(FactorError, match=r"libcholmod3 .* libcholmod5 .*so\.0.*so\.1"):
        factor(lattice(5, 6))


@pytest.mark.usefixtures("unloaded")
def test_another_library_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library whose record has one more integer in front: every value stands eight bytes further on."""
    place = cholmod._defaults_in_place

    def shifted(common: cholmod._Common) -> bool:
        room = ctypes.sizeof(common) - 8
        return place(cholmod._Common.from_buffer_copy(bytes(8) + ctypes.string_at(ctypes.addressof(common), room)))

    monkeypatch.setattr(cholmod, "_defaults_in_place", shifted)
    with pytest.raises(FactorError, match=r"CHOLMOD (3\.0|5\.3)\.\d+, .* libcholmod3 .* libcholmod5"):
        factor(lattice(5, 6))


def test_every_default_is_looked_at() -> None:
    """A record out of place from some field on is noticed: each of these fields decides alone."""
    library = cholmod._library()
    for name, value in (("grow0", 1.0), ("supernodal", 0), ("print", 0), ("postorder", 0), ("status", 1)):
        common = cholmod._Common()
        library.cholmod_start(ctypes.byref(common))
        assert cholmod._defaults_in_place(common)
        setattr(common, name, value)
        assert not cholmod._defaults_in_place(common)


def test_failures_of_the_library_say_what_to_try() -> None:
    common = cholmod._Common()
    for status, error, text in ((-2, FactorError, "memory"), (-3, FactorError, "entries"), (-4, RuntimeError, "-4")):
        common.status = status
        with pytest.raises(error, match=text):
            cholmod._raise_failure(common)


GRID = """
import os, signal, threading, time
from scipy import sparse
from macrofit.base.cholmod import factor

line = sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(300, 300))
grid = (sparse.kronsum(line, line) + sparse.eye(90000)).tocsr()
factor(grid[:100, :100].tocsr(), None, 1)
signal.signal(signal.SIGTERM, signal.default_int_handler)
end = threading.Timer(DELAY, os.kill, (os.getpid(), signal.SIGTERM))
try:
    end.start()
    held = factor(grid, None, 1)
    time.sleep(20.0)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.parametrize("delay", [0.02, 0.1, 0.2])
def test_a_signal_during_a_factor_is_the_users(delay: float) -> None:
    """CHOLMOD's METIS takes whatever SIGTERM comes meanwhile for its own, and may never end then."""
    script = GRID.replace("DELAY", str(delay))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30.0)
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")


def test_openmp_is_left_as_it_was() -> None:
    library = cholmod._library()
    if not hasattr(library, "omp_get_max_active_levels"):
        pytest.skip("this CHOLMOD has no OpenMP")
    before = library.omp_get_max_active_levels()
    with cholmod._one_thread(library):
        assert library.omp_get_max_active_levels() == 0
    factor(lattice(50, 6))
    assert library.omp_get_max_active_levels() == before > 0


def resident() -> float:
    """Resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


@pytest.mark.parametrize("held", [True, False])
def test_memory_is_given_back(held: bool) -> None:
    """In 200 turns the factors take 600 MB, the solutions 100 MB, the workspaces 80 MB; the allocator keeps under 1."""
    K, last, rhs = lattice(200, 6, held=held), np.arange(30), np.ones((1200, 50))
    for turn in range(220):
        if turn == 20:
            before = resident()
        try:
            L = factor(K, last)
        except NotDefiniteError:
            assert not held
        else:
            assert held
            L.solve(rhs)
            assert L.compliance()[0, 0] > 0.0
    assert resident() - before < 4.0
