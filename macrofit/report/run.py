"""The page of one run, from the files in its folder alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from markupsafe import Markup

from ..acceptance import Verdict, judge_scene, load_standard
from ..base.arrays import FloatArray
from ..base.figure import BLUE, VERMILION
from ..results.curves import without_rounding
from ..results.folder import CURVE, FORCE_SD, INTERFACE, SCENE, SUMMARY, read_table
from ..scene import Scene, load_scene
from .chart import Frame, Window, bands, curve_frame, names, path
from .inputs import computed
from .page import read_json
from .seat import read_seat, seat_view

NEEDED = ("peak_force_N", "max_von_mises_MPa", "verdict", "doubts", "counters", "versions", "energy_balance")
BALANCES = {
    "force_balance": "Largest difference between the pushing force and the reactions of the supports, over the force",
    "energy_balance": "Work of the press against stored and dissipated energy, over the largest of them",
    "max_residual": "Largest residual of an increment, relative",
    "increments": "Increments",
    "unconverged_increments": "Increments that did not converge",
    "cutbacks": "Cutbacks of the increment",
    "newton_iterations": "Newton iterations",
}
TIMES = {
    "dofs": "Degrees of freedom", "setup_cpu_s": "Set-up [CPU s]", "increments_cpu_s": "Increments [CPU s]",
    "stress_cpu_s": "Stress [CPU s]", "total_cpu_s": "Together [CPU s]",
}  # fmt: skip


def run_page(folder: Path, *, standard: str | None = None, wheel: str | None = None) -> dict[str, Any]:
    """What the template `run.html` is filled with.

    Raises:
        MacrofitError: a file of the folder is missing or damaged, or the standard is unknown.
    """
    numbers = read_json(folder / SUMMARY, NEEDED)
    scene = load_scene(folder / SCENE)
    curve = read_table(folder / CURVE)
    if standard is not None:
        numbers = numbers | {"verdict": _judged(scene, curve, numbers, standard, wheel)}
    verdict = None if numbers["verdict"] is None else msgspec.convert(numbers["verdict"], Verdict)
    clear = {**curve, "force_N": without_rounding(curve["force_N"], curve["normal_force_N"])}
    frame = curve_frame(clear["displacement_mm"], clear["force_N"] / 1e3)
    seat = read_seat(folder / INTERFACE, len(curve["force_N"]))
    view = None if seat is None else seat_view(seat, curve, frame)
    return computed(folder, scene, numbers) | {
        "what": "a press fit",
        "verdict": verdict,
        "curve": _curve(clear, frame, verdict, Markup("") if view is None else view["dot"]),
        "seat": view,
        "balances": {key: said for key, said in BALANCES.items() if key in numbers},
        "times": {key: said for key, said in TIMES.items() if key in numbers},
    }


def windows(verdict: Verdict | None) -> list[Window]:
    """The windows of final forces that a verdict knows."""
    if verdict is None:
        return []
    known = (("EN 13260", verdict.en_13260), ("GOST 11018", verdict.gost_11018))
    return [
        Window(name=name, low=window.low / 1e3, high=window.high / 1e3) for name, window in known if window is not None
    ]


def _curve(curve: Mapping[str, FloatArray], frame: Frame, verdict: Verdict | None, dot: Markup) -> Markup:
    """The fitting curve in its windows, the peak marked."""
    x, y = curve["displacement_mm"], curve["force_N"] / 1e3
    parts = [bands(frame, windows(verdict)), frame.axes("displacement of the wheel [mm]", "pushing force [kN]")]
    if len(x):
        top = int(np.argmax(y))
        across, up = float(frame.across(x[top])), float(frame.up(y[top]))
        side = "end" if across > 300.0 else "start"
        parts += [
            path(frame.line(x, y), BLUE),
            Markup('<circle r="4" cx="{:.1f}" cy="{:.1f}" fill="{}"/>').format(across, up, VERMILION),
            Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">peak {:.5g}{} kN at {:.6g} mm</text>').format(
                across + (-10.0 if side == "end" else 10.0), up - 6.0, side, y[top], _deviation(curve, top), x[top]
            ),
        ]
    return frame.drawing(*parts, names(frame, windows(verdict)), dot, name="fitting curve")


def _deviation(curve: Mapping[str, FloatArray], row: int) -> str:
    """The standard deviation of a force, where the provider of friction states one."""
    deviation = curve.get(FORCE_SD)
    return "" if deviation is None or not deviation[row] > 0.0 else f" ± {deviation[row] / 1e3:.2g}"


def _judged(
    scene: Scene, curve: Mapping[str, FloatArray], numbers: Mapping[str, Any], standard: str, wheel: str | None
) -> Any:
    """The verdict by another standard than that of summary.json."""
    largest = {body: at["value"] for body, at in numbers["max_von_mises_MPa"].items()}
    rules = load_standard(standard)
    verdict, _ = judge_scene(scene, curve["displacement_mm"], curve["force_N"], largest, rules, wheel)
    return None if verdict is None else msgspec.to_builtins(verdict)
