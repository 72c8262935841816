"""A service computation with its folder: pressed on, released, bent, turned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec
from mpi4py import MPI

from ..assembly import Assembly, discretise_bodies
from ..base.arrays import FloatArray
from ..base.progress import Paced
from ..base.ranks import raise_together
from ..bodies.body import Body
from ..errors import MacrofitError, OutputError
from ..friction import GivenFriction
from ..monitor import lines_of_first
from ..scene import Scene
from ..solution import Journal
from .bonded import Bonded, Harmonic, bonded_solution, in_bending, one_harmonic
from .fatigue.limits import limits_of
from .harmonics import HarmonicBody
from .helpers import Helpers, help_first
from .history import Endurance, Fretting, endurance, fretting, slip_left, stress_histories
from .journal import Kept, KeptRotation, open_folder
from .kernel import Kernel
from .output.write import write_service
from .residual import Residual, pressed_and_released, restored
from .rotation import Moment, Revolution, check_grip
from .wheelset import Wheelset, in_harmonics, service_keys, touching, wheelset, with_service


@dataclass(frozen=True, kw_only=True)
class Turned:
    """What the rotation told."""

    revolutions: list[Revolution]
    angles: int
    fretting: Fretting
    endurance: Endurance
    friction: FloatArray  # (m,) coefficients
    plastic_strain: float  # largest, of the press
    doubts: tuple[str, ...] = ()  # about the friction of the press


@dataclass(frozen=True, kw_only=True)
class Service:
    """A wheelset in service; ``turned`` is None where no revolution is whole, as in the bonded solution."""

    whole: Wheelset
    bonded: Bonded
    turned: Turned | None
    moments: list[Moment]  # of the last revolution, or of what there is of the first
    ended: str | None = None  # why it ended early


def pressed(scene: Scene) -> Scene:
    """What the press of a scene depends on: all but the loads."""
    return msgspec.structs.replace(scene, service=None)


class Shared:
    """What computations of the same bodies have in common: factors, and the released fit where only loads differ."""

    def __init__(
        self,
        assembly_of: Callable[[Scene], Assembly] | None = None,
        make: Callable[[Body, str], HarmonicBody] = in_harmonics,
    ) -> None:
        """How the assembly of a scene is had, where it is kept, and how a body in harmonics is made."""
        self._assembly_of, self._make = assembly_of, make
        self._revolved: dict[str, tuple[Body, HarmonicBody]] = {}
        self._last: tuple[Scene, Residual, Mapping[str, Body]] | None = None

    def released(
        self, scene: Scene, friction: GivenFriction | None, journal: Journal | None, tell: Callable[[str], None]
    ) -> tuple[Residual, Mapping[str, Body]]:
        """The fit after the press, see `pressed_and_released`; the last one where all but the loads is the same.

        Raises:
            MacrofitError: see `pressed_and_released`.
        """
        if self._assembly_of is None:
            return pressed_and_released(scene, friction, journal, tell=tell)
        without_loads = pressed(scene)
        if self._last is None or self._last[0] != without_loads:
            found = pressed_and_released(scene, friction, journal, self._assembly_of(scene), tell)
            self._last = without_loads, *found
        return self._last[1:]

    def revolved(self, body: Body, name: str) -> HarmonicBody:
        """The axle or the wheel in harmonics, with the factors that it has already."""
        if name not in self._revolved or self._revolved[name][0] is not body:
            self._revolved[name] = body, self._make(body, name)
        return self._revolved[name][1]


class Course:
    """A service computation on its way; what it has can be judged at any time."""

    def __init__(self, scene: Scene, say: Callable[[str], None], kept: Kept, shared: Shared | None = None) -> None:
        self.scene, self._say, self._kept = scene, say, kept
        self._shared, self._tell = shared or Shared(), Paced(say)
        self._begun: tuple[Wheelset, list[Harmonic], Residual] | None = None
        self._rotation: KeptRotation | None = None
        self._revolutions: list[Revolution] = []

    @property
    def rotation(self) -> KeptRotation | None:
        """The fit as it turns, which can be turned on; None before the wheel is released."""
        return self._rotation

    def carry_out(self, friction: GivenFriction | None = None) -> Service:
        """Press, release and turn, see `serve`.

        Raises:
            MacrofitError: see `serve`.
        """
        limits_of(service_keys(self.scene), self.scene.axle.material)
        residual, bodies = self._released(friction)
        self._say(f"Released        at {residual.displacement:.6g} mm, after {residual.force / 1e3:.5g} kN")
        whole, found = _with_harmonics(self.scene, residual, bodies, self._shared)
        self._begun = whole, found, residual
        self._turn(whole, found, residual)
        done = self.so_far()
        assert done is not None
        return done

    def _released(self, friction: GivenFriction | None) -> tuple[Residual, Mapping[str, Body]]:
        held = self._kept.next()
        if held is not None:
            bodies = discretise_bodies(self.scene, MPI.COMM_SELF)
            return restored(*held, bodies), bodies
        residual, found = self._shared.released(self.scene, friction, self._kept.press, self._tell)
        self._kept.append(residual.scalars, residual.arrays)
        return residual, found

    def _turn(self, whole: Wheelset, found: list[Harmonic], residual: Residual) -> None:
        keys, chosen = whole.loads.keys, whole.fit.chosen
        start = (residual.traction[:, chosen], residual.gap[chosen], residual.friction[chosen])
        self._rotation = rotation = KeptRotation(Kernel(whole.fit, found), *start, keys.steps, kept=self._kept)
        rotation.tell = self._tell
        check_grip(rotation, whole.loads)
        here = rotation.loaded()
        for count in range(1, keys.revolutions + 1):
            self._revolutions.append(rotation.revolve(here))
            here = self._revolutions[-1].moments[-1]
            left = slip_left(self._revolutions[-1])
            work = f"friction work {1e-3 * self._revolutions[-1].friction_work:.5g} J"
            told = "no place stays in contact all around" if left is None else f"it leaves {max(left):.1e} of the slip"
            self._say(f"Revolution {count:<4} {work}; {told}")
            if left is not None and max(left) < keys.periodicity:
                break

    def so_far(self, ended: str | None = None) -> Service | None:
        """What there is of it, which ``ended`` early for this reason; None before the wheel is released."""
        if self._begun is None:
            return None
        whole, found, residual = self._begun
        turned = None
        if self._rotation is not None and self._revolutions:
            turned = _turned(whole, found, residual, self._rotation, self._revolutions)
        moments = [] if self._rotation is None else list(self._rotation.moments)
        bonded = in_bending(whole, dict(enumerate(found)))
        return Service(whole=whole, bonded=bonded, turned=turned, moments=moments, ended=ended)


def serve(
    scene: Scene, say: Callable[[str], None] = lambda _: None, *, friction: GivenFriction | None = None
) -> Service:
    """Press the wheel of a scene on, release it, and turn it under its loads with friction.

    Args:
        scene: the wheelset, its press and its loads.
        say: told of the release and of every revolution.
        friction: an object in place of the scene's [friction], see `solve`.

    Raises:
        SceneError: nothing can bend.
        ConvergenceError: the press, or nothing holds the wheel: it slides or lifts off in service.
    """
    return Course(scene, say, Kept()).carry_out(friction)


def _with_harmonics(
    scene: Scene, residual: Residual, bodies: Mapping[str, Body], shared: Shared
) -> tuple[Wheelset, list[Harmonic]]:
    pressed = wheelset(scene, bodies, residual.displacement, residual.coupling, shared.revolved)
    whole = touching(pressed, residual.gap)
    return whole, [one_harmonic(whole, n) for n in range(whole.loads.keys.harmonics + 1)]


def _turned(
    whole: Wheelset, found: list[Harmonic], residual: Residual, rotation: KeptRotation, revolutions: list[Revolution]
) -> Turned:
    wear = fretting(whole, revolutions[-1])
    stress = stress_histories(whole, rotation.kernel, found, residual, revolutions[-1])
    return Turned(
        revolutions=revolutions,
        angles=rotation.kernel.angles,
        fretting=wear,
        endurance=endurance(whole, stress, wear),
        friction=rotation.friction,
        plastic_strain=residual.plastic_strain,
        doubts=residual.doubts,
    )


def bonded_only(scene: Scene) -> Service:
    """The bonded solution of a scene, its wheel at the last displacement of the motion, without a press.

    Raises:
        SceneError: nothing can bend, or the wheel is not on its seat.
    """
    whole = wheelset(scene, discretise_bodies(scene, MPI.COMM_SELF))
    return Service(whole=whole, bonded=bonded_solution(whole), turned=None, moments=[])


def carry_out_service(
    scene: Scene, comm: MPI.Comm, folder: Path, *, bonded: bool, quiet: bool, resume: bool = False
) -> list[str]:
    """Compute, write into ``folder``, and give the lines for people; what ends early leaves there what it has.

    Collective: other ranks condense harmonics for the first, which computes and writes; they give no lines.

    Raises:
        MacrofitError: the scene, the press or the rotation.
    """
    if bonded and resume:
        raise OutputError("--resume: a bonded solution has no steps to go on from; leave it out")
    lines: list[str] = []
    scene = with_service(scene)
    with raise_together(comm):
        if comm.rank > 0:
            if not bonded:
                help_first(comm, scene)
        elif bonded or comm.size == 1:
            lines = _carried_out(scene, comm, folder, Shared(), bonded=bonded, quiet=quiet, resume=resume)
        else:
            with Helpers(comm, scene) as helpers:
                shared = Shared(make=helpers.revolved)
                lines = _carried_out(scene, comm, folder, shared, bonded=bonded, quiet=quiet, resume=resume)
    return lines


def _carried_out(
    scene: Scene, comm: MPI.Comm, folder: Path, shared: Shared, *, bonded: bool, quiet: bool, resume: bool
) -> list[str]:
    with open_folder(folder, scene, resume=resume) as kept:
        if bonded:
            lines = write_service(folder, bonded_only(scene))
        else:
            course = Course(scene, lines_of_first(comm, quiet=quiet), kept, shared)
            try:
                found = course.carry_out()
            except (MacrofitError, KeyboardInterrupt) as error:
                raise _with_what_was_had(course, folder, error) from None
            lines = write_service(folder, found)
    return [*lines, f"Files           {folder}"]


def _with_what_was_had(
    course: Course, folder: Path, error: MacrofitError | KeyboardInterrupt
) -> MacrofitError | KeyboardInterrupt:
    """Write what an error or a signal left; gives the error, which says where. A second failure must not hide it."""
    with suppress(MacrofitError):
        found = course.so_far(str(error) or "interrupted")
        if found is not None:
            write_service(folder, found)
            if isinstance(error, MacrofitError):
                return type(error)(f"{error}; what was computed until then is in {folder}")
    return error
