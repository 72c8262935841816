"""From a scene to what the increments need: the bodies on their ranks, condensed; the friction field; the engine."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mpi4py import MPI

from .base.files import cache_folder
from .base.ranks import raise_together
from .bodies.body import Body, CondensedBody
from .contact.condensed import Condensed
from .contact.seat import Seat
from .errors import SceneError
from .friction import BuildContext, FrictionField, ScriptFriction, build_provider
from .parallel import SharedAsk, owner, summed
from .plasticity.material import hardening
from .press import Engine
from .scene.checks import SOFTEST
from .scene.keys import Scene
from .solution import TILE, tiles

if TYPE_CHECKING:
    from .bodies.stress import StressEvaluator
    from .plasticity.body import PlasticBody
    from .plasticity.yielding import Yielding

BODY_KEYS = ("axle", "wheel", "mesh", "contact", "solver")
"""The tables and keys of a scene that the bodies and their contact lines depend on."""


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """Everything that depends on bodies, mesh and contact alone: made once, it serves every friction and motion."""

    scene: Scene
    comm: MPI.Comm
    bodies: dict[str, Body]  # those of this rank
    seat: Seat
    axle: CondensedBody
    wheel: CondensedBody
    engine: Engine
    evaluators: dict[str, StressEvaluator] = field(default_factory=dict)  # made when stresses are first asked for
    plastic: dict[str, PlasticBody] = field(default_factory=dict)  # made when steel may yield

    @property
    def dofs(self) -> int:
        """Unknowns of both bodies."""
        return self.axle.dofs + self.wheel.dofs

    def work(self) -> dict[str, int]:
        """Factorisations and right-hand sides of both bodies so far, each on its own rank. Collective."""
        own = [body for name, body in self.bodies.items() if owner(self.comm, name) == self.comm.rank]
        factorisations = sum(body.factorisations for body in own)
        sides = sum(body.back_substitutions for body in own)
        return summed(self.comm, {"factorisations": factorisations, "back_substitutions": sides})

    def serves(self, scene: Scene) -> bool:
        """Whether the scene has the same bodies, meshes, contact formulation and solver."""
        return all(getattr(scene, key) == getattr(self.scene, key) for key in BODY_KEYS)

    def checked(self, scene: Scene, comm: MPI.Comm) -> Assembly:
        """Itself, once it is seen to serve the scene on these ranks.

        Raises:
            SceneError: it was made for other bodies or ranks; the message names the tables.
        """
        others = [key for key in BODY_KEYS if getattr(scene, key) != getattr(self.scene, key)]
        if others:
            raise SceneError(
                f"{', '.join(others)}: differ from the scene that was assembled; only friction, motion, output and "
                f"title may change where an assembly is used again, otherwise assemble the new scene"
            )
        if comm != self.comm:
            raise SceneError("the assembly was made on another communicator; assemble the scene on this one")
        return self


def assemble(scene: Scene, comm: MPI.Comm) -> Assembly:
    """Mesh, factor and condense both bodies, each on a rank of its own. Collective.

    Raises:
        MeshError: a body cannot be meshed, supported or held in memory.
    """
    bodies = discretise_bodies(scene, comm)
    seat, axle, wheel = condense_bodies(scene, comm, bodies)
    return Assembly(
        scene=scene,
        comm=comm,
        bodies=bodies,
        seat=seat,
        axle=axle,
        wheel=wheel,
        engine=engine_of(scene, seat, axle, wheel, bodies),
    )


def discretise_bodies(scene: Scene, comm: MPI.Comm) -> dict[str, Body]:
    """The bodies this rank holds; the monolithic solver needs both on every rank. Collective.

    Raises:
        MeshError: a body cannot be meshed, supported or held in memory.
    """
    everywhere = scene.solver == "monolithic"
    bodies: dict[str, Body] = {}
    with raise_together(comm):
        for name in ("axle", "wheel"):
            if everywhere or owner(comm, name) == comm.rank:
                bodies[name] = Body(scene, name)
    return bodies


def condense_bodies(scene: Scene, comm: MPI.Comm, bodies: dict[str, Body]) -> tuple[Seat, CondensedBody, CondensedBody]:
    """The seat's operators and both bodies condensed on their contact lines, on every rank. Collective."""
    condensed: dict[str, CondensedBody] = {}
    seat = None
    with raise_together(comm):
        if "axle" in bodies:
            seat = Seat(bodies["axle"].line, scene.contact)
            bodies["axle"].stabilisation = seat.stabilisation
        for name, body in bodies.items():
            if owner(comm, name) == comm.rank:
                condensed[name] = body.condense(load_trace=name == "wheel" or bodies[name].stabilisation is not None)
    if comm.size > 1:  # alone, a broadcast would copy both compliances
        condensed = {name: comm.bcast(condensed.get(name), root=owner(comm, name)) for name in ("axle", "wheel")}
    axle, wheel = condensed["axle"], condensed["wheel"]
    return seat or Seat(axle.line, scene.contact), axle, wheel


def friction_field(
    scene: Scene, comm: MPI.Comm, seat: Seat, wheel: CondensedBody, script: ScriptFriction | None = None
) -> FrictionField:
    """The scene's provider, or a script's in place of it, asked through all ranks. Collective.

    Raises:
        ProviderError: it cannot be built, or breaks the contract.
    """
    material, folder = scene.axle.material, cache_folder()
    context = BuildContext(
        seat_tiles=tiles(seat.line.coordinate),
        bore_tiles=tiles(wheel.line.coordinate),
        tile_size=TILE,
        seat_origin=float(seat.line.coordinate[0]),
        youngs_modulus=material.youngs_modulus,
        poisson_ratio=material.poisson_ratio,
        cache_dir=None if folder is None else str(folder),
    )
    name, options = scene.friction.provider, scene.friction.options
    with raise_together(comm), warnings.catch_warnings():
        if comm.rank > 0:  # all are told the same, and the first one says it
            warnings.simplefilter("ignore")
        provider = build_provider(name, options, context) if script is None else script.build(options, context)
    stated = script is not None and script.digest is not None
    fingerprint = script.fingerprint(options) if script is not None and stated else ""
    ask = SharedAsk(comm, name)
    return FrictionField(provider, name, ask, part=ask.part, fingerprint=fingerprint)


def yielding_of(scene: Scene, assembly: Assembly) -> Yielding | None:
    """The bodies that may yield, each on its rank; None where none can, and nothing is made for it."""
    laws = {name: hardening(body.material) for name, body in (("axle", scene.axle), ("wheel", scene.wheel))}
    names = tuple(name for name, law in laws.items() if law is not None)
    if not names:
        return None
    from .plasticity.body import PlasticBody
    from .plasticity.yielding import Yielding

    for name in names:
        law = laws[name]
        if law is not None and name not in assembly.plastic and owner(assembly.comm, name) == assembly.comm.rank:
            assembly.plastic[name] = PlasticBody(assembly.bodies[name], law)
    unseen = tuple(
        name
        for name, law in laws.items()
        if law is not None and law.yield_stress < SOFTEST * getattr(scene, name).material.youngs_modulus
    )
    return Yielding(assembly.comm, assembly.plastic, names, unseen)


def engine_of(scene: Scene, seat: Seat, axle: CondensedBody, wheel: CondensedBody, bodies: dict[str, Body]) -> Engine:
    """The engine the scene names."""
    if scene.solver == "monolithic":
        from .contact.monolithic import Monolithic

        return Monolithic(seat, bodies["axle"], bodies["wheel"])
    return Condensed(seat, axle, wheel)
