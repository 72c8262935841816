"""The order in which the explicit engine goes through a lattice: eight spheres at once, with all beams of each.

A block is eight spheres, a lane for each. Row by row it holds one beam of every one of them; a sphere with fewer beams
than its neighbours in the block has beams without stiffness to itself. Spheres are sorted by their number of beams
within windows, so that few of those are needed, 2 %, and neighbours in space stay neighbours in memory.
Every beam is listed twice, from either end.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray, IntArray

from .. import kernels

WINDOW = 256
"""Spheres within which the order is by the number of beams."""
WIDTH = kernels.WIDTH


class Blocks(NamedTuple):
    """A lattice in blocks of eight spheres, as `meso.kernels` reads it."""

    place: IntArray
    """Line of each sphere: block times eight plus lane, shape (n,)."""
    start: IntArray
    """First row of each block, shape (blocks + 1,)."""
    others: npt.NDArray[np.uint32]
    """Where the line of the other end of each beam begins, in doubles, shape (rows, 8)."""
    beams: FloatArray
    """Columns of `Lattice.beams` seen from this end, shape (rows, 6, 8)."""
    bond: IntArray
    """Number of each beam, -1 where there is none, shape (rows, 8)."""
    mass: FloatArray
    """Mass [t] and moment of inertia [t mm2], 1 in an empty lane, shape (blocks, 2, 8)."""
    held: IntArray
    """Number among `anchors` of each block with spheres that an external face holds, or -1, shape (blocks,)."""
    anchors: FloatArray
    """What holds them: the columns of `Lattice.anchors`, shape (m, 5, 8)."""

    def from_both_ends(self, values: FloatArray, none: tuple[float, ...]) -> FloatArray:
        """Values (bonds, k) of the beams from both ends, and (k,) where there is none, shape (rows, k, 8)."""
        spread = np.where((self.bond >= 0)[:, :, None], values[self.bond], np.array(none))
        return in_lines(spread.transpose(0, 2, 1))


def arranged(
    first: IntArray, cols: IntArray, beams: FloatArray, inverse: FloatArray, anchored: IntArray, anchors: FloatArray
) -> Blocks:
    """The blocks of a lattice, given by the fields and properties of `Lattice` of these names."""
    n, bonds = len(inverse), len(cols)
    here, there = np.concatenate([first, cols]), np.concatenate([cols, first])
    degree = np.bincount(here, minlength=n)
    order = np.lexsort((degree, np.arange(n) // WINDOW))
    place = np.empty(n, np.int64)
    place[order] = np.arange(n)
    count = -(-n // WIDTH)
    filled = np.zeros(count * WIDTH, np.int64)
    filled[:n] = degree[order]
    height = filled.reshape(count, WIDTH).max(axis=1)
    start = np.concatenate([[0], np.cumsum(height)])
    here, there = place[here], place[there]
    sort = np.lexsort((there, here))
    here, there, number = here[sort], there[sort], np.tile(np.arange(bonds), 2)[sort]
    block, lane = np.divmod(here, WIDTH)
    row = start[block] + np.arange(2 * bonds) - (np.cumsum(filled) - filled)[here]
    others = WIDTH * (WIDTH * np.repeat(np.arange(count), height)[:, None] + np.arange(WIDTH, dtype=np.uint32))
    others[row, lane] = WIDTH * there
    bond = np.full((start[-1], WIDTH), -1)
    bond[row, lane] = number
    seen = np.zeros((start[-1], 6, WIDTH))
    seen[:, [kernels.AXIS_X, kernels.PER_LENGTH]] = 1.0  # of what is none: no division by zero
    seen[row, :, lane] = beams[number]
    seen[row, : kernels.PER_LENGTH, lane] *= np.where(sort < bonds, 1.0, -1.0)[:, None]
    mass = np.ones((count, 2, WIDTH))
    mass[place // WIDTH, :, place % WIDTH] = 1.0 / inverse
    holding = np.unique(place[anchored] // WIDTH)
    held = np.full(count, -1)
    held[holding] = np.arange(len(holding))
    held_by = np.zeros((len(holding), 5, WIDTH))
    held_by[held[place[anchored] // WIDTH], :, place[anchored] % WIDTH] = anchors
    return Blocks(
        place=place,
        start=start,
        others=others.astype(np.uint32),
        beams=in_lines(seen),
        bond=bond,
        mass=mass,
        held=held,
        anchors=held_by,
    )


def in_lines(values: FloatArray) -> FloatArray:
    """A copy that begins with a line of the processor's cache, 64 bytes."""
    memory = np.empty(values.size + WIDTH)
    skip = -(memory.ctypes.data // 8) % WIDTH
    copy: FloatArray = memory[skip : skip + values.size].reshape(values.shape)
    copy[:] = values
    return copy
