"""Pressure and shear along the seat at every displacement, packed for the slider of the page."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..base.arrays import FloatArray, IntArray
from ..base.figure import BLUE, VERMILION
from ..errors import OutputError
from .chart import Frame, path, span

MOST_VALUES = 75_000
"""Facets times displacements in a page; each takes 8 bytes of it."""
STEPS = 32_000
"""A value is a whole number of this part of the largest one."""
SHOWN = {
    "displacement_mm": ("displacement", 1.0, "mm"),
    "force_N": ("pushing force", 1e-3, "kN"),
    "normal_force_N": ("normal force", 1e-3, "kN"),
    "mean_friction": ("mean friction", 1.0, ""),
    "max_pressure_MPa": ("largest pressure", 1.0, "MPa"),
}
"""Columns of the fitting curve that follow the slider: name, factor, unit."""


@dataclass(frozen=True, kw_only=True)
class Seat:
    """The seat's facets at the increments that the page shows."""

    coordinate: str
    edges: FloatArray  # (facets + 1,) mm
    pressure: FloatArray  # (shown, facets) MPa
    traction: FloatArray  # (shown, facets) MPa
    friction: FloatArray  # (shown, facets)
    shown: IntArray  # numbers of the increments

    @cached_property
    def bound(self) -> FloatArray:
        """What friction can hold (shown, facets) [MPa], with the sign that the shear has on the whole."""
        sign = np.where(self.traction.sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        return np.asarray(sign * self.friction * self.pressure)


def read_seat(path: Path, increments: int) -> Seat | None:
    """The seat of a run's interface.h5; None where the file, or the facets' places, are not known.

    Raises:
        OutputError: the file is damaged, or of another run than a curve of this many increments.
    """
    if not path.is_file():
        return None
    import h5py

    try:
        with h5py.File(path, "r") as file:
            edges = np.append(file["facet_start"][:], file["facet_end"][-1:])
            if len(file["displacement"]) != increments:
                raise OutputError(f"{path}: is not of the fitting curve beside it; compute the run again")
            if increments == 0 or len(edges) < 2 or not np.isfinite(edges).all():
                return None
            shown = shown_increments(increments, len(edges) - 1)
            pressure, traction, friction = (file[name][:][shown] for name in ("pressure", "traction", "friction"))
            coordinate = "z along the axle" if file.attrs["coordinate"] == "z" else "radius r"
    except (OSError, KeyError, ValueError) as error:
        raise OutputError(f"{path}: cannot be read ({error}); compute the run again") from None
    return Seat(
        coordinate=coordinate, edges=edges, pressure=pressure, traction=traction, friction=friction, shown=shown
    )


def shown_increments(increments: int, facets: int) -> IntArray:
    """The numbers of as many increments as fit on a page, evenly spaced, the last one among them."""
    every = -(-increments // max(1, MOST_VALUES // facets))
    return np.arange(increments - 1, -1, -every)[::-1]


def seat_view(seat: Seat, curve: Mapping[str, FloatArray], whole: Frame) -> dict[str, Any]:
    """The drawings of pressure and shear at the last displacement, and what the slider needs for the others.

    Args:
        seat: what is shown.
        curve: the columns of the fitting curve.
        whole: the frame of the fitting curve, on which a dot follows the slider.
    """
    x0, x1 = float(seat.edges[0]), float(seat.edges[-1])
    low, high = span(seat.pressure)
    pressure = Frame(x0=x0, x1=x1, y0=low, y1=high, height=280.0)
    low, high = span(np.concatenate([seat.traction, seat.bound]))
    shear = Frame(x0=x0, x1=x1, y0=low, y1=high, height=280.0)
    below = f"{seat.coordinate} [mm]"
    return {
        "count": len(seat.shown),
        "left_out": len(curve["force_N"]) - len(seat.shown),
        "pressure": pressure.drawing(
            pressure.axes(below, "contact pressure [MPa]"),
            path(pressure.stairs(seat.edges, seat.pressure[-1]), BLUE, mark="pressure"),
            name="contact pressure along the seat",
        ),
        "shear": shear.drawing(
            shear.axes(below, "shear on the axle [MPa]"),
            path(shear.stairs(seat.edges, seat.traction[-1]), BLUE, mark="traction"),
            path(shear.stairs(seat.edges, seat.bound[-1]), VERMILION, width=1.2, dash="5 3", mark="bound"),
            name="shear along the seat",
        ),
        "readouts": [
            {"key": key, "name": name, "factor": factor, "unit": unit, "value": float(curve[key][-1])}
            for key, (name, factor, unit) in SHOWN.items()
        ],
        "data": _data(seat, curve, pressure, shear, whole),
        "dot": Markup('<circle id="dot" r="5" cx="{:.2f}" cy="{:.2f}" class="dot"/>').format(
            float(whole.across(curve["displacement_mm"][-1])), float(whole.up(curve["force_N"][-1] / 1e3))
        ),
    }


def _data(seat: Seat, curve: Mapping[str, FloatArray], pressure: Frame, shear: Frame, whole: Frame) -> dict[str, Any]:
    """What the script of the page reads: pixels of the facets' ends, packed values, the curve's columns."""
    columns = {key: curve[key][seat.shown] for key in SHOWN}
    return {
        "edges": pressure.across(seat.edges).round(2).tolist(),
        "lines": [
            _packed("pressure", seat.pressure, pressure),
            _packed("traction", seat.traction, shear),
            _packed("bound", seat.bound, shear),
        ],
        "columns": {key: values.tolist() for key, values in columns.items()},
        "dot": [whole.across(columns["displacement_mm"]).round(2).tolist(),
                whole.up(columns["force_N"] / 1e3).round(2).tolist()],
    }  # fmt: skip


def _packed(name: str, values: FloatArray, frame: Frame) -> dict[str, Any]:
    """Values (shown, facets) as 16-bit integers, and the pixel of zero and those of one of them."""
    step = float(np.abs(values).max(initial=0.0)) / STEPS or 1.0
    whole = np.rint(values / step).astype("<i2")
    return {
        "name": name,
        "zero": float(frame.up(0.0)),
        "pixels": float(frame.up(step) - frame.up(0.0)),
        "values": base64.b64encode(whole.tobytes()).decode(),
    }
