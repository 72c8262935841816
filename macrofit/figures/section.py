"""The section of a scene drawn to scale, with every key of its shapes on it and its corners magnified.

Everything is drawn in inches on one sheet, so that rows of dimensions and texts know what room they have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..base.figure import BLACK, BLUE, GREEN, PURPLE, VERMILION, blank, save
from ..base.progress import printable
from ..bodies.geometry import Sizes, draw_body
from ..bodies.mesh import read_mesh
from ..errors import OutputError
from ..scene.keys import MeshFile, Scene
from .dimensions import Leader, Span, View, unmeasured, views

Named = list[tuple[str, FloatArray]]
"""Boundary edges by name, (n, 2, 2): ends in (z, r) [mm]."""

WIDEST, HIGHEST = 7.0, 6.0
"""The whole section on the sheet, without its dimensions [inch]."""
CORNER = 2.6
"""Width of a magnified corner on the sheet [inch]."""
PITCH, MARGIN = 0.26, 0.35
"""From one row of dimensions to the next, and around a view [inch]."""
BESIDE = 2.3
"""Room beside a magnified corner for the words of its heights [inch]."""
SIZE = 7.5
"""Height of the letters [pt]."""
FORMATS = (".svg", ".pdf", ".png")
FILL = {"axle": "#DCE9F3", "wheel": "#FBEBD3"}
COLOURS = {"seat": BLUE, "bore": VERMILION, "held": GREEN, "pushed": PURPLE, "axis": "0.45"}
SMOOTH = 50.0, 1000.0
"""Pieces of a contact line in its straight parts and in its arcs, which are drawn as chords."""
INK = "0.25"


@dataclass(frozen=True, kw_only=True)
class Outline:
    """A body's section where it is drawn."""

    body: str
    loops: list[FloatArray]  # (n, 2, 2) edges each, (z, r) [mm]
    named: Named


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A view's place on the sheet: inches of a point (z, r)."""

    axes: Any
    scale: float  # inch/mm
    left: float  # inch, of the window's left edge
    bottom: float
    view: View

    def at(self, z: Any, r: Any) -> tuple[Any, Any]:
        """The point on the sheet [inch]."""
        return self.left + (z - self.view.window[0]) * self.scale, self.bottom + (r - self.view.window[2]) * self.scale

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the window [inch]."""
        z0, z1, r0, r1 = self.view.window
        return self.left, self.left + (z1 - z0) * self.scale, self.bottom, self.bottom + (r1 - r0) * self.scale


def write_section(scene: Scene, target: Path) -> Path:
    """Draw the section of a scene into a file, its ending the format; in an SVG the labels are text.

    Raises:
        MeshError: a mesh file cannot be read.
        OutputError: the file cannot be written, or its ending is none of a drawing.
    """
    if target.suffix not in FORMATS:
        raise OutputError(f"{target}: no format of a drawing; end its name with {', '.join(FORMATS)}")
    drawn = section(scene)
    from matplotlib import rc_context

    with rc_context({"svg.fonttype": "none"}):
        return save(drawn, target)


def section(scene: Scene) -> Any:
    """The half section above the axis, the wheel where the motion starts; the figure."""
    outlines = [outline(scene, "axle", 0.0), outline(scene, "wheel", scene.displacements[0])]
    whole, *corners = views(scene, bounds(outlines))
    z0, z1, r0, r1 = whole.window
    scale = min(WIDEST / (z1 - z0), HIGHEST / (r1 - r0))
    before, after, under, over = room(whole, scale)
    notes = _notes(scene, [whole, *corners])
    height = max(under + (r1 - r0) * scale + over, sum(_corner_height(corner) for corner in corners) + 0.3)
    foot = 0.2 + 0.16 * len(notes)
    across = before + (z1 - z0) * scale + after
    title = printable(scene.title) or "Section of the scene"
    least = 0.3 + max(words_wide(title) * 10.0 / SIZE, *map(words_wide, notes))
    figure = blank(max(across + (CORNER + BESIDE if corners else 0.0), least), height + foot + 0.7)
    axes = _canvas(figure)
    bottom = foot + under + 0.5 * (height - under - over - (r1 - r0) * scale)
    sheet = Sheet(axes=axes, scale=scale, left=before, bottom=bottom, view=whole)
    _draw_whole(sheet, outlines, scene)
    top = foot + height
    for letter, corner in zip("ABCDEF", corners, strict=False):
        _draw_corner(axes, sheet, corner, letter, outlines, (across, top))
        top -= _corner_height(corner)
    for k, line in enumerate(notes):
        axes.text(0.15, foot - 0.16 * (k + 1), line, fontsize=SIZE, color=INK, va="bottom", parse_math=False)
    axes.text(0.15, foot + height + 0.42, title, fontsize=10, va="bottom", parse_math=False)
    return figure


def outline(scene: Scene, body: str, shift: float) -> Outline:
    """The outline of a body, drawn or from its file, moved along the axis by ``shift`` [mm]."""
    shape = scene.axle if body == "axle" else scene.wheel
    file = getattr(scene.mesh, body)
    if isinstance(shape, MeshFile) and file is not None:
        data = read_mesh(file, body, scene.mesh.unit)
        moved = data.points[:, ::-1] + np.array([shift, 0.0])
        named = [(name, moved[pairs]) for name, pairs in data.edges.items()]
        return Outline(body=body, loops=[moved[pairs] for pairs in _rings(data.triangles)], named=named)
    contact = "seat" if body == "axle" else "bore"
    reach = float(np.ptp(draw_body(shape, contact, Sizes(1.0, 1.0, 0.0)).generatrix.breaks))
    sizes = Sizes(reach / SMOOTH[0], reach / SMOOTH[1], 0.3)
    drawing = draw_body(shape, contact, sizes)
    edges = np.array([(edge.start[::-1], edge.end[::-1]) for edge in drawing.edges]) + np.array([shift, 0.0])
    names = np.array([edge.name for edge in drawing.edges])
    return Outline(body=body, loops=[edges], named=[(name, edges[names == name]) for name in set(names) - {""}])


def _rings(triangles: Any) -> list[Any]:
    """The closed loops of a mesh's boundary, each as its edges (n, 2) in order."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, first, count = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True)
    after = {int(a): int(b) for a, b in _turned(pairs[first[count == 1]])}
    rings = []
    while after:
        ring, (point, _) = [], next(iter(after.items()))
        while point in after:
            ring.append((point, after.pop(point)))
            point = ring[-1][1]
        rings.append(np.array(ring))
    return rings


