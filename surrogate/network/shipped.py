"""Files that come with the package; README has the three commands that make them anew."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "models"
NETWORK = FOLDER / "energy.safetensors"
"""Ensemble on foundations for faces as generated."""
ENVELOPE = FOLDER / "envelope.safetensors"
"""Ensemble on foundations for the envelopes of the spheres."""
PAPER = FOLDER / "paper.safetensors"
"""Convolutional network as Lalleman et al. describe it, trained on the same split."""
EVALUATION = FOLDER / "evaluation.csv"
"""Friction tests of a hundred pairs of surfaces that no network here was trained on."""
