"""The tables of a scene as frozen records: every key, its default, its meaning, its unit and its bounds.

Lengths in mm, forces in N, moduli in MPa. What one key alone cannot say is in `checks`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

from ..base.keys import Keys, NotNegative, Positive, told
from .material import Material, expansion

Metal: TypeAlias = Annotated[Material, told("Elastic constants of the body.")]
Profile: TypeAlias = Annotated[
    str | None,
    told(
        "CSV of z [mm] and deviation of the radius [um] on top of what is drawn, looked for beside the scene; z = 0 at "
        "the end that goes on first: the seat's entrance, the bore's leading face."
    ),
]
Warmth: TypeAlias = Annotated[
    NotNegative, msgspec.Meta(le=600.0), told("How much warmer the whole wheel is than axle and surroundings [K].")
]

AXLE_TEMPERATURE = (
    "axle.temperature: the axle has that of the surroundings; wheel.temperature says how much warmer the wheel is than "
    "it, for an axle that is chilled too"
)
"""What is said where an axle is given a temperature."""


class Shaft(Keys, frozen=True, tag="shaft", tag_field="shape"):
    """An axle: lead, taper, seat and tail along z; the seat's entrance (end of the taper) is z = 0."""

    seat_radius: Annotated[Positive, told("Radius of the seat, at its entrance [mm].")]
    seat_length: Annotated[Positive, told("Length of the seat [mm].")]
    taper: Annotated[
        NotNegative,
        msgspec.Meta(le=1.0),
        told("Cone of the seat, growth of its diameter per length from its entrance on [mm/mm]; 0: a cylinder."),
    ] = 0.0
    taper_length: Annotated[
        NotNegative, told("Length of the taper before the seat, from seat_radius - taper_height to seat_radius [mm].")
    ] = 0.0
    taper_height: Annotated[NotNegative, told("Height of the taper, on the radius [mm].")] = 0.0
    taper_blend: Annotated[NotNegative, told("Radius of the arc between taper and seat [mm]; 0: a sharp corner.")] = 0.0
    lead_length: Annotated[NotNegative, told("Length of the cylinder before the taper [mm].")] = 0.0
    lead_radius: Annotated[
        Positive | None, told("Radius of the cylinder before the taper [mm]; left out: where the taper starts.")
    ] = None
    tail_length: Annotated[
        NotNegative, told("Length of the cylinder behind the seat, held axially at its far end [mm].")
    ] = 0.0
    tail_radius: Annotated[
        Positive | None, told("Radius of the cylinder behind the seat [mm]; left out: seat_radius, no shoulder.")
    ] = None
    tail_blend: Annotated[NotNegative, told("Fillet radius in the corner of the shoulder [mm].")] = 0.0
    inner_radius: Annotated[NotNegative, told("Radius of the hole along the axis [mm]; 0: a solid axle.")] = 0.0
    profile: Profile = None
    material: Metal = Material()


class Hub(Keys, frozen=True, tag="wheel", tag_field="shape"):
    """A wheel or, with web_thickness = 0, a plain ring; z is measured from its leading face, backwards."""

    bore_radius: Annotated[Positive, told("Radius of the bore, at the leading face [mm].")]
    hub_length: Annotated[Positive, told("Length of the hub [mm].")]
    hub_outer_radius: Annotated[Positive, told("Outer radius of the hub [mm].")]
    bore_taper: Annotated[
        NotNegative,
        msgspec.Meta(le=1.0),
        told("Cone of the bore, loss of its diameter per length from the leading face on [mm/mm]; 0: a cylinder."),
    ] = 0.0
    chamfer_length: Annotated[
        NotNegative,
        told("Length of the chamfer at the leading edge, from bore_radius + chamfer_height to bore_radius [mm]."),
    ] = 0.0
    chamfer_height: Annotated[NotNegative, told("Height of the chamfer, on the radius [mm].")] = 0.0
    chamfer_blend: Annotated[
        NotNegative, told("Radius of the arc between chamfer and bore [mm]; 0: a sharp corner.")
    ] = 0.0
    rear_edge_blend: Annotated[NotNegative, told("Radius of the bore's rear edge [mm]; 0: a sharp edge.")] = 0.0
    web_thickness: Annotated[NotNegative, told("Thickness of the web [mm]; 0: a plain ring without web and rim.")] = 0.0
    web_offset: Annotated[
        float,
        told("From the middle of the hub to the middle of web and rim, positive towards the leading face [mm]."),
    ] = 0.0
    web_blend: Annotated[NotNegative, told("Fillet radius where the web meets hub and rim [mm].")] = 0.0
    rim_inner_radius: Annotated[NotNegative, told("Inner radius of the rim [mm].")] = 0.0
    rim_outer_radius: Annotated[NotNegative, told("Outer radius of the rim [mm].")] = 0.0
    rim_width: Annotated[NotNegative, told("Width of the rim along the axis [mm].")] = 0.0
    profile: Profile = None
    temperature: Warmth = 0.0
    material: Metal = Material()