def _turned(pairs: Any) -> list[tuple[int, int]]:
    """The edges of loops, each turned so that it starts where another one ends."""
    beside: dict[int, list[int]] = {}
    for k, pair in enumerate(pairs.tolist()):
        for point in pair:
            beside.setdefault(point, []).append(k)
    left, ordered = set(range(len(pairs))), []
    while left:
        k = left.pop()
        a, b = pairs[k].tolist()
        ordered.append((a, b))
        while following := [k for k in beside[b] if k in left]:
            left.discard(following[0])
            first, second = pairs[following[0]].tolist()
            a, b = b, second if first == b else first
            ordered.append((a, b))
    return ordered


def bounds(outlines: Sequence[Outline]) -> tuple[float, float, float, float]:
    """What both bodies fill: z from, z to, r from 0, r to [mm]."""
    points = np.concatenate([loop.reshape(-1, 2) for each in outlines for loop in each.loops])
    (z0, _), (z1, r1) = points.min(axis=0), points.max(axis=0)
    return float(z0), float(z1), 0.0, float(r1)


def words_wide(text: str) -> float:
    """Width of a label [inch], somewhat more than that of its letters."""
    return 0.6 * SIZE / 72.0 * len(text) + 0.06


def rows(spans: Sequence[Span], scale: float) -> list[tuple[Span, int]]:
    """Each length with the row it goes to, short ones first, so that no lines and no labels of a row meet."""
    taken: list[list[tuple[float, float]]] = []
    placed = []
    for span in sorted(spans, key=lambda span: span.high - span.low):
        middle, half = 0.5 * (span.low + span.high), 0.5 * words_wide(span.label) / scale
        low, high = min(span.low, middle - half), max(span.high, middle + half)
        free = (k for k, row in enumerate(taken) if all(high < a or low > b for a, b in row))
        row = next(free, len(taken))
        if row == len(taken):
            taken.append([])
        taken[row].append((low, high))
        placed.append((span, row))
    return placed


