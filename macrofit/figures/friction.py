"""The figure of a coefficient of friction that varies: along the seat at three displacements, and over the pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import FloatArray
from ..base.figure import BLUE, GREEN, VERMILION, blank, placed

if TYPE_CHECKING:
    from ..solution import Increment, PairFrictionMap, Solution

COLOURS = (BLUE, GREEN, VERMILION)
"""One for each displacement shown."""
BELOW = 0.5
"""Room for the words under the axes [inch]."""
FLATTEST = 0.02
"""Least height of the axis of coefficients [-], so that rounding is not drawn as variation."""


def friction(solution: Solution, pairs: PairFrictionMap) -> Any:
    """Left: the coefficient of the seat's facets in contact, with a band of one standard deviation of each side.

    Right: the coefficient of every pair of tiles met, seat tile along x and bore tile along y; the pairs that face
    each other at a displacement lie on a falling line.
    """
    stages = _stages(solution.increments)
    colours = COLOURS[-len(stages) :]
    figure = blank(10.5, 5.0)
    step = (5.0 - BELOW - 0.32) / len(stages)
    rows: list[Any] = []
    for k, (record, colour) in enumerate(zip(stages, colours, strict=True)):
        first = rows[0] if rows else None
        bottom = BELOW + (len(stages) - 1 - k) * step
        rows.append(placed(figure, 0.75, bottom, 4.1, step - 0.26, sharex=first, sharey=first))
        _along(rows[-1], solution, pairs, record, colour)
        rows[-1].tick_params(labelbottom=k == len(stages) - 1, labelsize=9)
    coordinate = "z along the axle" if solution.scene.direction == "radial" else "radius r"
    rows[-1].set_xlabel(f"{coordinate} [mm]")
    rows[len(rows) // 2].set_ylabel("coefficient of friction [-]")
    rows[0].set_ylim(*_range(solution, pairs, stages))
    held = np.flatnonzero(np.any([record.facets.pressure > 0.0 for record in stages], axis=0))
    rows[0].set_xlim(solution.seat[held[0]], solution.seat[held[-1] + 1])
    drawn = _pair_map(figure, pairs)
    for record, colour in zip(stages, colours, strict=True):
        _facing(drawn, pairs, record.displacement, colour)
    if solution.scene.title:
        figure.suptitle(solution.scene.title, fontsize=10, y=1.0 - 0.08 / 5.0, va="top")
    return figure


def _along(axes: Any, solution: Solution, pairs: PairFrictionMap, record: Increment, colour: Any) -> None:
    """One displacement: the facets in contact, and their mean weighted with the pressure."""
    value = np.where(record.facets.pressure > 0.0, record.facets.friction, np.nan)
    spread = facet_uncertainty(solution, pairs, record.displacement)
    if np.isfinite(value + spread).any():
        band = {"baseline": value - spread, "fill": True, "color": colour, "alpha": 0.28, "lw": 0}
        axes.stairs(value + spread, solution.seat, **band)
    axes.stairs(value, solution.seat, color=colour, lw=1.3, baseline=None)
    axes.axhline(record.mean_friction, color="0.45", lw=0.9, ls=(0, (4, 3)), zorder=1)
    axes.set_title(
        f"{record.displacement:g} mm, mean weighted with the pressure {record.mean_friction:.4f}",
        fontsize=9, loc="left", pad=3, color=colour, y=1.0,
    )  # fmt: skip
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="0.92", lw=0.6)
    axes.set_axisbelow(True)


def _range(solution: Solution, pairs: PairFrictionMap, stages: Sequence[Increment]) -> tuple[float, float]:
    """The axis of coefficients: that of the facets in contact with their bands, and room around it."""
    ends = []
    for record in stages:
        held = record.facets.pressure > 0.0
        spread = np.nan_to_num(facet_uncertainty(solution, pairs, record.displacement)[held])
        ends += [record.facets.friction[held] - spread, record.facets.friction[held] + spread]
    low, high = float(np.concatenate(ends).min()), float(np.concatenate(ends).max())
    room = max(0.08 * (high - low), 0.5 * (FLATTEST - (high - low)))
    return max(0.0, low - room), high + room


def facet_uncertainty(solution: Solution, pairs: PairFrictionMap, displacement: float) -> FloatArray:
    """Standard deviation of the friction of each facet [-], (facets,): sqrt(sum (w_p s_p)^2) / sum w_p.

    w_p is the length over which the facet faces pair p, s_p the pair's standard deviation; pairs are taken as
    independent. NaN where a pair states none or was not met, and everywhere where pairs change in the run.
    """
    facets = len(solution.seat) - 1
    if not pairs.lasting or not np.isfinite(pairs.uncertainty).any():
        return np.full(facets, np.nan)
    met = pairs.tiling.facing(solution.seat, displacement)
    table = np.full((pairs.tiling.seat_tiles, pairs.tiling.bore_tiles), np.nan)
    table[pairs.seat, pairs.bore] = pairs.uncertainty
    variance = np.bincount(met.facet, (met.weight * table[met.seat, met.bore]) ** 2, minlength=facets)
    total = np.bincount(met.facet, met.weight, minlength=facets)
    spread = np.full(facets, np.nan)
    spread[total > 0.0] = np.sqrt(variance[total > 0.0]) / total[total > 0.0]
    return spread


def _pair_map(figure: Any, pairs: PairFrictionMap) -> Any:
    """The coefficient of the pairs met, as an image; pairs that never met stay white."""
    table = np.full((pairs.bore.max() + 1, pairs.seat.max() + 1), np.nan)
    table[pairs.bore, pairs.seat] = pairs.coefficient
    left, width, height = 5.6, 3.75, 3.9  # at most
    scale = min(width / table.shape[1], height / table.shape[0])
    bottom = BELOW + 0.5 * (height - scale * table.shape[0])
    axes = placed(figure, left, bottom, scale * table.shape[1], scale * table.shape[0])
    low, high = np.nanpercentile(pairs.coefficient, [1.0, 99.0]) if pairs.seat.size > 500 else (None, None)
    image = axes.imshow(
        table, origin="lower", cmap="cividis", vmin=low, vmax=high, interpolation="nearest", aspect="equal",
        extent=(0, table.shape[1], 0, table.shape[0]),
    )  # fmt: skip
    extend = "neither" if low is None else "both"
    beside = placed(figure, left + scale * table.shape[1] + 0.12, BELOW + 0.2, 0.16, height - 0.4)
    bar = figure.colorbar(image, cax=beside, extend=extend, extendfrac=0.02)
    bar.set_label("coefficient of friction of a pair [-]" + ("" if pairs.lasting else ", latest"), fontsize=10)
    bar.ax.tick_params(labelsize=9)
    size, origin = pairs.tiling.size, pairs.tiling.seat_origin
    axes.set_xlabel(f"seat tile [{size:g} mm each, from z = {origin:g} mm]")
    axes.set_ylabel(f"bore tile [{size:g} mm each, from the leading edge]")
    axes.tick_params(labelsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def _facing(axes: Any, pairs: PairFrictionMap, displacement: float, colour: str) -> None:
    """The line of pairs that face each other at a displacement."""
    tiling = pairs.tiling
    shift = displacement if tiling.radial else 0.0
    leading = (tiling.bore_ends[1] + shift - tiling.seat_origin) / tiling.size  # of the bore, in tiles of the seat
    width, height = pairs.seat.max() + 1, pairs.bore.max() + 1
    x = np.clip([leading - height, leading], 0, width)
    for line in ({"color": "white", "lw": 3.0}, {"color": colour, "lw": 1.6}):
        axes.plot(x, leading - x, **line, solid_capstyle="butt", clip_on=False)


def _stages(records: Sequence[Increment]) -> list[Increment]:
    """Up to three increments in contact, evenly spaced, the last of them included."""
    touching = [record for record in records if record.normal_force > 0.0]
    places = np.linspace(0, len(touching), len(COLOURS) + 1)[1:].round().astype(int) - 1
    return [touching[k] for k in dict.fromkeys(places.tolist()) if k >= 0]