class Disc(Keys, frozen=True, tag="disc", tag_field="shape"):
    """A disc or spherical cap on the axis, pressed along z; as axle it is held, as wheel it is pushed."""

    radius: Annotated[Positive, told("Radius of the disc [mm].")]
    thickness: Annotated[Positive, told("Thickness of the disc on the axis [mm].")]
    crown_radius: Annotated[NotNegative, told("Sphere radius of the contact face [mm]; 0: flat.")] = 0.0
    contact_radius: Annotated[
        Positive | None, told("How far from the axis contact is looked for [mm]; left out: radius.")
    ] = None
    material: Metal = Material()


class MeshFile(Keys, frozen=True, tag="mesh", tag_field="shape"):
    """A body whose shape comes from a mesh file (see ``[mesh]``): what the file cannot say is left."""

    profile: Profile = None
    temperature: Warmth = 0.0
    material: Metal = Material()


class MeshKeys(Keys, frozen=True):
    """Element order and sizes, or the user's own mesh files."""

    order: Annotated[Literal[1, 2], told("Order of the elements [-].")] = 2
    seat_facet: Annotated[Positive, told("Length of a facet of the seat [mm].")] = 1.0
    bore_facet: Annotated[
        Positive | None,
        told(
            "Length of a facet of the bore [mm]; left out: 0.97 seat_facet, so that the lines never repeat their phase."
        ),
    ] = None
    corner_facet: Annotated[
        Positive | None,
        told("Length of a facet in the arcs of the seat (blends, crowns) [mm], 0.97 of it in the bore's."),
    ] = None
    coarse: Annotated[Positive, told("Largest element [mm].")] = 20.0
    growth: Annotated[
        NotNegative, told("Growth of the element size with the distance from the contact line [mm/mm].")
    ] = 0.35
    axle: Annotated[str | None, told("Mesh file of the axle, looked for beside the scene.")] = None
    wheel: Annotated[str | None, told("Mesh file of the wheel, looked for beside the scene.")] = None
    unit: Annotated[
        Literal["mm", "cm", "m", "in"] | None,
        told("Unit of length of the mesh files; left out: mm, and a body below 1 mm is taken for a mistake."),
    ] = None


class ContactKeys(Keys, frozen=True):
    """How the contact conditions are imposed (see ``macrofit.contact.law``)."""

    formulation: Annotated[
        Literal["nitsche", "penalty"], told("Nitsche's method, consistent with the bulk stress, or penalty.")
    ] = "nitsche"
    theta: Annotated[Literal[-1, 0, 1], told("Variant of Nitsche's method: 1 is symmetric [-].")] = 0
    gamma0: Annotated[
        Annotated[float, msgspec.Meta(ge=0.01)] | None,
        told("gamma = gamma0 E / h of Nitsche's method [-]; left out: 10, and 30 for theta = 1, coercive only then."),
    ] = None
    penalty_stiffness: Annotated[
        Positive | None, told("Stiffness of the penalty method [MPa/mm]; left out: 10 E per mm.")
    ] = None
    direction: Annotated[
        Literal["radial", "axial"] | None, told("Direction of the gap; left out: by the shapes of the bodies.")
    ] = None
    allow_no_contact: Annotated[
        bool,
        told("Whether bodies from files may never meet, or overlap where no contact is looked for; otherwise refused."),
    ] = False


