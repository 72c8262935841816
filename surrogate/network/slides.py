"""Foundations slid over each other as the network answers, in numpy; `foundation.py` has their formulas in torch.

In single precision over the nodes of a face. Every row is computed by itself: the same bits whatever else is asked.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from functools import reduce
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import BoolArray, FloatArray, HeightArray, IntArray

if TYPE_CHECKING:
    from .checkpoint import EnsembleOptions

Single: TypeAlias = npt.NDArray[np.float32]
"""Numbers in the network's precision."""
T = TypeVar("T", bound=np.generic)
LEAST_SHARE = 0.25
"""Cells that a node in a corner of a face stands for [-]: less cannot touch."""
NEWTON_STEPS = 30
"""Upper bound of the steps to the height; N(z) is convex and piecewise linear, and five usually suffice."""
MOST_GATHERED = 0.6
"""Share of the rows up to which those that still move are copied, and looked at by themselves [-]."""
NEWTON_TOLERANCE = 1e-5
"""Step below which the iteration ends, as a share of the mean overlap [-]."""


class SlideNumbers(NamedTuple):
    """Response of foundations of stiffnesses K to a slide, (pairs, K) each; see `foundation.SlideResponse`."""

    b: Single
    """Change of the energy over the mean load and the slide [-]."""
    load: Single
    """Mean over the slide, over the load at the start [-]."""
    least: Single
    """Smallest load of the positions, over the load at the start [-]."""
    depth: Single
    """Mean energy over mean load [mm]."""


class EndStates(NamedTuple):
    """Foundations of stiffnesses K, each pressed by a force: what the two ends of a slide say of it, (rows, K) each."""

    overlap: FloatArray
    """Sum over the nodes of the overlap [mm]."""
    squares: Single
    """Sum over the nodes of its square [mm2]."""
    height: FloatArray
    """Height of the face [mm]."""

    def take(self, rows: npt.NDArray[np.integer[Any]] | slice) -> EndStates:
        """Some of the rows."""
        return EndStates(self.overlap[rows], self.squares[rows], self.height[rows])


class SlideEnds(NamedTuple):
    """The ends of slides by numbers that tell them apart, and what is known of them."""

    kept: KeptEnds
    first: IntArray
    """Number of the beginning of each slide, (pairs,)."""
    last: IntArray
    """Number of its end, (pairs,)."""


class KeptEnds:
    """The ends of slides that were computed so far. On a strip, a slide begins where the one before it ended.

    Args:
        numbers: how many ends there may be; they are numbered from 0.
    """

    def __init__(self, numbers: int) -> None:
        self._row: npt.NDArray[np.int32] = np.full(numbers, -1, dtype=np.int32)
        self._states: EndStates | None = None  # with room for more
        self.count = 0

    def missing(self, numbers: IntArray) -> tuple[IntArray, IntArray]:
        """The numbers that are not known, each once, and where each stands among those given."""
        unknown = np.flatnonzero(self._row[numbers] < 0)
        new, at = np.unique(numbers[unknown], return_index=True)
        return new, unknown[at]

    def add(self, numbers: IntArray, states: EndStates) -> None:
        """Keep the states of these numbers."""
        old, self.count = self.count, self.count + len(numbers)
        known = states if self._states is None else self._states
        self._states = EndStates(
            with_room(known.overlap, states.overlap, old),
            with_room(known.squares, states.squares, old),
            with_room(known.height, states.height, old),
        )
        self._row[numbers] = np.arange(old, self.count)

    def at(self, numbers: IntArray) -> EndStates:
        """The states of numbers that are known."""
        assert self._states is not None
        return self._states.take(self._row[numbers])


def with_room(rows: npt.NDArray[T], more: npt.NDArray[T], old: int) -> npt.NDArray[T]:
    """A table of the first `old` rows and of `more`; it doubles, so that few rows are moved."""
    new = old + len(more)
    if new > len(rows) or not old:
        larger = np.empty((max(new, 2 * len(rows)), *more.shape[1:]), dtype=more.dtype)
        larger[:old] = rows[:old] if old else larger[:0]
        rows = larger
    rows[old:new] = more
    return rows


