"""An elastic foundation between two rough faces: the physics that the network starts from, in torch.

Winkler: where the faces would overlap by o, they press with p = K o. The wheel's face is lowered until it carries the
load of the friction test, and then slid at that height. The energy U = K/2 int o^2 dA and the load N = K int o dA at
several positions give the slope of the law mu_meso = a mu_micro + b without anything learned:

    b = (U(end) - U(start)) / (mean N x slide)

because what friction does not lose stays behind as stored energy.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

NEWTON = 12
"""Steps to the height; N(z) is convex and piecewise linear, and three or four usually suffice."""


def facing(wheel: Tensor, axle: Tensor, positions: int) -> Tensor:
    """Sum of the heights of both faces at equal steps of the slide, from the start to the end.

    Args:
        wheel: heights outward from its plate (pairs, n + 1, n + 1) [mm].
        axle: heights (pairs, 2 n + 1, n + 1) [mm]; the wheel begins at its first row.
        positions: how many, one more than a divisor of n.

    Returns:
        (pairs, positions, n + 1, n + 1) [mm].
    """
    cells = wheel.shape[1] - 1
    step = cells // (positions - 1)
    return torch.stack([axle[:, k * step : k * step + cells + 1] + wheel for k in range(positions)], dim=1)


class Foundation(nn.Module):
    """Energies and loads of foundations of several stiffnesses K, which are parameters.

    Args:
        stiffness: starting values of K [N/mm3].
        load: that the height is set to carry at the start [N].
        positions: of the slide that are looked at, the first and the last among them.
        edge: of the apparent area [mm], and length of the slide.
    """

    def __init__(self, stiffness: list[float], load: float, positions: int = 9, edge: float = 1.0) -> None:
        super().__init__()
        self.log_stiffness = nn.Parameter(torch.tensor(stiffness, dtype=torch.float32).log())  # (K,)
        self.load, self.positions, self.edge = load, positions, edge
        weight = torch.ones(positions)
        weight[0] = weight[-1] = 0.5
        self.register_buffer("weight", weight / weight.sum())  # (S,) trapezoid rule along the slide
        self.weight: Tensor

    def forward(self, wheel: Tensor, axle: Tensor) -> tuple[Tensor, Tensor]:
        """b [-] and mean load over the load [-] for each stiffness: two of shape (pairs, K)."""
        sums = facing(wheel, axle, self.positions).flatten(2)  # (P, S, G)
        area = self.edge**2
        energies, loads = [], []
        for stiffness in self.log_stiffness.exp():
            height = self._height(sums[:, 0], self.load / (stiffness * area))  # (P, 1)
            overlap = (sums - height[:, None]).clamp_min(0.0)  # (P, S, G)
            loads.append(stiffness * area * overlap.mean(dim=2) @ self.weight)
            ends = overlap[:, [0, -1]].square().mean(dim=2)  # (P, 2)
            energies.append(0.5 * stiffness * area * (ends[:, 1] - ends[:, 0]))
        load = torch.stack(loads, dim=1)  # (P, K)
        b = torch.stack(energies, dim=1) / (load.clamp_min(0.05 * self.load) * self.edge)
        return b, load / self.load

    @staticmethod
    def _height(sums: Tensor, mean_overlap: Tensor) -> Tensor:
        """z with mean <sums - z> = mean_overlap, by Newton from below; sums (P, G), result (P, 1) [mm]."""
        height = sums.amin(dim=1, keepdim=True) - mean_overlap
        for _ in range(NEWTON):
            gap = sums - height
            inside = (gap > 0.0).float()
            height = height + ((gap * inside).mean(1, keepdim=True) - mean_overlap) / inside.mean(1, keepdim=True)
        return height
