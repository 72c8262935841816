"""What stands on the drawing of a scene's section: which key is measured where, in the whole view and in its corners.

Only places and words; `section` draws them. Coordinates are (z, r) [mm] in the axle's frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import singledispatch
from pathlib import Path
from typing import Any

from ..base.progress import printable
from ..scene.keys import Disc, Hub, MeshFile, Scene, Shaft
from ..scene.profile import bore_profile, seat_profile

Place = tuple[float, float]
"""A point (z, r) [mm]."""

AROUND = 0.35
"""Margin around what a magnified corner shows, in its larger side."""


@dataclass(frozen=True)
class Span:
    """A key measured from low to high, along z or along r; ``feature`` is the other coordinate of what it measures."""

    label: str
    low: float  # mm
    high: float  # mm
    feature: float  # mm


@dataclass(frozen=True)
class Leader:
    """A key written beside a place, with a line to it; ``side`` is where the text goes, in (z, r) directions."""

    label: str
    place: Place
    side: Place


@dataclass(frozen=True, kw_only=True)
class View:
    """A part of the section with its dimensions: lengths in rows below and above it, radii in columns beside it."""

    title: str
    window: tuple[float, float, float, float]  # z from, z to, r from, r to [mm]
    below: list[Span] = field(default_factory=list)
    above: list[Span] = field(default_factory=list)
    left: list[Span] = field(default_factory=list)
    right: list[Span] = field(default_factory=list)
    leaders: list[Leader] = field(default_factory=list)

    def labels(self) -> list[str]:
        """Every label on it."""
        spans = (*self.below, *self.above, *self.left, *self.right)
        return [*(span.label for span in spans), *(leader.label for leader in self.leaders)]


def views(scene: Scene, window: tuple[float, float, float, float]) -> list[View]:
    """The whole section, which fills ``window``, and after it the corners that are too small to be read on it."""
    whole = View(title="", window=window)
    corners = []
    for table, body, shift in (("axle", scene.axle, 0.0), ("wheel", scene.wheel, scene.displacements[0])):
        dimension(body, table, shift, whole)
        corners += list(magnified(body, table, shift))
    return [whole, *corners]


def unmeasured(scene: Scene, drawn: list[View]) -> list[str]:
    """The keys of the bodies' shapes that are on no view, each with its value, in words."""
    there = {label.partition(" = ")[0] for view in drawn for label in view.labels()}
    words = []
    for table, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        for key in () if isinstance(body, MeshFile) else body.__struct_fields__:
            if key != "material" and f"{table}.{key}" not in there:
                value = getattr(body, key)
                words.append(f"{table}.{key}" + (" left out" if value is None else f" = {_written(value)}"))
    return words


@singledispatch
def dimension(body: Any, table: str, shift: float, view: View) -> None:
    """Put the dimensions of a body, moved by ``shift`` [mm], on the view of the whole; nothing for one from a file."""


@dimension.register
def _(axle: Shaft, table: str, shift: float, view: View) -> None:
    start = -axle.taper_length
    end, last = seat_profile(axle)[-1], axle.seat_length + axle.tail_length
    view.below.append(Span(_label(axle, table, "seat_length"), 0.0, axle.seat_length, axle.seat_radius))
    if axle.lead_length > 0.0:
        view.below.append(Span(_label(axle, table, "lead_length"), start - axle.lead_length, start, axle.seat_radius))
    if axle.tail_length > 0.0:
        view.below.append(Span(_label(axle, table, "tail_length"), axle.seat_length, last, axle.seat_radius))
    view.right.append(Span(_label(axle, table, "seat_radius"), 0.0, axle.seat_radius, 0.0))
    for key in ("tail_radius", "inner_radius"):
        _radius(view.right, axle, table, key, last)
    _radius(view.left, axle, table, "lead_radius", start - axle.lead_length)
    if axle.taper > 0.0:
        middle = (0.6 * end[0], 0.6 * end[1] + 0.4 * axle.seat_radius)
        view.leaders.append(Leader(_label(axle, table, "taper"), middle, (0.3, -1.0)))


@dimension.register
def _(wheel: Hub, table: str, shift: float, view: View) -> None:
    rear, top = shift - wheel.hub_length, wheel.hub_outer_radius
    view.above.append(Span(_label(wheel, table, "hub_length"), rear, shift, top))
    view.left.append(Span(_label(wheel, table, "bore_radius"), 0.0, wheel.bore_radius, shift))
    view.left.append(Span(_label(wheel, table, "hub_outer_radius"), 0.0, top, rear))
    if wheel.bore_taper > 0.0:
        at = bore_profile(wheel)[0]
        place = (rear + 0.2 * wheel.hub_length, at[1] + 0.1 * wheel.bore_taper * wheel.hub_length)
        view.leaders.append(Leader(_label(wheel, table, "bore_taper"), place, (0.3, -0.8)))
    if wheel.web_thickness > 0.0:
        _web(wheel, table, shift, view)


@dimension.register
def _(disc: Disc, table: str, shift: float, view: View) -> None:
    held = table == "axle"
    ends = (0.0, disc.thickness) if held else (shift - disc.thickness, shift)
    (view.below if held else view.above).append(
        Span(_label(disc, table, "thickness"), *ends, 0.0 if held else disc.radius)
    )
    _radius(view.right if held else view.left, disc, table, "radius", ends[1] if held else ends[0])
    _radius(view.right if held else view.left, disc, table, "contact_radius", ends[0] if held else ends[1])
    if disc.crown_radius > 0.0:
        r = 0.8 * disc.radius
        depth = disc.crown_radius - math.sqrt(disc.crown_radius**2 - r**2)
        place = (ends[0] + depth, r) if held else (ends[1] - depth, r)
        view.leaders.append(Leader(_label(disc, table, "crown_radius"), place, (1.0 if held else -1.0, 0.3)))


