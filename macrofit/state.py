"""What an increment starts from, and what a step leaves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from .base.arrays import FloatArray, IntArray
from .contact.law import ContactProblem, Status
from .contact.newton import Report
from .contact.seat import applied
from .contact.status import OPEN, SLIP, STICK
from .plasticity.material import limit_load
from .solution import FacetState, Increment

if TYPE_CHECKING:
    from .bodies.body import ContactLine
    from .contact.interface import MortarCoupling
    from .plasticity.body import Changes
    from .plasticity.yielding import Flow, Settled
    from .scene.keys import Scene


@dataclass(frozen=True, kw_only=True)
class State:
    """Everything an increment starts from."""

    displacement: float
    direction: float  # sign of the last motion
    friction_force: float  # axial resultant of the tangential traction [N]
    seat_displacement: FloatArray  # (2 loaded nodes,) [mm]
    bore_displacement: FloatArray  # (2 bore nodes,) [mm]
    seat_load: FloatArray  # (2 loaded nodes,) [N]
    bore_load: FloatArray  # (2 bore nodes,) [N]
    pressure: FloatArray  # (facets,) [MPa]
    accumulated_slip: FloatArray  # (facets,) [mm]
    kind: IntArray  # (facets, moments) status
    sign: IntArray  # (facets, moments) of the slip
    kappa: FloatArray  # (facets, moments) see `contact.law`
    thermal_strain: float  # of the wheel
    held: FloatArray  # (facets, moments) elastic slip (lambda - (T u - Q)) / gamma, see `contact.law` [mm]
    shear: FloatArray  # (facets, moments) tangential force on the seat [N]
    flow: Flow | None = None  # of the points of this rank's bodies, where they may yield
    changes: dict[str, Changes] | None = None  # of the points of all bodies in this increment

    @property
    def axial_force(self) -> float:
        """Axial resultant of the load on the seat [N]: the pushing force."""
        return float(self.seat_load.reshape(2, -1)[1].sum())

    def arrays(self) -> dict[str, FloatArray | IntArray]:
        """The state as named arrays, for a journal; of the bodies what this increment changed."""
        own = {name: np.asarray(getattr(self, name)) for name in self._named()}
        for body, changes in (self.changes or {}).items():
            own |= {f"{body}.{name}": values for name, values in changes.items()}
        return own

    @staticmethod
    def restored(arrays: dict[str, FloatArray | IntArray]) -> State:
        """The inverse of ``arrays``; what else stands in a journal is left."""
        scalars = {
            name: float(arrays[name]) for name in ("displacement", "direction", "friction_force", "thermal_strain")
        }
        own = {name: arrays[name] for name in State._named()}
        changes: dict[str, dict[str, FloatArray | IntArray]] = {}
        for name, values in arrays.items():
            body, _, field = name.partition(".")
            if field and body in ("axle", "wheel"):
                changes.setdefault(body, {})[field] = values
        return State(**{**own, **scalars}, changes=changes or None)  # type: ignore[arg-type]

    @staticmethod
    def _named() -> list[str]:
        return [name for name in State.__dataclass_fields__ if name not in ("flow", "changes")]


@dataclass(frozen=True, kw_only=True)
class Posed:
    """What Newton's method is to solve for one displacement, and where it starts; n moments."""

    displacement: float  # mm
    moved: float  # way from the state before [mm]
    contact: ContactProblem
    friction: FloatArray  # (n,)
    status: Status
    kappa: FloatArray  # (n,)


@dataclass(frozen=True, kw_only=True)
class Step:
    """The trial of one displacement; its state counts where Newton's method converged."""

    state: State
    report: Report
    facets: FacetState
    force: float
    normal_force: float
    friction_force: float  # axial resultant of the tangential traction
    friction_bound: float  # integral of friction * pressure
    strain_energy: float
    dissipation: float
    slip_work: float  # what friction takes of the press beyond the mean of its force before and after [N mm]
    torque: float = 0.0  # N mm, integral of friction * pressure * radius
    heat: float = 0.0  # N mm, of the wheel's change of temperature
    settled: Settled | None = None


def first_guess(state: State, line: ContactLine, contact: ContactProblem, friction: FloatArray, moved: float) -> Status:
    """The status before, moment by moment; sliding contact where the bore's same point was in contact before.

    A motion that turns around starts from stick; the first increment from contact wherever the gap is closed.
    """
    kind, sign = covered_moments(state.kind, contact.coupling), covered_moments(state.sign, contact.coupling)
    points = contact.coupling.portions.points
    shift = moved if line.radial else 0.0
    there = np.searchsorted(line.coordinate, points - shift, side="right") - 1
    inside = (there >= 0) & (there < line.facets)
    there = np.where(inside, there, 0)
    half = 2 * (points - shift) > line.coordinate[there] + line.coordinate[there + 1]
    came = state.kind[..., there, half * (state.kind.shape[-1] - 1)]
    fresh = (kind == OPEN) & (inside & (came != OPEN)).reshape(kind.shape)
    fresh |= ~state.pressure.any(axis=-1, keepdims=True) & (contact.coupling.gap < 0.0)
    kind = np.where(fresh, SLIP, kind)
    sign = np.where(fresh, int(np.sign(moved * contact.covered.normals[0, 0])), sign)
    turns = np.asarray(moved * state.direction < 0.0)[..., None]
    kind = np.where(turns & (kind == SLIP), STICK, kind)
    kind = np.where((kind == SLIP) & (sign == 0), STICK, kind)
    kind = np.where((kind == STICK) & (friction == 0.0), SLIP, kind)
    sign = np.where((kind == SLIP) & (friction > 0.0), sign, 0)
    return Status(kind.astype(np.int8), sign.astype(np.int8))