class Motion(Keys, frozen=True):
    """Displacements of the wheel, 0 where its leading face is at the seat's entrance."""

    start: Annotated[
        float,
        told(
            "First displacement [mm]; where the bodies overlap there, it is shrunk on in place, without friction "
            "and free along the axis: the first force is 0."
        ),
    ] = 0.0
    travel: Annotated[float, told("Final displacement [mm].")] = 0.0
    increment: Annotated[Positive, told("Displacement from one increment to the next [mm].")] = 1.0
    displacements: Annotated[
        Annotated[tuple[float, ...], msgspec.Meta(min_length=1)] | None,
        told("All displacements, which may reverse, instead of start, travel and increment [mm]."),
    ] = None
    cooling: Annotated[
        int,
        msgspec.Meta(ge=0, le=10000),
        told(
            "In how many increments a wheel that is put on hot cools, where the motion starts and with nothing that "
            "pushes; 0: it keeps its temperature [-]."
        ),
    ] = 0
    release: Annotated[
        bool, told("Whether the press lets go at the end: the wheel moves back until no force is left.")
    ] = False
    max_cutbacks: Annotated[
        int, msgspec.Meta(ge=0), told("How often an increment may be halved where Newton's method fails [-].")
    ] = 8


class FrictionKeys(Keys, frozen=True):
    """The friction provider by its entry-point name, and its options."""

    provider: Annotated[str, told("Name of the friction provider, see `macrofit providers`.")] = "uniform"
    options: Annotated[dict[str, Any], told("Options of the provider, with its own keys and units.")] = msgspec.field(
        default_factory=dict
    )


class OutputKeys(Keys, frozen=True):
    """What is computed and written beyond the fitting curve."""

    stress: Annotated[bool, told("Whether the largest von Mises stress of each body over the run is computed.")] = True
    fields_at: Annotated[
        tuple[float, ...] | None, told("Displacements whose fields are written [mm]; left out: the last one.")
    ] = None
    fields: Annotated[
        tuple[Literal["displacement", "von_mises", "stress"], ...],
        told("Fields that are written: displacement [mm], von_mises [MPa], stress [MPa]."),
    ] = ("displacement", "von_mises")
    frames: Annotated[
        int, msgspec.Meta(ge=0), told("That many more displacements, evenly spaced, for an animation [-].")
    ] = 0


class ServiceKeys(Keys, frozen=True):
    """Loads of the pressed wheelset in rotating bending, for `macrofit service`."""

    journal_force: Annotated[
        NotNegative, told("Force P of the journal downwards, and of the rail on the wheel upwards [N].")
    ] = 110e3
    journal_moment: Annotated[
        NotNegative, told("Bending moment at the front end of the drawn axle: P times the way to the journal [N mm].")
    ] = 6e7
    lateral_force: Annotated[
        float, told("Force of the rail on the wheel along the axle, positive towards the held end [N].")
    ] = 0.0
    torque: Annotated[float, told("Torque around the rim of the wheel, carried by the held end [N mm].")] = 0.0
    rim_offset: Annotated[
        float, told("Where the wheel stands on the rail, from the middle of its rim, positive towards the front [mm].")
    ] = 0.0
    harmonics: Annotated[
        int, msgspec.Meta(ge=1, le=20), told("Highest harmonic H of the rotation; there are 2 H + 1 angles [-].")
    ] = 4
    steps: Annotated[
        int, msgspec.Meta(ge=3, le=10000), told("Least steps of a revolution, rounded up to a multiple of 2 H + 1 [-].")
    ] = 63
    revolutions: Annotated[
        int,
        msgspec.Meta(ge=1, le=100),
        told("Revolutions that are followed at most, behind the one in which the loads come up [-]."),
    ] = 3
    periodicity: Annotated[
        float,
        msgspec.Meta(ge=0.0, lt=1.0),
        told("Slip that a revolution may leave, in its largest range, to be the last one [-]; 0: all are followed."),
    ] = 0.0
    bending_limit: Annotated[
        Positive | None,
        told(
            "What the axle's steel bears for ever in reversed bending, without fretting [MPa]; left out: of its grade, "
            "or 200."
        ),
    ] = None
    torsion_limit: Annotated[
        Positive | None,
        told("The same in reversed torsion, above 1/2 and below 1 of bending_limit [MPa]; left out: 0.6 of it."),
    ] = None
    seat_limit: Annotated[
        Positive | None,
        told(
            "Nominal bending stress that a seat under a wheel bears for ever, fretting included [MPa]; left out: of "
            "the axle's grade."
        ),
    ] = None
    safety: Annotated[
        Annotated[float, msgspec.Meta(ge=1.0)] | None,
        told("Security factor by which seat_limit is divided [-]; left out: of the axle's grade, or 1."),
    ] = None


