"""The picture of von Mises stress in both bodies, whole or zoomed on both ends of the contact.

Stress is shown at the nodes, z to the right and r upwards, on the deformed shape, not magnified: undeformed,
the two bodies would overlap by the interference just where it matters. The map is viridis, on one scale for all views
of a figure; a vermilion line encloses what flowed, a dashed one what an elastic body has beyond its yield stress.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..acceptance.fit import yield_stresses
from ..base.arrays import FloatArray
from ..base.figure import blank, placed
from .body import (
    Window,
    colour_bar,
    deformed,
    draw_axis,
    draw_bodies,
    draw_push,
    draw_yield,
    inside,
    largest_node,
    mark_largest,
    mark_largest_node,
    name_bodies,
    pushed_to,
    whole_window,
    window_around,
)

if TYPE_CHECKING:
    from ..solution import BodyField, Solution

LEFT, BETWEEN, RIGHT, BELOW = 0.72, 0.62, 1.0, 0.55
"""Around and between the views; to the right the bar of colours [inch]."""


class _View(NamedTuple):
    window: Window
    title: str


def stress(solution: Solution, zoom: float | None = None) -> Any:
    """Von Mises stress of both bodies at the last displacement with fields, on one scale.

    With ``zoom`` [mm]: windows of that width on both ends of the contact, or where the gap is not along the radius one
    on the largest stress.
    """
    at = max(solution.fields, key=lambda displacement: _order(solution, displacement))
    bodies = solution.fields[at]
    marks = _marks(solution, at)
    views = [_View(whole_window(list(bodies.values())), "")] if zoom is None else _ends(solution, at, marks, zoom)
    scale = min((6.5, 6.5, 4.0)[len(views)] / _extent(views[0])[1], 6.0 / _extent(views[0])[0])
    height, width = scale * _extent(views[0])
    across = LEFT + len(views) * width + (len(views) - 1) * BETWEEN + RIGHT
    title = _title(solution, at, columns=int(13 * max(across, 4.6)))
    above = 0.18 + 0.19 * title.count("\n") + (0.5 if views[0].title else 0.3)
    figure = blank(max(across, 4.6), BELOW + height + above)
    figure.suptitle(title, fontsize=10, y=1.0 - 0.08 / (BELOW + height + above), va="top")
    top = max(largest_node(bodies, view.window)[2] for view in views)
    for k, view in enumerate(views):
        axes = placed(figure, LEFT + k * (width + BETWEEN), BELOW, width, height)
        drawn = _draw_view(axes, solution, bodies, view, top)
        if zoom is None and "wheel" in bodies and pushed_to(solution.scene, at):
            draw_push(axes, bodies["wheel"], view.window)
        name_bodies(axes, bodies, view.window, _mark(axes, bodies, marks, view.window))
        axes.set_ylabel("" if k else "r [mm]")
    colour_bar(figure, drawn, "von Mises stress [MPa]", (across - RIGHT + 0.15, BELOW, 0.16, min(height, 4.5)))
    return figure


def _draw_view(axes: Any, solution: Solution, bodies: Mapping[str, BodyField], view: _View, top: float) -> Any:
    from matplotlib.colors import Normalize

    bounds = yield_stresses(solution.scene)
    values = {body: field.von_mises for body, field in bodies.items()}
    drawn = draw_bodies(axes, bodies, view.window, values, scale=Normalize(0.0, top or 1.0))
    for body, field in bodies.items():
        draw_yield(axes, field, view.window, bounds.get(body))
    draw_axis(axes, view.window)
    axes.set_xlabel("z [mm]")
    axes.set_title(view.title, fontsize=9, y=1.0)
    axes.spines[["top", "right"]].set_visible(bool(view.title))
    return drawn


def _extent(view: _View) -> FloatArray:
    return view.window[1] - view.window[0]


def _ends(solution: Solution, displacement: float, marks: Mapping[str, _Mark], zoom: float) -> list[_View]:
    """Views of both ends of what carries pressure; one where they are closer than half a window, or have no radius."""
    record = solution.increments[max(0, _order(solution, displacement))]
    held = np.flatnonzero(record.facets.pressure > 0.0)
    if solution.scene.direction != "radial" or not len(held):
        centre = _centre(solution.fields[displacement], marks)
        return [_View(window_around(centre, zoom), "where the stress is largest")]
    axle = solution.fields[displacement]["axle"]
    ends = [_on_surface(axle, float(solution.seat[k])) for k in (held[0], held[-1] + 1)]
    if abs(ends[1][1] - ends[0][1]) < 0.5 * zoom:
        return [_View(window_around(0.5 * (ends[0] + ends[1]), zoom), "the contact")]
    names = ("end of the contact at the seat's entrance", "end of the contact at the wheel's leading edge")
    return [_View(window_around(end, zoom), name) for end, name in zip(ends, names, strict=True)]


def _on_surface(axle: BodyField, z: float) -> FloatArray:
    """The outermost node of the axle about a place along it."""
    place = deformed(axle)
    reach = 0.02 * float(np.ptp(place[:, 1]))
    near = place[np.abs(place[:, 1] - z) <= max(reach, float(np.abs(place[:, 1] - z).min()))]
    return np.array([float(near[:, 0].max()), z])


def _title(solution: Solution, displacement: float, columns: int) -> str:
    """What is shown, and the run's largest stress where that is of another displacement."""
    lines = textwrap.wrap(solution.scene.title, columns)
    flowed = any(zone.area_mm2 for zone in solution.flowed.values())
    beyond = bool(solution.beyond_yield)
    lines.append(
        f"displacement {displacement:g} mm"
        + (", flowed within the line" if flowed else "")
        + (", beyond yield within the dashed line" if beyond else "")
    )
    extremes = solution.max_von_mises
    if extremes:
        body = max(extremes, key=lambda name: extremes[name].value)
        if abs(extremes[body].displacement_mm - displacement) >= 1e-9:
            at = extremes[body]
            note = f"largest of the run: {body}, {at.value:.0f} MPa at {at.displacement_mm:g} mm"
            lines[-1:] = textwrap.wrap(f"{lines[-1]} ({note})", columns)
    return "\n".join(lines)