def first_kappa(state: State, contact: ContactProblem) -> FloatArray:
    """kappa to start from: that of the seat's same point in the rear half, of the bore's in the front half.

    The deformed interface follows the seat's edge behind and the bore's edge in front.
    """
    kappa = contact.kappa(state.bore_displacement)
    rear = covered_moments(state.kind, contact.coupling) != OPEN
    rear[..., contact.moments // 2 :] = False
    return np.where(rear, covered_moments(state.kappa, contact.coupling), kappa)


def covered_moments(values: FloatArray | IntArray, coupling: MortarCoupling) -> Any:
    """What the moments that face the bore have (..., n) of values (..., facets, moments)."""
    chosen = values[..., coupling.portions.facet, :]
    return chosen.reshape(*chosen.shape[:-2], -1)


def elastic_energy(state: State, stabilisation: sp.csr_matrix | None) -> Any:
    """1/2 u' K u of both bodies [N mm]; the seat's ``stabilisation`` is no part of its stiffness."""
    seat = state.seat_displacement
    energy = 0.5 * (_product(state.seat_load, seat) + _product(state.bore_load, state.bore_displacement))
    if stabilisation is not None:
        energy -= 0.5 * _product(seat, applied(stabilisation, seat))
    return energy


def _product(load: FloatArray, displacement: FloatArray) -> Any:
    """The product of two vectors of a body's nodes; of several runs, of each."""
    if load.ndim == 1:
        return float(load @ displacement)
    return np.einsum("irn,irn->r", load, displacement)


def nothing_touches(accumulated_slip: FloatArray) -> FacetState:
    """The facets of a seat that the wheel is nowhere near."""
    zero = np.zeros(len(accumulated_slip))
    return FacetState(
        pressure=zero,
        traction=zero,
        gap=zero,
        slip=zero,
        accumulated_slip=accumulated_slip,
        status=zero.astype(np.int64),
        friction=zero,
    )


def accepted(
    index: int, before: State, steps: list[Step], cutbacks: int, wall_s: float, friction_sd: float
) -> Increment:
    """The increment that converged steps make up from the state before it, the last of which it ends with."""
    last = steps[-1]
    return Increment(
        index=index,
        displacement=last.state.displacement,
        force=last.force,
        normal_force=last.normal_force,
        friction_force=last.friction_force,
        mean_friction=last.friction_bound / last.normal_force if last.normal_force else 0.0,
        max_pressure=float(last.facets.pressure.max(initial=0.0)),
        active_facets=int((last.facets.status != OPEN).sum()),
        sticking_facets=int((last.facets.status == STICK).sum()),
        newton_iterations=sum(step.report.iterations for step in steps),
        cutbacks=cutbacks,
        residual=last.report.residual,
        converged=last.report.converged,
        strain_energy=last.strain_energy,
        dissipation=sum(step.dissipation for step in steps),
        plastic_work=sum(step.settled.work for step in steps if step.settled is not None),
        plastic_strain=0.0 if last.settled is None else last.settled.largest,
        plastic_iterations=sum(step.settled.iterations for step in steps if step.settled is not None),
        work=_work(before, steps),
        torque=last.torque,
        friction_sd=friction_sd,
        wall_s=wall_s,
        facets=last.facets,
    )


def remedy(scene: Scene, state: State, failed: Step, *, cools: bool) -> str:
    """What may help a step from a state that failed; a shorter one does not at a limit load."""
    shorter = "a larger motion.cooling" if cools else "a smaller motion.increment"
    if failed.settled is None or failed.settled.converged:
        nitsche = scene.contact.formulation == "nitsche"
        return f"{shorter}, or {'contact.gamma0 nearer to 10' if nitsche else 'contact.penalty_stiffness'}"
    steel = "material.hardening or less friction"
    limit = limit_load(scene, failed.facets.friction * state.pressure)
    return f"{steel}: {limit}" if limit else f"{shorter}, or {steel}, for plastic strain and contact did not settle"


def slip_work(before: State, after: State, moved: FloatArray, contact: ContactProblem, slip: FloatArray) -> FloatArray:
    """What a step's slip adds to its work: 1/2 sum of (tangential force after - before) . slip [N mm].

    Args:
        before: the state before the step.
        after: that after it.
        moved: way of the wheel along each facet of the seat (facets,) [mm]; what is open moves with it.
        contact: which facets face each other.
        slip: of their moments [mm].
    """
    facets = contact.coupling.portions.facet
    passed = np.broadcast_to(moved[:, None], after.kind.shape).copy()
    touching = after.kind[..., facets, :] != OPEN
    passed[..., facets, :] = np.where(touching, slip.reshape(touching.shape), passed[..., facets, :])
    return np.asarray(0.5 * ((after.shear - before.shear) * passed).sum(axis=(-2, -1)))


def _work(before: State, steps: list[Step]) -> float:
    """Work of the press and of heat [N mm] over steps: by the mean force before and after each, and what slip adds.

    Where bodies stick the force grows along a step, and its mean is exact; where they slip, friction has its final
    value from the first slip on, which is also what the step dissipates.
    """
    work = 0.0
    for state, step in zip([before, *(step.state for step in steps)], steps, strict=False):
        moved = step.state.displacement - state.displacement
        if moved != 0.0 or step.heat != 0.0:
            work += 0.5 * (state.axial_force + step.state.axial_force) * moved + step.heat + step.slip_work
    return work
