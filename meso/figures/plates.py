"""Figures for a report: the two rough faces, the two plates, their forces, and what the beams' parameters do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.base.figure import BLUE, COLOURS, DPI, VERMILION, blank, placed, plain, save

from ..surfaces.roughness import measure
from ..surfaces.surface import Surface
from .render import View, draw, outside

if TYPE_CHECKING:
    from ..calibrate import Influence
    from ..plates import Plates
    from ..records import Curve, Slide


MANY = 6
"""Slides named in a figure; more are drawn without."""
WIDTH = 1250
"""Pixels of the picture of the plates."""
LEVELS = 9
"""Contour lines of a map: a shade would give a height another colour than its bar has."""


def write_figures(folder: Path, plates: Plates, envelopes: dict[str, Surface], slides: Sequence[Slide]) -> list[Path]:
    """Every figure of a run. Raises OutputError when one cannot be written."""
    drawn = {
        "surfaces.png": surfaces(plates, envelopes),
        "plates.png": plates_seen(plates),
        "forces.png": forces(slides),
    }
    return [save(figure, folder / name) for name, figure in drawn.items()]


def surface(face: Surface, title: str) -> Any:
    """One rough face as a map."""
    scale, (length, width) = 3.3 / max(face.size[1], 0.3 * face.size[0]), face.size
    across, up = scale * length, scale * width
    figure = blank(across + 1.6, up + 0.85)
    axes = placed(figure, 0.55, 0.5, across, up)
    _maps(figure, [axes], [face])
    axes.set_title(title, fontsize=10, y=1.0)
    axes.set_xlabel("x, along the slide [mm]", fontsize=9)
    axes.set_ylabel("y [mm]", fontsize=9)
    return figure


def surfaces(plates: Plates, envelopes: dict[str, Surface]) -> Any:
    """Both rough faces as maps; below them the envelopes of the spheres that stand for them, down to a mean radius.

    The Sq of the spheres is that of summary.json: away from the edges of the plates.
    """
    packings = {"wheel": plates.wheel_packing, "axle": plates.axle_packing}
    wheel, axle = (packing.surface for packing in packings.values())
    scale = 7.4 / (wheel.size[0] + axle.size[0])
    across, up = [scale * face.size[0] for face in (wheel, axle)], scale * wheel.size[1]
    figure = blank(sum(across) + 2.05, 2.0 * up + 1.25)
    lefts, bottoms = (0.55, 1.0 + across[0]), (0.85 + up, 0.48)
    axes = [[placed(figure, x, y, w, up) for x, w in zip(lefts, across, strict=True)] for y in bottoms]
    _maps(figure, axes[0], [wheel, axle])
    _maps(figure, axes[1], [envelopes[body] for body in packings], depth=float(plates.lattice.radii.mean()))
    for upper, lower, (body, packing) in zip(*axes, packings.items(), strict=True):
        upper.set_title(f"{body}: surface, Sq {1e3 * measure(packing.surface).Sq:.2f} µm", fontsize=9.5, y=1.0)
        upper.tick_params(labelbottom=False)
        spheres = 1e3 * measure(packing.inner_envelope).Sq
        lower.set_title(f"{body}: its spheres, Sq {spheres:.0f} µm", fontsize=9.5, y=1.0)
        lower.set_xlabel("x, along the slide [mm]", fontsize=9)
    for left, right in axes:
        left.set_ylabel("y [mm]", fontsize=9)
        right.tick_params(labelleft=False)
    return figure


def _maps(figure: Any, axes: Sequence[Any], faces: Sequence[Surface], depth: float = np.inf) -> None:
    """Maps in one scale of colours, with its bar; it ends `depth` [mm] below the highest point."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    colours = colormaps["viridis"]
    high = max(float(face.heights.max()) for face in faces)
    low = max(min(float(face.heights.min()) for face in faces), high - depth)
    scale = Normalize(1e3 * low, 1e3 * max(high, low + 1e-9))
    for each, face in zip(axes, faces, strict=True):
        length, width = face.size
        box = each.get_position().size * figure.get_size_inches() * DPI
        x, y = (np.linspace(0.0, side, max(2, round(pixels))) for side, pixels in zip(face.size, box, strict=True))
        heights = face.at(x[None, :], y[:, None])  # rows from below
        shown = colours(scale(1e3 * heights), bytes=True)  # a picture of heights would be resampled twice
        each.imshow(shown, extent=(0.0, length, 0.0, width), origin="lower", interpolation="nearest")
        if depth == np.inf:
            lines = {"levels": np.linspace(scale.vmin, scale.vmax, LEVELS + 2)[1:-1], "linestyles": "solid"}
            each.contour(x[::6], y[::6], 1e3 * heights[::6, ::6], colors="white", linewidths=0.5, alpha=0.6, **lines)
        each.tick_params(labelsize=8.5)
        each.xaxis.set_major_locator(MaxNLocator(min(10, max(2, round(5 * length / width))), steps=[1, 2, 5, 10]))
    extend = "min" if depth < np.inf else "neither"
    last, (across, up) = axes[-1].get_position(), figure.get_size_inches()
    place = placed(figure, across * last.x1 + 0.12, up * last.y0, 0.17, up * last.height)
    bar = figure.colorbar(ScalarMappable(scale, colours), cax=place, extend=extend)
    bar.set_label("height [µm]", fontsize=9)
    bar.ax.tick_params(labelsize=8.5)


