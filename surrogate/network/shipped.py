"""Files that come with the package, by the preset of the plates they are of; `make networks` makes them anew."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

NetworkName: TypeAlias = Literal["energy", "cnn"]
"""The network that is shaped like the physics, or the paper's convolutional one."""

FOLDER = Path(__file__).parent / "models"


class Shipped(NamedTuple):
    """Files of one preset of the plates."""

    energy: Path
    """Ensemble on foundations for faces as generated."""
    cnn: Path
    """Convolutional networks as Lalleman et al. describe them, trained on the same split."""
    evaluation: Path
    """Friction tests of a hundred pairs of surfaces that no network here was trained on."""
    database: Path | None = None
    """Friction tests that both learned from."""

    def network(self, name: NetworkName) -> Path:
        """The file of a network."""
        return self.energy if name == "energy" else self.cnn


SHIPPED = {
    "slow": Shipped(FOLDER / "energy.safetensors", FOLDER / "paper.safetensors", FOLDER / "evaluation.csv"),
    "as-published": Shipped(
        FOLDER / "as-published-energy.safetensors",
        FOLDER / "as-published-cnn.safetensors",
        FOLDER / "as-published-evaluation.csv.gz",
        FOLDER / "as-published-train.csv.gz",
    ),
}
"""What there is for each preset of the plates."""
NETWORK, PAPER, EVALUATION = SHIPPED["slow"][:3]
"""Those of the default plates."""
ENVELOPE = FOLDER / "envelope.safetensors"
"""Ensemble on foundations for the envelopes of the spheres of the default plates."""
WIDE_EVALUATION, ROUGH_EVALUATION = FOLDER / "wide-evaluation.csv.gz", FOLDER / "rough-evaluation.csv.gz"
"""Friction tests of unseen pairs of the wide design, and of more of its rough part."""
ROUGHEST_EVALUATION = FOLDER / "roughest-evaluation.csv.gz"
"""Many packings of unseen pairs with R from 50 um, at 30 to 300 MPa."""
