"""What a run says in numbers and in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from ..acceptance import Standard, verdict
from ..acceptance.run import holding
from ..scene import Disc
from .curves import without_rounding
from .doubts import doubtful_lines, doubts
from .versions import versions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..solution import Extreme, Solution, YieldZone


def summary(solution: Solution, standard: Standard | None = None) -> dict[str, Any]:
    """The numbers of summary.json, keys with their units; ``standard`` judges. A number that does not exist is None."""
    scene, records = solution.scene, solution.increments
    force = without_rounding(solution.force, np.array([record.normal_force for record in records]))
    top = int(np.argmax(force)) if records else None
    judged, reason = verdict(solution, standard)
    radial = None if scene.interference is None else round(scene.interference, 12)  # 95 - 94.7 = 0.29999...
    return {
        "title": scene.title,
        "peak_force_N": None if top is None else float(force[top]),
        "peak_force_displacement_mm": None if top is None else float(solution.displacement[top]),
        "lowest_force_N": float(force.min()) if records else None,
        "final_force_N": float(force[-1]) if records else None,
        "peak_force_sd_N": None if top is None else _known(records[top].force_sd),
        "final_force_sd_N": _known(records[-1].force_sd) if records else None,
        "max_von_mises_MPa": _places(solution.max_von_mises),
        "residual_von_mises_MPa": _places(solution.residual),
        "plastic_strain": _zones(solution.flowed, "value"),
        "beyond_yield": _zones(solution.beyond_yield, "stress_over_yield"),
        "plastic_work_N_mm": sum(record.plastic_work for record in records),
        "interference_radial_mm": radial,
        "interference_diametral_mm": None if radial is None else 2.0 * radial,
        "heat": _heat(solution),
        "holding": holding(solution),
        "force_balance": solution.force_balance,
        "energy_balance": solution.energy_balance,
        "max_residual": max((record.residual for record in records), default=0.0),
        "increments": len(records),
        "unconverged_increments": sum(not record.converged for record in records),
        "newton_iterations": sum(record.newton_iterations for record in records),
        "cutbacks": sum(record.cutbacks for record in records),
        "setup_cpu_s": solution.setup_cpu_s,
        "increments_cpu_s": solution.increments_cpu_s,
        "stress_cpu_s": solution.stress_cpu_s,
        "total_cpu_s": solution.setup_cpu_s + solution.increments_cpu_s + solution.stress_cpu_s,
        "dofs": solution.dofs,
        "counters": solution.counters,
        "versions": versions(),
        "verdict": None if judged is None else msgspec.to_builtins(judged),
        "verdict_reason": reason or None,
        "doubts": doubts(solution),
    }


def _known(value: float) -> float | None:
    """A number that exists, else None."""
    return value if math.isfinite(value) else None


def _heat(solution: Solution) -> dict[str, float | int] | None:
    """How warm the wheel is put on [K], how much wider that makes its bore [1], and in how many increments it cools."""
    scene = solution.scene
    if isinstance(scene.wheel, Disc) or scene.thermal_strain == 0.0:
        return None
    return {
        "wheel_temperature_K": scene.wheel.temperature,
        "thermal_strain": scene.thermal_strain,
        "cooling_increments": scene.motion.cooling,
    }


def _places(extremes: dict[str, Extreme]) -> dict[str, dict[str, float]]:
    """The largest stress of each body and its place; z in the axle's frame."""
    return {
        body: {"value": at.value, "r_mm": at.r_mm, "z_mm": at.z_mm, "displacement_mm": at.displacement_mm}
        for body, at in extremes.items()
    }


def _zones(zones: dict[str, YieldZone], name: str) -> dict[str, dict[str, float]]:
    """Where each body flowed, or is beyond its yield stress; z in the axle's frame."""
    return {
        body: {name: zone.value} | {key: getattr(zone, key) for key in ("r_mm", "z_mm", "depth_mm", "area_mm2")}
        for body, zone in zones.items()
    }


def sentences(numbers: dict[str, Any]) -> list[str]:
    """A summary in a few lines for people."""
    lines = []
    radial = numbers["interference_radial_mm"]
    if radial is not None:
        lines.append(interference_line(radial))
    lines += _heat_said(numbers["heat"])
    if numbers["increments"]:
        lines.append(
            f"Peak force      {numbers['peak_force_N'] / 1e3:.5g} kN "
            f"at {numbers['peak_force_displacement_mm']:.6g} mm, "
            f"{numbers['final_force_N'] / 1e3:.5g} kN at the end"
        )
    lines += _deviation_said(numbers["peak_force_sd_N"], numbers["final_force_sd_N"])
    lines += _holding_said(numbers["holding"])
    for head, key in (("Max von Mises", "max_von_mises_MPa"), ("Once released", "residual_von_mises_MPa")):
        lines += [
            f"{head:15} {at['value']:.1f} MPa in the {body} at r = {at['r_mm']:.2f} mm, "
            f"z = {at['z_mm']:.2f} mm, displacement {at['displacement_mm']:.6g} mm"
            for body, at in numbers[key].items()
        ]
    for body, zone in numbers["plastic_strain"].items():
        lines.append(
            f"Plastic strain  {zone['value']:.2%} at most in the {body} at r = {zone['r_mm']:.2f} mm, "
            f"z = {zone['z_mm']:.2f} mm; {_extent(zone)}"
            if zone["area_mm2"]
            else f"Plastic strain  none in the {body}"
        )
    failed = numbers["unconverged_increments"]
    if failed:
        lines.append(f"Not converged   {failed} of {numbers['increments']} increments")
    judged = numbers["verdict"]
    lines.append(f"Verdict         {judged['sentence'] if judged else 'none: ' + numbers['verdict_reason'] + '.'}")
    return lines + doubtful_lines(numbers["doubts"])


def _deviation_said(peak: float | None, end: float | None) -> Iterator[str]:
    said = [f"{force / 1e3:.2g} kN at the {where}" for force, where in ((peak, "peak"), (end, "end")) if force]
    if said:
        yield f"Uncertain by    {', '.join(said)}: standard deviation, from the coefficients of the pairs of tiles"


def _heat_said(heat: dict[str, Any] | None) -> Iterator[str]:
    if heat is not None:
        cools = heat["cooling_increments"]
        yield (
            f"Heated wheel    {heat['wheel_temperature_K']:g} K warmer than the axle, its bore wider by "
            f"{heat['thermal_strain']:.4%}; {f'cooled in {cools} increments' if cools else 'it stays so'}"
        )


def _holding_said(holds: dict[str, float] | None) -> Iterator[str]:
    if holds is not None:
        yield (
            f"Holds           {holds['push_off_N'] / 1e3:.5g} kN pushed on, {holds['pull_off_N'] / 1e3:.5g} kN pulled "
            f"off, {holds['torque_N_mm'] / 1e6:.4g} kN m of torque, at {holds['displacement_mm']:.6g} mm"
        )


def _extent(zone: dict[str, float]) -> str:
    return f"it flowed down to {zone['depth_mm']:.1f} mm, over {zone['area_mm2']:.0f} mm2 of the section"


def interference_line(radial: float) -> str:
    """The interference both ways, so that a radius is never taken for a diameter."""
    return f"Interference    {radial:.4g} mm on the radius, {2.0 * radial:.4g} mm on the diameter"
