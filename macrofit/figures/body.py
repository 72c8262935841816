"""Bodies as figures show them: coloured by stress or a difference of it, outlined, named, with axis and push.

Everything is drawn on the deformed shape, z to the right and r upwards. Places are (r, z) [mm].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..base.arrays import FloatArray, IntArray
from ..base.figure import VERMILION, placed

if TYPE_CHECKING:
    from ..scene import Scene
    from ..solution import BodyField

YIELDED = 1e-5
"""Accumulated plastic strain at the contour of what flowed."""
FLATTEST = 0.28
"""Least height of a view over its width: words need room beside a slender shaft."""
SHORTEST = 0.13
"""Length of the arrow of the push, over the width of the view."""
ASPECT = 0.75
"""Height of a window about a place over its width."""

LETTER = 5.2
"""Width of a letter of what is marked [pt]."""
CANDIDATES = 120
"""Places that are tried for the name of a body."""
WIDER = 2.2
"""Width of a name over its height, about."""

Window = tuple[FloatArray, FloatArray]
"""Lowest and highest (r, z) [mm]."""


def deformed(field: BodyField) -> FloatArray:
    """Places of the nodes, (n, 2) [mm]."""
    return field.points + field.displacement


def inside(points: FloatArray, window: Window) -> npt.NDArray[np.bool_]:
    """Which of the points (..., 2) are in the window."""
    return np.asarray(((points >= window[0]) & (points <= window[1])).all(axis=-1))


def whole_window(bodies: list[BodyField]) -> Window:
    """What all bodies fill, with a margin, and to the left with room for the arrow of the push."""
    points = np.concatenate([deformed(field) for field in bodies])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.03 * (high - low)
    low, high = low - margin - np.array([margin[0], SHORTEST * (high - low)[1]]), high + margin
    high[0] = max(high[0], low[0] + FLATTEST * (high - low)[1])
    if low[0] <= 0.0:  # words go below the axis
        low[0] = min(low[0], -0.07 * high[0])
    return low, high


def window_around(centre: FloatArray, width: float) -> Window:
    """A window of this width [mm] about a place; nothing lies beyond the axis."""
    half = 0.5 * width * np.array([ASPECT, 1.0])
    low = np.maximum(centre - half, [0.0, -np.inf])
    return low, low + 2.0 * half


def largest_node(bodies: Mapping[str, BodyField], window: Window) -> tuple[str, FloatArray, float]:
    """The largest von Mises stress at a node in a window: its body, its place and its value [MPa]."""
    found = {}
    for body, field in bodies.items():
        values = np.where(inside(deformed(field), window), field.von_mises, 0.0)
        found[body] = (int(values.argmax()), float(values.max()))
    body = max(found, key=lambda name: found[name][1])
    node, value = found[body]
    return body, deformed(bodies[body])[node], value


def draw_bodies(
    axes: Any,
    bodies: Mapping[str, BodyField],
    window: Window,
    values: Mapping[str, FloatArray],
    *,
    scale: Any,
    colours: str = "viridis",
) -> Any:
    """All bodies in a window, with a value at each node; gives what a bar is of, None without a body."""
    drawn = None
    for body, field in bodies.items():
        drawn = _draw_field(axes, field, window, values[body], scale=scale, colours=colours)
    _frame_view(axes, window)
    return drawn


def _draw_field(axes: Any, field: BodyField, window: Window, values: FloatArray, *, scale: Any, colours: str) -> Any:
    """Colours of the triangles that reach into the window, and the outline of the body; gives what a bar is of."""
    from matplotlib.collections import TriMesh

    drawn = TriMesh(_triangles(field, seen_cells(field, window)), cmap=colours, norm=scale, rasterized=True)
    drawn.set_array(values)
    axes.add_collection(drawn, autolim=False)  # `_frame_view` sets the limits; to find them takes a path per triangle
    edges = deformed(field)[_outline(field.cells)]
    apart = np.concatenate([edges, np.full_like(edges[:, :1], np.nan)], axis=1)  # one line with gaps
    r, z = apart.reshape(-1, 2).T
    style = {"color": "black", "lw": 0.6, "solid_capstyle": "butt", "scalex": False, "scaley": False}
    axes.plot(z, r, zorder=2, **style)
    return drawn


def seen_cells(field: BodyField, window: Window) -> IntArray:
    """The cells that reach into the window; one where none does."""
    corners = deformed(field)[field.cells]
    reach = ((corners.max(axis=1) >= window[0]) & (corners.min(axis=1) <= window[1])).all(axis=1)
    return np.asarray(field.cells[reach] if reach.any() else field.cells[:1])


def draw_yield(axes: Any, field: BodyField, window: Window, bound: float | None) -> None:
    """A line around what flowed; in an elastic body a dashed one where its stress is the yield stress [MPa]."""
    seen = seen_cells(field, window)
    plastic = field.plastic_strain is not None
    values, level = (field.plastic_strain, YIELDED) if plastic else (field.von_mises, bound)
    if values is None or level is None or not values[seen].min() < level < values[seen].max():
        return
    style = {"colors": [VERMILION], "linewidths": 1.2, "linestyles": "solid" if plastic else "dashed"}
    axes.tricontour(_triangles(field, seen), values, levels=[level], **style)


def name_bodies(axes: Any, bodies: Mapping[str, BodyField], window: Window, marked: Sequence[FloatArray] = ()) -> None:
    """The name of each body where it is thickest, away from the edges of the window and from what is marked."""
    for body, field in bodies.items():
        place = _room(field, window, marked)
        if place is not None:
            _words(axes, place, body, fontsize=10, fontweight="bold", ha="center", va="center")


def _room(field: BodyField, window: Window, marked: Sequence[FloatArray]) -> FloatArray | None:
    """Where a name has most room; None where the body is hardly seen. A word is wider than it is high."""
    place = deformed(field)
    middles = place[seen_cells(field, window)[:, :3]].mean(axis=1)
    seen = middles[inside(middles, window)]
    if not len(seen):
        return None
    tried = seen[:: -(-len(seen) // CANDIDATES)]
    outline = place[np.unique(_outline(field.cells))]
    size = (window[1] - window[0]).max()
    near = outline[inside(outline, (window[0] - 0.3 * size, window[1] + 0.3 * size))]
    free = [_apart(tried, near), 0.4 * _apart(tried, np.array(marked).reshape(-1, 2))]
    edges = np.minimum(tried - window[0], window[1] - tried)
    free.append(np.minimum(edges[:, 0], edges[:, 1] / WIDER))
    return np.asarray(tried[int(np.min(free, axis=0).argmax())])


def _apart(points: FloatArray, others: FloatArray) -> FloatArray:
    """Distance from each point to the nearest of others, lengths along z counted less: names are wide."""
    between = (points[:, None] - others[None]) / np.array([1.0, WIDER])
    return np.asarray(np.sqrt((between**2).sum(axis=-1).min(axis=1, initial=np.inf)))


def draw_axis(axes: Any, window: Window, *, named: bool = True) -> None:
    """The axis of rotation, where the window has it, and its name."""
    (low_r, low_z), (high_r, high_z) = window
    if not low_r <= 0.0 < high_r:
        return
    axes.plot([low_z, high_z], [0.0, 0.0], color="0.25", lw=0.9, dashes=(9, 3, 2, 3), zorder=4)
    below = -low_r > 0.01 * (high_r - low_r)  # there is room under it
    if named:
        axes.annotate(
            "axis of rotation", (high_z, 0.0), (-4, -2 if below else 2), textcoords="offset points", fontsize=7.5,
            ha="right", va="top" if below else "bottom", annotation_clip=False, color="0.25" if below else "white",
            zorder=5,
        )  # fmt: skip


def pushed_to(scene: Scene, displacement: float) -> bool:
    """Whether a push along the axle leads to this displacement [mm]: none where the press lets go, cools or pulls."""
    places = np.array(scene.displacements)
    there = np.flatnonzero(np.abs(places - displacement) < 1e-9)
    if scene.direction != "radial" or not len(there):
        return False
    last = int(there[-1])
    return last == 0 or bool(places[last] > places[last - 1])


def draw_push(axes: Any, wheel: BodyField, window: Window) -> None:
    """An arrow at the rear face of the wheel's hub, the way the wheel is pushed."""
    place = deformed(wheel)
    low, high = place[:, 0].min(), place[:, 0].max()
    rear = float(place[place[:, 0] <= low + 0.16 * (high - low), 1].min())
    face = place[np.abs(place[:, 1] - rear) <= 1e-3 * np.ptp(place[:, 1]), 0]
    r = 0.5 * float(face.min() + face.max())
    start = max(window[0][1], rear - SHORTEST * (window[1] - window[0])[1])
    if start >= rear:
        return
    axes.annotate(
        "", (rear, r), (start, r), arrowprops={"arrowstyle": "-|>", "lw": 1.8, "color": VERMILION, "shrinkA": 0.0},
        zorder=6,
    )  # fmt: skip
    _words(axes, np.array([r, 0.5 * (start + rear)]), "push", fontsize=9, ha="center", va="bottom", color=VERMILION)