def plates_seen(plates: Plates) -> Any:
    """The two plates of spheres at their first touch, the wheel's on the axle's, seen obliquely."""
    view = View()
    lift = np.array([0.0, 0.0, plates.first_touch])
    pieces = {"wheel": (plates.wheel, lift, VERMILION), "axle": (plates.axle, np.zeros(3), BLUE)}
    centres, radii, colours = [], [], []
    for lattice, shift, colour in pieces.values():
        shown = outside(view, lattice.centres, lattice.radii)
        centres.append(lattice.centres[shown] + shift)
        radii.append(lattice.radii[shown])
        colours.append(_shades(colour, int(shown.sum())))
    image, extent = draw(view, np.concatenate(centres), np.concatenate(radii), np.concatenate(colours), width=WIDTH)
    left, right, bottom, top = extent
    inch = WIDTH / DPI / (right - left)  # of a mm: a pixel of the picture is one of the figure, and none is resampled
    left, right, bottom, top = left - 0.06, right + 0.06, bottom - 0.16, top + 0.06
    across, up = inch * (right - left), inch * (top - bottom)
    figure = blank(across, up)
    axes = placed(figure, 0.0, 0.0, across, up)
    axes.imshow(image, extent=extent, interpolation="nearest")
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.set_axis_off()
    _label_plates(axes, view, plates)
    return figure


def _shades(colour: str, count: int) -> FloatArray:
    """A colour, a little lighter or darker from sphere to sphere, shape (count, 3)."""
    from matplotlib.colors import to_rgb

    tone = np.random.default_rng(0).uniform(0.80, 1.15, count)
    shades: FloatArray = np.clip(np.array(to_rgb(colour)) * tone[:, None] + 0.04, 0.0, 1.0)
    return shades


