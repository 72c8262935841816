"""What a run leaves behind: plain records, filled by the solver and read by monitors, files and figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from .base.arrays import FloatArray, IntArray
from .friction import Outside, TileOverlaps, tile_overlaps
from .scene.keys import Scene

TILE = 1.0  # mm, length of a friction tile


@dataclass(frozen=True, kw_only=True)
class FacetState:
    """The seat's facets at one increment, arrays of shape (facets,); zero where the wheel is not near."""

    pressure: FloatArray  # MPa, mean over the covered part of the facet
    traction: FloatArray  # MPa, tangential, on the axle; has the sign of slip
    gap: FloatArray  # mm, > 0 open
    slip: FloatArray  # mm, of this increment
    accumulated_slip: FloatArray  # mm, sum of |slip|
    status: IntArray  # OPEN, STICK or SLIP, by the slip of this increment: what the cone's edge holds still sticks
    friction: FloatArray  # coefficient of friction


@dataclass(frozen=True, kw_only=True)
class Increment:
    """One accepted increment."""

    index: int
    displacement: float  # mm
    force: float  # N, pushing force on the wheel, > 0 against the motion of the insertion
    normal_force: float  # N, integral of the pressure
    friction_force: float  # N, axial resultant of the tangential traction on the axle, part of force
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
    plastic_work: float = 0.0  # N mm, of both bodies in this increment
    plastic_strain: float = 0.0  # largest accumulated plastic strain so far
    work: float = 0.0  # N mm, of the press, and of a wheel's heat, in this increment
    plastic_iterations: int = 0  # of plastic strains and contact; 0 where no steel may yield
    torque: float = 0.0  # N mm, integral of 2 pi r^2 friction pressure ds: what friction carries around the axis
    friction_sd: float = math.nan  # deviation of the friction of what slips over normal_force, NaN where none is stated
    wall_s: float
    facets: FacetState = field(repr=False)

    @property
    def push_off(self) -> float:
        """Force [N] at which the wheel slides on in the direction of the insertion.

        Integral of friction * pressure, and what the slope of the fit adds. The pressure is that of this state: what a
        push would change in it (1 to 3 %, by Poisson's ratio) is left out.
        """
        return self.mean_friction * self.normal_force + (self.force - self.friction_force)

    @property
    def force_sd(self) -> float:
        """Standard deviation of the force from that of the friction [N]; NaN where the provider states none."""
        return self.friction_sd * self.normal_force

    @property
    def pull_off(self) -> float:
        """Force [N] at which the wheel slides back off, see `push_off`; below 0 where it jumps off by itself."""
        return self.mean_friction * self.normal_force - (self.force - self.friction_force)


@dataclass(frozen=True)
class Extreme:
    """Largest von Mises stress of a body over the whole run, and where and when it occurs."""

    value: float  # MPa
    r_mm: float
    z_mm: float  # in the axle's frame, for the wheel too
    displacement_mm: float


@dataclass(frozen=True, kw_only=True)
class YieldZone:
    """Where a body flowed, or would have if it were not taken as elastic."""

    value: float  # largest accumulated plastic strain at the end, or largest von Mises stress over the yield stress
    r_mm: float
    z_mm: float  # in the axle's frame, for the wheel too
    depth_mm: float  # largest distance from the contact line
    area_mm2: float  # of the section


@dataclass(frozen=True, kw_only=True)
class BodyField:
    """Displacement and stress of one body at one displacement, for files and figures."""

    points: FloatArray  # (n, 2) undeformed (r, z) [mm]; the wheel's are shifted by the travel
    cells: IntArray  # (m, 3) or (m, 6): vertices, then the middle of the edge opposite to each
    displacement: FloatArray  # (n, 2) [mm]
    stress: FloatArray  # (n, 4) [MPa], recovered at the nodes: rr, zz, tt, rz
    von_mises: FloatArray  # (n,) [MPa], recovered at the nodes
    plastic_strain: FloatArray | None = None  # (n,) accumulated, recovered at the nodes; None of elastic bodies


@dataclass(frozen=True, kw_only=True)
class Tiling:
    """Where the friction tiles of seat and bore lie."""

    size: float  # mm
    seat_origin: float  # mm, coordinate where seat tile 0 starts
    seat_tiles: int
    bore_ends: tuple[float, float]  # mm, coordinates of the bore's rear and leading edge at displacement 0
    bore_tiles: int
    radial: bool  # the bore moves along the seat

    def overlaps(self, start: FloatArray, end: FloatArray, displacement: float) -> TileOverlaps:
        """Which pairs of tiles the pieces [start, end] of the seat face at a displacement, and over what length."""
        edge = self.bore_ends[1] + (displacement if self.radial else 0.0)
        tiles = (self.size, self.seat_tiles, self.bore_tiles)
        return tile_overlaps(start, end, edge, *tiles, seat_origin=self.seat_origin)

    def facing(self, seat: FloatArray, displacement: float) -> TileOverlaps:
        """The same for the parts of the seat's facets, between its ends (facets + 1,) [mm], that face the bore."""
        shift = displacement if self.radial else 0.0
        rear, leading = (place + shift for place in self.bore_ends)
        covered = np.clip(seat, rear, leading)
        return self.overlaps(covered[:-1], covered[1:], displacement)