class _Mark(NamedTuple):
    place: FloatArray  # (r, z) [mm], deformed
    value: float  # MPa


def _marks(solution: Solution, displacement: float) -> dict[str, _Mark]:
    """The largest stresses of the run that occur at this displacement."""
    marks = {}
    for body, at in solution.max_von_mises.items():
        if abs(at.displacement_mm - displacement) < 1e-9 and body in solution.fields[displacement]:
            field = solution.fields[displacement][body]
            place = np.array([at.r_mm, at.z_mm])
            nearest = int(np.linalg.norm(field.points - place, axis=1).argmin())
            marks[body] = _Mark(place + field.displacement[nearest], at.value)
    return marks


def _mark(axes: Any, bodies: Mapping[str, BodyField], marks: Mapping[str, _Mark], window: Window) -> list[FloatArray]:
    """The largest stresses of the run that are in the window, or the largest at a node in it; as `mark_largest`."""
    seen = {body: mark for body, mark in marks.items() if inside(mark.place, window)}
    if not seen:
        return mark_largest_node(axes, bodies, window, "{body}, largest here: {value:.0f} MPa")
    return [
        place
        for body, mark in seen.items()
        for place in mark_largest(axes, window, body, mark.place, f"{body}, largest of the run: {mark.value:.0f} MPa")
    ]


def _centre(bodies: Mapping[str, BodyField], marks: Mapping[str, _Mark]) -> FloatArray:
    """Where the run's largest stress is; where it is not of this displacement, the largest at a node."""
    if marks:
        return max(marks.values(), key=lambda mark: mark.value).place
    field = max(bodies.values(), key=lambda field: float(field.von_mises.max()))
    centre: FloatArray = deformed(field)[int(field.von_mises.argmax())]
    return centre


def _order(solution: Solution, displacement: float) -> int:
    """Number of the last increment at this displacement: the motion may come by more than once."""
    near = np.flatnonzero(np.abs(solution.displacement - displacement) < 1e-9)
    return int(near[-1]) if len(near) else -1
