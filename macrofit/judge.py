"""A measured curve, or the folder of a run, held against a standard."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from .acceptance import Standard, Verdict, judge, judge_scene, load_standard
from .acceptance.fit import measured_fit
from .acceptance.verdict import DEFAULT, Check
from .base.files import read_regular, write_json
from .errors import OutputError
from .identify.measured import FAR, Measured, Reading, read_measured
from .results.folder import CURVE, SCENE, SUMMARY, read_curve
from .scene import load_scene
from .scene.profile import SMALL_STRAIN

EXIT_CODES = {"accepted": 0, "refused": 1, "undecided": 2}
"""What `macrofit judge` ends with."""
MOST_BYTES = 10_000_000
"""Size of a summary.json; one has a few thousand."""


@dataclass(frozen=True, kw_only=True)
class Seat:
    """What the user says of the fit of a measured curve; a run's folder says it itself."""

    diameter: float | None = None  # mm
    length: float | None = None  # mm
    interference: float | None = None  # mm, on the diameter


def carry_out_judgement(
    source: Path,
    seat: Seat,
    *,
    reading: Reading,
    standard: str | None = None,
    wheel: str | None = None,
    target: Path | None = None,
    as_json: bool = False,
) -> tuple[list[str], int]:
    """Judge a curve or a run, write the verdict to ``target`` as JSON, give its lines and the exit code.

    With ``as_json`` the lines are the same JSON.

    Raises:
        MacrofitError: the curve, the folder, the standard or the target is not what it should be.
    """
    rules = load_standard(standard or DEFAULT)
    if source.is_dir():
        taken, verdict = _of_folder(source, seat, reading, rules, wheel)
    else:
        taken, verdict = _of_curve(source, seat, reading, rules, wheel)
    if target is not None:
        write_json(target, msgspec.to_builtins(verdict))
    if as_json:
        return [msgspec.json.format(msgspec.json.encode(verdict), indent=2).decode()], EXIT_CODES[verdict.word]
    return [f"Curve           {taken}", *lines(verdict)], EXIT_CODES[verdict.word]


def lines(verdict: Verdict) -> list[str]:
    """A verdict for people: a line for each check, and the word."""
    return [
        f"Standard        {verdict.standard}, {verdict.wheel}; seat {verdict.seat_diameter_mm:g} mm in diameter, "
        f"{verdict.length_mm:g} mm long",
        *(_line(check) for check in verdict.checks),
        f"Verdict         {verdict.sentence}",
    ]


def _line(check: Check) -> str:
    said = check.note if check.value is None else f"{check.measured():<22} {check.note or check.limits()}"
    result = "-" if check.result == "not applicable" else check.result
    return f"  {check.name.replace('_', ' '):<22} {result:<9} {said}".rstrip()


def _of_curve(path: Path, seat: Seat, reading: Reading, rules: Standard, wheel: str | None) -> tuple[str, Verdict]:
    if seat.diameter is None or seat.length is None:
        if not path.exists():
            raise OutputError(f"{path}: cannot be read: there is no such file or folder")
        missing = [f"--{name} MM" for name in ("diameter", "length") if getattr(seat, name) is None]
        raise OutputError(f"{path}: say what fit the curve is of: {' and '.join(missing)}, as --diameter 190")
    measured = read_measured(path, reading)
    _check_seat(path, measured, seat.diameter, seat.length, seat.interference or 0.0)
    _check_units(path, measured, seat.length, (rules.window(wheel)[1].high or 0.0) * seat.diameter)
    fit = measured_fit(seat.diameter, seat.length, measured.displacement, measured.force, seat.interference)
    return measured.taken, judge(fit, rules, wheel)


def _check_seat(path: Path, measured: Measured, diameter: float, length: float, interference: float) -> None:
    """Refuse dimensions [mm] that are in other units: no fit has them, and none has such a curve.

    Raises:
        OutputError: the dimension that is.
    """
    way = float(np.ptp(measured.displacement))
    if interference > SMALL_STRAIN * diameter:
        raise OutputError(
            f"--interference {interference:g}: {interference:g} mm are too much for a diameter of {diameter:g} mm; "
            f"--diameter, --length and --interference are in mm"
        )
    for name, value, other in (("diameter", diameter, length), ("length", length, diameter)):
        if not other / FAR < value or ("mm" not in measured.assumed and not way / FAR < value):
            raise OutputError(
                f"--{name} {value:g}: {value:g} mm are no {name} of a fit that is pressed {way:.4g} mm in {path}; "
                f"--diameter, --length and --interference are in mm"
            )


def _check_units(path: Path, measured: Measured, length: float, force: float) -> None:
    """Refuse numbers without a unit that are no mm or N of a fit of this length [mm] and about this force [N].

    Raises:
        OutputError: they are `FAR` from it.
    """
    span, top = float(np.ptp(measured.displacement)), float(np.abs(measured.force).max())
    for unit, found, wanted, example in (("mm", span, length, "displacement_m"), ("N", top, force, "force_kN")):
        if unit in measured.assumed and not wanted / FAR < found < FAR * wanted:
            raise OutputError(
                f"{path}: names no unit, and {found:.4g} {unit} are not those of this fit, about {wanted:.4g} {unit}; "
                f"write the unit in its header, for example {example}"
            )


def _of_folder(folder: Path, seat: Seat, reading: Reading, rules: Standard, wheel: str | None) -> tuple[str, Verdict]:
    if seat != Seat() or reading != Reading():
        raise OutputError(
            f"{folder}: is a folder, whose scene says diameter, length and interference and whose curve is taken "
            f"whole; leave those options out, or give {folder / CURVE}"
        )
    if not (folder / SCENE).is_file():
        raise OutputError(
            f"{folder}: holds no run of macrofit ({SCENE} is missing); a study has them in runs/, with --keep"
        )
    scene = load_scene(folder / SCENE)
    displacement, force = read_curve(folder)
    largest, holds = _of_summary(folder / SUMMARY)
    verdict, reason = judge_scene(scene, displacement, force, largest, rules, wheel, holds)
    if verdict is None:
        raise OutputError(f"{folder}: cannot be judged: {reason}")
    return f"{folder / CURVE}: {len(force)} increments", verdict


def _of_summary(path: Path) -> tuple[dict[str, float], float | None]:
    """Largest von Mises stress of each body [MPa] and the force that the fit holds [N]; none where the run did not end.

    Raises:
        OutputError: the file is damaged.
    """
    if not path.is_file():
        return {}, None
    try:
        numbers: Any = msgspec.json.decode(read_regular(path, MOST_BYTES))
        held = numbers.get("holding")
        holds = None if held is None else min(float(held["push_off_N"]), float(held["pull_off_N"]))
        return {body: float(at["value"]) for body, at in numbers["max_von_mises_MPa"].items()}, holds
    except (msgspec.MsgspecError, ValueError, KeyError, TypeError, AttributeError):
        raise OutputError(f"{path}: is not a summary of macrofit; compute the run again") from None