@dataclass(frozen=True, kw_only=True)
class PairFrictionMap:
    """The pairs of tiles a run has met and their friction, arrays of shape (pairs,)."""

    tiling: Tiling
    seat: IntArray  # tile number
    bore: IntArray
    coefficient: FloatArray  # the latest answer of the provider
    uncertainty: FloatArray  # its standard deviation, NaN where the provider states none
    lasting: bool  # a pair keeps its coefficient: the provider depends on tiles alone


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A whole run: its increments, its stresses and fields, and what it took."""

    scene: Scene
    seat: FloatArray  # (facets + 1,) coordinates of the seat's facet ends [mm]: z, or r where the gap is axial
    increments: tuple[Increment, ...]
    max_von_mises: dict[str, Extreme]  # "axle", "wheel"; empty where the scene asks for no stress
    fields: dict[float, dict[str, BodyField]]  # displacement -> body -> field
    force_balance: float | None  # see force_balance(); None where no displacement field was computed
    energy_balance: float  # see energy_balance()
    dofs: int
    setup_cpu_s: float
    increments_cpu_s: float
    stress_cpu_s: float
    counters: dict[str, int]  # factorisations, right_hand_sides, back_substitutions, provider_calls, ...
    friction: PairFrictionMap | None = None  # None where the coefficient is the same everywhere
    interference: float | None = None  # mm, deepest overlap of the undeformed bodies; None where the scene says it
    bore_ends: tuple[float, float] | None = None  # mm, coordinates of the bore's ends at displacement 0
    flowed: dict[str, YieldZone] = field(default_factory=dict)  # of bodies that may yield, where stress is evaluated
    beyond_yield: dict[str, YieldZone] = field(default_factory=dict)  # of elastic bodies that state a yield stress
    outside: tuple[Outside, ...] = ()  # pairs of tiles for which the provider of friction may be wrong, by reason
    origin: Callable[[], dict[str, Any]] = dict  # what the provider of friction says of where it has it from
    residual: dict[str, Extreme] = field(default_factory=dict)  # largest von Mises stress once the press has let go

    @property
    def displacement(self) -> FloatArray:
        """Displacements of the increments [mm]."""
        return np.array([record.displacement for record in self.increments])

    @property
    def force(self) -> FloatArray:
        """Pushing force at the increments [N]."""
        return np.array([record.force for record in self.increments])


class Journal(Protocol):
    """Where accepted increments are kept as they come, and read back from to resume."""

    def records(self) -> list[tuple[Increment, dict[str, FloatArray | IntArray]]]:
        """The increments of an earlier run of the same scene, with the state each left."""
        ...

    def append(self, record: Increment, state: dict[str, FloatArray | IntArray]) -> None:
        """Keep one more."""
        ...


def energy_balance(increments: Sequence[Increment]) -> float:
    """|work - growth of the elastic energy - friction's and plastic work| / the largest of them on the way.

    From the first increment on. What is left is of first order in the increment where contact is made, and next to
    nothing where the same facets stick and slip. Work below 1e-2 of the strain energy is taken as that much: where
    nothing is to be moved (no friction), the balance is of rounding and mesh alone.
    """
    work = stored = dissipated = most = 0.0
    for before, after in pairwise(increments):
        work += after.work
        stored += after.strain_energy - before.strain_energy
        dissipated += after.dissipation + after.plastic_work
        most = max(most, abs(work), abs(stored))
    held = max((record.strain_energy for record in increments), default=0.0)
    scale = max(most, dissipated, 1e-2 * held)
    return abs(work - stored - dissipated) / scale if scale > 0.0 else 0.0


def force_balance(increments: Sequence[Increment], reactions: dict[str, FloatArray]) -> float | None:
    """Largest |pushing force - reaction of a support| over the largest normal or pushing force.

    reactions: body -> axial force of its support on it at each increment [N], NaN where it was not evaluated. None
    where nothing was evaluated.
    """
    force = np.array([record.force for record in increments])
    scale = max((max(abs(record.force), record.normal_force) for record in increments), default=0.0)
    errors = [np.abs(force + reactions["axle"]), np.abs(force - reactions["wheel"])] if reactions else []
    known = np.concatenate([error[np.isfinite(error)] for error in errors]) if errors else np.zeros(0)
    if len(known) == 0:
        return None
    return float(known.max()) / scale if scale > 0.0 else float(known.max())


def tiles(coordinate: FloatArray) -> int:
    """Number of friction tiles on a contact line."""
    return max(1, int(np.ceil((coordinate[-1] - coordinate[0]) / TILE - 1e-9)))