def _web(wheel: Hub, table: str, shift: float, view: View) -> None:
    hub = shift - 0.5 * wheel.hub_length
    middle = hub + wheel.web_offset
    web, rim = 0.5 * wheel.web_thickness, 0.5 * wheel.rim_width
    half_way = 0.5 * (wheel.hub_outer_radius + wheel.rim_inner_radius)
    view.above.append(Span(_label(wheel, table, "rim_width"), middle - rim, middle + rim, wheel.rim_outer_radius))
    view.above.append(Span(_label(wheel, table, "web_thickness"), middle - web, middle + web, half_way))
    if wheel.web_offset != 0.0:
        low, high = sorted((hub, middle))
        view.above.append(Span(_label(wheel, table, "web_offset"), low, high, wheel.hub_outer_radius))
    for key in ("rim_inner_radius", "rim_outer_radius"):
        _radius(view.left, wheel, table, key, middle - rim)
    if wheel.web_blend > 0.0:
        reach = (1.0 - math.sqrt(0.5)) * wheel.web_blend
        place = (middle + web + reach, wheel.rim_inner_radius - reach)
        view.leaders.append(Leader(_label(wheel, table, "web_blend"), place, (1.0, -1.0)))


def _radius(column: list[Span], body: Any, table: str, key: str, z: float) -> None:
    """A radius from the axis, where the key is given and not 0."""
    value = getattr(body, key)
    if value:
        column.append(Span(_label(body, table, key), 0.0, value, z))


@singledispatch
def magnified(body: Any, table: str, shift: float) -> Iterator[View]:
    """The corners of a body that want a view of their own."""
    return iter(())


@magnified.register
def _(axle: Shaft, table: str, shift: float) -> Iterator[View]:
    if axle.taper_length > 0.0:
        start, seat, length = axle.seat_radius - axle.taper_height, axle.seat_radius, axle.taper_length
        view = View(title="entrance of the seat", window=_around(-length, _reach(axle, length), start, seat))
        view.below.append(Span(_label(axle, table, "taper_length"), -length, 0.0, start))
        if axle.taper_height > 0.0:
            view.right.append(Span(_label(axle, table, "taper_height"), start, seat, 0.0))
        if axle.taper_blend > 0.0:
            view.leaders.append(Leader(_label(axle, table, "taper_blend"), (0.0, seat), (-0.6, 1.0)))
        yield view
    if axle.tail_blend > 0.0:
        end = seat_profile(axle)[-1][1]
        tail = end if axle.tail_radius is None else axle.tail_radius
        size, out = axle.tail_blend, 1.0 if tail < end else -1.0  # the arc's centre is above a narrower tail
        reach = (1.0 - math.sqrt(0.5)) * size
        window = _around(axle.seat_length - size, axle.seat_length + size, min(end, tail), max(end, tail))
        view = View(title="shoulder behind the seat", window=window)
        place = (axle.seat_length + reach, tail + out * reach)
        view.leaders.append(Leader(_label(axle, table, "tail_blend"), place, (1.0, 1.0)))
        yield view


@magnified.register
def _(wheel: Hub, table: str, shift: float) -> Iterator[View]:
    if wheel.chamfer_length > 0.0:
        bore, length = wheel.bore_radius - 0.5 * wheel.bore_taper * wheel.chamfer_length, wheel.chamfer_length
        mouth, corner = wheel.bore_radius + wheel.chamfer_height, shift - length
        view = View(title="leading edge of the bore", window=_around(corner - length, shift, bore, mouth))
        view.below.append(Span(_label(wheel, table, "chamfer_length"), corner, shift, bore))
        if wheel.chamfer_height > 0.0:
            view.right.append(Span(_label(wheel, table, "chamfer_height"), wheel.bore_radius, mouth, shift))
        if wheel.chamfer_blend > 0.0:
            view.leaders.append(Leader(_label(wheel, table, "chamfer_blend"), (corner, bore), (-0.6, 1.0)))
        yield view
    if wheel.rear_edge_blend > 0.0:
        rear, size = shift - wheel.hub_length, wheel.rear_edge_blend
        bore = bore_profile(wheel)[0][1]
        view = View(title="rear edge of the bore", window=_around(rear - size, rear + 2.0 * size, bore, bore + size))
        place = (rear + 0.29 * size, bore + 0.29 * size)
        view.leaders.append(Leader(_label(wheel, table, "rear_edge_blend"), place, (1.0, 1.0)))
        yield view


def _reach(axle: Shaft, length: float) -> float:
    """How far behind the entrance the arc of the taper goes, at least a third of the taper [mm]."""
    arc = axle.taper_blend * math.tan(0.5 * math.atan2(axle.taper_height, length))
    return max(arc, length / 3.0)


def _around(z0: float, z1: float, r0: float, r1: float) -> tuple[float, float, float, float]:
    """The window of a corner: what it shows with a margin, not much wider than high."""
    side = max(z1 - z0, r1 - r0)
    margin, middle = AROUND * side, 0.5 * (r0 + r1)
    half = max(0.5 * (r1 - r0) + 0.5 * margin, 0.33 * side)
    return (z0 - margin, z1 + margin, middle - half, middle + half)


def _written(value: float | str) -> str:
    return printable(Path(value).name) if isinstance(value, str) else f"{value:g}"


def _label(body: Any, table: str, key: str) -> str:
    return f"{table}.{key} = {getattr(body, key):g}"
