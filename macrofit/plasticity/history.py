"""The plastic strains of one body at the increments of a run, from what changed in each."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..base.arrays import FloatArray
from .body import Changes, PlasticBody, changed
from .law import PointState
from .surface import SurfaceFit


class FlowHistory:
    """Plastic strains, and what they do to displacement and stress; the increments are asked for in ascending order."""

    def __init__(self, body: PlasticBody, changes: Sequence[Changes | None]) -> None:
        self.body, self._changes = body, changes
        flowed = [each is not None and len(each["points"]) > 0 for each in changes]
        self.any: list[bool] = np.logical_or.accumulate(flowed).tolist()
        self._state, self._done = body.rest().state, 0

    @cached_property
    def surface(self) -> SurfaceFit:
        """What finds the stress of a contact line that flowed; made when a field is first asked for."""
        return SurfaceFit(self.body)

    def at(self, numbers: Sequence[int]) -> list[PointState]:
        """What the points remember after increments of these numbers."""
        states = []
        for number in numbers:
            for each in self._changes[self._done : number + 1]:
                if each:
                    self._state = changed(self._state, each)
            self._done = max(self._done, number + 1)
            states.append(self._state)
        return states

    def loads(self, states: Sequence[PointState]) -> FloatArray:
        """f_p (dofs, k) [N] of k states."""
        return np.stack([self.body.load(state.strain) for state in states], axis=1)

    def stresses(self, states: Sequence[PointState]) -> FloatArray:
        """D eps_p (4, points, k) [MPa] of k states."""
        return np.asarray(np.einsum("ij,pjk->ipk", self.body.moduli, np.stack([s.strain for s in states], axis=2)))
