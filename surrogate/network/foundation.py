"""An elastic foundation between two rough faces: the physics that the network starts from, in torch.

Winkler: where the faces would overlap by o, they press with p = K o. The wheel's face is lowered until it carries the
load of the friction test, and then slid at that height z, or at that load. The energy U = K/2 int o^2 dA and the load
N = K int o dA at several positions give the slope of the law mu_meso = a mu_micro + b without anything learned:

    b = (U(end) - U(start) + N (z(end) - z(start))) / (mean N x slide)

because what friction does not lose stays behind as stored energy, or has lifted the load.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from .inference import check_foundations
from .slides import NEWTON_STEPS, NEWTON_TOLERANCE, node_shares


class SlideResponse(NamedTuple):
    """Response of foundations of stiffnesses K to a slide, (pairs, K) each."""

    b: Tensor
    """Change of the energy over the mean load and the slide [-]."""
    load: Tensor
    """Mean over the slide, over the load at the start [-]."""
    least: Tensor
    """Smallest load of the positions, over the load at the start [-]; 0 where contact is lost."""
    depth: Tensor
    """Mean energy over mean load [mm]: half of the overlap where the load is carried."""


class Foundation(nn.Module):
    """Energies and loads of foundations of several stiffnesses.

    Args:
        stiffness: K [N/mm3], rising.
        load: normal force at the start, which sets the height [N].
        positions: places of the slide, the first and the last among them: one more than a divisor of n.
        edge: edge of the apparent area, and length of the slide [mm].
        trapezoid: nodes on the border of a face stand for half a cell of the grid, see `slides.node_shares`.

    Raises:
        ValueError: the stiffnesses do not rise, or there are fewer than two positions.
    """

    def __init__(
        self, stiffness: list[float], load: float, positions: int = 5, edge: float = 1.0, trapezoid: bool = False
    ) -> None:
        super().__init__()
        self.trapezoid = trapezoid
        check_foundations(stiffness, positions)
        self.stiffness, self.load, self.positions, self.edge = tuple(stiffness), load, positions, edge

    def forward(self, wheel: Tensor, axle: Tensor) -> tuple[Tensor, Tensor]:
        """Slope b and mean load of each foundation, as in `slide`."""
        slide = self.slide(wheel, axle)
        return slide.b, slide.load

    def slide(
        self, wheel: Tensor, axle: Tensor, load: Tensor | None = None, constant_force: Tensor | None = None
    ) -> SlideResponse:
        """Slide every wheel over its axle, at the height that carries the load at the start or at that load.

        A row of the answer has the same bits whatever the other rows are, for a given number of rows. At constant
        force the means along the slide are those of its ends: each place costs a search for the height.

        Args:
            wheel: heights outward from its plate (pairs, n + 1, n + 1) [mm].
            axle: heights (pairs, 2 n + 1, n + 1) [mm]; the wheel begins at its first row.
            load: normal force at the start of each pair (pairs,) [N]; left out, `self.load`.
            constant_force: whether each pair keeps its load, (pairs,); left out, none does.
        """
        rows = wheel.shape[1] - 1
        stride, row = rows // (self.positions - 1), wheel.shape[2]
        face, track = wheel.flatten(1), axle.flatten(1)
        nodes = face.shape[1]  # G
        shares = torch.from_numpy(node_shares(rows + 1, row)).to(face) if self.trapezoid else None
        sums = [face + track[:, at : at + nodes] for at in range(0, rows * row + 1, stride * row)]  # S of (P, G)
        loads = face.new_full((len(face),), self.load) if load is None else load  # (P,)
        none = constant_force is None or not bool(constant_force.any())
        if none or constant_force is None:
            return self._slid(sums, loads, shares, free=False)
        free = self._slid([sums[0], sums[-1]], loads, shares, free=True)
        if bool(constant_force.all()):
            return free
        held = self._slid(sums, loads, shares, free=False)
        return SlideResponse(*(torch.where(constant_force[:, None], *each) for each in zip(free, held, strict=True)))

    def _slid(self, sums: list[Tensor], loads: Tensor, shares: Tensor | None, *, free: bool) -> SlideResponse:
        """Slide at constant force over the first place and the last, or at constant height over all of them."""
        solved = sums if free else sums[:1]
        # flat faces would be pressed to their mean less the overlap: others not so deep
        deepest = (loads / (self.stiffness[0] * self.edge**2))[:, None]
        heights = [mean_of_nodes(at, shares)[:, None] - deepest for at in solved]  # (P, 1) each
        found: list[tuple[Tensor, ...]] = []
        for stiffness in self.stiffness:
            overlap = (loads / (stiffness * self.edge**2))[:, None]
            heights = [contact_height(at, overlap, z, shares) for at, z in zip(solved, heights, strict=True)]
            found.append(self._response(sums, heights if free else heights * len(sums), stiffness, loads, shares))
        return SlideResponse(*(torch.stack(column, dim=1) for column in zip(*found, strict=True)))

    def _response(
        self, sums: list[Tensor], heights: list[Tensor], stiffness: float, start: Tensor, shares: Tensor | None
    ) -> tuple[Tensor, ...]:
        """b, mean load, least load and depth of a foundation whose face lies at these heights."""
        area = self.edge**2
        nodes = sums[0].shape[1] if shares is None else float(shares.sum())
        roots = 1.0 if shares is None else shares.sqrt()
        loads, energies = [], []
        for at, height in zip(sums, heights, strict=True):
            overlap = (at - height).relu_()  # (P, G)
            loads.append(sum_of_nodes(overlap, shares) * (stiffness * area / nodes))
            energies.append(
                torch.linalg.vector_norm(overlap * roots, dim=1).square() * (0.5 * stiffness * area / nodes)
            )
        load, energy = trapezoid_mean(loads), trapezoid_mean(energies)  # (P,)
        lifted = start * (heights[-1] - heights[0])[:, 0]
        held = torch.maximum(load, 0.05 * start)
        b = (energies[-1] - energies[0] + lifted) / (held * self.edge)
        least = torch.stack(loads, dim=1).amin(1)
        return b, load / start, least / start, energy / held


def trapezoid_mean(values: list[Tensor]) -> Tensor:
    """Mean along the slide of values at equal steps, by the trapezoid rule."""
    inner = sum(values[1:-1], 0.5 * (values[0] + values[-1]))
    return inner / (len(values) - 1)


def sum_of_nodes(values: Tensor, shares: Tensor | None) -> Tensor:
    """Sum over the nodes (pairs, G) of what they stand for, (pairs,)."""
    return values.sum(1) if shares is None else (values * shares).sum(1)


def mean_of_nodes(values: Tensor, shares: Tensor | None) -> Tensor:
    """Mean over the nodes, each for what it stands for, (pairs,)."""
    return sum_of_nodes(values, shares) / (values.shape[1] if shares is None else float(shares.sum()))


def contact_height(sums: Tensor, overlap: Tensor, start: Tensor, shares: Tensor | None = None) -> Tensor:
    """The height z at which the mean overlap <sums - z> is the one asked for, by Newton from below.

    Each pair stops by itself when its step is less than `NEWTON_TOLERANCE` of the overlap, so that its bits do not
    depend on the others. The last step carries the gradient, dz/dsums = 1/(nodes in contact) on the nodes in contact
    before that step.

    Args:
        sums: sums of the heights of both faces (pairs, G) [mm].
        overlap: mean overlap over all nodes (pairs, 1) [mm].
        start: a height not above z, (pairs, 1) [mm].
        shares: cells that each node stands for (G,); one each where they are left out.

    Returns:
        z, (pairs, 1) [mm].
    """
    height, whole = start, sums.shape[1] if shares is None else float(shares.sum())
    for _ in range(NEWTON_STEPS):
        below = height.detach()
        inside = (sums - below).relu_()
        excess = sum_of_nodes(inside, shares)[:, None] - overlap * whole
        step = excess / sum_of_nodes(inside.detach().sign(), shares)[:, None]
        moves = step > NEWTON_TOLERANCE * overlap
        if not bool(moves.any()):
            break
        height = torch.where(moves, below + step, height)
    return height
