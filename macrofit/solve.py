"""solve(scene) -> Solution: the whole method, in the order of its steps. The file to read first."""

from __future__ import annotations

import time

import numpy as np
from mpi4py import MPI

from .assembly import Assembly, assemble, friction_field
from .base.ranks import raise_together
from .monitor import Monitor, Silent
from .parallel import summed
from .press import Press, State
from .scene import Scene
from .solution import Increment, Journal, Solution, energy_balance, force_balance
from .stress import evaluate_stresses


def solve(
    scene: Scene,
    comm: MPI.Comm | None = None,
    monitor: Monitor | None = None,
    journal: Journal | None = None,
    assembly: Assembly | None = None,
) -> Solution:
    """Press the wheel of a scene onto its axle. Collective over ``comm`` (default: all ranks).

    1. each body is meshed, assembled, factored and condensed on its contact line, on a rank of its own;
    2. every rank steps through the same small interface problems, increment by increment;
    3. the stresses follow from the accepted interface loads, in batches, where the bodies are.

    ``monitor`` is told of every accepted increment; ``journal`` (rank 0) keeps them and gives back those of an
    interrupted run. An ``assembly`` of the same bodies on the same ranks (see `assemble`) takes the place of step 1:
    scenes that differ in friction, motion and output alone share it, with the same bits.
    Raises SceneError, MeshError, ProviderError or ConvergenceError, on all ranks together.
    """
    comm = MPI.COMM_WORLD if comm is None else comm
    monitor = Silent() if monitor is None else monitor
    clock = [time.process_time()]

    factored = 0 if assembly is None else assembly.factorisations
    assembly = assemble(scene, comm) if assembly is None else assembly.checked(scene, comm)
    seat, wheel, engine = assembly.seat, assembly.wheel, assembly.engine
    friction = friction_field(scene, comm, seat, wheel)
    press, engaged = Press(scene, seat, wheel.line, engine, friction), engine.factorisations
    clock.append(time.process_time())

    monitor.started(scene, len(scene.displacements), assembly.dofs)
    increments, states = advance(press, comm, monitor, journal)
    clock.append(time.process_time())

    stresses = evaluate_stresses(scene, assembly, states)
    clock.append(time.process_time())
    monitor.finished()

    setup, stepping, stress = np.diff(clock).tolist()
    return Solution(
        scene=scene,
        seat=seat.line.coordinate,
        increments=tuple(increments),
        max_von_mises=stresses.extremes,
        fields=stresses.fields,
        force_balance=force_balance(increments, stresses.reactions),
        energy_balance=energy_balance(increments),
        dofs=assembly.dofs,
        setup_cpu_s=setup,
        increments_cpu_s=stepping,
        stress_cpu_s=stress,
        counters={
            "factorisations": assembly.factorisations - factored + stresses.factorisations,
            "interface_factorisations": engine.factorisations - engaged,
            "newton_iterations": sum(record.newton_iterations for record in increments),
            "right_hand_sides": stresses.back_substitutions,  # condensing takes none, a Schur complement instead
            "back_substitutions": stresses.back_substitutions,
            "provider_calls": friction.calls,
            "pairs_asked": friction.pairs_asked,
        }
        | summed(comm, friction.counters),
        friction=press.pair_friction(),
    )


def advance(
    press: Press, comm: MPI.Comm, monitor: Monitor, journal: Journal | None
) -> tuple[list[Increment], list[State]]:
    """Step through the scene's displacements, from the last one the journal holds."""
    with raise_together(comm):
        kept = journal.records() if journal is not None and comm.rank == 0 else []
    kept = comm.bcast(kept)
    increments = [record for record, _ in kept]
    states = [State.restored(arrays) for _, arrays in kept]
    press.friction.recall(arrays for _, arrays in kept)
    for record, state in press.increments(states[-1] if states else press.rest(), len(states)):
        arrays = state.arrays() | press.friction.news()
        with raise_together(comm):
            if journal is not None and comm.rank == 0:
                journal.append(record, arrays)
            monitor.increment(record)
        increments.append(record)
        states.append(state)
    return increments, states