def room(view: View, scale: float) -> tuple[float, float, float, float]:
    """What the dimensions take to the left, right, below and above the window [inch]."""
    z0, z1, *_ = view.window
    before, after = PITCH * len(view.left), PITCH * len(view.right)
    for span in (*view.below, *view.above):
        middle, half = 0.5 * (span.low + span.high), 0.5 * words_wide(span.label) / scale
        before = max(before, (z0 - middle + half) * scale)
        after = max(after, (middle + half - z1) * scale)
    deep = [PITCH * (1 + max((row for _, row in rows(spans, scale)), default=-1)) for spans in (view.below, view.above)]
    columns = () if view.title else (*view.left, *view.right)  # whose words stand upright
    upright = max((words_wide(span.label) for span in columns), default=0.0)
    over = max(deep[1], upright - (view.window[3] - view.window[2]) * scale)
    return before + MARGIN, after + MARGIN, deep[0] + MARGIN, over + MARGIN


def _canvas(figure: Any) -> Any:
    """Axes all over the sheet whose unit is the inch."""
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    across, up = figure.get_size_inches()
    axes.set(xlim=(0.0, across), ylim=(0.0, up))
    axes.axis("off")
    return axes


def _draw_whole(sheet: Sheet, outlines: Sequence[Outline], scene: Scene) -> None:
    from matplotlib.lines import Line2D

    _draw_bodies(sheet, outlines, None)
    left, right, bottom, _ = sheet.box
    sheet.axes.plot([left - 0.15, right + 0.15], [bottom, bottom], color=INK, lw=0.8, dashes=(9, 3, 2, 3))
    _draw_dimensions(sheet)
    for each in outlines:
        _name_body(sheet, each, scene)
    there = {name for each in outlines for name, _ in each.named}
    handles = [Line2D([], [], color=colour, lw=2.0, label=name) for name, colour in COLOURS.items() if name in there]
    across, up = sheet.axes.figure.get_size_inches()
    sheet.axes.legend(
        handles=handles, ncols=len(handles), frameon=False, fontsize=SIZE, loc="upper left",
        bbox_to_anchor=(0.1 / across, (up - 0.32) / up), borderaxespad=0.0,
    )  # fmt: skip