class FacePairs(NamedTuple):
    """Wheels on axles."""

    wheels: HeightArray
    """Heights (wheels, n + 1, n + 1) [mm]."""
    axles: HeightArray
    """Heights (axles, 2 n + 1, n + 1) [mm]."""
    wheel: IntArray
    """Number of the wheel of each pair, (pairs,)."""
    axle: IntArray
    """Number of its axle, (pairs,)."""


def slide_foundations(
    options: EnsembleOptions, pairs: FacePairs, loads: FloatArray, free: BoolArray, room: Single
) -> SlideNumbers:
    """Slide every wheel over its axle by its length of 1 mm; see `Foundation.slide`.

    Args:
        options: stiffnesses and positions, and what nodes on the border stand for.
        pairs: the faces.
        loads: normal force at the start of each pair (pairs,) [N].
        free: whether each pair keeps its load, (pairs,); else it keeps its height.
        room: memory to be overwritten, (at least 2 x positions x pairs x G,).
    """
    count = len(pairs.wheel)
    held = None if free.all() else _slid_held(options, pairs, loads, room)
    if held is not None and not free.any():
        return held
    numbers = np.arange(2 * count)
    moved = slide_by_ends(options, pairs, loads, SlideEnds(KeptEnds(2 * count), numbers[:count], numbers[count:]), room)
    if held is None:
        return moved
    return SlideNumbers(*(np.where(free[:, None], *each) for each in zip(moved, held, strict=True)))


def slide_by_ends(
    options: EnsembleOptions, pairs: FacePairs, loads: FloatArray, ends: SlideEnds, room: Single
) -> SlideNumbers:
    """As `slide_foundations` for pairs that all keep their load; ends that are known are not computed again."""
    count, nodes, shares = len(pairs.wheel), pairs.wheels[0].size, _shares(options, pairs.wheels)
    new, at = ends.kept.missing(np.concatenate([ends.first, ends.last]))
    if len(new):
        order = np.argsort(at >= count, kind="stable")  # beginnings before ends
        new, at = new[order], at[order]
        begin, which = int((at < count).sum()), at % count
        sums, work = room[: 2 * len(new) * nodes].reshape(2, len(new), nodes)
        faces = _flat(pairs.wheels)[pairs.wheel[which]]
        for place, part in ((0, slice(begin)), (options.positions - 1, slice(begin, None))):
            np.add(faces[part], _track(options, pairs, place)[pairs.axle[which[part]]], out=sums[part])
        ends.kept.add(new, _pressed(options, sums, loads[which], work, shares))
    return _between(options, ends.kept.at(ends.first), ends.kept.at(ends.last), loads, _whole(shares, nodes))


def _flat(faces: HeightArray) -> HeightArray:
    return faces.reshape(len(faces), -1)


