"""The friction tests that benchmarks of the network learn from: those of the plates, or toys with made-up answers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import torch

from meso.settings import FaceKeys
from surrogate.data.database import Header, Samples
from surrogate.data.faces import generated_face
from surrogate.data.journal import journal_of
from surrogate.network.foundation import Foundation

ROOT = Path(__file__).parents[2]
DEFAULT = ROOT / "build" / "bench" / "train.h5"
PAIRS = 1000
"""Of the default database."""
TOY = Header(design="{}", settings='[surface]\nform = "tiles"\n', code="", version="", micro_frictions=2, squares=2)
"""Of made-up samples."""


EVALUATION = DEFAULT.with_name("evaluation.h5")
"""A hundred pairs of surfaces that no shipped network has seen."""


def default_database() -> Path:
    """`DEFAULT`, of a thousand pairs."""
    return _made(DEFAULT, "--pairs", str(PAIRS))


def evaluation_database() -> Path:
    """`EVALUATION`, three packings of spheres for each pair."""
    return _made(
        EVALUATION, "--pairs", "100", "--packings", "3", "--first-surface", "31000", "--first-packing", "2000",
        "--micro-friction", "0.03,0.05,0.07,0.09",
    )  # fmt: skip


def _made(database: Path, *words: str) -> Path:
    """A database, made by the command of the README where it is missing or was left unfinished."""
    if not database.exists() or journal_of(database).exists():
        command = ["generate", "-o", str(database.relative_to(ROOT)), *words]
        print(
            f"{database} is missing or unfinished: macrofit-surrogate {' '.join(command)}", file=sys.stderr, flush=True
        )
        database.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(
            [sys.executable, "-m", "surrogate", *command],
            cwd=ROOT, stdin=subprocess.DEVNULL, stdout=sys.stderr, check=True,
        )  # fmt: skip
    return database


def made_up(count: int, rng: np.random.Generator | None = None) -> Samples:
    """Samples with the foundation's b for an answer; with `rng`, envelopes as rough as those of spheres."""
    rows = np.zeros(count, TOY.row())
    rows["id"] = rows["wheel_seed"] = rows["axle_seed"] = rows["packing_seed"] = np.arange(count)
    keys = FaceKeys(form="tiles")
    for k in range(count):
        rows["wheel"][k], rows["axle"][k] = generated_face("wheel", k, keys), generated_face("axle", k, keys)
    if rng is not None:
        for name in ("wheel_envelope", "axle_envelope"):
            rows[name] = rng.normal(scale=keys.max_height / 4.0, size=rows[name].shape)
    rows["max_height"], rows["levels"], rows["hurst_exponent"] = 0.02, 3, 0.8
    rows["micro_friction"] = (0.03, 0.07)
    rows["minimum_normal"], rows["pressure"] = 1.0, 170.0
    with torch.inference_mode():
        faces = [torch.from_numpy(rows[name].copy()) for name in ("wheel", "axle")]
        b = Foundation([3e4], 170.0)(*faces)[0].numpy()
    rows["meso_friction"] = rows["micro_friction"] + b
    return Samples(**{name: rows[name].copy() for name in rows.dtype.names or ()})
