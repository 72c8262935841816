"""Small scenes for tests: the geometry of the shipped ones on coarse meshes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import msgspec
import numpy as np
from mpi4py import MPI

from macrofit.assembly import condense_bodies, discretise_bodies, friction_field
from macrofit.bodies.body import Body
from macrofit.contact.condensed import Condensed
from macrofit.press import Press
from macrofit.scene import Scene, build_scene, load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

_solved: dict[bytes, Solution] = {}

NO_FIELDS = ("output.stress=false", "output.fields_at=[]")
HARDENING = ("yield_stress=350", "hardening.law=linear", "hardening.kinematic=5000")
YIELDING = tuple(f"{body}.material.{key}" for body in ("axle", "wheel") for key in HARDENING)
"""Overrides: both bodies of a scene yield at 350 MPa and harden kinematically."""


def small_press(*overrides: str, fields: bool = False) -> Scene:
    """The wheelset on 5 mm facets, pressed from 15 to 60 mm in nine increments; about 0.2 s."""
    return load_scene(
        "wheelset",
        [
            "mesh.seat_facet=5.0",
            "mesh.bore_facet=4.7",
            "mesh.coarse=40",
            "motion.start=15",
            "motion.travel=60",
            "motion.increment=5",
            *(() if fields else NO_FIELDS),
            *overrides,
        ],
    )


def small_path(path: Sequence[float], *overrides: str, fields: bool = False) -> Scene:
    """The same wheelset along displacements [mm] that may turn."""
    scene = small_press(*overrides, fields=fields)
    motion = msgspec.structs.replace(scene.motion, displacements=tuple(path), start=0.0, travel=0.0, increment=1.0)
    return msgspec.structs.replace(scene, motion=motion)


def solved(scene: Scene) -> Solution:
    """The solution of a scene on this rank alone, computed once in a session; its arrays are read-only.

    For tests that look at a solution. One that changes the solver before, or writes into the solution, calls `solve`.
    """
    key = msgspec.json.encode(scene)
    if key not in _solved:
        _solved[key] = solve(scene, MPI.COMM_SELF)
        make_read_only(_solved[key])
    return _solved[key]


def make_read_only(record: object) -> None:
    """Lock the arrays in a record, however deep they are."""
    if isinstance(record, np.ndarray):
        record.flags.writeable = False
    elif dataclasses.is_dataclass(record):
        make_read_only([getattr(record, each.name) for each in dataclasses.fields(record)])
    elif isinstance(record, dict):
        make_read_only(list(record.values()))
    elif isinstance(record, list | tuple):
        for each in record:
            make_read_only(each)


def condensed_press(scene: Scene, *, reuse: bool = True) -> tuple[Press, dict[str, Body]]:
    """The parts of solve() up to the first increment, on this rank alone."""
    bodies = discretise_bodies(scene, MPI.COMM_SELF)
    seat, axle, wheel = condense_bodies(scene, MPI.COMM_SELF, bodies)
    friction = friction_field(scene, MPI.COMM_SELF, seat, wheel)
    return Press(scene, seat, wheel.line, Condensed(seat, axle, wheel, reuse=reuse), friction), bodies


def plain_shaft(provider: str = "uniform", *, back: tuple[float, ...] = (), **options: object) -> Scene:
    """A ring of 30 mm pushed from 35 to 50 mm along a cylinder, and ``back``; facets of 1 mm are tiles; 0.4 s."""
    tables = {
        "axle": {"seat_radius": 50.0, "seat_length": 60.0},
        "wheel": {"bore_radius": 49.99, "hub_length": 30.0, "hub_outer_radius": 80.0},
        "mesh": {"seat_facet": 1.0, "bore_facet": 1.3},
        "motion": {"displacements": [*(35.0 + 1.7 * k for k in range(9)), 50.0, *back]},
        "friction": {"provider": provider, "options": options},
        "output": {"stress": False, "fields_at": []},
    }
    return build_scene(tables)