def _track(options: EnsembleOptions, pairs: FacePairs, place: int) -> HeightArray:
    """What lies under a wheel on every axle (axles, G) at a place of the slide, 0 to positions - 1."""
    along, row = pairs.wheels.shape[1:]
    start = place * ((along - 1) // (options.positions - 1)) * row
    return _flat(pairs.axles)[:, start : start + along * row]


def _shares(options: EnsembleOptions, wheels: HeightArray) -> Single | None:
    return node_shares(*wheels.shape[1:]) if options.trapezoid else None


def _whole(shares: Single | None, nodes: int) -> float:
    """Cells that all nodes together stand for."""
    return float(nodes if shares is None else shares.sum())


def _pressed(
    options: EnsembleOptions, sums: HeightArray, loads: FloatArray, work: Single, shares: Single | None
) -> EndStates:
    """Each row of `sums` (rows, G) pressed by its load (rows,) [N]."""
    overlaps, squares, heights = [], [], []
    for touch in _touches(options, sums, loads, work, shares):
        overlaps.append(touch.overlap)
        squares.append(np.einsum("ij,ij->i", work, work if shares is None else work * shares))
        heights.append(touch.height)
    return EndStates(np.stack(overlaps, axis=1), np.stack(squares, axis=1), np.stack(heights, axis=1))


def _touches(
    options: EnsembleOptions, sums: HeightArray, loads: FloatArray, work: Single, shares: Single | None
) -> Iterator[Touch]:
    """What touches where each stiffness bears the loads; its overlaps are in `work` until the next is asked for."""
    # flat faces would be pressed to their mean less the overlap: others not so deep
    mean = _row_sums(sums, shares) / _whole(shares, sums.shape[1])
    touch = touched(sums, mean - loads / options.stiffness[0], work, shares)
    for stiffness in options.stiffness:
        touch = contact_height(sums, loads / stiffness, touch, work, shares)
        yield touch


def _between(
    options: EnsembleOptions, first: EndStates, last: EndStates, loads: FloatArray, whole: float
) -> SlideNumbers:
    """The response of a slide at constant force to its two ends."""
    overlaps, squares = np.stack([first.overlap, last.overlap]), np.stack([first.squares, last.squares])
    heights = np.stack([first.height, last.height])
    return _response(options, overlaps, squares, heights, start=loads, whole=whole)


def _slid_held(options: EnsembleOptions, pairs: FacePairs, loads: FloatArray, room: Single) -> SlideNumbers:
    """Slide at constant height, that of the first place, over all of them."""
    places, count, nodes = options.positions, len(pairs.wheel), pairs.wheels[0].size
    shares, faces = _shares(options, pairs.wheels), _flat(pairs.wheels)[pairs.wheel]
    sums, work = room[: 2 * places * count * nodes].reshape(2, places, count, nodes)
    for place, out in enumerate(sums):
        np.add(faces, _track(options, pairs, place)[pairs.axle], out=out)
    above = work.reshape(-1, nodes)
    overlaps, squares, heights = [], [], []
    for touch in _touches(options, sums[0], loads, above[:count], shares):
        _overlap(sums[1:].reshape(-1, nodes), np.tile(touch.height, places - 1), above[count:])
        overlaps.append(np.concatenate([touch.overlap, _row_sums(above[count:], shares)]).reshape(places, count))
        weighed = above if shares is None else above * shares
        squares.append(np.einsum("ij,ij->i", above, weighed).reshape(places, count))
        heights.append(touch.height[None])
    by_stiffness = [np.stack(column, axis=2) for column in (overlaps, squares, heights)]
    return _response(options, *by_stiffness, start=loads, whole=_whole(shares, nodes))


class Touch(NamedTuple):
    """Faces at heights z, (rows,) each."""

    height: FloatArray
    """Height z of each row [mm]."""
    overlap: FloatArray
    """Sum over the nodes of what is above z [mm]."""
    nodes: IntArray | Single
    """Number of nodes above z [-]."""


@functools.lru_cache(maxsize=4)
def node_shares(along: int, across: int) -> Single:
    """Cells of the grid that each node of a face stands for, (along x across,): 1, on an edge 1/2, in a corner 1/4.

    So sums over the nodes are integrals by the trapezoid rule. With whole cells all around the border counts double,
    and where few nodes touch, as on rough faces, its peaks carry too much.
    """
    sides = [np.ones(points, dtype=np.float32) for points in (along, across)]
    for side in sides:
        side[[0, -1]] = 0.5
    return np.outer(*sides).ravel()


def touched(sums: HeightArray, height: FloatArray, work: Single, shares: Single | None = None) -> Touch:
    """What touches at these heights; leaves the overlap of each node in `work`."""
    _overlap(sums, height, work)
    inside = work > 0.0
    # sums of quarters are exact in any order, in a matrix product too
    nodes = np.add.reduce(inside, axis=1, dtype=np.int32) if shares is None else inside @ shares
    return Touch(height, _row_sums(work, shares), nodes)


def contact_height(
    sums: HeightArray, overlap: FloatArray, start: Touch, work: Single, shares: Single | None = None
) -> Touch:
    """The height z at which the mean overlap <sums - z> is the one asked for, by Newton from below.

    Each pair stops by itself when its step is less than `NEWTON_TOLERANCE` of the overlap; most need half as many steps
    as the slowest.

    Args:
        sums: sums of the heights of both faces (pairs, G) [mm].
        overlap: mean overlap over all nodes (pairs,) [mm].
        start: at a height not above z.
        work: the overlaps of `start` (pairs, G); those at z are left there.
        shares: cells that each node stands for (G,), from `node_shares`; one each where they are left out.
    """
    height, sum_above, nodes = start.height.copy(), start.overlap.copy(), start.nodes.copy()
    whole = sums.shape[1] if shares is None else float(shares.sum())
    target, tolerance = overlap * whole, NEWTON_TOLERANCE * overlap
    moving: IntArray | slice = slice(None)  # the rows whose step was not small enough yet; the others stay
    for _ in range(NEWTON_STEPS):
        step = (sum_above[moving] - target[moving]) / np.maximum(nodes[moving], LEAST_SHARE)
        moves = np.flatnonzero(step > tolerance[moving])
        if not len(moves):
            break
        rows = moves if isinstance(moving, slice) else moving[moves]
        height[rows] += step[moves]
        if len(rows) > MOST_GATHERED * len(sums):
            moving, touch = slice(None), touched(sums, height, work, shares)
        else:
            above = np.empty((len(rows), sums.shape[1]), dtype=np.float32)
            moving, touch = rows, touched(sums[rows], height[rows], above, shares)
            work[rows] = above
        sum_above[moving], nodes[moving] = touch.overlap, touch.nodes
    return Touch(height, sum_above, nodes)


def _response(
    options: EnsembleOptions,
    overlaps: FloatArray,
    squares: Single,
    heights: FloatArray,
    *,
    start: FloatArray,
    whole: float,
) -> SlideNumbers:
    """What foundations of stiffnesses K say of a slide.

    Args:
        options: the stiffnesses.
        overlaps: sum over the nodes at each place (places, pairs, K) [mm].
        squares: sum of the squares (places, pairs, K) [mm^2].
        heights: of the face at each place, or the one at all of them (places or 1, pairs, K) [mm].
        start: normal force at the start (pairs,) [N].
        whole: cells that all nodes together stand for.
    """
    springs, begin = np.array(options.stiffness) / whole, start[:, None]
    loads, energies = springs * overlaps, ((0.5 * springs).astype(np.float32) * squares).astype(np.float64)
    load, energy = _trapezoid_mean(loads), _trapezoid_mean(energies)
    carried = np.maximum(load, 0.05 * begin)
    b = (energies[-1] - energies[0] + begin * (heights[-1] - heights[0])) / carried
    each = b, load / begin, loads.min(axis=0) / begin, energy / carried
    return SlideNumbers(*(column.astype(np.float32) for column in each))


def _overlap(sums: HeightArray, heights: FloatArray, work: Single) -> None:
    """What is above a height for each row, into `work`; zeros of its shape are compared with twice as fast as one."""
    np.subtract(sums, heights[:, None].astype(np.float32), out=work)
    np.maximum(work, _zeros(work.size.bit_length())[: work.size].reshape(work.shape), out=work)


@functools.lru_cache(maxsize=2)
def _zeros(bits: int) -> Single:
    """At least so many zeros as a number of so many bits counts."""
    return np.zeros(1 << bits, dtype=np.float32)


def _row_sums(rows: Single, shares: Single | None = None) -> FloatArray:
    """The sum of each row, of what its nodes stand for; by einsum, in a third of the time of `sum`."""
    sums = np.einsum("ij->i", rows) if shares is None else np.einsum("ij,j->i", rows, shares)
    return np.asarray(sums, dtype=np.float64)


def _trapezoid_mean(values: FloatArray) -> FloatArray:
    """Mean along the slide of values at equal steps, by the trapezoid rule."""
    return np.asarray(reduce(np.add, values[1:-1], 0.5 * (values[0] + values[-1])) / (len(values) - 1))
