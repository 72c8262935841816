"""The page of a wheelset in service, from the files in its folder alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from markupsafe import Markup

from ..base.arrays import FloatArray
from ..base.figure import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION
from ..base.files import read_regular
from ..errors import OutputError
from ..results.folder import SCENE
from ..scene import load_scene
from ..scene.keys import ServiceKeys
from .chart import Frame, legend, path, span
from .inputs import computed
from .page import MOST_BYTES, read_json

NEEDED = ("title", "bonded", "friction", "endurance", "verdict", "doubts", "ended", "versions", "provenance")
STRESSES = {
    "nominal_stress_MPa": ("nominal", BLACK, "7 4"),
    "bonded_bending_stress_MPa": ("bonded fit", BLUE, ""),
    "largest_axial_stress_MPa": ("largest, with press and friction", VERMILION, ""),
    "least_axial_stress_MPa": ("least, with press and friction", ORANGE, ""),
}
CRITERIA = {
    "crossland": ("Crossland", BLUE, ""),
    "dang_van": ("Dang Van", VERMILION, ""),
    "findley": ("Findley", GREEN, ""),
}
SLIPS = {
    "axial_slip_range_mm": ("slip range along the axle", BLUE, ""),
    "around_slip_range_mm": ("slip range around it", PURPLE, "7 4"),
    "opening_mm": ("opening", ORANGE, "2 3"),
}
WORST = {
    "axial_stress_amplitude_MPa": ("Amplitude of the axial stress", "MPa"),
    "crossland": ("Crossland", "of the limit"),
    "dang_van": ("Dang Van", "of the limit"),
    "findley": ("Findley", "of the limit"),
    "swt_MPa": ("Smith, Watson, Topper", "MPa"),
    "ruiz_MPa2_mm": ("Ruiz and Chen", "MPa² mm"),
}
BALANCES = {
    "work_balance": "Work of the loads against that of friction, over the latter",
    "slip_left_by_revolution.axial": "Slip along the axle that the last revolution leaves, over its largest range",
    "slip_left_by_revolution.around": "The same around the axle",
    "wave_error.axial": "How far pressure and shear along are from a wave that turns with the loads",
    "wave_error.around": "The same of the shear around the axle",
    "steps": "Steps of a revolution",
    "harmonics": "Highest harmonic",
    "newton_iterations": "Newton iterations",
}


def service_page(folder: Path) -> dict[str, Any]:
    """What the template `service.html` is filled with.

    Raises:
        MacrofitError: a file of the folder is missing or damaged.
    """
    numbers = read_json(folder / "service.json", NEEDED)
    scene = load_scene(folder / SCENE)
    scene = msgspec.structs.replace(scene, service=scene.service or ServiceKeys())
    return computed(folder, scene, numbers) | {
        "what": "a wheelset in service",
        "verdict": numbers["verdict"],
        "charts": _charts(folder, turned=numbers["friction"] is not None),
        "worst": WORST,
        "balances": {} if numbers["friction"] is None else {f"friction.{key}": said for key, said in BALANCES.items()},
    }


def _charts(folder: Path, *, turned: bool) -> list[tuple[str, Markup]]:
    """Curves along the seat, each with what it is."""
    seat = _columns(folder / "seat.csv")
    found = [("Axial stress at the surface of the seat", _chart(seat, STRESSES, 1.0, "axial stress [MPa]"))]
    if turned:
        wear = _columns(folder / "fretting.csv")
        found += [
            ("Criteria over what a smooth surface bears", _chart(seat, CRITERIA, 1.0, "share of the limit [-]")),
            ("Slip and opening over a revolution", _chart(wear, SLIPS, 1e3, "slip, opening [um]")),
        ]
    return found


def _chart(
    columns: dict[str, FloatArray], curves: dict[str, tuple[str, str, str]], factor: float, beside: str
) -> Markup:
    """Columns of a table over the place, those that it has."""
    there = {name: said for name, said in curves.items() if name in columns}
    z = columns["z_mm"]
    low, high = span(np.concatenate([factor * columns[name] for name in there]))
    frame = Frame(x0=float(z[0]), x1=float(z[-1]), y0=low, y1=high, height=280.0)
    drawn = [
        path(frame.line(z, factor * columns[name]), colour, dash=dash, mark=name)
        for name, (_, colour, dash) in there.items()
    ]
    keys = [(said, colour, dash) for said, colour, dash in there.values()]
    return frame.drawing(frame.axes("z along the axle [mm]", beside), *drawn, name=beside) + legend(keys)


def _columns(path_: Path) -> dict[str, FloatArray]:
    """The columns of a table of numbers.

    Raises:
        OutputError: it is none.
    """
    try:
        head, *rows = read_regular(path_, MOST_BYTES).decode().split()
        values = np.array([row.split(",") for row in rows], dtype=np.float64)
        found = dict(zip(head.split(","), values.T, strict=True))
    except ValueError as error:
        raise OutputError(f"{path_}: cannot be read ({error}); compute it again") from None
    if "z_mm" not in found or len(values) < 2:
        raise OutputError(f"{path_}: is no table of a seat; compute it again")
    return found
