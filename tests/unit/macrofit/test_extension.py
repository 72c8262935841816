"""Unloaded unknowns follow given displacements as the dense inverse has it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from macrofit.base.cholmod import factor
from macrofit.bodies import extension
from tests.unit.base.test_cholmod import assert_close, lattice, unknowns

LAST = {"few": [3, 40, 41, 99], "half": list(range(119, 0, -2)), "unordered": [80, 3, 119, 40, 0, 77, 12]}


@pytest.mark.parametrize("last", LAST.values(), ids=LAST.keys())
@pytest.mark.parametrize("chosen", [[2], [118, 4, 60, 2], []], ids=["one", "unordered", "none"])
def test_unloaded_unknowns_follow_the_contact_nodes(
    last: list[int], chosen: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """u_o = C_oc f and u_c = C_cc f, so that C_cc given returns C_oc; 7 columns at a time leave a remainder."""
    monkeypatch.setattr(extension, "COLUMNS", 7)
    K, block = lattice(120, 3), 3
    wanted = unknowns(np.array(chosen, dtype=np.int64), block)
    contact = unknowns(np.array(last), block)
    inverse = np.linalg.inv(K.toarray())
    got = extension.extend(factor(K, np.array(last), block), wanted, inverse[np.ix_(contact, contact)])
    if chosen:
        assert_close(got, inverse[np.ix_(wanted, contact)])
    assert got.shape == (len(wanted), len(contact))


def test_a_supernode_may_straddle_the_contact_nodes() -> None:
    """A dense stiffness is one supernode, of the interior and of the contact nodes."""
    rng = np.random.default_rng(5)
    half = rng.normal(size=(40, 40))
    K = half @ half.T + 40.0 * np.eye(40)
    last = np.arange(30, 40)
    L = factor(sparse.csr_matrix(K), last)
    assert len(L.supernodes[0]) == 2
    inverse = np.linalg.inv(K)
    got = extension.extend(L, np.array([29, 3, 0]), inverse[30:, 30:])
    assert_close(got, inverse[np.array([29, 3, 0])][:, last])
