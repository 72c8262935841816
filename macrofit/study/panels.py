"""Stress of the runs of a study: that of the first one, and what the others differ from it by.

Two columns of stress that differ by a few percent look the same. One scale for all stresses of a figure, one for all
differences.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..acceptance.fit import yield_stresses
from ..base.arrays import FloatArray
from ..base.figure import blank, placed
from ..figures.body import (
    Window,
    colour_bar,
    deformed,
    draw_axis,
    draw_bodies,
    draw_push,
    draw_yield,
    inside,
    mark_largest_node,
    name_bodies,
    pushed_to,
    whole_window,
    window_around,
)
from ..scene.keys import Shaft
from ..solution import BodyField
from .plan import PlannedRun

Bodies = Mapping[str, BodyField]
Shown = Sequence[tuple[PlannedRun, dict[float, dict[str, BodyField]]]]

LEFT, BETWEEN, BELOW, ABOVE, BARS = 0.72, 0.14, 0.55, 0.62, 1.85
"""Around and between the panels [inch]; the bars of both scales are to the right."""
ACROSS, HIGHEST, NARROWEST = 9.5, 3.2, 1.5
"""Width of all panels together, height and width of one [inch]."""


class _Panel(NamedTuple):
    bodies: Bodies
    values: dict[str, FloatArray]  # MPa
    difference: bool


class _Row(NamedTuple):
    displacement: float  # mm
    window: Window
    title: str
    panels: list[_Panel]


def stress_panels(shown: Shown, zoom: float | None = None) -> Any:
    """Von Mises stress, a column per run and a row per displacement; of all but the first run the difference from it.

    Runs whose meshes are not those of the first show their own stress. With ``zoom`` [mm]: a row for each end of the
    contact, in windows of that width.
    """
    rows = list(_rows(shown, zoom))
    extent = rows[0].window[1] - rows[0].window[0]
    width = max(NARROWEST, min(ACROSS / len(shown), 4.0, HIGHEST * extent[1] / extent[0]))
    height = width * extent[0] / extent[1]
    apart = any(not np.array_equal(row.window, rows[0].window) for row in rows)  # then each row needs its own ticks
    gap = 0.56 if apart else 0.36
    across, pitch = LEFT + len(shown) * (width + BETWEEN) + BARS, height + gap
    figure = blank(across, BELOW + len(rows) * pitch + ABOVE - gap)
    scales = [_scale(rows, difference=difference) for difference in (False, True)]
    drawn: dict[bool, Any] = {}
    for k, row in enumerate(rows):
        bottom = BELOW + (len(rows) - 1 - k) * pitch
        for column, ((run, _), panel) in enumerate(zip(shown, row.panels, strict=True)):
            axes = placed(figure, LEFT + column * (width + BETWEEN), bottom, width, height)
            drawn[panel.difference] = draw_bodies(
                axes, panel.bodies, row.window, panel.values, scale=scales[panel.difference],
                colours="RdBu_r" if panel.difference else "viridis",
            )  # fmt: skip
            if not panel.difference:
                _annotate(axes, row, panel.bodies, run, whole=zoom is None)
            elif zoom is None:
                draw_axis(axes, row.window, named=False)
            axes.set_title(_title(shown, run, row, panel, column, first=k == 0), fontsize=8.5)
            axes.tick_params(labelbottom=apart or k == len(rows) - 1, labelleft=column == 0)
            axes.set_ylabel("" if column else "r [mm]", fontsize=9)
            axes.set_xlabel("z [mm]" if k == len(rows) - 1 else "", fontsize=9)
    tall = len(rows) * pitch - gap
    for difference, label in ((False, "von Mises stress [MPa]"), (True, f"difference from {shown[0][0].label} [MPa]")):
        if difference in drawn:
            part = 0.92 * tall / len(drawn)
            bottom = BELOW + (tall - part if len(drawn) > 1 and not difference else 0.0)
            colour_bar(figure, drawn[difference], label, (across - BARS + 0.1, bottom, 0.15, part))
    return figure


def _rows(shown: Shown, zoom: float | None) -> Iterator[_Row]:
    for displacement in sorted({displacement for _, fields in shown for displacement in fields}):
        columns = [fields.get(displacement, {}) for _, fields in shown]
        panels = [_panel(columns[0], bodies, first=k == 0) for k, bodies in enumerate(columns)]
        for window, name in _windows(shown, columns, zoom):
            yield _Row(displacement, window, f"{displacement:g} mm{name}", panels)


def _panel(reference: Bodies, bodies: Bodies, *, first: bool) -> _Panel:
    """The stress of a run, or where its nodes are those of the first run the difference from its."""
    alike = not first and set(bodies) == set(reference) and all(
        np.array_equal(field.cells, reference[body].cells) and np.allclose(field.points, reference[body].points)
        for body, field in bodies.items()
    )  # fmt: skip
    values = {
        body: field.von_mises - reference[body].von_mises if alike else field.von_mises
        for body, field in bodies.items()
    }
    return _Panel(bodies, values, alike)


def _windows(shown: Shown, columns: Sequence[Bodies], zoom: float | None) -> list[tuple[Window, str]]:
    """Lowest and highest (r, z) [mm] of the panels: all of the runs' bodies, or both ends of the contact."""
    everything = [field for _, fields in shown for bodies in fields.values() for field in bodies.values()]
    axle = shown[0][0].scene.axle
    if zoom is None or not isinstance(axle, Shaft):
        return [(whole_window(everything), "")]
    places = [(0.0, ", at the seat's entrance"), (_leading_end(columns, zoom), ", at the wheel's leading edge")]
    seen = places if places[1][0] > 0.5 * zoom else places[:1]
    return [(window_around(np.array([axle.seat_radius, z]), zoom), name) for z, name in seen]


