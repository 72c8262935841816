"""Stress fields of the runs of a study: kept in one file a run, read back for figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..base.files import replacing, writing
from ..solution import BodyField, Solution
from .plan import PlannedRun
from .statistics import BODIES

FIELDS = "fields"


def fields_file(folder: Path, digest: str) -> Path:
    """Where the fields of a run are kept."""
    return folder / FIELDS / f"{digest[:16]}.npz"


def save_fields(folder: Path, digest: str, solution: Solution) -> None:
    """Keep the fields of a run for the study's stress figures."""
    arrays: dict[str, Any] = {}
    for number, (displacement, bodies) in enumerate(sorted(solution.fields.items())):
        arrays[f"{number}/displacement"] = np.array(displacement)
        for body, field in bodies.items():
            for name in ("points", "cells", "displacement", "stress", "von_mises"):
                arrays[f"{number}/{body}/{name}"] = getattr(field, name)
    target = fields_file(folder, digest)
    with writing(target):
        target.parent.mkdir(exist_ok=True)
    with replacing(target) as draft:
        np.savez_compressed(draft, **arrays)


def load_fields(folder: Path, run: PlannedRun) -> dict[float, dict[str, BodyField]]:
    """The fields `save_fields` kept of a run: displacement -> body -> field; empty where there are none."""
    path = fields_file(folder, run.digest)
    if not path.is_file():
        return {}
    fields: dict[float, dict[str, BodyField]] = {}
    with np.load(path) as arrays:
        for name in [name for name in arrays.files if name.count("/") == 1]:
            number = name.partition("/")[0]
            fields[float(arrays[name])] = {
                body: BodyField(
                    **{
                        part: arrays[f"{number}/{body}/{part}"]
                        for part in ("points", "cells", "displacement", "stress", "von_mises")
                    }
                )
                for body in BODIES
            }
    return fields
