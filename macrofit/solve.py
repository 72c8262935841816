"""solve(scene) -> Solution: the whole method, in the order of its steps. The file to read first."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from .assembly import Assembly, assemble, friction_field, yielding_of
from .base.arrays import FloatArray
from .base.foreign import foreign_code
from .base.ranks import raise_together
from .bodies.approach import check_approach
from .bodies.outlook import overlap
from .friction import FacingPairs, FrictionField, GivenFriction, Outside, ScriptFriction, outside_range
from .monitor import Monitor, Silent
from .parallel import joined, summed
from .press import Press
from .results.agreement import agree
from .scene import Scene, with_script_friction
from .solution import Increment, Journal, Solution, energy_balance, force_balance
from .state import State
from .stress import Stresses, evaluate_stresses


def solve(
    scene: Scene,
    comm: MPI.Comm | None = None,
    monitor: Monitor | None = None,
    journal: Journal | None = None,
    assembly: Assembly | None = None,
    *,
    friction: GivenFriction | None = None,
) -> Solution:
    """Press the wheel of a scene onto its axle. Collective.

    1. each body is meshed, assembled, factored and condensed on its contact line, on a rank of its own;
    2. every rank steps through the same small interface problems, increment by increment;
    3. the stresses follow from the accepted interface loads, in batches, where the bodies are.

    Args:
        scene: what is pressed, how, and what is asked for.
        comm: the ranks that share the work; all by default.
        monitor: told of every accepted increment.
        journal: keeps the increments (rank 0) and gives back those of an interrupted run.
        assembly: of the same bodies on the same ranks (see `assemble`), in place of step 1: scenes that differ in
            friction, motion and output alone share it, with the same bits.
        friction: an object in place of the scene's [friction]: a provider, options with `build(context)`, or what
            makes one of them; checked and shared as an installed one. With a journal it must state a `digest`.

    Raises:
        SceneError: another assembly's bodies or ranks; bodies never meet, or where they must not; ranks differ.
        MeshError: a body cannot be meshed, supported or held in memory.
        ProviderError: friction cannot be had, or is another than the journal's.
        ConvergenceError: no cutback helps. Every error is raised on all ranks together.
    """
    comm = MPI.COMM_WORLD if comm is None else comm
    monitor = Silent() if monitor is None else monitor
    going = steps(scene, comm, monitor, journal, assembly, friction)
    while True:
        try:
            next(going)
        except StopIteration as end:
            solution: Solution = end.value
            return solution


def steps(
    scene: Scene,
    comm: MPI.Comm,
    monitor: Monitor,
    journal: Journal | None,
    assembly: Assembly | None,
    friction: GivenFriction | None,
    *,
    pressed: Callable[..., Press] = Press,
) -> Generator[None, None, Solution]:
    """The steps of `solve`, which pauses before every increment: several runs may take turns (see `lockstep`)."""
    scene, script = _with_friction(scene, friction, journal, comm)
    agree(comm, [scene])
    clock = [time.process_time()]

    before = {} if assembly is None else assembly.work()
    assembly = assemble(scene, comm) if assembly is None else assembly.checked(scene, comm)
    seat, wheel, engine = assembly.seat, assembly.wheel, assembly.engine
    check_approach(scene, seat.line.side, wheel.line.side)
    field = friction_field(scene, comm, seat, wheel, script)
    press = pressed(scene, seat, wheel.line, engine, field, yielding_of(scene, assembly))
    engaged = engine.factorisations
    clock.append(time.process_time())

    monitor.started(scene, len(scene.displacements) + scene.motion.release, assembly.dofs)
    increments, states = yield from advance(press, comm, monitor, journal)
    clock.append(time.process_time())

    stresses = evaluate_stresses(scene, assembly, states, increments)
    clock.append(time.process_time())
    monitor.finished()

    counters = {
        "interface_factorisations": engine.factorisations - engaged,
        **_counters(increments, assembly.work(), before, field), **summed(comm, _counted(field, comm)),
    }  # fmt: skip
    outside = doubted_pairs(press, increments, comm)
    return _solution(press, assembly, increments, stresses, clock, counters, outside)


def doubted_pairs(press: Press, increments: Sequence[Increment], comm: MPI.Comm) -> tuple[Outside, ...]:
    """The pairs of tiles for which the provider of friction says that it may be wrong, and what they carry. Collective.

    They are asked about with the pressure that they had, not with that of the increment before.
    """

    def moment(number: int) -> tuple[FacingPairs, FloatArray, FloatArray]:
        record = increments[number]
        facing = press.tiling.facing(press.seat.line.coordinate, record.displacement)
        return FacingPairs.of(facing), record.facets.pressure, record.facets.accumulated_slip

    forces = np.array([record.normal_force for record in increments])
    return outside_range(press.friction, forces, moment, lambda told, count: joined(comm, told, count))


def _with_friction(
    scene: Scene, friction: GivenFriction | None, journal: Journal | None, comm: MPI.Comm
) -> tuple[Scene, ScriptFriction | None]:
    """The scene, naming the object that a script gives as friction, and that object."""
    if friction is None:
        return scene, None
    script = ScriptFriction(friction)
    with raise_together(comm):
        if journal is not None:
            script.required_digest()
    return with_script_friction(scene, script), script


def _counted(field: FrictionField, comm: MPI.Comm) -> dict[str, int]:
    """What the provider counts on this rank."""
    with raise_together(comm), foreign_code():
        return field.counters
    return {}


def _counters(
    increments: list[Increment], work: dict[str, int], before: dict[str, int], field: FrictionField
) -> dict[str, int]:
    done = {name: count - before.get(name, 0) for name, count in work.items()}
    return {
        **done,
        "newton_iterations": sum(record.newton_iterations for record in increments),
        "right_hand_sides": done["back_substitutions"],  # condensing takes none, a Schur complement instead
        "provider_calls": field.calls,
        "pairs_asked": field.pairs_asked,
    }


def _solution(
    press: Press,
    assembly: Assembly,
    increments: list[Increment],
    stresses: Stresses,
    clock: list[float],
    counters: dict[str, int],
    outside: tuple[Outside, ...],
) -> Solution:
    setup, stepping, stress = np.diff(clock).tolist()
    return Solution(
        scene=press.scene,
        seat=press.seat.line.coordinate,
        increments=tuple(increments),
        max_von_mises=stresses.extremes,
        fields=stresses.fields,
        force_balance=force_balance(increments, stresses.reactions),
        energy_balance=energy_balance(increments),
        dofs=assembly.dofs,
        setup_cpu_s=setup,
        increments_cpu_s=stepping,
        stress_cpu_s=stress,
        counters=counters,
        friction=press.pair_friction(),
        interference=deepest_overlap(press, increments) if press.scene.interference is None else None,
        bore_ends=press.tiling.bore_ends,
        flowed=stresses.flowed,
        beyond_yield=stresses.beyond_yield,
        residual=stresses.residual,
        outside=outside,
        origin=press.friction.origin,
    )


def deepest_overlap(press: Press, increments: list[Increment]) -> float:
    """How deep the undeformed bodies overlap at most over the increments [mm]; negative where they never do."""
    lines = press.seat.line.generatrix, press.bore.generatrix
    every = float(np.diff(press.seat.line.coordinate).min())
    radial = press.seat.line.radial
    depths = [overlap(*lines, record.displacement, every, radial=radial) for record in increments]
    return max(depths, default=-math.inf)


def advance(
    press: Press, comm: MPI.Comm, monitor: Monitor, journal: Journal | None
) -> Generator[None, None, tuple[list[Increment], list[State]]]:
    """Step through the scene's displacements, from the last one the journal holds; pause before each."""
    with raise_together(comm):
        kept = journal.records() if journal is not None and comm.rank == 0 else []
    kept = comm.bcast(kept)
    increments = [record for record, _ in kept]
    states = [State.restored(arrays) for _, arrays in kept]
    press.friction.recall(arrays for _, arrays in kept)
    accepted = press.increments(press.resumed(states), len(states))
    yield
    for record, state in accepted:
        with raise_together(comm):
            if journal is not None and comm.rank == 0:
                journal.append(record, state.arrays() | press.friction.news())
            monitor.increment(record)
        increments.append(record)
        states.append(replace(state, flow=None))
        yield
    return increments, states
