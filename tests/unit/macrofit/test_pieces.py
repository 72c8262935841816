"""The compliance of a body is the dense inverse's, into however many pieces it is cut."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from macrofit.base.arrays import FloatArray, IntArray
from macrofit.base.cholmod import NotDefiniteError
from macrofit.bodies import body, pieces
from macrofit.bodies.body import Body
from macrofit.bodies.pieces import UNKNOWNS, condensed, divided
from macrofit.scene import load_scene

ACROSS, ALONG = 5, 23
NODES = np.arange(ACROSS * ALONG).reshape(ALONG, ACROSS)


def plate(seed: int = 3, *, held: bool = True) -> tuple[sparse.csr_matrix, IntArray]:
    """Stiffness and quadrilaterals of a plate of springs, each cell with a random positive definite stiffness."""
    rng = np.random.default_rng(seed)
    corners = [NODES[:-1, :-1], NODES[1:, :-1], NODES[1:, 1:], NODES[:-1, 1:]]
    cells = np.stack([corner.ravel() for corner in corners], axis=1)
    K = np.zeros((2 * NODES.size, 2 * NODES.size))
    for cell in cells:
        places = (2 * cell[:, None] + np.arange(2)).ravel()
        half = rng.normal(size=(8, 8))
        half[:, ::2] -= half[:, ::2].mean(axis=1, keepdims=True)  # it may move freely in either direction
        half[:, 1::2] -= half[:, 1::2].mean(axis=1, keepdims=True)
        K[np.ix_(places, places)] += half.T @ half
    if held:
        K[:2, :] = K[:, :2] = 0.0
        K[:2, :2] = np.eye(2)  # a support on the line, at its end
    return sparse.csr_matrix(K), cells


def wanted(K: sparse.csr_matrix, loaded: IntArray, others: IntArray) -> FloatArray:
    inverse = np.linalg.inv(K.toarray())
    rows, columns = np.concatenate([loaded, others]), loaded
    return np.asarray(inverse[np.ix_(np.r_[2 * rows, 2 * rows + 1], np.r_[2 * columns, 2 * columns + 1])])


@pytest.mark.parametrize("count", [1, 2, 3, 7, 22])
@pytest.mark.parametrize("beside", [True, False])
def test_pieces_leave_nothing_out(count: int, *, beside: bool) -> None:
    """Cuts meet the line and what lies beside it; of 22 pieces only the first and the last have nodes on no cut."""
    K, cells = plate()
    piece = np.minimum(cells[:, 0] // ACROSS * count // (ALONG - 1), count - 1)
    loaded, others = NODES[:, 0], NODES[:, 1] if beside else np.zeros(0, dtype=np.int64)
    got = condensed(K, cells, piece, loaded, others)
    exact = wanted(K, loaded, others)
    assert got.shape == exact.shape
    assert np.abs(got - exact).max() <= 1e-11 * np.abs(exact).max()


def test_any_division_will_do() -> None:
    """Pieces of scattered elements, one of them without any: nearly all nodes are cuts."""
    K, cells = plate()
    piece = np.random.default_rng(1).choice([0, 1, 3], len(cells))
    got, exact = condensed(K, cells, piece, NODES[::-1, 0], NODES[:, 2]), wanted(K, NODES[::-1, 0], NODES[:, 2])
    assert np.abs(got - exact).max() <= 1e-11 * np.abs(exact).max()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_free_body_is_noticed(count: int, seed: int) -> None:
    """Each piece is held by its cuts; that nothing holds these shows in their Schur complement.

    The pivot that should be zero is below it or above, as rounding will have it.
    """
    K, cells = plate(seed, held=False)
    piece = cells[:, 0] // ACROSS * count // (ALONG - 1)
    with pytest.raises(NotDefiniteError):
        condensed(K, cells, np.minimum(piece, count - 1), NODES[:, 0], NODES[:, 1])


def test_division_by_facets() -> None:
    """As many facets in each piece, wherever the elements are; what lies beyond the line belongs to its ends."""
    facets = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(2.0, 100.0, 100)])
    middles = np.array([-50.0, 0.5, 0.99, 1.5, 70.0, 1000.0])
    assert divided(facets, middles, 2 * UNKNOWNS).tolist() == [0, 0, 0, 1, 1, 1]
    assert divided(facets, middles, UNKNOWNS).tolist() == [0] * 6
    assert divided(facets, middles, 3).tolist() == [0] * 6


@pytest.mark.parametrize("which", ["axle", "wheel"])
@pytest.mark.parametrize("name", ["contact-patch", "lame-rings"])
def test_a_supported_node_of_the_line_stays(name: str, which: str) -> None:
    """Where the line ends on the axis or on a held face; whatever is loaded there goes into the support."""
    made = Body(load_scene(name), which)
    line = made.trace[: len(made.line.nodes)]
    held = np.flatnonzero(made.supported[line].T)
    compliance = made.condense(load_trace=False).compliance.reshape(2, len(made.trace), -1)
    assert len(held)
    assert np.abs(compliance[:, : len(line)].reshape(2 * len(line), -1)[held]).max() <= 1e-15 * np.abs(compliance).max()
    assert np.abs(compliance[..., held]).max() <= 1e-15 * np.abs(compliance).max()
    loads = np.zeros((made.dofs, 1))
    loads[2 * line + 1] = 1.0
    given = loads.copy()
    moved = made.solve(loads)[:, 0].reshape(-1, 2)
    assert np.array_equal(loads, given)  # they are the caller's
    assert not moved[made.supported].any()
    on_line = compliance[1, :, len(line) :].sum(axis=1)
    assert np.abs(moved[made.trace, 1] - on_line).max() <= 1e-9 * np.abs(on_line).max()


@pytest.mark.parametrize("name", ["contact-patch", "lame-rings"])
def test_cuts_go_across_the_line(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An axial line is divided along r, a radial one along z: all pieces have as good as the same part of it."""
    found: list[IntArray] = []

    def noted(*given: object) -> IntArray:
        found.append(divided(*given))  # type: ignore[arg-type]
        return found[-1]

    monkeypatch.setattr(body, "divided", noted)
    monkeypatch.setattr(pieces, "UNKNOWNS", 20)
    made = Body(load_scene(name), "wheel")
    made.condense(load_trace=False)
    count = 2 * len(made.line.nodes) // 20
    assert np.bincount(found[0], minlength=count).min() > 0.2 * len(found[0]) / count
