"""From the keys of a material to the law at its points."""

from __future__ import annotations

import math

import numpy as np

from ..base.arrays import FloatArray
from ..scene.keys import Scene
from ..scene.material import (
    ChabocheHardening,
    LinearHardening,
    Material,
    TabulatedHardening,
    VoceHardening,
    yield_stress,
)
from .law import Hardening


def hardening(material: Material) -> Hardening | None:
    """The law of a material; None where it stays elastic."""
    stress, keys = yield_stress(material), material.hardening
    if stress is None or material.elastic:
        return None
    match keys:
        case None:
            return Hardening(yield_stress=stress)
        case LinearHardening():
            backs = ((keys.kinematic,), (0.0,)) if keys.kinematic else ((), ())
            return Hardening(yield_stress=stress, isotropic=keys.isotropic, moduli=backs[0], recalls=backs[1])
        case VoceHardening():
            return Hardening(yield_stress=stress, isotropic=keys.isotropic, saturation=keys.saturation, rate=keys.rate)
        case ChabocheHardening():
            return Hardening(
                yield_stress=stress,
                isotropic=keys.isotropic,
                saturation=keys.saturation,
                rate=keys.rate,
                moduli=keys.moduli,
                recalls=keys.recalls,
            )
        case TabulatedHardening():
            gains = tuple((np.array(keys.stress) - keys.stress[0]).tolist())
            return Hardening(yield_stress=stress, curve=(keys.plastic_strain, gains))


def limit_load(scene: Scene, friction: FloatArray) -> str:
    """What is said where friction (facets,) [MPa] holds more than a surface of a scene's bodies ever bears in shear.

    Such friction is not overcome by sliding: the steel flows without limit. Empty where it bears more, or hardens.
    """
    laws = (hardening(scene.axle.material), hardening(scene.wheel.material))
    bears = min((law.limit for law in laws if law is not None), default=math.inf) / math.sqrt(3.0)
    holds = float(friction.max(initial=0.0))
    if holds <= bears:
        return ""
    return (
        f"friction holds up to {holds:.3g} MPa, and the steel flows along the surface at {bears:.3g} MPa, its limit "
        f"load, rather than slide"
    )
