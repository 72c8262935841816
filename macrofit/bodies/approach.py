"""Whether two bodies can be pressed together at all, from their contact lines and outlines before anything deforms.

What the keys of a drawing tell is checked when the scene is read (`scene.checks`); this judges the gap itself, and
so bodies from files too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import FloatArray
from ..errors import SceneError
from ..scene.keys import MeshFile, Scene
from ..scene.profile import SMALL_STRAIN, sampled
from .geometry import Generatrix, Sizes, draw_body, polyline, with_profile
from .magnitudes import check_drawing
from .reader import read_mesh
from .triangles import MeshData, ordered_line, place, tabulate_edges

STEP = 400
"""Points of the common length where the gap is looked at, beside the ends of all pieces."""

SLIVER = 0.01
"""How far beside a contact line bodies may overlap, in its lengths: a rounded edge that nobody named."""

SHALLOW = 1e-3
"""Overlap beside a contact line that the numbers of a file leave, in the largest interference."""

OPT_OUT = "; contact.allow_no_contact = true computes it all the same"


@dataclass(frozen=True, kw_only=True)
class Side:
    """A contact line before it deforms, and what its body has beside it.

    beside (k, 2, 2): ends (r, z) [mm] of the boundary edges where no contact is looked for; none for a drawn body,
    which is checked by its keys. outward: sign of the normal in the direction of the heights.
    """

    line: Generatrix
    beside: FloatArray
    outward: float

    @property
    def ends(self) -> tuple[float, float]:
        """First and last coordinate [mm]."""
        return float(self.line.breaks[0]), float(self.line.breaks[-1])


def side_of_mesh(data: MeshData, where: str, contact: str, *, radial: bool) -> Side:
    """The side that a mesh file gives.

    Raises:
        MeshError: its contact line is none.
    """
    pairs = data.edges[contact]
    turn, order = ordered_line(data.points, pairs, where, contact, radial=radial)
    chain = np.where(turn[:, None], pairs[:, ::-1], pairs)[order]
    columns = [1, 0] if radial else [0, 1]
    middles = data.middles.get(contact)
    line = polyline(
        data.points[np.append(chain[:, 0], chain[-1, 1])][:, columns],
        None if middles is None else middles[order][:, columns],
    )
    table = tabulate_edges(data.triangles)
    inner = data.points[table.opposite[table.find(pairs), 0]] - data.points[pairs[:, 0]]
    along = data.points[pairs[:, 1]] - data.points[pairs[:, 0]]
    along = np.where(turn[:, None], -along, along)[:, columns]
    below = np.sign(along[:, 0] * inner[:, columns[1]] - along[:, 1] * inner[:, columns[0]])  # -1: the body lies below
    return Side(line=line, beside=beside_line(data, contact), outward=float(-below.mean()))


def beside_line(data: MeshData, contact: str) -> FloatArray:
    """Ends (k, 2, 2) [mm] of the boundary edges that are not of the contact line."""
    table = tabulate_edges(data.triangles)
    boundary = table.boundary
    return np.asarray(data.points[boundary[~np.isin(table.find(boundary), table.find(data.edges[contact]))]])


def sides_of(scene: Scene) -> tuple[Side, Side]:
    """Seat and bore of a scene, drawn or from files, without any elements.

    Raises:
        MeshError: a file cannot be read.
        SceneError: a profile cannot be read, or is none of this body.
    """
    radial = scene.direction == "radial"
    sides = []
    for body, contact, outward in (("axle", "seat", 1.0), ("wheel", "bore", -1.0)):
        shape, file = getattr(scene, body), getattr(scene.mesh, body)
        if isinstance(shape, MeshFile):
            where = f"mesh.{body}"
            side = side_of_mesh(read_mesh(str(file), body, scene.mesh.unit), where, contact, radial=radial)
            sides.append(replace(side, line=with_profile(side.line, scene, body)))
            continue
        drawing = draw_body(shape, contact, Sizes.of(scene.mesh, contact))
        check_drawing(drawing, scene.mesh.coarse, scene.mesh.growth)
        line = with_profile(drawing.generatrix, scene, body)
        sides.append(Side(line=line, beside=np.zeros((0, 2, 2)), outward=outward if radial else -outward))
    return sides[0], sides[1]


def gap_between(seat: Side, bore: Side, displacement: float, *, radial: bool) -> FloatArray | None:
    """Undeformed gaps [mm] where the bore, moved, faces the seat; < 0: they overlap. None where they do not face."""
    shift = displacement if radial else 0.0
    low, high = max(seat.ends[0], bore.ends[0] + shift), min(seat.ends[1], bore.ends[1] + shift)
    if high <= low:
        return None
    breaks = np.concatenate([seat.line.breaks, bore.line.breaks + shift, np.linspace(low, high, STEP)])
    s = np.clip(breaks, low, high)
    height = bore.line.height(s - shift) - seat.line.height(s)
    return np.asarray(height if radial else (height + displacement) * seat.outward)


def first_overlap(seat: Side, bore: Side, displacements: Sequence[float], *, radial: bool) -> float | None:
    """The first of the displacements [mm] at which the undeformed bodies overlap; None where they never do."""
    for displacement in displacements:
        gap = gap_between(seat, bore, displacement, radial=radial)
        if gap is not None and gap.min() < 0.0:
            return displacement
    return None


def check_approach(scene: Scene, seat: Side, bore: Side) -> None:
    """Whether bodies from files face each other, meet, stay within small strain and overlap nowhere else.

    Raises:
        SceneError: what is wrong, where, and what to try.
    """
    if not len(seat.beside) + len(bore.beside):
        return
    _check_facing(seat, bore, radial=scene.direction == "radial")
    lenient = scene.contact.allow_no_contact
    if not lenient:
        _check_meeting(scene, seat, bore)
    if scene.direction == "axial":
        return
    limit = SMALL_STRAIN * float(np.abs(seat.line.height(seat.line.breaks)).max())
    if not lenient:
        _check_mouth(scene, seat, bore)
    for displacement in sampled(scene.displacements):
        gap = gap_between(seat, bore, displacement, radial=True)
        depth = 0.0 if gap is None else max(0.0, -float(gap.min()))
        if depth > limit:
            raise SceneError(
                f"mesh.wheel: at a displacement of {displacement:.6g} mm the bodies overlap by {depth:.4g} mm, an "
                f"interference beyond small strain (at most {limit:.3g} mm); check radii and units, and where z = 0 is "
                f"in both files"
            )
        if not lenient:
            _check_beside(seat, bore, displacement, 1.05 * depth + SHALLOW * limit)


def _check_facing(seat: Side, bore: Side, *, radial: bool) -> None:
    """The seat looks away from the axis, or against the motion; the bore looks at it."""
    outward = 1.0 if radial else -1.0
    for body, name, side, wanted in (("axle", "seat", seat, outward), ("wheel", "bore", bore, -outward)):
        if side.outward != wanted:
            words = {(True, 1.0): "away from", (True, -1.0): "towards"}.get((radial, wanted))
            where = f"{words} the axis" if words else f"towards z = {'-' if wanted < 0 else '+'}infinity"
            raise SceneError(
                f"mesh.{body}: all of '{name}' must face {where}; are the two bodies swapped, or other edges named so?"
            )


def _check_meeting(scene: Scene, seat: Side, bore: Side) -> None:
    """At some displacement the bodies overlap, or else everything is zero."""
    radial = scene.direction == "radial"
    if first_overlap(seat, bore, scene.displacements[::-1], radial=radial) is not None:
        return
    gaps = [gap_between(seat, bore, displacement, radial=radial) for displacement in sampled(scene.displacements)]
    low, high = min(scene.displacements), max(scene.displacements)
    closest = min((float(gap.min()) for gap in gaps if gap is not None), default=None)
    if closest is not None:
        said = f"the gap is {closest:.4g} mm or more" if closest > 0.0 else "they touch without interference"
    else:
        said = (
            f"the seat, {'z' if radial else 'r'} = {seat.ends[0]:.6g} to {seat.ends[1]:.6g}, and the bore, "
            f"{bore.ends[0]:.6g} to {bore.ends[1]:.6g} before it moves, never face each other"
        )
    raise SceneError(
        f"motion: axle and wheel never meet at displacements from {low:.6g} to {high:.6g} mm: {said}; check radii, "
        f"travel and units (mm){OPT_OUT}"
    )


def _check_mouth(scene: Scene, seat: Side, bore: Side) -> None:
    """The leading edge of the bore does not run into the axle's end, nor start within the axle without a rest."""
    entrance = seat.ends[0] - bore.ends[1]  # the displacement at which the bore's mouth comes to the seat
    high = max(scene.displacements)
    first = scene.displacements[0]
    if first <= entrance <= high:
        at = entrance
    elif entrance < first <= 0.0 and high > first and first + bore.ends[1] <= seat.ends[1]:
        at = first
    else:
        return
    mouth = float(bore.line.height(np.array([bore.ends[1]]))[0])
    axle = float(seat.line.height(np.array([at + bore.ends[1]]))[0])
    if mouth < axle * (1.0 - 1e-9):
        raise SceneError(
            f"mesh.wheel: the bore's mouth, r = {mouth:.6g}, is narrower than the axle where it enters, {axle:.6g}, "
            f"at a displacement of {at:.6g} mm; name taper and chamfer as 'seat' and 'bore' too, or give "
            f"motion.start > 0 for a shrink fit{OPT_OUT}"
        )


