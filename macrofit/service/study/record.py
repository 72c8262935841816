"""What a study of wheelsets in service keeps of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ...base.arrays import FloatArray
from ...base.files import starts_with
from ...study.plan import Plan
from ...study.record import RecordFile
from ...study.statistics import varied

KIND = b"macrofit service study "
MAGIC = KIND + b"1\n"
MEASURES = {
    "friction_work_N_mm": "friction.friction_work_N_mm",
    "front_slip_range_mm": "friction.slip_range_mm.front",
    "inner_slip_range_mm": "friction.slip_range_mm.inner",
    "front_slip_zone_mm": "friction.slip_zone_mm.front",
    "inner_slip_zone_mm": "friction.slip_zone_mm.inner",
    "largest_pressure_MPa": "friction.largest_pressure_MPa",
    "opening_mm": "friction.opening_mm",
    "nominal_stress_MPa": "verdict.nominal_stress_MPa",
    "axial_stress_amplitude_MPa": "endurance.axial_stress_amplitude_MPa.value",
    "crossland": "endurance.crossland.value",
    "dang_van": "endurance.dang_van.value",
    "findley": "endurance.findley.value",
    "swt_MPa": "endurance.swt_MPa.value",
    "ruiz_MPa2_mm": "endurance.ruiz_MPa2_mm.value",
}
"""Columns of the table, and the keys of service.json that they come from."""


class ServiceRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A finished run: its measures, and how it ended."""

    digest: str
    values: dict[str, float | None]  # by the names of MEASURES; None where it ended before that
    verdict: str
    ended: str | None
    doubts: list[str]
    cpu_s: float


def record_of(digest: str, numbers: Mapping[str, Any] | None, ended: str | None, cpu_s: float) -> ServiceRecord:
    """What is kept of a service.json, and why it ended early; without one the wheel was never released."""
    return ServiceRecord(
        digest=digest,
        values={name: _at(numbers, key) for name, key in MEASURES.items()},
        verdict="not judged" if numbers is None else numbers["verdict"]["word"],
        ended=ended,
        doubts=[] if numbers is None else list(numbers["doubts"]),
        cpu_s=cpu_s,
    )


def _at(numbers: Mapping[str, Any] | None, key: str) -> float | None:
    found: Any = reduce(lambda table, part: None if table is None else table[part], key.split("."), numbers)
    return None if found is None else float(found)


class ServiceStudyFile(RecordFile[ServiceRecord]):
    """The file of a study of wheelsets in service."""

    def __init__(self, path: Path, *, replace: bool) -> None:
        """Open or make the file, see `RecordFile`."""
        super().__init__(path, ServiceRecord, MAGIC, replace=replace)


def is_service_study(path: Path) -> bool:
    """Whether the file is there and starts as one of such a study does."""
    return starts_with(path, KIND)


def measured(plan: Plan, records: Sequence[ServiceRecord], name: str) -> FloatArray:
    """The values of a measure over the runs that are no references, those that have it."""
    return np.array([value for record in varied(plan, records) if (value := record.values[name]) is not None])