def _label_plates(axes: Any, view: View, plates: Plates) -> None:
    (length, width), thickness = plates.axle_packing.size, plates.settings.plates.thickness
    edge = plates.settings.plates.edge
    top, off = 2.0 * thickness + plates.first_touch, 0.07 * width
    grey = "0.25"

    def arrow(start: Sequence[float], end: Sequence[float], text: str, side: tuple[int, int], **style: Any) -> None:
        a, b = view.flat([start, end])
        axes.annotate("", b, a, arrowprops={"color": grey, "shrinkA": 0, "shrinkB": 0} | style)
        place = {"textcoords": "offset points", "ha": "center", "va": "center"}
        axes.annotate(text, 0.5 * (a + b), side, fontsize=11, color=grey, **place)

    between = {"arrowstyle": "<->", "lw": 0.9}
    arrow((0.0, -off, 0.0), (length, -off, 0.0), f"{length:g} mm", (-12, -12), **between)
    arrow((length + off, 0.0, 0.0), (length + off, width, 0.0), f"{width:g} mm", (24, -10), **between)
    behind = width + 0.5 * off
    slide = {"arrowstyle": "-|>", "lw": 2.2, "mutation_scale": 18}
    arrow((edge + 0.1 * edge, behind, top), (edge + 0.5 * edge, behind, top), "slide", (8, 12), **slide)
    for text, colour, place in (
        ("wheel", VERMILION, (0.62 * edge, behind, top + 0.07 * width)),
        ("axle", BLUE, (length - 0.12 * edge, behind, thickness + 0.07 * width)),
    ):
        x, y = view.flat(place)
        axes.text(x, y, text, fontsize=15, weight="bold", color=colour, ha="center", va="bottom")


def forces(slides: Sequence[Slide]) -> Any:
    """Squeeze and slide: normal and tangential force, and below their ratio with its mean and the error of the mean."""
    figure = blank(8.2, 5.6)
    squeeze, slide = placed(figure, 0.65, 3.2, 1.6, 2.1), placed(figure, 2.85, 3.2, 5.2, 2.1)
    ratio, words = placed(figure, 2.85, 0.5, 5.2, 2.4, sharex=slide), placed(figure, 0.25, 0.5, 1.6, 2.1)
    first = slides[0]
    squeeze.plot(1e3 * first.squeeze.displacement, first.squeeze.normal, color="black", lw=1.5)
    slide.plot(first.curve.displacement, first.curve.normal, color="black", lw=1.3, label="normal N")
    for k, (each, colour) in enumerate(zip(slides, _colours(len(slides)), strict=True)):
        squeeze.plot(1e3 * each.squeeze.displacement, each.squeeze.tangential, color=colour, lw=1.2)
        label = f"tangential T, micro {each.micro_friction:g}" if len(slides) > 1 else "tangential T"
        slide.plot(
            each.curve.displacement, each.curve.tangential, color=colour, lw=1.2, label=label if k < MANY else None
        )
        _ratio(ratio, each.curve, colour)
    _scale_ratio(ratio, [each.curve for each in slides])
    top = max(1.0, *(float(each.curve.normal.max()) for each in slides), float(first.squeeze.normal.max()))
    low = min(0.0, *(float(each.curve.tangential.min()) for each in slides))
    for axes in (squeeze, slide):
        plain(axes)
        axes.set_ylim(1.1 * low, 1.12 * top)
        axes.margins(x=0.01)
    plain(ratio)
    slide.tick_params(labelbottom=False, labelleft=False)
    squeeze.set_ylabel("force [N]")
    squeeze.set_xlabel("approach [µm]")
    squeeze.set_title("squeeze", fontsize=10, y=1.0)
    slide.set_title(f"slide ({first.engine})", fontsize=10, y=1.0)
    ratio.set_ylabel("T / N")
    ratio.set_xlabel("displacement of the wheel [mm]")
    words.set_axis_off()
    handles, labels = slide.get_legend_handles_labels()
    words.legend(handles, labels, loc="upper left", frameon=False, fontsize=9, handlelength=1.4, borderaxespad=0.0)
    below = 0.94 - 0.088 * len(handles)
    words.text(0.05, below, _numbers(slides), transform=words.transAxes, fontsize=9, va="top", linespacing=1.5)
    return figure


def _numbers(slides: Sequence[Slide]) -> str:
    """Coefficients of the first few slides, micro and meso."""
    lines = ["friction micro → meso"]
    for each in slides[:MANY]:
        lines.append(f"{each.micro_friction:g} → {each.curve.coefficient:.4f} ± {each.curve.uncertainty:.4f}")
    return "\n".join([*lines, "…"] if len(slides) > MANY else lines)


