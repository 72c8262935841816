"""Stress fields of the runs of a study: kept in one file a run, read back for figures."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrayfile import read_npz
from ..base.files import replacing, writing
from ..errors import OutputError
from ..solution import BodyField, Solution
from .plan import PlannedRun
from .statistics import BODIES

FIELDS = "fields"
PARTS = ("points", "cells", "displacement", "stress", "von_mises")
MOST_BYTES = 10_000_000_000
"""Size of a file; a mesh of a million nodes has 0.1 GB for each displacement."""


def fields_file(folder: Path, digest: str) -> Path:
    """Where the fields of a run are kept."""
    return folder / FIELDS / f"{digest[:16]}.npz"


def save_fields(folder: Path, digest: str, solution: Solution) -> None:
    """Keep the fields of a run for the study's stress figures."""
    arrays: dict[str, Any] = {}
    for number, (displacement, bodies) in enumerate(sorted(solution.fields.items())):
        arrays[f"{number}/displacement"] = np.array(displacement)
        for body, field in bodies.items():
            for name in PARTS:
                arrays[f"{number}/{body}/{name}"] = getattr(field, name)
    target = fields_file(folder, digest)
    with writing(target):
        target.parent.mkdir(exist_ok=True)
    with replacing(target) as draft:
        np.savez_compressed(draft, **arrays)


def load_fields(folder: Path, run: PlannedRun) -> dict[float, dict[str, BodyField]]:
    """The fields `save_fields` kept of a run: displacement -> body -> field; empty where there are none.

    Raises:
        OutputError: the file is damaged.
    """
    path = fields_file(folder, run.digest)
    if not path.is_file():
        return {}
    arrays = read_npz(path, MOST_BYTES)
    try:
        return {
            float(place): {
                body: BodyField(**{part: arrays[f"{name.partition('/')[0]}/{body}/{part}"] for part in PARTS})
                for body in BODIES
            }
            for name, place in arrays.items()
            if name.count("/") == 1
        }
    except (KeyError, TypeError, ValueError) as error:
        raise OutputError(f"{path}: does not hold the fields of a run ({error}); delete it") from None


def lost_fields(folder: Path, runs: Iterable[PlannedRun]) -> set[str]:
    """Digests of the runs whose fields are damaged, which is said in a warning, or gone."""
    lost = set()
    for run in runs:
        try:
            if not load_fields(folder, run):
                lost.add(run.digest)
        except OutputError as error:
            warnings.warn(f"{error}; the run is computed again", stacklevel=2)
            lost.add(run.digest)
    return lost
