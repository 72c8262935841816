"""What the axle's steel bears for ever, and the nominal stress of the seat held against it as EN 13103-1 does.

The nominal stress is that of a beam, K M d / (2 I), with the resultant of bending moment and torque for M and K = 1
within the cylindrical seat. EN 13103-1 holds it against the limit of a seat under a wheel, which tests of whole axles
have given and which has fretting in it, over a security factor. Grooves and fillets beside the seat, where K is above
1, are not judged, nor are the forces: those of the scene are taken as they are.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec
import numpy as np

from ...base.arrays import FloatArray
from ...errors import SceneError
from ...scene.keys import ServiceKeys
from ...scene.material import Material, cards
from ..wheelset import Wheelset
from .criteria import Limits

STANDARD = "EN 13103-1"
BENDING = 200.0
"""Limit in reversed bending where neither the keys nor the grade state one [MPa]."""
OWN = "service.seat_limit of the scene"

Word: TypeAlias = Literal["accepted", "refused", "not judged"]


class SeatLimit(msgspec.Struct, frozen=True, kw_only=True):
    """What a seat bears for ever, and where that stands."""

    stress: float  # MPa
    safety: float
    source: str
    known: str


class StressVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """The nominal stress of the seat held against what it bears; None: nothing is known to hold it against."""

    word: Word
    standard: str
    axle: str  # "solid" or "hollow"
    nominal_stress_MPa: float  # noqa: N815 - units
    z_mm: float
    limit_MPa: float | None  # noqa: N815
    safety: float | None
    source: str
    known: str

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        stress = f"nominal stress {self.nominal_stress_MPa:.1f} MPa on the seat of a {self.axle} axle"
        if self.limit_MPa is None or self.safety is None:
            known = " or ".join(grade for grade, card in cards().items() if "fatigue_seat" in card)
            return f"{stress}, not judged: state axle.material.grade, {known}, or service.seat_limit"
        permitted = self.limit_MPa / self.safety
        return (
            f"{self.word} by {self.standard}: {stress}, permitted {permitted:.1f} MPa "
            f"({self.limit_MPa:g} / {self.safety:g}; {self.known})"
        )


def limits_of(keys: ServiceKeys, material: Material) -> Limits:
    """The fatigue limits of a smooth surface: of the keys, or of the axle's grade.

    Raises:
        SceneError: no criterion has constants for them.
    """
    bending = keys.bending_limit
    if bending is None:
        bending = float(_card(material).get("fatigue_bending", BENDING))
    torsion = 0.6 * bending if keys.torsion_limit is None else keys.torsion_limit
    if not 0.5 < torsion / bending < 1.0:
        raise SceneError(
            f"service.torsion_limit: {torsion:g} must be above 1/2 and below 1 of bending_limit, {bending:g}; steels "
            f"have 0.55 to 0.65"
        )
    return Limits(bending=bending, torsion=torsion)


def seat_limit(keys: ServiceKeys, material: Material, *, hollow: bool) -> SeatLimit | None:
    """What a seat under a wheel bears for ever: of the keys, or of the axle's grade; None where neither states it."""
    card = _card(material)
    safety = float(card.get("fatigue_safety", 1.0)) if keys.safety is None else keys.safety
    if keys.seat_limit is not None:
        return SeatLimit(stress=keys.seat_limit, safety=safety, source=OWN, known="as given")
    stress = card.get("fatigue_hollow_seat" if hollow else "fatigue_seat")
    if stress is None:
        return None
    source, known = str(card["fatigue_source"]), str(card["fatigue_known"])
    return SeatLimit(stress=float(stress), safety=safety, source=source, known=known)


def judge_stress(whole: Wheelset) -> StressVerdict:
    """Hold the largest nominal stress of the fit against what the seat bears for ever."""
    portions = whole.fit.coupling.portions
    used = whole.fit.chosen // portions.points.shape[1]
    z = np.array([portions.start[used[0]], *whole.fit.z, portions.end[used[-1]]])
    stress = resultant_stress(whole, z)
    top = int(np.argmax(stress))
    hollow = whole.loads.face.section.inner > 0.0
    limit = seat_limit(whole.loads.keys, whole.scene.axle.material, hollow=hollow)
    word: Word = "not judged"
    if limit is not None:
        word = "accepted" if stress[top] <= limit.stress / limit.safety else "refused"
    return StressVerdict(
        word=word,
        standard=STANDARD,
        axle="hollow" if hollow else "solid",
        nominal_stress_MPa=float(stress[top]),
        z_mm=float(z[top]),
        limit_MPa=None if limit is None else limit.stress,
        safety=None if limit is None else limit.safety,
        source="" if limit is None else limit.source,
        known="" if limit is None else limit.known,
    )


def resultant_stress(whole: Wheelset, z: FloatArray) -> FloatArray:
    """Nominal stress [MPa] at places of the seat [mm] of the resultant of bending moment and torque."""
    torque = np.where(z > whole.loads.rail_z, whole.loads.keys.torque, 0.0)
    moments = np.hypot(whole.loads.moment(z), torque)
    sections = whole.section(z)
    return np.array([each.bending_stress(m) for each, m in zip(sections, moments.tolist(), strict=True)])


def _card(material: Material) -> dict[str, float | str]:
    return {} if material.grade is None else cards()[material.grade]
