"""A checkpoint of a network that has learned nothing: its foundations give coefficients that make sense."""

from __future__ import annotations

from pathlib import Path

import torch

from surrogate.data.plates import Faces
from surrogate.data.samples import Plates
from surrogate.network.checkpoint import EnsembleOptions, Provenance, save_checkpoint


def untrained(path: Path, stiffness: float = 3e4, faces: Faces = "generated") -> str:
    """Write it, and give back its path. It claims to have seen what the shipped design has."""
    options = EnsembleOptions(stiffness=[stiffness], load=170.0, members=2)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = options.build_network()
    about = Provenance(
        options=options,
        faces=faces,
        database="",
        seed=0,
        training=0,
        validation=0,
        points=33,
        plates=Plates(),
        surface_seeds=(0, 999),
        packing_seeds=(0, 255),
        max_height=(0.005, 0.04),
        levels=(3, 4),
        hurst_exponent=(0.5, 1.0),
        micro_friction=(0.01, 0.09),
        validation_error={},
        validation_r2=0.0,
        versions={},
    )
    save_checkpoint(path, network, about)
    return str(path)
