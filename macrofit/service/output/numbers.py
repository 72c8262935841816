"""What a service computation writes: service.json, seat.csv, and lines for people."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from ...base.arrays import BoolArray, FloatArray
from ...base.files import write_text
from ...plasticity.material import hardening
from ...results.doubts import doubtful_lines, large_strain, past_table
from ...results.versions import provenance, versions
from ...scene import dump_scene
from ..bonded import OUTSIDE, Bonded, Edge
from ..fatigue.limits import judge_stress, limits_of
from ..fit import Fit
from ..history import SLIPPED, Endurance, Fretting, slip_left
from ..seat_stress import MM, NM, NN
from ..wheelset import Wheelset

if TYPE_CHECKING:
    from ..run import Service, Turned

STEADY = 5e-3
"""Slip that a revolution may leave, in the largest range of slip."""
BALANCED = 1e-3
"""How far the work of the loads may be from that of friction, in this."""
LEAST_STRESS = 1.0
"""Nominal stress below which loads may be in another unit, kN or N m [MPa]."""
MOST_STRESS = 250.0
"""Nominal stress above which no axle lasts, fretting or not, and loads may be of another one [MPa]; EA4T bears 240."""
LEAST_WORK = 100.0
"""Friction work of a revolution below which it is counted as that much [N mm]; a wheelset has 1e3 to 1e5."""


def numbers(found: Service) -> dict[str, Any]:
    """The numbers of service.json, keys with their units; friction is None where no revolution is whole."""
    whole, turned = found.whole, found.turned
    keys, verdict = whole.loads.keys, judge_stress(whole)
    limits = limits_of(keys, whole.scene.axle.material)
    return {
        "title": whole.scene.title,
        "displacement_mm": whole.displacement,
        "journal_force_N": keys.journal_force,
        "journal_moment_N_mm": keys.journal_moment,
        "lateral_force_N": keys.lateral_force,
        "torque_N_mm": keys.torque,
        "bonded": {edge.name: _edge(edge) for edge in found.bonded.edges},
        "friction": None if turned is None else _friction(whole.fit, turned),
        "endurance": None if turned is None else _endurance(turned.endurance),
        "limits_MPa": {"bending": limits.bending, "torsion": limits.torsion},
        "verdict": msgspec.to_builtins(verdict) | {"sentence": verdict.sentence},
        "doubts": [
            *unit_doubts(verdict.nominal_stress_MPa),
            *([] if turned is None else service_doubts(whole, turned)),
        ],
        "turned_revolutions": found.moments[-1].time if found.moments else None,
        "ended": found.ended,
        "scene": dump_scene(whole.scene),
        "versions": versions(),
        "provenance": provenance(whole.scene),
    }


def _edge(edge: Edge) -> dict[str, float | str | None]:
    return {
        "z_mm": edge.z,
        "nominal_stress_MPa": edge.nominal_stress,
        "stress_concentration": edge.concentration,
        "no_concentration_because": edge.without,
        "shear_power": edge.shear_power,
        "no_shear_power_because": edge.without_power,
    }


def _friction(fit: Fit, turned: Turned) -> dict[str, Any]:
    wear, last = turned.fretting, turned.revolutions[-1]
    held = wear.always
    middle = 0.5 * (fit.z[wear.touches].min() + fit.z[wear.touches].max())
    sides = {"front": held & (fit.z < middle), "inner": held & (fit.z >= middle)}
    return {
        "steps": len(last.moments) - 1,
        "harmonics": (turned.angles - 1) // 2,
        "friction_work_N_mm": last.friction_work,
        "friction_work_of_revolutions_N_mm": [each.friction_work for each in turned.revolutions],
        "work_balance": abs(last.load_work - last.friction_work) / max(abs(last.friction_work), 1e-300),
        "slip_left_by_revolution": _where_held(held, wear.left),
        "slip_left_of_revolutions": [
            None if left is None else max(left) for left in map(slip_left, turned.revolutions)
        ],
        "wave_error": _where_held(held, wear.wave_errors),
        "newton_iterations": sum(each.iterations for each in turned.revolutions),
        "slip_zone_mm": {"front": wear.front_zone, "inner": wear.inner_zone},
        "slip_range_mm": {
            name: float(wear.axial_range[side].max()) if side.any() else None for name, side in sides.items()
        },
        "largest_pressure_MPa": float(wear.largest_pressure.max(initial=0.0)),
        "opening_mm": float(wear.opening.max(initial=0.0)) + 0.0,  # no -0.0
    }


def _where_held(held: BoolArray, values: tuple[float, float]) -> dict[str, float | None]:
    """What is told of places that stay in contact; None where there is none, which is not the same as 0."""
    return dict(zip(("axial", "around"), values if held.any() else (None, None), strict=True))


def unit_doubts(nominal: float) -> list[str]:
    """What a largest nominal stress [MPa] says of the loads and their units; without any bending it says nothing."""
    if nominal == 0.0 or LEAST_STRESS <= nominal <= MOST_STRESS:
        return []
    return [
        f"odd loads: the nominal stress is {nominal:.3g} MPa, and axles at work have 50 to 150: state those of this "
        f"axle, service.journal_force in N and service.journal_moment in N mm"
    ]


def service_doubts(whole: Wheelset, turned: Turned) -> list[str]:
    """What speaks against a rotation, in one sentence each."""
    wear, last, found = turned.fretting, turned.revolutions[-1], []
    if not wear.always.any():
        found.append(
            "no place of the seat stays in contact all around: the wheel lifts off as it turns; lower the loads"
        )
    if max(wear.left) > STEADY and wear.axial_range.max() > SLIPPED:
        way = "along" if wear.left[0] == max(wear.left) else "around"
        found.append(
            f"the wheel creeps: the last revolution leaves {max(wear.left):.1%} of the slip, {way} the axle; try more "
            f"service.revolutions, and if it stays, lower the loads"
        )
    periodicity = whole.loads.keys.periodicity
    if periodicity > 0.0 and wear.always.any() and max(wear.left) >= periodicity:
        found.append(
            f"not periodic yet: revolution {len(turned.revolutions)} leaves {max(wear.left):.1e} of the slip, and "
            f"service.periodicity allows {periodicity:g}; go on with --resume and more service.revolutions"
        )
    if abs(last.load_work - last.friction_work) > BALANCED * max(abs(last.friction_work), LEAST_WORK):
        found.append("the work of the loads is not that of friction; try more service.steps or service.revolutions")
    found.extend(turned.doubts)
    found.extend(large_strain(turned.plastic_strain))
    found.extend(past_table(whole.scene, dict.fromkeys(("axle", "wheel"), turned.plastic_strain)))
    if any(hardening(body.material) for body in (whole.scene.axle, whole.scene.wheel)):
        found.append("steel that yielded in the press is taken as elastic in service (shakedown)")
    return found


def _endurance(found: Endurance) -> dict[str, Any]:
    criteria = found.criteria
    values = {
        "axial_stress_amplitude_MPa": 0.5 * np.ptp(found.stress[:, :, MM], axis=1),
        "crossland": criteria.crossland,
        "dang_van": criteria.dang_van,
        "findley": criteria.findley,
        "swt_MPa": criteria.swt,
        "ruiz_MPa2_mm": found.ruiz,
    }
    worst = {name: int(np.argmax(value)) for name, value in values.items()}
    return {name: {"value": float(values[name][k]), "z_mm": float(found.z[k])} for name, k in worst.items()}


def seat_columns(bonded: Bonded, turned: Turned | None) -> dict[str, FloatArray]:
    """The columns of seat.csv; with those of the rotation where there was one."""
    first = bonded.harmonics[1].stress
    columns = {
        "z_mm": bonded.z,
        "nominal_stress_MPa": bonded.nominal,
        "bonded_bending_stress_MPa": bonded.bending,
        "bonded_normal_MPa": 2.0 * first[:, NN].real,
        "bonded_shear_MPa": 2.0 * first[:, NM].real,
    }
    if turned is None:
        return columns
    found = turned.endurance
    return columns | {
        "largest_axial_stress_MPa": found.stress[:, :, MM].max(axis=1),
        "least_axial_stress_MPa": found.stress[:, :, MM].min(axis=1),
        "crossland": found.criteria.crossland,
        "dang_van": found.criteria.dang_van,
        "findley": found.criteria.findley,
        "swt_MPa": found.criteria.swt,
        "ruiz_MPa2_mm": found.ruiz,
    }


def fretting_columns(fit: Fit, wear: Fretting, friction: FloatArray) -> dict[str, FloatArray]:
    """The columns of fretting.csv."""
    return {
        "z_mm": fit.z,
        "friction": friction,
        "largest_pressure_MPa": np.maximum(wear.largest_pressure, 0.0),
        "least_pressure_MPa": np.maximum(wear.least_pressure, 0.0),
        "largest_shear_MPa": wear.largest_shear,
        "axial_slip_range_mm": wear.axial_range,
        "around_slip_range_mm": wear.around_range,
        "friction_work_N_per_mm": wear.work,
        "opening_mm": np.maximum(wear.opening, 0.0),
    }


def write_columns(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write columns as CSV.

    Raises:
        OutputError: it cannot be written.
    """
    rows = np.stack(list(columns.values()), axis=1).tolist()
    lines = [",".join(columns), *(",".join(repr(value) for value in row) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def sentences(found: dict[str, Any]) -> list[str]:
    """A service computation in a few lines for people."""
    lines = [
        f"Loads           {found['journal_force_N'] / 1e3:.4g} kN on the journal and the rail, "
        f"{found['journal_moment_N_mm'] / 1e6:.4g} kN m at the front end of the axle"
    ]
    for name, edge in found["bonded"].items():
        lines.append(
            f"{name.capitalize() + ' edge':<15} nominal bending stress {edge['nominal_stress_MPa']:.1f} MPa "
            f"at z = {edge['z_mm']:.1f} mm{_bonded_said(edge)}"
        )
    lines.append(f"Verdict         {found['verdict']['sentence']}")
    if found["friction"]:
        lines += _turned_said(found["friction"], found["endurance"])
    return lines + doubtful_lines(found["doubts"])


def _bonded_said(edge: dict[str, Any]) -> str:
    said = []
    if edge["stress_concentration"] is not None:
        said.append(f"{edge['stress_concentration']:.2f} times as much {OUTSIDE:g} mm beside the hub")
    else:
        said.append(f"no concentration, for {edge['no_concentration_because']}")
    if edge["shear_power"] is not None:
        said.append(f"shear as the distance to the power {edge['shear_power']:.2f}")
    elif edge["no_shear_power_because"] != edge["no_concentration_because"]:
        said.append(f"no power of the shear, for {edge['no_shear_power_because']}")
    return f"; bonded: {', '.join(said)}"


def _turned_said(friction: dict[str, Any], endurance: dict[str, Any]) -> list[str]:
    zone, slip, left = (friction[key] for key in ("slip_zone_mm", "slip_range_mm", "slip_left_by_revolution"))
    steady = "not known, no place stays in contact all around"
    if left["axial"] is not None:
        steady = (
            f"the last revolution leaves {left['axial']:.1e} of slip along, {left['around']:.1e} around, and is a wave "
            f"to {friction['wave_error']['axial']:.1e}"
        )
    return [
        *(f"{name.capitalize() + ' slip':<15} {_slip_said(slip[name], zone[name])}" for name in zone),
        f"Friction work   {1e-3 * friction['friction_work_N_mm']:.4g} J per revolution; that of the loads differs by "
        f"{friction['work_balance']:.1e}",
        f"Steady          {steady}",
        f"Share of limit  {_shares_said(endurance)}",
    ]


def _slip_said(slip: float | None, zone: float) -> str:
    if slip is None:
        return f"not known, no place there stays in contact all around; over {zone:.1f} mm"
    return f"{1e3 * slip:.2f} um along the axle, over {zone:.1f} mm"


def _shares_said(endurance: dict[str, Any]) -> str:
    """The criteria, and the place of the worst; that of each where they differ."""
    shares = {name: endurance[name] for name in ("crossland", "dang_van", "findley")}
    words = {name: f"{name.replace('_', ' ').title()} {found['value']:.2f}" for name, found in shares.items()}
    places = {name: f"z = {found['z_mm']:.1f} mm" for name, found in shares.items()}
    if len(set(places.values())) == 1:
        return f"{', '.join(words.values())} of a smooth surface, worst at {places['crossland']}"
    return ", ".join(f"{words[name]} at {places[name]}" for name in shares) + ", of a smooth surface"
