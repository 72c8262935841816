"""A service computation with its folder: pressed on, released, bent, turned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..assembly import discretise_bodies
from ..base.arrays import FloatArray
from ..base.files import write_json, writing
from ..bodies.body import Body
from ..errors import SceneError
from ..friction import GivenFriction
from ..monitor import lines_of_first
from ..results.folder import prepare_for_all
from ..scene import Scene
from .bonded import Bonded, Harmonic, bonded_solution, in_bending, one_harmonic
from .history import Endurance, Fretting, endurance, fretting, limits_of, stress_histories
from .kernel import Kernel
from .output import FRETTING, NUMBERS, SEAT, fretting_columns, numbers, seat_columns, sentences, write_columns
from .residual import Residual, pressed_and_released
from .rotation import Revolution, Rotation
from .wheelset import Wheelset, service_keys, touching, wheelset

FIGURE = "service.png"


@dataclass(frozen=True, kw_only=True)
class Turned:
    """What the rotation told."""

    revolutions: list[Revolution]
    angles: int
    fretting: Fretting
    endurance: Endurance
    friction: FloatArray  # (m,) coefficients


@dataclass(frozen=True, kw_only=True)
class Service:
    """A wheelset in service; ``turned`` is None where it was taken as bonded."""

    whole: Wheelset
    bonded: Bonded
    turned: Turned | None


def serve(
    scene: Scene, say: Callable[[str], None] = lambda _: None, *, friction: GivenFriction | None = None
) -> Service:
    """Press the wheel of a scene on, release it, and turn it under its loads with friction.

    Args:
        scene: the wheelset, its press and its loads.
        say: told of the release and of every revolution.
        friction: an object in place of the scene's [friction], see `solve`.

    Raises:
        SceneError: nothing can bend, or nothing holds the wheel.
        ConvergenceError: the press, or the wheel slides or lifts off in service.
    """
    limits_of(service_keys(scene))
    residual, bodies = pressed_and_released(scene, friction)
    say(f"Released        at {residual.displacement:.6g} mm, after {residual.force / 1e3:.5g} kN")
    whole, found = _with_harmonics(scene, residual, bodies)
    return Service(
        whole=whole, bonded=in_bending(whole, dict(enumerate(found))), turned=_turned(whole, found, residual, say)
    )


def _with_harmonics(scene: Scene, residual: Residual, bodies: Mapping[str, Body]) -> tuple[Wheelset, list[Harmonic]]:
    pressed = wheelset(scene, bodies, residual.displacement, residual.coupling)
    whole = touching(pressed, residual.gap)
    return whole, [one_harmonic(whole, n) for n in range(whole.loads.keys.harmonics + 1)]


def _turned(whole: Wheelset, found: list[Harmonic], residual: Residual, say: Callable[[str], None]) -> Turned:
    kernel, chosen, keys = Kernel(whole.fit, found), whole.fit.chosen, whole.loads.keys
    friction = residual.friction[chosen]
    rotation = Rotation(kernel, residual.traction[:, chosen], residual.gap[chosen], friction, keys.steps)
    here, revolutions = rotation.loaded(), []
    for count in range(1, keys.revolutions + 1):
        revolutions.append(rotation.revolve(here))
        here = revolutions[-1].moments[-1]
        say(f"Revolution {count:<4} friction work {1e-3 * revolutions[-1].friction_work:.5g} J")
    wear = fretting(whole, revolutions[-1])
    stress = stress_histories(whole, kernel, found, residual, revolutions[-1])
    return Turned(
        revolutions=revolutions,
        angles=kernel.angles,
        fretting=wear,
        endurance=endurance(whole, stress, wear),
        friction=friction,
    )


def bonded_only(scene: Scene) -> Service:
    """The bonded solution of a scene, its wheel at the last displacement of the motion, without a press.

    Raises:
        SceneError: nothing can bend, or the wheel is not on its seat.
    """
    whole = wheelset(scene, discretise_bodies(scene, MPI.COMM_SELF))
    return Service(whole=whole, bonded=bonded_solution(whole), turned=None)


def carry_out_service(scene: Scene, comm: MPI.Comm, folder: Path, *, bonded: bool, quiet: bool) -> list[str]:
    """Compute, write into ``folder``, and give the lines for people.

    Raises:
        MacrofitError: the scene, the press or the rotation; or more than one rank.
    """
    if comm.size > 1:
        raise SceneError(f"service: works on one rank, and there are {comm.size}; leave mpirun out")
    prepare_for_all(comm, folder, NUMBERS)
    with writing(folder):
        for stale in (NUMBERS, SEAT, FRETTING, FIGURE):
            (folder / stale).unlink(missing_ok=True)
    write_json(folder / NUMBERS, {})  # the folder is a service's from here on, also where it ends early
    found = bonded_only(scene) if bonded else serve(scene, lines_of_first(comm, quiet=quiet))
    return [*write_service(folder, found), f"Files           {folder}"]


def write_service(folder: Path, found: Service) -> list[str]:
    """Write service.json, the tables and the figure; gives the lines for people.

    Raises:
        OutputError: a file cannot be written.
    """
    from .figures import write_figure

    told = numbers(found.whole, found.bonded, found.turned)
    write_columns(folder / SEAT, seat_columns(found.bonded, found.turned))
    if found.turned is not None:
        columns = fretting_columns(found.whole.fit, found.turned.fretting, found.turned.friction)
        write_columns(folder / FRETTING, {name: np.asarray(column) for name, column in columns.items()})
    write_figure(folder / FIGURE, found)
    write_json(folder / NUMBERS, told)
    return sentences(told)
