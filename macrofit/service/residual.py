"""What the press leaves behind: the tractions of the released fit, and the friction of each place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from mpi4py import MPI

from ..assembly import Assembly, assemble, friction_field, yielding_of
from ..base.arrays import BoolArray, FloatArray, IntArray
from ..bodies.approach import check_approach
from ..bodies.body import Body, ContactLine
from ..bodies.stress import StressEvaluator
from ..bodies.surface import surface_stress as nodal_stress
from ..contact.cooling import warmed
from ..contact.interface import MortarCoupling, couple_lines
from ..errors import ConvergenceError, SceneError
from ..friction import GivenFriction, ScriptFriction
from ..plasticity.surface import SurfaceFit
from ..press import REACH, Press
from ..release import is_held, let_go
from ..results.doubts import outside_doubts
from ..scene.keys import Scene
from ..solution import Increment, Journal
from ..solve import doubted_pairs
from ..state import State, Step
from .seat_stress import MM, TT, facet_mean, surface_stress

SMOOTH = "friction: without it nothing holds the wheel in service; give a coefficient"
NUMBERS = ("displacement", "force", "thermal_strain", "plastic_strain")
"""What of a residual is a number."""
DOUBTS = "doubts"
"""What a journal calls the doubts about a press, as text; left out where there are none."""


@dataclass(frozen=True, kw_only=True)
class Residual:
    """The fit after the press has let go, m moments."""

    displacement: float  # mm
    force: float  # N, with which the wheel was pressed on last
    thermal_strain: float  # of the wheel
    coupling: MortarCoupling
    traction: FloatArray  # (3, m): normal, along, around [MPa]
    gap: FloatArray  # (m,) of open moments, 0 in contact [mm]
    friction: FloatArray  # (m,)
    stress: FloatArray  # (facets, 6) of the seat, see `seat_stress` [MPa]
    plastic_strain: float = 0.0  # largest of the press
    doubts: tuple[str, ...] = ()  # about the friction of the press, see `results.doubts`

    @property
    def scalars(self) -> dict[str, float | int | bool]:
        """Its numbers, for a journal."""
        return {name: float(getattr(self, name)) for name in NUMBERS}

    @property
    def arrays(self) -> dict[str, FloatArray | IntArray]:
        """Its arrays, for a journal."""
        own = {name: getattr(self, name) for name in ("traction", "gap", "friction", "stress")}
        return own | ({DOUBTS: np.frombuffer("\n".join(self.doubts).encode(), dtype=np.uint8)} if self.doubts else {})


def restored(
    scalars: Mapping[str, float], arrays: Mapping[str, FloatArray | IntArray], bodies: Mapping[str, Body]
) -> Residual:
    """The inverse of `Residual.scalars` and `Residual.arrays`, for the same bodies."""
    lines = (bodies["axle"].line, bodies["wheel"].line)
    place = (scalars["displacement"], scalars["thermal_strain"])
    own = {name: values for name, values in arrays.items() if name != DOUBTS}
    doubts = tuple(np.asarray(arrays[DOUBTS]).tobytes().decode().split("\n")) if DOUBTS in arrays else ()
    coupling = _coupling(lines, place, len(arrays["gap"]))
    return Residual(coupling=coupling, doubts=doubts, **scalars, **own)  # type: ignore[arg-type]


def pressed_and_released(
    scene: Scene,
    friction: GivenFriction | None = None,
    journal: Journal | None = None,
    assembly: Assembly | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Residual, Mapping[str, Body]]:
    """Press the wheel on, let it go, and give what is left with the bodies; ``friction`` stands for the scene's.

    The ``journal`` keeps the increments of the press, and gives back those of an interrupted one; the ``assembly`` is
    that of the same bodies, where it is there already; ``tell`` hears how far the press is.

    Raises:
        SceneError: the bodies never meet.
        ConvergenceError: an increment cannot be solved, no place without force is found, or nothing holds the wheel.
    """
    scene = msgspec.structs.replace(scene, motion=msgspec.structs.replace(scene.motion, release=False))
    assembly = assemble(scene, MPI.COMM_SELF) if assembly is None else assembly
    seat, wheel = assembly.seat, assembly.wheel
    check_approach(scene, seat.line.side, wheel.line.side)
    script = None if friction is None else ScriptFriction(friction)
    field = friction_field(scene, MPI.COMM_SELF, seat, wheel, script)
    press = Press(scene, seat, wheel.line, assembly.engine, field, yielding_of(scene, assembly))
    records, before, after = _pressed(press, journal, tell)
    strain = scene.thermal_strain_at(len(scene.displacements) - 1)
    held = is_held(after)
    if held and after.friction_force == 0.0:
        raise ConvergenceError(SMOOTH)
    steps, _ = let_go(press, after) if held else press.advance_to(before, after.displacement, strain)
    if not steps[-1].facets.pressure.any():
        raise ConvergenceError(
            f"service: at {after.displacement:g} mm nothing presses the wheel onto its seat; change motion.travel or "
            f"the radii"
        )
    if not steps[-1].facets.friction.any():
        raise ConvergenceError(SMOOTH)
    found = _residual(press, steps[-1], after.axial_force, assembly)
    flowed = max((record.plastic_strain for record in records), default=0.0)
    outside = doubted_pairs(press, records, MPI.COMM_SELF)
    doubts = tuple(outside_doubts(outside, [record.displacement for record in records]))
    return replace(found, plastic_strain=flowed, doubts=doubts), assembly.bodies


def _pressed(
    press: Press, journal: Journal | None, tell: Callable[[str], None]
) -> tuple[list[Increment], State, State]:
    """All increments, and the states before and after the last of them."""
    kept = [] if journal is None else journal.records()
    states = [State.restored(arrays) for _, arrays in kept]
    press.friction.recall(arrays for _, arrays in kept)
    before, after = press.resumed(states[:-1]), press.resumed(states)
    records = [record for record, _ in kept]
    for record, state in press.increments(after, len(states)):
        if journal is not None:
            journal.append(record, state.arrays() | press.friction.news())
        records.append(record)
        before, after = after, state
        tell(f"Pressed         to {state.displacement:.4g} of {press.scene.displacements[-1]:.4g} mm")
    return records, before, after


def _residual(press: Press, step: Step, force: float, assembly: Assembly) -> Residual:
    state, found = step.state, step.report.answer.traction
    place = (state.displacement, state.thermal_strain)
    coupling = _coupling((press.seat.line, press.bore), place, found.shape[1])
    facet = np.repeat(coupling.portions.facet, press.seat.moments)
    traction = np.concatenate([found, np.zeros((1, found.shape[1]))])
    return Residual(
        displacement=state.displacement,
        force=force,
        thermal_strain=state.thermal_strain,
        coupling=coupling,
        traction=traction,
        gap=np.maximum(step.report.answer.trial[0], 0.0) / press.seat.gamma[facet],
        friction=step.facets.friction[facet],
        stress=_stress(press, step, assembly),
    )


def _coupling(lines: tuple[ContactLine, ContactLine], place: tuple[float, float], moments: int) -> MortarCoupling:
    """So many moments that face each other, with or without the ends that stand wide open.

    Raises:
        SceneError: there are none at this displacement [mm], with this thermal strain of the wheel.
    """
    bore = warmed(lines[1], place[1])
    couplings = (couple_lines(lines[0], bore, place[0], reach) for reach in (REACH, np.inf))
    found = next((each for each in couplings if each is not None and len(each.normals) == moments), None)
    if found is None:
        raise SceneError(f"service: at {place[0]:g} mm, where the press lets go, the wheel is off its seat")
    return found


def _stress(press: Press, step: Step, assembly: Assembly) -> FloatArray:
    """The stress of the seat (facets, 6) [MPa]: of its surface, and where it flowed as `plasticity.surface` has it."""
    line, nodes = press.seat.line, len(press.seat.line.nodes)
    moved = step.state.seat_displacement.reshape(2, -1)[:, :nodes]
    displacement = np.stack([moved[0], np.zeros(nodes), moved[1]], axis=1).astype(np.complex128)
    means = np.stack([-step.facets.pressure, step.facets.traction, np.zeros(line.facets)], axis=1)
    out = surface_stress(line, 0, displacement, means.astype(np.complex128)).real
    if "axle" in assembly.plastic:
        flowed, found = _flowed(step, assembly)
        out[flowed, MM], out[flowed, TT] = found[flowed].T
    return out


def _flowed(step: Step, assembly: Assembly) -> tuple[BoolArray, FloatArray]:
    """Which facets of the seat flowed (facets,), and their stress along and around it (facets, 2) [MPa]."""
    plastic, state = assembly.plastic["axle"], step.state
    body, flow = plastic.body, state.flow
    if flow is None:
        return np.zeros(body.line.facets, dtype=np.bool_), np.zeros((body.line.facets, 2))
    own = flow["axle"].state
    displacement = body.back_substitute(state.seat_load[:, None]) + body.solve(plastic.load(own.strain)[:, None])
    stress = StressEvaluator(body).stress(displacement)[:, :, 0] - plastic.moduli @ own.strain.T
    (n_r, n_z), pressure, shear = body.line.normals.T, step.facets.pressure, step.facets.traction
    traction = np.stack([-pressure * n_r - shear * n_z, -pressure * n_z + shear * n_r], axis=1)
    fit, of_nodes = SurfaceFit(plastic), nodal_stress(body, displacement[:, 0], traction)
    nodes, order = fit.flowed(own.accumulated, of_nodes), body.line.order
    of_nodes[nodes] = fit.stress(np.flatnonzero(nodes), stress, own, traction)
    rr, zz, tt, rz = (facet_mean(each, order).real for each in of_nodes.T.astype(np.complex128))
    flowed = np.logical_or.reduce([nodes[k : len(nodes) - order + k : order] for k in range(order + 1)])
    return flowed, np.stack([n_z**2 * rr + n_r**2 * zz - 2.0 * n_r * n_z * rz, tt], axis=1)
