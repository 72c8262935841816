"""The plastic strains of one body at the increments of a run, from what changed in each."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..base.arrays import FloatArray
from .body import Changes, PlasticBody
from .surface import PlasticFields, SurfaceFit


class FlowHistory:
    """Plastic strains, and what they do to displacement and stress; the increments are asked for in ascending order."""

    def __init__(self, body: PlasticBody, changes: Sequence[Changes | None]) -> None:
        self.body, self._changes = body, changes
        flowed = [each is not None and len(each["points"]) > 0 for each in changes]
        self.any: list[bool] = np.logical_or.accumulate(flowed).tolist()
        self._strain, self._accumulated, self._done = np.zeros((body.count, 4)), np.zeros(body.count), 0
        self._back = np.zeros((body.count, 4))

    @cached_property
    def surface(self) -> SurfaceFit:
        """What finds the stress of a contact line that flowed; made when a field is first asked for."""
        return SurfaceFit(self.body)

    def at(self, numbers: Sequence[int]) -> PlasticFields:
        """What the points remember after k increments."""
        strains, accumulated, backs = [], [], []
        for number in numbers:
            for each in self._changes[self._done : number + 1]:
                if each:
                    self._strain[each["points"]] = each["strain"]
                    self._accumulated[each["points"]] = each["accumulated"]
                    self._back[each["points"]] = each["back"].sum(axis=1)
            self._done = max(self._done, number + 1)
            strains.append(self._strain.copy())
            accumulated.append(self._accumulated.copy())
            backs.append(self._back.copy())
        return PlasticFields(
            strain=np.stack(strains, axis=2), accumulated=np.stack(accumulated, axis=1), back=np.stack(backs, axis=2)
        )

    def loads(self, strains: FloatArray) -> FloatArray:
        """f_p (dofs, k) [N] of plastic strains (points, 4, k)."""
        return np.stack([self.body.load(strain) for strain in np.moveaxis(strains, 2, 0)], axis=1)

    def stresses(self, strains: FloatArray) -> FloatArray:
        """D eps_p (4, points, k) [MPa]."""
        return np.asarray(np.einsum("ij,pjk->ipk", self.body.moduli, strains))