def _check_beside(seat: Side, bore: Side, displacement: float, depth: float) -> None:
    """Neither body overlaps the other beside a contact line, deeper than ``depth`` [mm] or over more than a sliver."""
    for body, name, own, other, shift, sign in (
        ("axle", "seat", seat, bore, -displacement, 1.0),
        ("wheel", "bore", bore, seat, displacement, -1.0),
    ):
        if not len(own.beside):
            continue
        share = np.linspace(0.0, 1.0, 9)[:, None, None]
        points = ((1.0 - share) * own.beside[:, 0] + share * own.beside[:, 1]).reshape(-1, 2)
        r, z = points.T
        low, high = other.ends
        rim = 1e-6 * (high - low)
        faced = (z + shift > low + rim) & (z + shift < high - rim)
        overlap = np.where(faced, sign * (r - other.line.height(np.clip(z + shift, low, high))), 0.0)
        beyond = np.maximum(np.maximum(own.ends[0] - z, z - own.ends[1]), 0.0)
        sliver = SLIVER * min(own.ends[1] - own.ends[0], high - low)
        bad = (overlap > depth) | ((overlap > 1e-9 * np.abs(r).max()) & (beyond > sliver))
        if bad.any():
            worst = int(np.argmax(np.where(bad, overlap, -np.inf)))
            raise SceneError(
                f"mesh.{body}: at a displacement of {displacement:.6g} mm axle and wheel overlap by "
                f"{overlap[worst]:.4g} mm at {place((r[worst], z[worst]))} of the file, beside '{name}', where no "
                f"contact is looked for; shorten motion.travel, or name those edges '{name}' too{OPT_OUT}"
            )