class Scene(Keys, frozen=True):
    """Everything that determines a run."""

    axle: Annotated[Shaft | Disc | MeshFile, told("The body that is held.")]
    wheel: Annotated[Hub | Disc | MeshFile, told("The body that is pushed.")]
    motion: Annotated[Motion, told("Displacements of the wheel.")]
    title: Annotated[str, told("What figures and lists call the scene.")] = ""
    solver: Annotated[
        Literal["condensed", "monolithic"],
        told("Interface problem condensed on the contact line, or both bodies and the contact in one system."),
    ] = "condensed"
    mesh: Annotated[MeshKeys, told("Element order and sizes, or mesh files.")] = MeshKeys()
    contact: Annotated[ContactKeys, told("How the contact conditions are imposed.")] = ContactKeys()
    friction: Annotated[FrictionKeys, told("Where the coefficient of friction comes from.")] = FrictionKeys()
    output: Annotated[OutputKeys, told("What is computed and written beyond the fitting curve.")] = OutputKeys()
    service: Annotated[
        ServiceKeys | None, told("Loads in service, for `macrofit service`; left out: those of its table.")
    ] = None

    @property
    def displacements(self) -> tuple[float, ...]:
        """The displacements of the wheel [mm], the starting one first, once more for each increment of cooling."""
        motion = self.motion
        planned = motion.displacements
        if planned is None:
            steps = max(0, math.ceil((motion.travel - motion.start) / motion.increment - 1e-9))
            planned = (*(motion.start + k * motion.increment for k in range(steps)), motion.travel)
        return (planned[0],) * motion.cooling + planned

    @property
    def thermal_strain(self) -> float:
        """Thermal strain alpha dT of the heated wheel at the start [-]; 0 where it is as warm as the axle."""
        if isinstance(self.wheel, Disc) or self.wheel.temperature == 0.0:
            return 0.0
        return expansion(self.wheel.material) * self.wheel.temperature

    def thermal_strain_at(self, index: int) -> float:
        """Thermal strain of the wheel at an increment [-]: it falls in equal steps while the wheel cools."""
        strain, steps = self.thermal_strain, self.motion.cooling
        return strain * max(0.0, 1.0 - index / steps) if steps else strain

    @property
    def direction(self) -> Literal["radial", "axial"]:
        """Direction in which the gap is measured."""
        if self.contact.direction is not None:
            return self.contact.direction
        return "axial" if isinstance(self.axle, Disc) else "radial"

    @property
    def interference(self) -> float | None:
        """Radial interference of the drawn radii, of equal cones at the end of the motion [mm]; otherwise None."""
        if (
            not (isinstance(self.axle, Shaft) and isinstance(self.wheel, Hub))
            or self.axle.taper != self.wheel.bore_taper
        ):
            return None
        cone = 0.5 * self.axle.taper * self.displacements[-1] if self.axle.taper > 0.0 else 0.0
        return self.axle.seat_radius - self.wheel.bore_radius + cone
