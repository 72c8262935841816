"""What a run leaves behind: plain records, filled by the solver and read by monitors, files and figures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .geometry import FloatArray
from .mesh import IntArray
from .scene import Scene

OPEN, STICK, SLIP = 0, 1, 2
"""Status of a facet."""


@dataclass(frozen=True)
class FacetState:
    """The seat's facets at one increment, arrays of shape (facets,); zero where the wheel does not cover them."""

    pressure: FloatArray  # MPa, mean over the covered part of the facet
    traction: FloatArray  # MPa, tangential, on the axle; has the sign of slip
    gap: FloatArray  # mm, > 0 open
    slip: FloatArray  # mm, of this increment
    accumulated_slip: FloatArray  # mm, sum of |slip|
    status: IntArray  # OPEN, STICK or SLIP
    friction: FloatArray  # coefficient of friction


@dataclass(frozen=True)
class Increment:
    """One accepted increment."""

    index: int
    displacement: float  # mm
    force: float  # N, pushing force on the wheel, > 0 against the motion of the insertion
    normal_force: float  # N, integral of the pressure
    mean_friction: float  # integral of friction * pressure over integral of pressure
    max_pressure: float  # MPa
    active_facets: int
    sticking_facets: int
    newton_iterations: int
    cutbacks: int
    residual: float  # relative
    converged: bool
    strain_energy: float  # N mm, both bodies
    dissipation: float  # N mm, by friction in this increment
    wall_s: float
    facets: FacetState = field(repr=False)


@dataclass(frozen=True)
class Extreme:
    """Largest von Mises stress of a body over the whole run, and where and when it occurs."""

    value: float  # MPa
    r_mm: float
    z_mm: float  # in the axle's frame, for the wheel too
    displacement_mm: float


@dataclass(frozen=True)
class BodyField:
    """Displacement and stress of one body at one displacement, for files and figures."""

    points: FloatArray  # (n, 2) undeformed (r, z) [mm]; the wheel's are shifted by the travel
    cells: IntArray  # (m, 3) or (m, 6): vertices, then the middle of the edge opposite to each
    displacement: FloatArray  # (n, 2) [mm]
    stress: FloatArray  # (n, 4) [MPa], recovered at the nodes: rr, zz, tt, rz
    von_mises: FloatArray  # (n,) [MPa], recovered at the nodes


@dataclass(frozen=True)
class Solution:
    """A whole run."""

    scene: Scene
    seat: FloatArray  # (facets + 1,) coordinates of the seat's facet ends [mm]: z, or r where the gap is axial
    increments: tuple[Increment, ...]
    max_von_mises: dict[str, Extreme]  # "axle", "wheel"; empty where the scene asks for no stress
    fields: dict[float, dict[str, BodyField]]  # displacement -> body -> field
    force_balance: float  # largest |force - reaction| / |force| over both bodies, where reactions were evaluated
    energy_balance: float  # |work - strain energy - dissipation| / work
    dofs: int
    setup_cpu_s: float
    increments_cpu_s: float
    stress_cpu_s: float
    counters: dict[str, int]  # factorisations, right_hand_sides, back_substitutions, provider_calls, ...

    @property
    def displacement(self) -> FloatArray:
        """Displacements of the increments [mm]."""
        return np.array([record.displacement for record in self.increments])

    @property
    def force(self) -> FloatArray:
        """Pushing force at the increments [N]."""
        return np.array([record.force for record in self.increments])