def _leading_end(columns: Sequence[Bodies], zoom: float) -> float:
    """Where the axle's stress is largest within a window's width behind the wheel's leading edge [mm]."""
    bodies = next(bodies for bodies in columns if bodies)
    leading, axle = float(deformed(bodies["wheel"])[:, 1].max()), bodies["axle"]
    z = deformed(axle)[:, 1]
    near = np.flatnonzero((z > leading - zoom) & (z <= leading))
    return float(z[near[int(axle.von_mises[near].argmax())]]) if len(near) else leading


def _scale(rows: Sequence[_Row], *, difference: bool) -> Any:
    """One scale for the stresses of a figure, or one about zero for the differences: what is in the windows."""
    from matplotlib.colors import Normalize

    top = max(
        (
            float(np.abs(values[inside(deformed(panel.bodies[body]), row.window)]).max(initial=0.0))
            for row in rows
            for panel in row.panels
            if panel.difference == difference
            for body, values in panel.values.items()
        ),
        default=0.0,
    )
    return Normalize(-(top or 1.0) if difference else 0.0, top or 1.0)


def _annotate(axes: Any, row: _Row, bodies: Bodies, run: PlannedRun, *, whole: bool) -> None:
    """Names, axis, push, the largest stress, and where an elastic body is beyond its yield stress."""
    window, bounds = row.window, yield_stresses(run.scene)
    for body, field in bodies.items():
        if getattr(run.scene, body).material.elastic:
            draw_yield(axes, field, window, bounds.get(body))
    if whole:
        draw_axis(axes, window)
        if "wheel" in bodies and pushed_to(run.scene, row.displacement):
            draw_push(axes, bodies["wheel"], window)
    if bodies:
        name_bodies(axes, bodies, window, mark_largest_node(axes, bodies, window))


def _title(shown: Shown, run: PlannedRun, row: _Row, panel: _Panel, column: int, *, first: bool) -> str:
    """The run over its column, with what is taken from it; the row's displacement over its first panel."""
    name = run.label or f"run {run.number}"
    if panel.difference:
        name = f"{name}, less {shown[0][0].label}"
    return "\n".join(filter(None, (name if first else "", row.title if column == 0 else "")))
