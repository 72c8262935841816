"""The tables of a scene as frozen records: every key, its default and its unit.

Lengths in mm, forces in N, moduli in MPa.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import msgspec

from .material import Material


class Keys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of every table of a scene: frozen, and an unknown key is an error."""


class Shaft(Keys, frozen=True, tag="shaft", tag_field="shape"):
    """An axle: lead, taper, seat and tail along z; the seat's entrance (end of the taper) is z = 0."""

    seat_radius: float
    seat_length: float
    taper_length: float = 0.0  # before the seat, from seat_radius - taper_height up to seat_radius
    taper_height: float = 0.0
    taper_blend: float = 0.0  # radius of the arc between taper and seat; 0: a sharp corner
    lead_length: float = 0.0  # cylinder before the taper
    lead_radius: float | None = None  # None: where the taper starts
    tail_length: float = 0.0  # cylinder behind the seat; its far end is held axially
    tail_radius: float | None = None  # None: seat_radius, no shoulder
    tail_blend: float = 0.0  # fillet in the corner of the shoulder
    inner_radius: float = 0.0  # 0: a solid axle
    material: Material = Material()


class Hub(Keys, frozen=True, tag="wheel", tag_field="shape"):
    """A wheel or, with web_thickness = 0, a plain ring; z is measured from its leading face, backwards."""

    bore_radius: float
    hub_length: float
    hub_outer_radius: float
    chamfer_length: float = 0.0  # at the leading edge, from bore_radius + chamfer_height to bore_radius
    chamfer_height: float = 0.0
    chamfer_blend: float = 0.0  # radius of the arc between chamfer and bore; 0: a sharp corner
    rear_edge_blend: float = 0.0  # rounding of the bore's rear edge; 0: a sharp edge
    web_thickness: float = 0.0
    web_offset: float = 0.0  # from the middle of the hub to the middle of web and rim, towards the leading face
    web_blend: float = 0.0  # fillets where the web meets hub and rim
    rim_inner_radius: float = 0.0
    rim_outer_radius: float = 0.0
    rim_width: float = 0.0
    material: Material = Material()


class Disc(Keys, frozen=True, tag="disc", tag_field="shape"):
    """A disc or spherical cap on the axis, pressed along z; as axle it is held, as wheel it is pushed."""

    radius: float
    thickness: float
    crown_radius: float = 0.0  # sphere radius of the contact face; 0: flat
    contact_radius: float | None = None  # how far from the axis contact is looked for; None: radius
    material: Material = Material()


class Drawn(Keys, frozen=True, tag="mesh", tag_field="shape"):
    """A body whose shape comes from a mesh file (see ``[mesh]``): only its material is left to say."""

    material: Material = Material()


class MeshKeys(Keys, frozen=True):
    """Element order and sizes, or the user's own mesh files."""

    order: Literal[1, 2] = 2
    seat_facet: float = 1.0  # length of a facet of the seat [mm]
    bore_facet: float | None = None  # None: 0.97 seat_facet, so that the two lines never repeat their phase
    corner_facet: float | None = None  # in the arcs of the seat (blends, crowns) [mm], 0.97 of it in the bore's
    coarse: float = 20.0  # largest element [mm]
    growth: float = 0.35  # growth of the element size with the distance from the contact line
    axle: str | None = None
    wheel: str | None = None


class ContactKeys(Keys, frozen=True):
    """How the contact conditions are imposed (see docs of ``macrofit.contact.law``)."""

    formulation: Literal["nitsche", "penalty"] = "nitsche"
    theta: Literal[-1, 0, 1] = 0
    gamma0: float | None = None  # gamma = gamma0 E / h; None: 10, and 30 for theta = 1, which is coercive only then
    penalty_stiffness: float | None = None  # MPa/mm; None: 10 E per mm
    direction: Literal["radial", "axial"] | None = None  # of the gap; None: by the shapes


class Motion(Keys, frozen=True):
    """Displacements of the wheel, 0 where its leading face is at the seat's entrance."""

    start: float = 0.0  # > 0: the interference is resolved in place before anything moves
    travel: float = 0.0  # final displacement
    increment: float = 1.0
    displacements: tuple[float, ...] | None = None  # instead of the three above; may reverse
    max_cutbacks: int = 8


class FrictionKeys(Keys, frozen=True):
    """The friction provider by its entry-point name, and its options."""

    provider: str = "uniform"
    options: dict[str, Any] = {}


class OutputKeys(Keys, frozen=True):
    """What is computed and written beyond the fitting curve."""

    stress: bool = True  # maximum von Mises stress of each body over the whole run
    fields_at: tuple[float, ...] | None = None  # displacements; None: the last one
    fields: tuple[Literal["displacement", "von_mises", "stress"], ...] = ("displacement", "von_mises")
    frames: int = 0  # that many more, evenly spaced, for an animation


class Scene(Keys, frozen=True):
    """Everything that determines a run."""

    axle: Shaft | Disc | Drawn
    wheel: Hub | Disc | Drawn
    motion: Motion
    title: str = ""
    solver: Literal["condensed", "monolithic"] = "condensed"
    mesh: MeshKeys = MeshKeys()
    contact: ContactKeys = ContactKeys()
    friction: FrictionKeys = FrictionKeys()
    output: OutputKeys = OutputKeys()

    @property
    def displacements(self) -> tuple[float, ...]:
        """The displacements of the wheel [mm], the starting one first."""
        motion = self.motion
        if motion.displacements is not None:
            return motion.displacements
        steps = max(0, math.ceil((motion.travel - motion.start) / motion.increment - 1e-9))
        return (*(motion.start + k * motion.increment for k in range(steps)), motion.travel)

    @property
    def direction(self) -> Literal["radial", "axial"]:
        """Direction in which the gap is measured."""
        if self.contact.direction is not None:
            return self.contact.direction
        return "axial" if isinstance(self.axle, Disc) else "radial"

    @property
    def interference(self) -> float | None:
        """Radial interference of the drawn radii [mm]; None where no two radii are drawn."""
        if isinstance(self.axle, Shaft) and isinstance(self.wheel, Hub):
            return self.axle.seat_radius - self.wheel.bore_radius
        return None
