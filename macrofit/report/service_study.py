"""The page of a study of wheelsets in service, from the files in its folder alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .inputs import studied
from .page import read_json
from .study import study_rows

NEEDED = ("title", "scene", "keys", "runs", "statistics", "verdicts", "ended", "doubts", "versions", "provenance")
COLUMNS = {
    "friction_work_N_mm": ("friction work [J]", 1e-3), "front_slip_range_mm": ("slip, front [um]", 1e3),
    "inner_slip_range_mm": ("slip, inner [um]", 1e3), "front_slip_zone_mm": ("slip zone, front [mm]", 1.0),
    "inner_slip_zone_mm": ("slip zone, inner [mm]", 1.0), "nominal_stress_MPa": ("nominal stress [MPa]", 1.0),
    "axial_stress_amplitude_MPa": ("amplitude of axial stress [MPa]", 1.0),
    "crossland": ("Crossland, of the limit", 1.0), "dang_van": ("Dang Van, of the limit", 1.0),
    "findley": ("Findley, of the limit", 1.0), "ruiz_MPa2_mm": ("Ruiz and Chen [MPa² mm]", 1.0),
}  # fmt: skip
"""What the table has of each run, and the spread of all: the heading and the factor of a measure."""


def service_study_page(folder: Path) -> dict[str, Any]:
    """What the template `service_study.html` is filled with.

    Raises:
        OutputError: a file of the folder is missing or damaged.
    """
    numbers = read_json(folder / "service-study.json", NEEDED)
    keys = numbers["keys"]
    rows = study_rows(folder / "service-study.csv", ("run", "label", *keys, "verdict", "ended"), COLUMNS)
    return studied(folder, numbers, [(row, _values(row, keys)) for row in rows], COLUMNS, COLUMNS)


def _values(row: dict[str, str], keys: list[str]) -> list[str]:
    """The values of the varied keys of a run; none of a reference, which is told by its name."""
    values = [row[key] for key in keys]
    return values if any(values) else []
