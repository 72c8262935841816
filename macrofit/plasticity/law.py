"""J2 plasticity with associated flow: the stress at many points by radial return.

With the deviatoric stress s, back-stresses X_i, the accumulated plastic strain p and the equivalent of von Mises
|t| = sqrt(3/2 t : t),

    |s - X| <= R(p),    X = sum of X_i,    d eps_p = 3/2 n dp,    n = (s - X) / |s - X|
    dX_i = C_i n dp - g_i X_i dp                    (Prager with g_i = 0, Armstrong and Frederick otherwise)

R is a curve of the material (`Hardening`). Over a step the direction n is taken at its end; the equations of X_i are
then integrated exactly, X_i = X_i0 exp(-g_i dp) + C_i n (1 - exp(-g_i dp)) / g_i, and one scalar equation is left:

    |s_trial - sum of X_i0 exp(-g_i dp)| = R(p + dp) + 3 G dp + sum of C_i (1 - exp(-g_i dp)) / g_i

Its left side minus its right falls with a slope of at least 3 G where |X_i| <= C_i / g_i, which the exact
integration keeps.

Stresses are ordered (rr, zz, tt, rz), plastic strains likewise with the engineering shear.

Source: Simo, Hughes, Computational Inelasticity (1998), 3.3; Chaboche, Int. J. Plasticity 5 (1989) 247-302; Lemaitre,
Chaboche, Mechanics of Solid Materials (1990), 5.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import FloatArray, IntArray

_SHEAR = np.array([1.0, 1.0, 1.0, 2.0])  # the shear counts twice in t : t, and in an engineering strain


@dataclass(frozen=True, kw_only=True)
class Hardening:
    """R(p) = yield_stress + isotropic p + saturation (1 - exp(-rate p)) + curve(p), and the back-stresses."""

    yield_stress: float
    """R(0), before anything flowed [MPa]."""
    isotropic: float = 0.0
    """Linear growth of R [MPa]."""
    saturation: float = 0.0
    """Q of Voce's law [MPa]."""
    rate: float = 0.0
    """b of Voce's law [-]."""
    curve: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    """Plastic strains from 0 on [-], and what R gained there [MPa]; linear between them, constant behind the last."""
    moduli: tuple[float, ...] = ()
    """C_i of each back-stress [MPa]: growth of the uniaxial back-stress by plastic strain."""
    recalls: tuple[float, ...] = ()
    """g_i of each back-stress [-]; 0: linear."""

    @property
    def limit(self) -> float:
        """Largest stress under tension that the steel comes to bear however far it flows [MPa], infinite by a line."""
        backs = [c / g if g else math.inf for c, g in zip(self.moduli, self.recalls, strict=True) if c]
        grown = math.inf if self.isotropic else self.saturation + max(self.curve[1], default=0.0)
        return self.yield_stress + grown + math.fsum(backs)

    def radius(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """R [MPa] and dR/dp [MPa] at accumulated plastic strains p (n,)."""
        left = np.exp(-self.rate * p)
        value = self.yield_stress + self.isotropic * p + self.saturation * (1.0 - left)
        slope = self.isotropic + self.saturation * self.rate * left
        if self.curve[0]:
            strains, gains = (np.array(column) for column in self.curve)
            value = value + np.interp(p, strains, gains)
            slopes = np.append(np.diff(gains) / np.diff(strains), 0.0)
            slope = slope + slopes[np.searchsorted(strains, p, side="right") - 1]
        return value, slope

    def tension(self, strain: float) -> float:
        """Stress under growing tension [MPa] at a plastic strain [-]: R(p) + sum of C / g (1 - exp(-g p))."""
        backs = (
            -c / g * math.expm1(-g * strain) if g else c * strain
            for c, g in zip(self.moduli, self.recalls, strict=True)
        )
        return float(self.radius(np.array([strain]))[0][0]) + math.fsum(backs)

    @cached_property
    def columns(self) -> tuple[FloatArray, ...]:
        """The constants as the kernels take them."""
        radius = (self.yield_stress, self.isotropic, self.saturation, self.rate)
        return tuple(np.array(each, dtype=np.float64) for each in (radius, *self.curve, self.moduli, self.recalls))

    @property
    def backs(self) -> int:
        """Number of back-stresses."""
        return len(self.moduli)


@dataclass(frozen=True, kw_only=True)
class PointState:
    """What n points remember."""

    strain: FloatArray
    """Plastic strain (n, 4), with the engineering shear [-]."""
    accumulated: FloatArray
    """Accumulated plastic strain p (n,) [-]."""
    back: FloatArray
    """Back-stresses (n, backs, 4) [MPa]."""
    work: FloatArray
    """Plastic work (n,), the integral of sigma : d eps_p [N mm/mm3]."""

    @staticmethod
    def virgin(count: int, backs: int) -> PointState:
        """Points that never flowed."""
        zero = np.zeros(count)
        return PointState(strain=np.zeros((count, 4)), accumulated=zero, back=np.zeros((count, backs, 4)), work=zero)

    def at(self, points: IntArray) -> PointState:
        """What some of the points remember."""
        return PointState(**{name: getattr(self, name)[points] for name in self.__dataclass_fields__})

    def with_points(self, points: IntArray, changed: PointState) -> PointState:
        """A copy with other values at some points."""
        out = {name: getattr(self, name).copy() for name in self.__dataclass_fields__}
        for name, values in out.items():
            values[points] = getattr(changed, name)
        return PointState(**out)


def deviator(stress: FloatArray) -> FloatArray:
    """The deviatoric part of stresses (n, 4)."""
    out = stress.copy()
    out[:, :3] -= stress[:, :3].mean(axis=1, keepdims=True)
    return out


def equivalent(deviatoric: FloatArray) -> FloatArray:
    """sqrt(3/2 t : t) (n,) of deviatoric stresses (n, 4)."""
    return np.asarray(np.sqrt(1.5 * (deviatoric**2 @ _SHEAR)))


def overshoot(trial: FloatArray, state: PointState, law: Hardening) -> FloatArray:
    """|s - X| - R (n,) [MPa] of trial stresses (n, 4): a point flows where it is positive."""
    from .kernels import overshoots

    return np.asarray(overshoots(trial, state.accumulated, state.back, *law.columns[:3]))


def flow(path: FloatArray, state: PointState, law: Hardening, shear_modulus: float) -> PointState:
    """The state of points that were led along total strains (steps, points, 4), one after the other.

    The work stays as it was: it is for the caller, who knows the stress before the steps.
    """
    from .kernels import follow

    strain, accumulated, back = (np.array(each, order="C") for each in (state.strain, state.accumulated, state.back))
    follow(np.ascontiguousarray(path), strain, accumulated, back, *law.columns, shear_modulus)
    return PointState(strain=strain, accumulated=accumulated, back=back, work=state.work)
