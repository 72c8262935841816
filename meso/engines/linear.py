"""Both plates as linear lattices in time: the state that the explicit engine advances where nothing breaks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .. import kernels
from ..lattice.candidates import NOBODY, ContactCandidates
from ..lattice.lattice import Lattice
from ..records import Sums


class Linear:
    """An explicit run of linear lattices: displacements and rotations of every sphere, small as they must be.

    Args:
        lattice: The two plates joined, the wheel's nodes first.
        dt: Time step [s].
        micro_friction: Coefficient of every contact [-].
        candidates: Of the two faces.
    """

    def __init__(
        self, lattice: Lattice, *, dt: float, micro_friction: float = 0.0, candidates: ContactCandidates = NOBODY
    ) -> None:
        self.lattice, self.dt, self.micro_friction = lattice, dt, micro_friction
        self.u, self.v = np.zeros((lattice.nodes, 6)), np.zeros((lattice.nodes, 6))
        self.drive, self.speed, self.steps = np.zeros(3), np.zeros(3), 0
        self._kinetic = 0.0
        self.candidates, self.history = candidates, candidates.at_rest()
        self.meet(candidates)

    def meet(self, candidates: ContactCandidates) -> None:
        """Take other candidates of the two faces; those known from before keep their history."""
        self.candidates, self.history = candidates, candidates.remembering(self.candidates, self.history)
        self._places = self.lattice.blocks.place[candidates.pair]
        self._window, self._live = np.zeros(2, np.int64), np.empty(len(self.history), np.int64)

    @property
    def live(self) -> npt.NDArray[np.int64]:
        """Numbers of the candidates that are looked at now."""
        return self._live[: self._window[1]]

    def advance(
        self,
        steps: int,
        speed: Sequence[float],
        *,
        damping: float = 0.0,
        target: float = 0.0,
        carriage: Sequence[float] = (1.0, 0.0),
    ) -> Sums:
        """Take some leapfrog steps while the wheel is carried at `speed` (3) [mm/s]; see `kernels.run_leapfrog`."""
        lattice, meet, total = self.lattice, self.candidates, np.zeros(7)
        self.speed[: 2 if target > 0.0 else 3] = speed[: 2 if target > 0.0 else 3]
        kernels.run_leapfrog(
            self.u, self.v, lattice.blocks, lattice.twist, self.dt, damping, meet.first, meet.last, self._places,
            meet.offset, meet.parameters, self.history, self.micro_friction, self._window, self._live,
            self.drive, self.speed, target, np.array(carriage, dtype=np.float64), steps, total,
        )  # fmt: skip
        self.steps += steps
        self._kinetic = 0.5 * total[6]
        return Sums(
            force=total[:3] / steps,
            work=float(total[5]),
            friction=float(total[3]),
            damping=float(total[4]),
            released=0.0,
        )

    def stored(self) -> tuple[float, float, float]:
        """Energy in the beams, in the contacts, and kinetic energy [N mm]."""
        lattice, meet, force = self.lattice, self.candidates, np.zeros_like(self.u)
        kernels.beam_forces(
            self.u, force, lattice.rows, lattice.cols, lattice.beams, lattice.anchored, lattice.anchors, lattice.twist
        )
        contact = kernels.contact_energy(
            self.u, self.live, meet.pair, meet.offset, meet.parameters, self.history, *self.drive
        )
        return float(-0.5 * np.sum(self.u * force)), float(contact), self._kinetic
