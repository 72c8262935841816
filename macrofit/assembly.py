"""From a scene to what the increments need: the bodies on their ranks, condensed; the friction field; the engine."""

from __future__ import annotations

from mpi4py import MPI

from .body import Body, CondensedBody, compile_form
from .condensed import Condensed
from .files import cache_folder
from .friction import BuildContext, FrictionField, build
from .parallel import SharedAsk, raise_together
from .press import TILE, Engine, tiles
from .scene_keys import Scene
from .seat import Seat


def owner(comm: MPI.Comm, body: str) -> int:
    """The rank that holds a body: the axle on the first, the wheel on the second (one rank holds both)."""
    return 0 if body == "axle" else min(1, comm.size - 1)


def discretise_bodies(scene: Scene, comm: MPI.Comm) -> dict[str, Body]:
    """The bodies this rank holds; the monolithic solver needs both on every rank. Collective.

    Raises MeshError.
    """
    everywhere = scene.solver == "monolithic"
    bodies: dict[str, Body] = {}
    if comm.size > 1:  # two ranks must not compile the same form at once
        with raise_together(comm):
            if comm.rank == 0:
                compile_form(scene.mesh.order)
    with raise_together(comm):
        for name in ("axle", "wheel"):
            if everywhere or owner(comm, name) == comm.rank:
                bodies[name] = Body(scene, name)
    return bodies


def condense_bodies(scene: Scene, comm: MPI.Comm, bodies: dict[str, Body]) -> tuple[Seat, CondensedBody, CondensedBody]:
    """The seat's operators and both bodies condensed on their contact lines, on every rank. Collective."""
    condensed: dict[str, CondensedBody] = {}
    with raise_together(comm):
        if "axle" in bodies:
            bodies["axle"].stabilisation = Seat(bodies["axle"].line, scene.contact).stabilisation
        for name, body in bodies.items():
            if owner(comm, name) == comm.rank:
                condensed[name] = body.condense(load_trace=name == "wheel" or bodies[name].stabilisation is not None)
    axle, wheel = (comm.bcast(condensed.get(name), root=owner(comm, name)) for name in ("axle", "wheel"))
    return Seat(axle.line, scene.contact), axle, wheel


def friction_field(scene: Scene, comm: MPI.Comm, seat: Seat, wheel: CondensedBody) -> FrictionField:
    """The scene's provider, asked through all ranks. Raises ProviderError."""
    material = scene.axle.material
    context = BuildContext(
        seat_tiles=tiles(seat.line.coordinate),
        bore_tiles=tiles(wheel.line.coordinate),
        tile_size=TILE,
        youngs_modulus=material.youngs_modulus,
        poisson_ratio=material.poisson_ratio,
        cache_dir=cache_folder(),
    )
    name = scene.friction.provider
    with raise_together(comm):
        provider = build(name, scene.friction.options, context)
    return FrictionField(provider, name, SharedAsk(comm, name))


def engine_of(scene: Scene, seat: Seat, axle: CondensedBody, wheel: CondensedBody, bodies: dict[str, Body]) -> Engine:
    """The engine the scene names."""
    if scene.solver == "monolithic":
        from .monolithic import Monolithic

        return Monolithic(seat, bodies["axle"], bodies["wheel"])
    return Condensed(seat, axle, wheel)
