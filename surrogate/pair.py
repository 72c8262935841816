"""One pair of rough faces, from their seeds or from files, and what the network says about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from macrofit.base.arrays import FloatArray, HeightArray
from meso.settings import SHARED, FaceKeys, SurfaceKeys

from .data.faces import generated_face, measured_face, rms_height
from .errors import PredictionError
from .network.checkpoint import Control, Provenance, outside_training
from .network.inference import QUANTILE_90
from .network.predict import Predictor

if TYPE_CHECKING:
    from meso.surfaces.surface import Body


SMOOTHEST, ROUGHEST = 0.043, 0.22
"""Sq over R of generated faces: the least and the most of 960 with H from 0.5 to 1 [-]."""
BEYOND = 5.0
"""A face that is smoother or rougher by this factor than any learned from is refused [-]."""


@dataclass(frozen=True, kw_only=True)
class PairPrediction:
    """Two faces and the coefficients of their friction."""

    wheel: HeightArray
    """Heights on 1 x 1 mm [mm], (n + 1, n + 1)."""
    axle: HeightArray
    """Heights on 2 x 1 mm [mm], (2 n + 1, n + 1)."""
    micro: FloatArray
    """Micro coefficients (k,)."""
    mean: FloatArray
    """Meso coefficients (k,)."""
    spread: FloatArray
    """Their standard deviations (k,)."""
    in_contact: bool
    """Whether the network expects contact all along the slide; where it is lost, errors are largest."""
    outside: list[str]
    """What lies outside all that the network has learned from, in words."""
    doubts: list[str]
    """What may be wrong with the files, in words."""
    done: list[str]
    """What was done to the files, in words."""

    @property
    def half(self) -> FloatArray:
        """Half the width of the 90 % interval, (k,)."""
        return QUANTILE_90 * self.spread


def predict_pair(
    predictor: Predictor,
    micro_friction: tuple[float, ...],
    surface: SurfaceKeys,
    pressure: float | None = None,
    control: Control | None = None,
) -> PairPrediction:
    """Make or read two faces, and predict the coefficients of their friction.

    Args:
        predictor: the network.
        micro_friction: micro coefficients [-].
        surface: how the faces are made, or their files; of strips and patches a seed is 65536 times the number plus
            the place on it.
        pressure: before the slide, on steel [MPa]; None: that of the network's plates.
        control: what is held while sliding; None: the height where the network knows that.

    Raises:
        PredictionError: a file or a key that gives no face; a network of envelopes.
    """
    about = predictor.provenance
    if not all(0.0 <= value < 2.0 for value in micro_friction):
        raise PredictionError(f"--micro-friction {micro_friction}: take numbers from 0 to 2")
    if about.faces != "generated":
        raise PredictionError("the network knows envelopes of spheres only: choose one of generated faces")
    faces, findings, doubts, done = _faces(about, surface)
    findings += _unseen_keys(about, faces, surface)
    micro = np.array(micro_friction)
    findings += [line for value in micro for line in outside_training(about, micro_friction=float(value))]
    held, unlike = _asked_slide(about, pressure, control)
    none = np.zeros(len(micro), dtype=np.int64)
    answer = predictor(faces[0][None], faces[1][None], none, none, micro, pressure, held)
    findings += unlike
    findings += [] if answer.seen.all() else ["the two faces together are unlike all pairs learned from"]
    return PairPrediction(
        wheel=faces[0],
        axle=faces[1],
        micro=micro,
        mean=answer.mean,
        spread=answer.spread,
        in_contact=bool(answer.in_contact.all()),
        outside=findings,
        doubts=doubts,
        done=done,
    )


def _unseen_keys(about: Provenance, faces: list[HeightArray], surface: SurfaceKeys) -> list[str]:
    """How faces lie outside those the network has seen, by their keys and their highest point, in words."""
    findings = other_faces(about, surface)
    highest = 1e3 * max(float(np.abs(face).max()) for face in faces)
    if (surface.axle is not None or surface.bore is not None) and highest > 750.0 * about.max_height[1]:
        findings.append(f"a face that rises {highest:.0f} µm from nominal is higher than any learned from")
    return findings


def _asked_slide(
    about: Provenance, pressure: float | None, control: Control | None
) -> tuple[Control | None, list[str]]:
    """What is held while sliding, and how the load lies outside what the network has seen, in words."""
    if not about.wide:
        return control, []
    held: Control = control or ("displacement" if "displacement" in about.pressures else "force")
    asked = about.plates.pressure if pressure is None else pressure
    return held, about.unlike(msgspec.structs.replace(about.plates, pressure=asked, control=held))


def _faces(about: Provenance, surface: SurfaceKeys) -> tuple[list[HeightArray], list[str], list[str], list[str]]:
    """The faces of both bodies; what of those from files was never seen, what may be wrong with them, what was done."""
    faces: list[HeightArray] = []
    findings: list[str] = []
    doubts = [f"{name}: {SHARED}" for name in surface.shared_files()]
    done: list[str] = []
    seeds: dict[Body, int] = {"wheel": surface.wheel_seed, "axle": surface.axle_seed}
    for body, seed in seeds.items():
        source = surface.measured(body)
        if source is None:
            faces.append(generated_face(body, seed, surface, about.points))
            continue
        face, did, doubted = measured_face(source, body, seed, about.points, surface.form)
        findings += outside_heights(face, body, source.files[0], about.max_height)
        doubts += [f"{source.files[0]}: {line}" for line in doubted]
        done += [f"{body}: {line}" for line in did]
        faces.append(face)
    return faces, findings, doubts, done


def other_faces(provenance: Provenance, keys: FaceKeys) -> list[str]:
    """Which generated faces lie outside what the network has seen, in words.

    Of Diamond-Square its range R is compared, of the self-affine generator the rms height with that of the faces seen.
    The form is not: the network sees the faces themselves, and those of strips are as steep as tiles by themselves.

    Args:
        provenance: what the network was trained on.
        keys: how the faces are made.
    """
    if keys.axle is not None and keys.bore is not None:
        return []
    shape = {"levels": keys.levels, "hurst_exponent": keys.hurst_exponent}
    if keys.generator == "diamond_square":
        findings = outside_training(provenance, max_height=keys.max_height, **shape)
    else:
        findings = outside_training(provenance, **shape)
        low, high = SMOOTHEST * min(provenance.max_height), ROUGHEST * max(provenance.max_height)
        if not low <= keys.rms_height <= high:
            findings.append(f"rms_height = {keys.rms_height:g} is outside {low:.2g} ... {high:.2g}")
    lays = provenance.lays or (provenance.plates.lay,)
    if keys.lay not in lays:
        findings.append(f"lay = '{keys.lay}' is not {' or '.join(map(repr, lays))}")
    return findings


def outside_heights(face: HeightArray, body: Body, file: str, learned: tuple[float, float]) -> list[str]:
    """What to say of a face from a file that is smoother or rougher than all that were learned from.

    Generated faces of range R have an Sq of `SMOOTHEST` to `ROUGHEST` R.

    Raises:
        PredictionError: it is so by a factor that only another unit explains.
    """
    rms = rms_height(face, body)
    low, high = SMOOTHEST * min(learned), ROUGHEST * max(learned)
    told = f"its rms height is {1e3 * rms:.3g} µm, those learned from have {1e3 * low:.2g} to {1e3 * high:.2g} µm"
    if rms < low / BEYOND:
        unit = "is it in m, or flat? see the unit of the heights" if rms > 1e-12 else "it is flat, or one plane"
        raise PredictionError(f"{file}: {told}; {unit}")
    if rms > high * BEYOND:
        raise PredictionError(f"{file}: {told}; is it in µm? see the unit of the heights")
    if low <= rms <= high:
        return []
    return [f"the {body}'s face is {'smoother' if rms < low else 'rougher'} than any learned from: {told}"]
