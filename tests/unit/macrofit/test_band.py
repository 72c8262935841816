"""A band of moments is the same matrix, with and without its zeros and in blocks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from macrofit.contact import interface
from macrofit.contact.interface import MortarCoupling, couple_lines
from tests.small import condensed_press, small_press


@pytest.fixture(scope="module")
def couplings() -> list[tuple[MortarCoupling, MortarCoupling]]:
    """Dense and sparse, where the wheel comes on, somewhere and all along; facets of both lines of many lengths."""
    press, _ = condensed_press(small_press("mesh.corner_facet=0.7"))
    found = []
    for travel in (20.0, 61.3, 180.0):
        pair = []
        for columns in (10**9, 0):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(interface, "_SPARSE", columns)
                coupling = couple_lines(press.seat.line, press.bore, travel)
            assert coupling is not None
            pair.append(coupling)
        found.append((pair[0], pair[1]))
    return found


def test_sparse_rows_are_the_dense_matrix(couplings: list[tuple[MortarCoupling, MortarCoupling]]) -> None:
    rng = np.random.default_rng(0)
    for dense, rows in couplings:
        assert isinstance(dense.bore.matrix, np.ndarray)
        assert sparse.issparse(rows.bore.matrix)
        assert np.array_equal(sparse.csr_matrix(rows.bore.matrix).toarray(), dense.bore.matrix)
        assert np.array_equal(sparse.csr_matrix(rows.slope).toarray(), dense.slope)
        assert abs(rows.bore_rows - dense.bore_rows).max() == 0.0
        moved = rng.normal(size=2 * rows.nodes)
        assert np.allclose(rows.bore_rows @ moved, rows.bore_moments(moved).ravel(), rtol=1e-12, atol=1e-12)
        forces, bore = rng.normal(size=(2, len(rows.normals))), rng.normal(size=2 * rows.nodes)
        for name, given in (("bore_loads", forces), ("bore_moments", bore), ("bore_slope", bore)):
            one, other = getattr(dense, name)(given), getattr(rows, name)(given)
            assert np.abs(one - other).max() <= 1e-13 * np.abs(one).max()
        several = np.stack([forces, 2.0 * forces], axis=1)
        assert np.allclose(rows.bore_loads(several)[:, 1].ravel(), 2.0 * rows.bore_loads(forces), rtol=1e-13)


def test_blocks_leave_nothing_out(couplings: list[tuple[MortarCoupling, MortarCoupling]]) -> None:
    rng = np.random.default_rng(1)
    for dense, rows in couplings:
        scale, given = rng.normal(size=len(rows.normals)), rng.normal(size=(dense.bore.matrix.shape[1], 5))
        scale[: len(scale) // 3] = 0.0
        wanted = scale[:, None] * (dense.bore.matrix @ given)
        for coupling in (dense, rows):
            out = np.zeros_like(wanted)
            coupling.bore.add_product(out, scale, given)
            assert np.abs(out - wanted).max() <= 1e-13 * np.abs(wanted).max()