def mark_largest(axes: Any, window: Window, body: str, place: FloatArray, words: str) -> list[FloatArray]:
    """A ring on a place of a body, and words beside it; gives the places that other words keep clear of."""
    r, z = place
    right = z < 0.5 * (window[0][1] + window[1][1])
    low = r < window[0][0] + 0.15 * (window[1][0] - window[0][0])
    offset = (14 if right else -14, 30 if body == "wheel" else 52 if low else -30)
    axes.plot(z, r, "o", ms=8, mfc="none", mec=VERMILION, mew=1.6, zorder=6)
    axes.annotate(
        words, (z, r), offset, textcoords="offset points", zorder=7,
        ha="left" if right else "right", va="center", fontsize=9,
        arrowprops={"arrowstyle": "-", "color": VERMILION, "relpos": (0.0 if right else 1.0, 0.5)},
        bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": "none", "alpha": 0.85},
    )  # fmt: skip
    size = axes.get_position().size * axes.figure.get_size_inches() * 72.0  # points
    point = (window[1] - window[0])[::-1] / size
    along = np.array([0.0, 0.5, 1.0]) * LETTER * len(words) * (1.0 if right else -1.0)
    return [place, *(place + point[::-1] * np.array([offset[1], offset[0] + x]) for x in along)]


