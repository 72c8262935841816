"""Small scenes for tests: the geometry of the shipped ones on coarse meshes."""

from __future__ import annotations

from mpi4py import MPI

from macrofit.assembly import condense_bodies, discretise_bodies, friction_field
from macrofit.body import Body
from macrofit.condensed import Condensed
from macrofit.press import Press
from macrofit.scene import Scene, load_scene

NO_FIELDS = ("output.stress=false", "output.fields_at=[]")


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


def condensed_press(scene: Scene, *, reuse: bool = True) -> tuple[Press, dict[str, Body]]:
    """The parts of solve() up to the first increment, on this rank alone."""
    bodies = discretise_bodies(scene, MPI.COMM_SELF)
    seat, axle, wheel = condense_bodies(scene, MPI.COMM_SELF, bodies)
    friction = friction_field(scene, MPI.COMM_SELF, seat, wheel)
    return Press(scene, seat, wheel.line, Condensed(seat, axle, wheel, reuse=reuse), friction), bodies
