"""What the elements of a body are once they are there: nodes, cells, boundaries, stiffness; and the basis of a cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..base.arrays import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True)
class Discretisation:
    """A Lagrange space of vectors (u_r, u_z) on one body; degree of freedom 2 * node + component.

    nodes (n, 2) [mm]; cells (m, 3) or (m, 6), vertices first, then the middle of the edge opposite to each;
    edges: boundary name -> (k, 3): cell, and its local indices of the edge's two end vertices.
    """

    order: int
    nodes: FloatArray
    cells: IntArray
    edges: dict[str, IntArray]
    stiffness: sp.csr_matrix

    def unknowns(self, cells: IntArray) -> IntArray:
        """The unknowns (n, 2 b) of cells (n,): node 0 r, node 0 z, node 1 r and so on."""
        nodes = self.cells[cells]
        unknowns = np.stack([2 * nodes, 2 * nodes + 1], axis=2).reshape(len(cells), -1)
        return np.asarray(unknowns, dtype=np.int64)

    def edge_nodes(self, name: str) -> IntArray:
        """Nodes of each edge of a boundary, (k, order + 1): start, (middle,) end."""
        cell, a, b = self.edges[name].T
        ends = [self.cells[cell, a], self.cells[cell, b]]
        if self.order == 2:
            ends.insert(1, self.cells[cell, 3 + (3 - a - b)])
        return np.stack(ends, axis=1)


def tabulate(order: int, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (p, b) and reference gradients (p, b, 2) of the scalar basis at reference ``points`` (p, 2)."""
    import basix

    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType.triangle, order, basix.LagrangeVariant.equispaced
    )
    table = element.tabulate(1, points)[..., 0]
    return table[0], np.moveaxis(table[1:], 0, -1)