def mark_largest_node(
    axes: Any, bodies: Mapping[str, BodyField], window: Window, words: str = "{value:.0f} MPa"
) -> list[FloatArray]:
    """`mark_largest` on the largest stress at a node in a window, with its body and value in the words."""
    body, place, value = largest_node(bodies, window)
    return mark_largest(axes, window, body, place, words.format(body=body, value=value)) if value > 0.0 else []


def _frame_view(axes: Any, window: Window) -> None:
    """Limits and scale of a view; true to scale by its size on the sheet, so that nothing has to be fitted."""
    (low_r, low_z), (high_r, high_z) = window
    axes.set(xlim=(low_z, high_z), ylim=(low_r, high_r))
    axes.tick_params(labelsize=8.5)


def colour_bar(figure: Any, drawn: Any, label: str, place: tuple[float, float, float, float]) -> None:
    """The bar of a scale at a place on the sheet [inch]."""
    bar = figure.colorbar(drawn, cax=placed(figure, *place))
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8.5)


def _triangles(field: BodyField, cells: IntArray) -> Any:
    from matplotlib.tri import Triangulation

    place = deformed(field)
    return Triangulation(place[:, 1], place[:, 0], _split(cells))


def _words(axes: Any, place: FloatArray, text: str, **how: Any) -> None:
    """A text that is read on dark and on light colours."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white")]
    axes.text(place[1], place[0], text, path_effects=halo, zorder=5, **how)


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
