"""`macrofit service` on a small wheelset, for tests of what it leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from click.testing import CliRunner, Result

from macrofit.cli import main

SHORT = (
    "mesh.seat_facet=8", "mesh.coarse=40", "motion.start=90", "motion.travel=180", "motion.increment=30",
    "wheel.bore_radius=94.85", "friction.options.coefficient=0.2", "service.harmonics=1", "service.steps=9",
)  # fmt: skip


def read_table(path: Path) -> dict[str, np.ndarray]:
    head, *rows = path.read_text().split()
    return dict(zip(head.split(","), np.array([row.split(",") for row in rows], dtype=float).T, strict=True))


def service(folder: Path, *more: str, scene: str = "wheelset", bonded: bool = False, resume: bool = False) -> Result:
    changes = [word for change in (*SHORT, *more) for word in ("--set", change)]
    flags = [*(["--bonded"] if bonded else []), *(["--resume"] if resume else [])]
    return CliRunner(mix_stderr=False).invoke(main, ["service", scene, *changes, "-o", str(folder), *flags])