def _ratio(axes: Any, curve: Curve, colour: Any) -> None:
    """T/N, the meso coefficient and the band of its standard error."""
    axes.plot(curve.displacement, curve.friction, color=colour, lw=0.9, alpha=0.75)
    mean, error = curve.coefficient, curve.uncertainty
    if np.isfinite(mean):
        axes.axhspan(mean - error, mean + error, color=colour, alpha=0.20, lw=0)
        axes.axhline(mean, color=colour, lw=1.2, ls=(0, (5, 3)))


def _scale_ratio(axes: Any, curves: Sequence[Curve]) -> None:
    """Limits from T/N, or from the bulk of it: it runs off where contact is nearly lost."""
    values = np.concatenate([curve.friction[np.isfinite(curve.friction)] for curve in curves])
    if len(values):
        low, high = np.quantile(values, [0.02, 0.98])
        if np.ptp(values) < 3.0 * (high - low):
            low, high = values.min(), values.max()
        means = [curve.coefficient for curve in curves if np.isfinite(curve.coefficient)] or [0.0]
        low, high = min(low, 0.0, *means), max(high, *means)
        axes.set_ylim(low - 0.08 * (high - low) - 1e-4, high + 0.12 * (high - low) + 1e-4)
    axes.axhline(0.0, color="0.5", lw=0.6)


def _colours(count: int) -> list[Any]:
    return [COLOURS[k % len(COLOURS)] for k in range(count)]


def influence_radius(points: Sequence[Influence], title: str = "") -> Any:
    """Macroscopic modulus and Poisson ratio against the radius ratio of the beams, a line for each of their moduli."""
    return _influence(
        points, lambda p: p.beams.radius_ratio, lambda p: p.beams.youngs_modulus,
        "radius ratio of the beams [-]", lambda modulus: f"{modulus / 1e6:.3g} TPa", "modulus of the beams", title,
        nested=True,
    )  # fmt: skip


def influence_modulus(points: Sequence[Influence], title: str = "") -> Any:
    """Macroscopic modulus and Poisson ratio against the modulus of the beams, a line for each radius ratio."""
    return _influence(
        points, lambda p: p.beams.youngs_modulus / 1e6, lambda p: p.beams.radius_ratio,
        "modulus of the beams [TPa]", lambda ratio: f"{ratio:g}", "radius ratio", title,
    )  # fmt: skip


def _influence(
    points: Sequence[Influence],
    along: Callable[[Influence], float],
    family: Callable[[Influence], float],
    label: str,
    name: Callable[[float], str],
    legend: str,
    title: str,
    *,
    nested: bool = False,
) -> Any:
    figure = blank(8.2, 3.5)
    left, right = placed(figure, 0.65, 0.5, 3.3, 2.6), placed(figure, 4.7, 0.5, 3.3, 2.6)
    members = sorted({family(point) for point in points})
    members = members[:: -(-len(members) // len(COLOURS))]  # as many as there are colours
    marks = ["o", "s", "^", "D", "v", "P"]
    for k, (member, colour) in enumerate(zip(members, _colours(len(members)), strict=True)):
        line = sorted((point for point in points if family(point) == member), key=along)
        x = [along(point) for point in line]
        style = {"color": colour, "marker": marks[k % len(marks)], "ms": 4, "lw": 1.2, "label": name(member)}
        left.plot(x, [point.test.youngs_modulus / 1e3 for point in line], **style)
        if nested:  # the lines lie on each other: each is a little smaller than the one below it
            style |= {"ms": 7.5 - 1.8 * min(k, 3), "lw": 2.8 - 0.6 * min(k, 3)}
        right.plot(x, [point.test.poisson_ratio for point in line], **style)
    left.set_ylabel("Young's modulus of the packing [GPa]")
    right.set_ylabel("Poisson ratio of the packing [-]")
    left.set_ylim(bottom=0.0)
    right.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.set_xlabel(label)
        plain(axes)
    if title:
        figure.suptitle(title, fontsize=10)
    left.legend(title=legend, frameon=False, fontsize=9, title_fontsize=9)
    return figure
