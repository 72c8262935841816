"""Displacements and stresses of a body from the loads of its contact line: largest values, and fields for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .assembly import Assembly
from .base.arrays import BoolArray, FloatArray
from .base.ranks import raise_together
from .bodies.elasticity import von_mises
from .bodies.stress import StressEvaluator
from .bodies.surface import surface_stress
from .parallel import owner
from .scene.keys import Scene
from .scene.material import yield_stress
from .solution import BodyField, Extreme, Increment, YieldZone
from .state import State

if TYPE_CHECKING:
    from .plasticity.history import FlowHistory
    from .plasticity.law import PointState

_BATCH = 48  # right-hand sides at once: 32 take a tenth longer, and from 84 on stresses leave the cache


@dataclass(frozen=True, kw_only=True)
class Stresses:
    """What the bodies' ranks found, on every rank."""

    extremes: dict[str, Extreme]
    residual: dict[str, Extreme]  # the largest at the end, where the press lets go
    fields: dict[float, dict[str, BodyField]]
    reactions: dict[str, FloatArray]  # body -> axial force of its support at each increment [N], NaN if not computed
    flowed: dict[str, YieldZone]
    beyond_yield: dict[str, YieldZone]


def evaluate_stresses(
    scene: Scene, assembly: Assembly, states: Sequence[State], increments: Sequence[Increment]
) -> Stresses:
    """The largest von Mises stress over the run and the fields the scene asks for. Collective."""
    comm = assembly.comm
    travels = [state.displacement for state in states]
    wanted = _fields_at(scene, travels)
    if not states or not (scene.output.stress or wanted):
        return Stresses(
            extremes={},
            residual={},
            fields={},
            reactions={},
            flowed={},
            beyond_yield={},
        )
    found: dict[str, _BodyStresses] = {}
    with raise_together(comm):
        for name, body in assembly.bodies.items():
            if owner(comm, name) == comm.rank:
                if name not in assembly.evaluators:
                    assembly.evaluators[name] = StressEvaluator(body)
                loads = [state.seat_load if name == "axle" else state.bore_load for state in states]
                evaluator, flow = assembly.evaluators[name], None
                if name in assembly.plastic:
                    from .plasticity.history import FlowHistory

                    flow = FlowHistory(assembly.plastic[name], [(state.changes or {}).get(name) for state in states])
                tractions = {k: _line_traction(assembly, name, increments[k]) for k in wanted}
                found[name] = _evaluate(evaluator, loads, travels, tractions, flow, everywhere=scene.output.stress)
    both = {name: comm.bcast(found.get(name), root=owner(comm, name)) for name in ("axle", "wheel")}
    return Stresses(
        extremes={name: part.extreme for name, part in both.items() if part.extreme is not None},
        residual={name: part.last for name, part in both.items() if part.last is not None and scene.motion.release},
        fields={travels[k]: {name: part.fields[k] for name, part in both.items()} for k in wanted},
        reactions={name: part.reactions for name, part in both.items()},
        flowed={name: part.zone for name, part in both.items() if part.zone and part.yields},
        beyond_yield={name: part.zone for name, part in both.items() if part.zone and not part.yields},
    )


def _fields_at(scene: Scene, travels: Sequence[float]) -> list[int]:
    """Numbers of the increments whose fields are wanted: nearest to output.fields_at, and output.frames more."""
    if not scene.output.fields or not travels:
        return []
    asked = scene.output.fields_at
    numbers = {len(travels) - 1} if asked is None else {int(np.abs(np.array(travels) - u).argmin()) for u in asked}
    cold = min(scene.motion.cooling, len(travels) - 1)  # of a wheel that cools in place, the fit when it is cold
    numbers = {max(number, cold) for number in numbers}
    numbers |= {int(k) for k in np.linspace(0, len(travels) - 1, min(scene.output.frames, len(travels))).round()}
    return sorted(numbers)


@dataclass(frozen=True, kw_only=True)
class _BodyStresses:
    extreme: Extreme | None
    last: Extreme | None
    fields: dict[int, BodyField]
    reactions: FloatArray
    zone: YieldZone | None
    yields: bool


