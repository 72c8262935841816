"""Predictions for pairs of surfaces: each surface is given once, and pairs name them by number."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import BoolArray, FloatArray, HeightArray, IntArray

from ..errors import PredictionError
from .checkpoint import Control, Provenance, load_for_answers
from .inference import TrainedEnsemble
from .shipped import NETWORK
from .slides import Single

if TYPE_CHECKING:
    from .model import Body, LallemanCNN, LallemanEnsemble


@dataclass(frozen=True)
class Prediction:
    """Meso coefficients of pairs, shape (pairs,) each."""

    mean: FloatArray
    """Mean over packings of the same two surfaces [-]; may be a little below 0."""
    spread: FloatArray
    """Standard deviation of one packing's coefficient and of the network together [-]."""
    in_contact: BoolArray
    """Whether the plates keep in contact all along the slide, as predicted; where they do not, errors are largest.

    False where the smallest load of the stiffest foundation is below a share that is chosen to catch nine of ten such
    pairs of the training set. By tenfold cross-validation it catches eight of ten, and three of five pairs that it
    names do lose contact. The paper's network cannot tell: True.
    """
    seen: BoolArray
    """Whether the pair is like those learned from, by what the network sees of the faces and their load; a network of
    one load cannot tell: True."""


class Predictor:
    """A trained network, ready to be asked: an ensemble on foundations in numpy, the paper's network in torch.

    Args:
        path: a checkpoint; the shipped network where it is left out.
        device: device of torch, for the paper's network; others than the processor differ by rounding. An ensemble on
            foundations takes milliseconds and answers on the processor.

    Raises:
        CheckpointError: it cannot be read, or is not what it says.
        SurrogateError: there is no such device.
    """

    model: TrainedEnsemble | LallemanCNN | LallemanEnsemble
    provenance: Provenance
    device: str

    def __init__(self, path: Path | None = None, device: str = "cpu") -> None:
        self.device = device
        if device != "cpu":
            from .devices import chosen_device

            self.device = chosen_device(device)
        self.model, self.provenance = load_for_answers(NETWORK if path is None else path)
        if not isinstance(self.model, TrainedEnsemble):
            self.model.to(self.device)

    def __call__(
        self,
        wheels: npt.NDArray[np.floating[Any]],
        axles: npt.NDArray[np.floating[Any]],
        wheel: IntArray,
        axle: IntArray,
        micro: float | FloatArray,
        pressure: float | FloatArray | None = None,
        control: Control | None = None,
    ) -> Prediction:
        """The coefficients of pairs: pair i is of wheels[wheel[i]] and axles[axle[i]].

        The answer for a pair does not depend on the others, to the bit.

        Args:
            wheels: heights outward from the nominal face on 1 x 1 mm (wheels, n + 1, n + 1) [mm].
            axles: on 2 x 1 mm (axles, 2 n + 1, n + 1) [mm].
            wheel: number of the wheel of each pair (pairs,).
            axle: number of the axle of each pair (pairs,).
            micro: micro coefficients [-], (pairs,) or one for all.
            pressure: before the slide, at the modulus of the network's plates [MPa], (pairs,) or one for all; left
                out, that of these plates.
            control: what is held while sliding; left out, what these plates hold.

        Raises:
            PredictionError: surfaces of another grid than the network's, values that are not finite, pairs of
                surfaces that are not there.
        """
        n = self.provenance.points - 1
        self._check("wheel", wheels, (n + 1, n + 1))
        self._check("axle", axles, (2 * n + 1, n + 1))
        for name, which, count in (("wheel", wheel, len(wheels)), ("axle", axle, len(axles))):
            if which.shape != wheel.shape or (which.size and not 0 <= which.min() <= which.max() < count):
                raise PredictionError(f"pairs name {name}s that are not there, or more of them than of the other")
        wheel_faces, axle_faces = (np.ascontiguousarray(heights, dtype=np.float32) for heights in (wheels, axles))
        first, second = (np.ascontiguousarray(of, dtype=np.int64) for of in (wheel, axle))
        if isinstance(self.model, TrainedEnsemble):
            load, free = self.conditions(len(first), pressure, control)
            slopes, features = self.model.prepare(
                wheel_faces, axle_faces, first, second, load=load, constant_force=free
            )
            return self.answer(self.model.affine_laws(slopes, features), self.model.flags(features), micro)
        return self.join(self._parts("wheel", wheel_faces, first), self._parts("axle", axle_faces, second), micro)

    def conditions(
        self, pairs: int, pressure: float | FloatArray | None, control: Control | None
    ) -> tuple[Single, BoolArray]:
        """Load of each pair [N] and whether it is held while sliding, (pairs,) each.

        Raises:
            PredictionError: a network of one load is asked about another, or a load that is not finite.
        """
        plates = self.provenance.plates
        held = plates.control if control is None else control
        loads = np.broadcast_to(np.asarray(plates.pressure if pressure is None else pressure), pairs) * plates.edge**2
        other = not self.provenance.wide and (held != plates.control or not np.all(loads == plates.load))
        if other or not (np.isfinite(loads).all() and np.all(loads > 0.0)):
            raise PredictionError(
                "the network knows one load and one way to slide" if other else "a pressure is not a number above 0"
            )
        return np.asarray(loads, dtype=np.float32), np.full(pairs, held == "force")

    def answer(self, laws: Single, flags: BoolArray, micro: float | FloatArray) -> Prediction:
        """The coefficients of pairs whose laws are known; the same bits as from their faces.

        Args:
            laws: affine laws of an ensemble, from its `affine_laws` (pairs, 3, members).
            flags: from its `flags` (pairs, 2).
            micro: micro coefficients [-], (pairs,) or one for all.

        Raises:
            PredictionError: a micro coefficient that is not finite.
        """
        assert isinstance(self.model, TrainedEnsemble)
        in_contact, seen = flags.T
        return Prediction(*self.model.evaluate_laws(laws, self._micros(micro, len(laws))), in_contact, seen)

    @staticmethod
    def nothing() -> Prediction:
        """The answer to no pairs."""
        none, flags = np.empty(0), np.empty(0, dtype=np.bool_)
        return Prediction(none, none, flags, flags)

    @staticmethod
    def _micros(micro: float | FloatArray, pairs: int) -> FloatArray:
        """Micro coefficients (pairs,), in double precision: the answer is affine in them."""
        given = np.asarray(micro, dtype=np.float64)
        if not np.isfinite(given).all():
            raise PredictionError("a micro coefficient is not finite")
        return np.broadcast_to(given, pairs).copy()

    def face_part(self, body: Body, face: HeightArray) -> Single:
        """What the paper's network makes of a face [mm] by itself: all that is needed of it in any pair."""
        import torch

        assert not isinstance(self.model, TrainedEnsemble)
        with torch.inference_mode():
            return np.asarray(self.model.face_part(body, torch.from_numpy(face).to(self.device)).cpu().numpy())

    def join(self, wheel: Single, axle: Single, micro: float | FloatArray) -> Prediction:
        """The coefficients of pairs whose parts are known; the same bits as from their faces.

        Args:
            wheel: `face_part` of the wheel of each pair, (pairs, members, units).
            axle: `face_part` of the axle of each pair.
            micro: micro coefficients [-], (pairs,) or one for all.

        Raises:
            PredictionError: a micro coefficient that is not finite.
        """
        import torch

        assert not isinstance(self.model, TrainedEnsemble)
        micros = torch.from_numpy(self._micros(micro, len(wheel))[:, None]).float()
        with torch.inference_mode():
            first, second, asked = (
                part.to(self.device) for part in (torch.from_numpy(wheel), torch.from_numpy(axle), micros)
            )
            mean, spread = (part.cpu() for part in self.model.join_parts(first, second, asked))
        known = np.ones(len(wheel), dtype=np.bool_)
        return Prediction(mean[:, 0].double().numpy(), spread[:, 0].double().numpy(), known, known)

    def _parts(self, body: Body, faces: HeightArray, which: IntArray) -> Single:
        """The parts of the face of each pair, each face once."""
        distinct, row = np.unique(which, return_inverse=True)
        none = [np.zeros(faces.shape[1:], dtype=np.float32)]  # for the shape
        parts = np.stack([self.face_part(body, face) for face in [faces[k] for k in distinct.tolist()] or none])
        return np.asarray(parts[row])

    @staticmethod
    def _check(name: str, heights: npt.NDArray[np.floating[Any]], shape: tuple[int, int]) -> None:
        """Refuse surfaces of another grid, or with values that are not finite."""
        if heights.ndim != 3 or heights.shape[1:] != shape:
            raise PredictionError(
                f"surfaces of the {name} have the shape {heights.shape}, not (any, {shape[0]}, {shape[1]}): "
                "resample them"
            )
        if not np.isfinite(heights).all():
            which = int(np.argwhere(~np.isfinite(heights).all(axis=(1, 2)))[0, 0])
            raise PredictionError(f"surface {which} of the {name} has heights that are not finite")
