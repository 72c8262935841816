"""Predictions for pairs of surfaces: each surface is given once, and pairs name them by number."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import torch

from .checkpoint import Model, Provenance, load
from .errors import PredictionError

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]

SHIPPED = Path(__file__).parent / "models" / "energy.safetensors"
"""The network that comes with the package."""


@dataclass(frozen=True)
class Prediction:
    """Meso coefficients of pairs, shape (pairs,) each."""

    mean: FloatArray
    """Over packings of the same two surfaces [-]; may be a little below 0."""
    spread: FloatArray
    """Standard deviation of one packing's coefficient and of the network together [-]."""


class Predictor:
    """A trained network, ready to be asked.

    Args:
        path: of a checkpoint; the shipped network where it is left out.

    Raises:
        CheckpointError: it cannot be read, or is not what it says.
    """

    model: Model
    provenance: Provenance

    def __init__(self, path: Path | None = None) -> None:
        self.model, self.provenance = load(SHIPPED if path is None else path)

    def __call__(
        self,
        wheels: npt.NDArray[np.floating[Any]],
        axles: npt.NDArray[np.floating[Any]],
        wheel: IntArray,
        axle: IntArray,
        micro: float | FloatArray,
    ) -> Prediction:
        """The coefficients of pairs: pair i is of wheels[wheel[i]] and axles[axle[i]].

        The answer for a pair does not depend on the others, to the bit.

        Args:
            wheels: heights outward from the nominal face on 1 x 1 mm (wheels, n + 1, n + 1) [mm].
            axles: on 2 x 1 mm (axles, 2 n + 1, n + 1) [mm].
            wheel: (pairs,).
            axle: (pairs,).
            micro: micro coefficients [-], (pairs,) or one for all.

        Raises:
            PredictionError: surfaces of another grid than the network's, or values that are not finite.
        """
        n = self.provenance.points - 1
        self._check("wheel", wheels, (n + 1, n + 1))
        self._check("axle", axles, (2 * n + 1, n + 1))
        friction = np.broadcast_to(np.asarray(micro, dtype=np.float64), wheel.shape)
        if not np.isfinite(friction).all():
            raise PredictionError("a micro coefficient is not finite")
        faces = [torch.from_numpy(np.ascontiguousarray(heights, dtype=np.float32)) for heights in (wheels, axles)]
        mean, spread = np.empty(len(wheel)), np.empty(len(wheel))
        with torch.inference_mode():
            for start in range(0, len(wheel), 64):
                part = slice(start, start + 64)
                micros = torch.from_numpy(friction[part].astype(np.float32))[:, None]
                m, s = self.model(faces[0][wheel[part]], faces[1][axle[part]], micros)
                mean[part], spread[part] = m[:, 0].numpy(), s[:, 0].numpy()
        return Prediction(mean, spread)

    @staticmethod
    def _check(name: str, heights: npt.NDArray[np.floating[Any]], shape: tuple[int, int]) -> None:
        if heights.ndim != 3 or heights.shape[1:] != shape:
            raise PredictionError(
                f"surfaces of the {name} have the shape {heights.shape}, not (any, {shape[0]}, {shape[1]}): resample them"
            )
        if not np.isfinite(heights).all():
            which = int(np.argwhere(~np.isfinite(heights).all(axis=(1, 2)))[0, 0])
            raise PredictionError(f"surface {which} of the {name} has heights that are not finite")