def _evaluate(
    evaluator: StressEvaluator,
    loads: Sequence[FloatArray],
    travels: Sequence[float],
    tractions: dict[int, FloatArray],
    flow: FlowHistory | None,
    *,
    everywhere: bool,
) -> _BodyStresses:
    body = evaluator.body
    flowed = [False] * len(loads) if flow is None else flow.any
    loaded = [k for k, load in enumerate(loads) if load.any() or flowed[k]]  # where none is, nothing is displaced
    reactions = np.zeros(len(loads))
    reactions[loaded] = np.nan
    fields: dict[int, BodyField] = {}
    best: Extreme | None = None
    last: Extreme | None = None
    stated = yield_stress(body.material)
    beyond = np.zeros(len(evaluator.places), dtype=bool)
    numbers = sorted({*tractions, *(loaded if everywhere else ())}) or [0]
    for start in range(0, len(numbers), _BATCH):
        batch = numbers[start : start + _BATCH]
        forces = np.stack([loads[k] for k in batch], axis=1)
        displacement = body.back_substitute(forces)
        inner = None
        states: list[PointState] = []
        if flow is not None:
            states = flow.at(batch)
            inner = flow.loads(states)
            moved = [at for at, k in enumerate(batch) if flowed[k]]
            if moved:
                displacement[:, moved] += body.solve(inner[:, moved])
        reactions[batch] = body.reaction(displacement, forces, inner)
        stress = evaluator.stress(displacement)
        if flow is not None:
            stress -= flow.stresses(states)
        if everywhere:
            equivalent = von_mises(stress)
            best = _larger(best, evaluator, equivalent, [travels[k] for k in batch])
            if batch[-1] == len(loads) - 1:
                last = _larger(None, evaluator, equivalent[:, -1:], travels[-1:])
            if flow is None and stated is not None:
                beyond |= (equivalent > stated).any(axis=1)
        for k in set(batch) & set(tractions):
            at = batch.index(k)
            own = states[at] if states else None
            fields[k] = _field(evaluator, displacement[:, at], stress[:, :, at], tractions[k], flow, own, travels[k])
    return _BodyStresses(
        extreme=best,
        last=last,
        fields=fields,
        reactions=reactions,
        zone=_zone(evaluator, best, beyond, stated)
        if flow is None
        else _flow_zone(evaluator, flow.at([len(loads) - 1])[0].accumulated, travels[-1]),
        yields=flow is not None,
    )


def _line_traction(assembly: Assembly, name: str, record: Increment) -> FloatArray:
    """Traction (t_r, t_z) [MPa] in the middle of each facet of a body's contact line, (facets, 2).

    The bore has the opposite of what the seat has at the same place, linear between the middles of the seat's facets.
    """
    seat, pressure, shear = assembly.seat.line, record.facets.pressure, record.facets.traction
    normals = seat.normals
    if name == "wheel":
        bore = assembly.wheel.line
        moved = record.displacement if bore.radial else 0.0
        place, there = (0.5 * (line.coordinate[1:] + line.coordinate[:-1]) for line in (bore, seat))
        pressure, shear = (np.interp(place + moved, there, each, left=0.0, right=0.0) for each in (pressure, shear))
        normals = -bore.normals
    n_r, n_z = normals.T
    on_axle = np.stack([-pressure * n_r - shear * n_z, -pressure * n_z + shear * n_r], axis=1)
    return np.asarray(on_axle if name == "axle" else -on_axle)


def _larger(
    best: Extreme | None, evaluator: StressEvaluator, equivalent: FloatArray, travels: Sequence[float]
) -> Extreme:
    point, column = np.unravel_index(int(equivalent.argmax()), equivalent.shape)
    value = float(equivalent[point, column])
    if best is not None and best.value >= value:
        return best
    r, z = evaluator.places[point]
    travel = travels[int(column)]
    return Extreme(value, float(r), float(z) + (travel if evaluator.body.which == "wheel" else 0.0), travel)


def _zone(
    evaluator: StressEvaluator, best: Extreme | None, beyond: BoolArray, stated: float | None
) -> YieldZone | None:
    """Where an elastic body was beyond the yield stress it states [MPa], at any time; None where nowhere."""
    if best is None or stated is None or not beyond.any():
        return None
    depth, area = evaluator.extent(beyond)
    return YieldZone(value=best.value / stated, r_mm=best.r_mm, z_mm=best.z_mm, depth_mm=depth, area_mm2=area)


def _flow_zone(evaluator: StressEvaluator, accumulated: FloatArray, travel: float) -> YieldZone:
    """Where a body flowed, from the accumulated plastic strain at its points at the end."""
    depth, area = evaluator.extent(accumulated > 0.0)
    top = int(accumulated.argmax())
    r, z = evaluator.places[top]
    moved = travel if evaluator.body.which == "wheel" else 0.0
    return YieldZone(value=float(accumulated[top]), r_mm=float(r), z_mm=float(z) + moved, depth_mm=depth, area_mm2=area)


def _field(
    evaluator: StressEvaluator,
    displacement: FloatArray,
    stress: FloatArray,
    traction: FloatArray,
    flow: FlowHistory | None,
    plastic: PointState | None,
    travel: float,
) -> BodyField:
    """The fields of a body; ``plastic`` is what its points remember."""
    body, patches = evaluator.body, evaluator.patches
    recovered, on_line = patches.recover(stress, traction), body.trace[: len(body.line.nodes)]
    recovered[on_line] = elastic = surface_stress(body, displacement, traction)
    if flow is not None and plastic is not None:
        flowed = np.flatnonzero(flow.surface.flowed(plastic.accumulated, elastic))
        recovered[on_line[flowed]] = flow.surface.stress(flowed, stress, plastic, traction)
    points = body.space.nodes + np.array([0.0, travel if body.which == "wheel" else 0.0])
    return BodyField(
        points=points,
        cells=body.space.cells,
        displacement=displacement.reshape(-1, 2),
        stress=recovered,
        von_mises=von_mises(recovered.T),
        plastic_strain=None if plastic is None else _recovered_plastic(evaluator, plastic.accumulated),
    )


def _recovered_plastic(evaluator: StressEvaluator, plastic: FloatArray) -> FloatArray:
    """Accumulated plastic strain at the nodes: never below 0, as straight lines through the points would be."""
    return np.asarray(np.maximum(evaluator.patches.recover(np.stack([plastic] * 4))[:, 0], 0.0))
