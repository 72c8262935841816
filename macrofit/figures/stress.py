"""The picture of von Mises stress in both bodies, whole or zoomed on the entrance of the seat.

Stress is shown at the nodes, z to the right and r upwards, on the deformed shape, not magnified: undeformed,
the two bodies would overlap by the interference just where it matters. The map is viridis; a vermilion line encloses
what flowed.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.arrays import FloatArray, IntArray
from ..base.figure import VERMILION, sheet
from ..scene.keys import Shaft

if TYPE_CHECKING:
    from ..solution import BodyField, Solution

YIELDED = 1e-5
"""Accumulated plastic strain at the contour of what flowed."""

Window = tuple[FloatArray, FloatArray]
"""Lowest and highest (r, z) [mm]."""


def stress(solution: Solution, zoom: float | None = None) -> Any:
    """Von Mises stress of both bodies at the last displacement with fields, on one scale.

    With ``zoom`` [mm]: a window of that width on the seat's entrance, or where none is drawn on the largest stress.
    """
    at = max(solution.fields, key=lambda displacement: _order(solution, displacement))
    bodies = solution.fields[at]
    marks = _marks(solution, at)
    if zoom is None:
        points = np.concatenate([_deformed(field) for field in bodies.values()])
        margin = 0.03 * np.ptp(points, axis=0)
        window = (points.min(axis=0) - margin, points.max(axis=0) + margin)
    else:
        half = 0.5 * zoom * np.array([0.75, 1.0])
        axle = solution.scene.axle
        place = np.array([axle.seat_radius, 0.0]) if isinstance(axle, Shaft) else _centre(bodies, marks)
        centre = np.maximum(place, [half[0], -np.inf])  # nothing lies beyond the axis
        window = (centre - half, centre + half)
    figure, (axes,) = sheet(*_frame(window[1] - window[0]))
    shown = [field.von_mises[_inside(_deformed(field), window)] for field in bodies.values()]
    top = max(float(values.max(initial=0.0)) for values in shown)
    for field in bodies.values():
        drawn = _draw_body(axes, field, window, top)
    _annotate(axes, {body: mark for body, mark in marks.items() if _inside(mark.place, window)}, window)
    (low_r, low_z), (high_r, high_z) = window
    axes.set(xlim=(low_z, high_z), ylim=(low_r, high_r), aspect="equal", xlabel="z [mm]", ylabel="r [mm]")
    axes.spines[["top", "right"]].set_visible(zoom is not None)
    figure.colorbar(drawn, ax=axes, label="von Mises stress [MPa]", fraction=0.05, pad=0.03)
    axes.set_title(_title(solution, at, columns=int(13 * figure.get_figwidth())), fontsize=10)
    return figure


def _title(solution: Solution, displacement: float, columns: int) -> str:
    """What is shown, and the run's largest stress where that is of another displacement."""
    lines = textwrap.wrap(solution.scene.title, columns)
    flowed = any(zone.area_mm2 for zone in solution.flowed.values())
    lines.append(f"displacement {displacement:g} mm" + (", flowed within the line" if flowed else ""))
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


def _centre(bodies: Mapping[str, BodyField], marks: Mapping[str, _Mark]) -> FloatArray:
    """Where the run's largest stress is; where it is not of this displacement, the largest at a node."""
    if marks:
        return max(marks.values(), key=lambda mark: mark.value).place
    field = max(bodies.values(), key=lambda field: float(field.von_mises.max()))
    centre: FloatArray = _deformed(field)[int(field.von_mises.argmax())]
    return centre


def _order(solution: Solution, displacement: float) -> int:
    """Number of the last increment at this displacement: the motion may come by more than once."""
    near = np.flatnonzero(np.abs(solution.displacement - displacement) < 1e-9)
    return int(near[-1]) if len(near) else -1


def _deformed(field: BodyField) -> FloatArray:
    return field.points + field.displacement


def _inside(points: FloatArray, window: Window) -> npt.NDArray[np.bool_]:
    return np.asarray(((points >= window[0]) & (points <= window[1])).all(axis=-1))


def _annotate(axes: Any, marks: Mapping[str, _Mark], window: Window) -> None:
    for body, mark in marks.items():
        r, z = mark.place
        right = z < 0.5 * (window[0][1] + window[1][1])
        low = r < window[0][0] + 0.15 * (window[1][0] - window[0][0])
        offset = (12 if right else -12, 26 if body == "wheel" else 52 if low else -26)
        axes.plot(z, r, "o", ms=8, mfc="none", mec=VERMILION, mew=1.6)
        axes.annotate(
            f"{body}, largest of the run: {mark.value:.0f} MPa", (z, r), offset, textcoords="offset points",
            ha="left" if right else "right", va="center", fontsize=9,
            arrowprops={"arrowstyle": "-", "color": VERMILION, "relpos": (0.0 if right else 1.0, 0.5)},
            bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": "none", "alpha": 0.85},
        )  # fmt: skip


def _draw_body(axes: Any, field: BodyField, window: Window, top: float) -> Any:
    """Colours of the triangles that reach into the window, and the outline of the body."""
    from matplotlib.collections import LineCollection
    from matplotlib.tri import Triangulation

    place = _deformed(field)
    corners = place[field.cells]
    reach = (corners.max(axis=1) >= window[0]) & (corners.min(axis=1) <= window[1])
    seen = field.cells[reach.all(axis=1)] if reach.all(axis=1).any() else field.cells[:1]
    drawn = axes.tripcolor(
        Triangulation(place[:, 1], place[:, 0], _split(seen)), field.von_mises,
        shading="gouraud", cmap="viridis", vmin=0.0, vmax=top, rasterized=True,
    )  # fmt: skip
    if _crosses(field, seen):
        mesh = Triangulation(place[:, 1], place[:, 0], _split(seen))
        axes.tricontour(mesh, field.plastic_strain, levels=[YIELDED], colors=[VERMILION], linewidths=1.0)
    axes.add_collection(LineCollection(list(place[_outline(field.cells)][..., ::-1]), colors="black", linewidths=0.6))
    return drawn


def _crosses(field: BodyField, cells: IntArray) -> bool:
    """Whether the border of what flowed crosses some of the cells."""
    if field.plastic_strain is None:
        return False
    flowed = field.plastic_strain[cells]
    return bool(flowed.min() < YIELDED < flowed.max())


def _split(cells: IntArray) -> IntArray:
    """Each quadratic triangle as four linear ones through its middles, so that every nodal value is shown."""
    if cells.shape[1] == 3:
        return cells
    parts = [[0, 5, 4], [1, 3, 5], [2, 4, 3], [3, 4, 5]]
    return np.concatenate([cells[:, part] for part in parts])


def _outline(cells: IntArray) -> IntArray:
    """The edges that belong to one triangle only, (n, 2), quadratic ones halved."""
    corners = np.array([[0, 1], [1, 2], [2, 0]])
    edges = cells[:, corners].reshape(-1, 2)
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    alone = first[count == 1]
    if cells.shape[1] == 3:
        return np.asarray(edges[alone])
    middles = cells[:, [5, 3, 4]].reshape(-1)[alone]
    ends = edges[alone]
    return np.concatenate([np.column_stack([ends[:, 0], middles]), np.column_stack([middles, ends[:, 1]])])


def _frame(extent: FloatArray) -> tuple[float, float]:
    """Width and height of a figure [inch] that suits an extent (r, z) drawn to scale."""
    height, width = float(extent[0]), float(extent[1])
    scale = min(6.5 / width, 6.5 / height)
    return max(width * scale, 2.8) + 1.9, max(height * scale, 1.6) + 1.1
