"""The compliance of a body between the nodes of its contact line, from pieces of the body that cuts divide.

All nodes of the line together at the end of one factor take operations of the third power of their number. Cuts s
across the line leave pieces k, each with its part c_k of the line, that know of each other through s alone: with
X_k = -K_kk^-1 K_ks, how a piece follows its cuts, and S the Schur complement on s,

    K^-1 = diag(K_kk^-1) + X S^-1 X'.

S has few unknowns, for elements grow away from the line, and a row of X as many as the two cuts of its piece.
Nothing is left out. Source: Przemieniecki, AIAA J. 1 (1963) 138-147, for the substructures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as sla

from ..base.arrays import FloatArray, IntArray
from ..base.cholmod import SINGULAR, NotDefiniteError, factor, inverse_of
from .extension import extend

UNKNOWNS = 300
"""Unknowns of the contact line in a piece: fewer make more cuts."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A piece between its cuts; a unknowns of the line, b of the cuts, w of the trace, the line's first."""

    trace: IntArray  # (w,) unknowns of the trace
    loaded: IntArray  # (a,) those of them on the line
    cut: IntArray  # (b,) places of its cuts' unknowns among all of them
    compliance: FloatArray  # (w, a) between held cuts [mm/N]
    follows: FloatArray  # (w, b) X_k: the displacements under those of the cuts
    taken: FloatArray  # (b, b) what the piece takes off the stiffness of the cuts [N/mm]


def divided(coordinate: FloatArray, cells: FloatArray, unknowns: int) -> IntArray:
    """The piece of each element, by where its middle is along the contact line.

    Args:
        coordinate: of the ends of the line's facets, ascending [mm].
        cells: coordinate of the middle of each element [mm].
        unknowns: number of those of the line.
    """
    count = max(unknowns // UNKNOWNS, 1)
    ends = np.linspace(0, len(coordinate) - 1, count + 1).astype(np.int64)[1:-1]
    return np.searchsorted(coordinate[ends], cells)


def condensed(K: Any, cells: IntArray, piece: IntArray, loaded: IntArray, others: IntArray) -> FloatArray:
    """The displacements of trace nodes under unit loads on those of the contact line.

    Args:
        K: stiffness, sparse, two unknowns of a node after each other, definite [N/mm].
        cells: nodes of the elements (e, n).
        piece: number of each element's piece (e,).
        loaded: nodes of the line, in the order of the columns.
        others: further nodes of the trace.

    Returns:
        The compliance (2 trace nodes, 2 loaded nodes), component-major, loaded nodes before others [mm/N].

    Raises:
        NotDefiniteError: K is not definite.
        FactorError: a factor is too large.
    """
    nodes = [np.unique(cells[piece == k]) for k in range(int(piece.max()) + 1)]
    touched = np.bincount(np.concatenate(nodes), minlength=K.shape[0] // 2)
    cut = np.flatnonzero(touched > 1)
    pieces = [_piece(K, own, touched[own] > 1, cut, loaded, others) for own in nodes if len(own)]
    trace, size = np.concatenate([loaded, others]), 2 * len(loaded)
    row, column = _places(trace, K.shape[0]), _places(loaded, K.shape[0])
    unknowns = _unknowns(cut)
    out, moved = np.empty((2 * len(trace), size)), np.empty((len(unknowns), size))  # of the cuts: S^-1 X'
    if len(cut):
        between = _between(K, cut, pieces)
        on_line, on_trace = column[unknowns] >= 0, row[unknowns] >= 0
        moved[:, column[unknowns[on_line]]] = between[:, on_line]
        for part in pieces:
            moved[:, column[part.loaded]] = between[:, part.cut] @ part.follows[: len(part.loaded)].T
        out[row[unknowns[on_trace]]] = moved[on_trace]
    for part in pieces:
        rows = part.follows @ moved[part.cut]
        rows[:, column[part.loaded]] += part.compliance
        out[row[part.trace]] = rows
    return out


def _piece(K: Any, nodes: IntArray, outside: IntArray, cut: IntArray, loaded: IntArray, others: IntArray) -> Piece:
    """A piece of some ``nodes``, of which those ``outside`` are on its cuts."""
    inner, edge = nodes[~outside], nodes[outside]
    line, beside = loaded[np.isin(loaded, inner)], others[np.isin(others, inner)]
    unknowns = _unknowns(nodes)
    whole = len(unknowns) == K.shape[0]
    made = factor(K if whole else K[unknowns][:, unknowns], np.searchsorted(nodes, np.concatenate([line, edge])), 2)
    lower = made.trailing_block()
    a, b = 2 * len(line), 2 * len(edge)
    known = np.zeros((a + b, a + b))  # displacements of line and cuts, under loads on the line and moves of the cuts
    if a:
        known[:a, a:] = sla.blas.dtrsm(-1.0, lower[:a, :a], lower[a:, :a].T, lower=1, trans_a=1)
        known[:a, :a] = inverse_of(lower[:a, :a])
    known[a:, a:] = np.eye(b)
    own = known[:a]
    if len(beside):
        own = np.concatenate([own, extend(made, _unknowns(np.searchsorted(nodes, beside)), known)])
    corner, stiffness = np.tril(lower[a:, a:]), K[_unknowns(edge)][:, _unknowns(edge)]
    return Piece(
        trace=_unknowns(np.concatenate([line, beside])),
        loaded=_unknowns(line),
        cut=_unknowns(np.searchsorted(cut, edge)),
        compliance=own[:, :a],
        follows=own[:, a:],
        taken=stiffness.toarray() - corner @ corner.T,
    )


def _between(K: Any, cut: IntArray, pieces: list[Piece]) -> FloatArray:
    """S^-1, the compliance between the cuts."""
    unknowns = _unknowns(cut)
    stiffness = K[unknowns][:, unknowns]
    schur = stiffness.toarray(order="F")
    for part in pieces:
        schur[np.ix_(part.cut, part.cut)] -= part.taken
    lower, failed = sla.lapack.dpotrf(schur, lower=1, overwrite_a=1)
    held = np.diagonal(lower) ** 2 > SINGULAR * stiffness.diagonal()
    if failed or not held.all():
        raise NotDefiniteError(*divmod(int(unknowns[failed - 1 if failed else np.argmin(held)]), 2))
    return inverse_of(lower)


def _unknowns(nodes: IntArray) -> IntArray:
    """Both unknowns of each node."""
    return np.asarray((2 * nodes[:, None] + np.arange(2)).ravel())


def _places(nodes: IntArray, count: int) -> IntArray:
    """Where the unknowns of some nodes stand component-major, by unknowns (count,); -1 where there are none."""
    place = np.full((count // 2, 2), -1, dtype=np.int64)
    place[nodes] = np.arange(len(nodes))[:, None] + len(nodes) * np.arange(2)
    return place.ravel()
