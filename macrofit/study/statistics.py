"""Statistics of the runs of a study."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.arrays import FloatArray
from .plan import Plan
from .record import Kept, RunRecord

BODIES = ("axle", "wheel")


MANY = 10
"""From so many runs on, their distributions are drawn."""


def statistics(values: FloatArray) -> dict[str, float]:
    """Mean, standard deviation (n - 1), least, largest and the 5 % and 95 % percentiles of a sample."""
    spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    low, high = np.percentile(values, [5.0, 95.0])
    return {
        "runs": len(values), "mean": float(values.mean()), "standard_deviation": spread,
        "min": float(values.min()), "max": float(values.max()), "percentile_5": float(low),
        "percentile_95": float(high),
    }  # fmt: skip


def varied(plan: Plan, records: Sequence[Kept]) -> list[Kept]:
    """The records of the runs that are no references; of all where nothing is varied."""
    chosen = [record for run, record in zip(plan.runs, records, strict=True) if run.values]
    return chosen or list(records)


def measured_samples(records: Sequence[RunRecord]) -> dict[str, FloatArray]:
    """What a study has the spread of: peak and final force [N], largest von Mises stresses [MPa]."""
    samples = {
        "peak_force_N": np.array([record.peak[0] for record in records]),
        "final_force_N": np.array([record.force_N[-1] for record in records]),
    }
    for body in BODIES:
        if all(body in record.max_von_mises for record in records):
            samples[f"{body}_max_von_mises_MPa"] = np.array([record.max_von_mises[body].value for record in records])
    return samples
