"""What bodies that yielded do to the linear problem of the contact."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import FloatArray
from .law import ContactProblem, EigenMoments


@dataclass(frozen=True, kw_only=True)
class Eigen:
    """What the plastic strain of a body does at its contact line."""

    displacement: FloatArray
    """u_p = K^-1 f_p of the trace nodes (2 trace nodes,) [mm]."""
    traction: FloatArray | None
    """n . D eps_p (facets, 2 ends, 2): its normal and tangential parts at the ends of each facet [MPa]; of the axle."""


def shifted(contact: ContactProblem, coordinate: FloatArray, eigen: dict[str, Eigen]) -> ContactProblem:
    """The contact problem of bodies that yielded."""
    approach, slope = np.zeros_like(contact.undeformed), np.zeros(contact.moments)
    coupling, covered = contact.coupling, contact.covered
    if "axle" in eigen:
        approach -= covered.trial_moments(eigen["axle"].displacement)
        if contact.nitsche and eigen["axle"].traction is not None:
            approach -= _traction_moments(contact, coordinate, eigen["axle"].traction) / covered.gamma
    if "wheel" in eigen:
        bore = eigen["wheel"].displacement
        approach += coupling.bore_moments(bore)
        slope += coupling.bore_slope(bore) if contact.radial else 0.0
    return replace(contact, eigen=EigenMoments(approach=approach, slope=slope))


def _traction_moments(contact: ContactProblem, s: FloatArray, ends: FloatArray) -> FloatArray:
    """Moments (2, n) of a traction (facets, 2 ends, 2) that is linear along each facet: its values at their points."""
    portions = contact.coupling.portions
    facet = portions.facet
    start, end = s[facet], s[facet + 1]
    along = ((portions.points - start[:, None]) / (end - start)[:, None])[:, :, None]
    values = (1.0 - along) * ends[facet, None, 0] + along * ends[facet, None, 1]
    return np.asarray(values.reshape(-1, 2).T)