def _draw_bodies(sheet: Sheet, outlines: Sequence[Outline], clip: Any) -> None:
    """Both sections filled, their outlines, and in colours the boundaries that have names."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Curve

    for each in outlines:
        rings = [np.stack(sheet.at(*np.append(loop[:, 0], loop[:1, 0], axis=0).T), axis=1) for loop in each.loops]
        shape = PathPatch(
            Curve.make_compound_path(*map(Curve, rings)), facecolor=FILL[each.body], edgecolor=BLACK, lw=0.9
        )
        drawn = [sheet.axes.add_patch(shape)]
        for name, edges in each.named:
            pieces = [np.stack(sheet.at(*chain.T), axis=-1) for chain in _chains(edges)]
            drawn.append(sheet.axes.add_collection(LineCollection(pieces, colors=COLOURS[name], lw=2.0, zorder=2)))
        for part in drawn:
            part.set_clip_path(clip)


def _chains(edges: FloatArray) -> list[FloatArray]:
    """Edges (n, 2, 2) that follow each other joined to lines, each of its points (k, 2)."""
    parts = np.split(edges, 1 + np.flatnonzero((edges[1:, 0] != edges[:-1, 1]).any(axis=1)))
    return [np.append(part[:, 0], part[-1:, 1], axis=0) for part in parts]


def _name_body(sheet: Sheet, each: Outline, scene: Scene) -> None:
    """The body's name in it; the wheel's with the arrow of the push."""
    contact = np.concatenate([edges for name, edges in each.named if name in ("seat", "bore")])
    z, r = 0.5 * (contact.min(axis=(0, 1)) + contact.max(axis=(0, 1)))
    (low, least), (high, most) = (ends(np.concatenate(each.loops), axis=(0, 1)) for ends in (np.min, np.max))
    if scene.direction == "axial":
        z, r, thick = 0.5 * (low + high), 0.5 * most, most
    elif each.body == "axle":
        r, thick = 0.5 * (least + r), r - least
    else:
        thick = getattr(scene.wheel, "hub_outer_radius", 1.3 * r) - r
        r += 0.5 * thick
    word = each.body if each.body == "axle" else "wheel, pushed →"
    size = float(np.clip(72.0 * thick * sheet.scale, 4.0, 9.0))
    sheet.axes.text(*sheet.at(z, r), word, fontsize=size, fontweight="bold", ha="center", va="center", zorder=6)


def _draw_dimensions(sheet: Sheet) -> None:
    left, right, bottom, top = sheet.box
    for spans, edge, side in ((sheet.view.below, bottom, -1.0), (sheet.view.above, top, 1.0)):
        for span, row in rows(spans, sheet.scale):
            _draw_length(sheet, span, edge + side * (MARGIN + PITCH * row))
    for spans, edge, side in ((sheet.view.left, left, -1.0), (sheet.view.right, right, 1.0)):
        for column, span in enumerate(sorted(spans, key=lambda span: span.high - span.low)):
            _draw_radius(sheet, span, edge + side * (0.25 + PITCH * column), bottom)
    for leader in sheet.view.leaders:
        _draw_leader(sheet, leader)


def _draw_length(sheet: Sheet, span: Span, y: float) -> None:
    (a, feature), (b, _) = sheet.at(span.low, span.feature), sheet.at(span.high, span.feature)
    for x in (a, b):
        sheet.axes.plot([x, x], [feature, y], color="0.55", lw=0.5, zorder=3)
    _arrow(sheet.axes, (a, y), (b, y))
    _words(sheet.axes, (0.5 * (a + b), y + 0.03), span.label, ha="center", va="bottom")


def _draw_radius(sheet: Sheet, span: Span, x: float, bottom: float) -> None:
    (feature, low), (_, high) = sheet.at(span.feature, span.low), sheet.at(span.feature, span.high)
    for y in (low, high):
        sheet.axes.plot([feature, x], [y, y], color="0.55", lw=0.5, zorder=3)
    _arrow(sheet.axes, (x, low), (x, high))
    if sheet.view.title:
        _words(sheet.axes, (x + 0.08, 0.5 * (low + high)), span.label, ha="left", va="center")
        return
    middle = max(0.5 * (low + high), bottom + 0.5 * words_wide(span.label))
    _words(sheet.axes, (x - 0.03, middle), span.label, ha="right", va="center", rotation=90)


def _draw_leader(sheet: Sheet, leader: Leader) -> None:
    x, y = sheet.at(*leader.place)
    across, up = leader.side
    place, anchor = (x + 0.45 * across, y + 0.45 * up), "left" if across > 0.0 else "right"
    if sheet.view.title:  # in the upper left corner of the frame
        place, anchor = (sheet.box[0] + 0.1, sheet.box[3] - 0.15), "left"
    sheet.axes.annotate(
        leader.label, (x, y), place, fontsize=SIZE, zorder=6, ha=anchor, va="center", bbox=_BACK,
        arrowprops={"arrowstyle": "->", "lw": 0.6, "color": INK, "shrinkA": 0.0, "shrinkB": 0.0},
    )  # fmt: skip


_BACK = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85}


def _words(axes: Any, place: tuple[float, float], text: str, **how: Any) -> None:
    axes.text(*place, text, fontsize=SIZE, zorder=6, bbox=_BACK, **how)


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    """A dimension line with arrows at both ends, from outside where it is too short for them."""
    short = abs(end[0] - start[0]) + abs(end[1] - start[1]) < 0.2
    axes.annotate(
        "", end, start, zorder=5,
        arrowprops={"arrowstyle": "|-|,widthA=0.2,widthB=0.2" if short else "<->", "lw": 0.7, "color": INK,
                    "shrinkA": 0.0, "shrinkB": 0.0, "mutation_scale": 7.0},
    )  # fmt: skip


def _corner_scale(corner: View) -> float:
    z0, z1, r0, r1 = corner.window
    return min(CORNER / (z1 - z0), CORNER / (r1 - r0))


def _corner_height(corner: View) -> float:
    """Height of a magnified corner with its dimensions and its title [inch]."""
    scale = _corner_scale(corner)
    _, _, under, over = room(corner, scale)
    return (corner.window[3] - corner.window[2]) * scale + under + over


def _draw_corner(
    axes: Any, whole: Sheet, corner: View, letter: str, outlines: Sequence[Outline], at: tuple[float, float]
) -> None:
    """A corner in its frame, top left corner of its room ``at`` [inch], and its letter on the whole section."""
    from matplotlib.patches import Rectangle

    scale = _corner_scale(corner)
    high = (corner.window[3] - corner.window[2]) * scale
    sheet = Sheet(axes=axes, scale=scale, left=at[0] + 0.1, bottom=at[1] - MARGIN - high, view=corner)
    left, right, bottom, top = sheet.box
    frame = Rectangle((left, bottom), right - left, top - bottom, fill=False, lw=0.8, edgecolor="0.4", zorder=7)
    axes.add_patch(frame)
    _draw_bodies(sheet, [each for each in outlines if each.body == _body_of(corner)], frame)
    _draw_dimensions(sheet)
    times = scale / whole.scale
    title = f"{letter}: {corner.title}, {times:.2g} times as large"
    axes.text(left, top + 0.06, title, fontsize=SIZE + 0.5, fontweight="bold", va="bottom")
    z0, z1, r0, r1 = corner.window
    x, y = whole.at(0.5 * (z0 + z1), 0.5 * (r0 + r1))
    axes.plot(x, y, "o", ms=11, mfc="none", mec=INK, mew=0.8, zorder=6)
    side = -1.0 if _body_of(corner) == "axle" else 1.0
    axes.text(x, y + side * 0.17, letter, fontsize=8, fontweight="bold", ha="center", va="center", zorder=6)


def _body_of(corner: View) -> str:
    return corner.labels()[0].partition(".")[0]


def _notes(scene: Scene, drawn: list[View]) -> list[str]:
    """What the drawing does not show, in lines that fit under it."""
    files = [
        f"mesh.{body} = {printable(getattr(scene.mesh, body))}"
        for body in ("axle", "wheel")
        if getattr(scene.mesh, body)
    ]
    words = unmeasured(scene, drawn)
    at = scene.displacements
    lines = [f"Lengths in mm, to scale. The wheel stands at {at[0]:g} mm and is pushed to {at[-1]:g} mm."]
    lines += files
    while words:
        take = 1
        while take < len(words) and words_wide(", ".join(words[: take + 1])) < WIDEST:
            take += 1
        lines.append(("Not drawn: " if "Not drawn" not in "".join(lines) else "    ") + ", ".join(words[:take]))
        words = words[take:]
    return lines
