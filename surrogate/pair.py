"""One pair of rough faces, from their seeds or from files, and what the network says about it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray

from .data.faces import from_file, generated
from .errors import PredictionError
from .network.checkpoint import outside
from .network.predict import Predictor
from .network.train import QUANTILE


@dataclass(frozen=True)
class Pair:
    """Two faces and the coefficients of their friction."""

    wheel: npt.NDArray[np.float32]
    """Heights on 1 x 1 mm [mm], (n + 1, n + 1)."""
    axle: npt.NDArray[np.float32]
    """Heights on 2 x 1 mm [mm], (2 n + 1, n + 1)."""
    micro: FloatArray
    """(k,)."""
    mean: FloatArray
    """Meso coefficients (k,)."""
    spread: FloatArray
    """Their standard deviations (k,)."""
    held: bool
    """Whether the network expects contact all along the slide; where it is lost, errors are largest."""
    outside: list[str]
    """What lies outside all that the network has learned from, in words."""

    @property
    def half(self) -> FloatArray:
        """Half the width of the 90 % interval, (k,)."""
        return QUANTILE * self.spread


def predict_pair(
    predictor: Predictor,
    micro_friction: tuple[float, ...],
    wheel: Path | None,
    axle: Path | None,
    wheel_seed: int,
    axle_seed: int,
    max_height: float,
    levels: int,
    hurst_exponent: float,
) -> Pair:
    """Faces, and the coefficients the network gives them.

    Raises:
        PredictionError: a file or a key that gives no face; a network of envelopes.
    """
    about = predictor.provenance
    if not all(0.0 <= value < 2.0 for value in micro_friction):
        raise PredictionError(f"--micro-friction {micro_friction}: take numbers from 0 to 2")
    if about.faces != "generated":
        raise PredictionError("the network knows envelopes of spheres only: choose one of generated faces")
    keys = {"levels": levels, "max_height": max_height, "hurst_exponent": hurst_exponent}
    faces = [
        from_file(file, body, about.points) if file is not None else generated(body, seed, **keys, points=about.points)  # type: ignore[arg-type]
        for body, file, seed in (("wheel", wheel, wheel_seed), ("axle", axle, axle_seed))
    ]
    said = []
    if wheel is None or axle is None:
        said += outside(about, **keys)
    highest = 2e3 * max(float(np.abs(face).max()) for face in faces)
    if (wheel is not None or axle is not None) and highest > 1.5e3 * about.max_height[1]:
        said.append(f"a face that rises {0.5 * highest:.0f} µm from nominal is higher than any learned from")
    micro = np.array(micro_friction)
    said += [line for value in micro for line in outside(about, micro_friction=float(value))]
    none = np.zeros(len(micro), dtype=np.int64)
    answer = predictor(faces[0][None], faces[1][None], none, none, micro)
    return Pair(faces[0], faces[1], micro, answer.mean, answer.spread, bool(answer.held.all()), said)
