"""What a run says in numbers and in words: the summary, the verdict of the standards, the scene's promise."""

from __future__ import annotations

import platform
import sys
from importlib import metadata
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from ..base.arrays import FloatArray
from ..bodies.geometry import Sizes, draw
from ..bodies.mesh import read_mesh
from ..errors import MacrofitError
from ..scene import Hub, MeshFile, Scene, Shaft

if TYPE_CHECKING:
    from ..solution import Solution

EN_13260 = (0.85 * 4e3, 1.45 * 4e3)
"""Pressing force at the end over the seat's diameter [N/mm]: 0.85 to 1.45 times 4e-3 MN per mm."""
GOST_11018 = (3.92e3, 5.88e3)
"""The same [N/mm]: 392 to 588 kN per 100 mm."""
OSCILLATION_LIMIT = 0.03
"""Largest drop of a smooth pressing curve below what it had reached, over its peak."""


class Window(msgspec.Struct, frozen=True, rename={"low": "low_N", "high": "high_N"}):
    """The forces [N] a standard accepts at the end of the press fit, and whether the run's is one of them."""

    low: float
    high: float
    inside: bool


class Verdict(msgspec.Struct, frozen=True, rename={"final_force": "final_force_N"}):
    """A press fit held against the acceptance rules for wheelsets.

    Where the motion reverses, only what comes before is the press fit.
    """

    seat_diameter_mm: float
    final_force: float
    en_13260: Window
    gost_11018: Window
    oscillation: float  # largest drop of the force below its running maximum, over the peak
    smooth: bool  # oscillation at most OSCILLATION_LIMIT
    bulge: float  # mean height of the curve above the chord from first force to end, over the peak
    convex: bool  # bulge not negative: the curve bulges upwards
    sentence: str


def verdict(solution: Solution) -> tuple[Verdict | None, str]:
    """The verdict, or None and the reason why the standards say nothing about this run."""
    scene = solution.scene
    axle = scene.axle
    if not (isinstance(axle, Shaft) and isinstance(scene.wheel, Hub)):
        return None, "the seat and the bore are not drawn with two radii"
    if scene.direction != "radial":
        return None, "the gap is not measured along the radius"
    pressed = _pressed(solution.displacement)
    displacement, force = solution.displacement[pressed], solution.force[pressed]
    if len(force) < 2 or displacement[0] > 0.0:
        return None, "the wheel is not pushed on from the entrance of the seat"
    if force.max() <= 0.0:
        return None, "no force is needed to push the wheel on"
    wheel = scene.wheel
    covered = min(float(displacement[-1]), axle.seat_length, wheel.hub_length)
    if covered < 0.8 * min(axle.seat_length, wheel.hub_length):
        return None, f"the wheel is pushed on by {displacement[-1]:g} mm only"
    return _judge(2.0 * axle.seat_radius, displacement, force), ""


def _pressed(displacement: FloatArray) -> slice:
    """The increments before the motion first turns back."""
    back = np.flatnonzero(np.diff(displacement) < 0.0)
    return slice(0, int(back[0]) + 1 if len(back) else len(displacement))


def _judge(diameter: float, displacement: FloatArray, force: FloatArray) -> Verdict:
    final, peak = float(force[-1]), float(force.max())
    european, russian = (
        Window(low * diameter, high * diameter, low * diameter <= final <= high * diameter)
        for low, high in (EN_13260, GOST_11018)
    )
    oscillation = float((np.maximum.accumulate(force) - force).max()) / peak
    bulge = _bulge(displacement, force) / peak
    smooth, convex = oscillation <= OSCILLATION_LIMIT, bulge >= 0.0
    sentence = (
        f"The wheel is pressed on with {final / 1e3:.0f} kN at the end, "
        f"{_placed(european, 'EN 13260')} and {_placed(russian, 'GOST 11018')} "
        f"for a seat of {diameter:g} mm in diameter; "
        f"the curve {'rises smoothly' if smooth else 'is not smooth'} "
        f"(it drops by {oscillation:.1%} of its peak, {OSCILLATION_LIMIT:.0%} allowed) "
        f"and {'bulges upwards' if convex else 'sags'}."
    )
    return Verdict(diameter, final, european, russian, oscillation, smooth, bulge, convex, sentence)


def _bulge(displacement: FloatArray, force: FloatArray) -> float:
    """Mean height of the curve above its chord [N], from where the force begins."""
    first = max(int(np.argmax(force > 1e-3 * force.max())) - 1, 0)
    s, f = displacement[first:], force[first:]
    chord = f[0] + (f[-1] - f[0]) * (s - s[0]) / (s[-1] - s[0])
    above = f - chord
    return float((0.5 * (above[1:] + above[:-1])) @ np.diff(s)) / float(s[-1] - s[0])


def _placed(window: Window, standard: str) -> str:
    where = "inside" if window.inside else "outside"
    return f"{where} the {window.low / 1e3:.0f} to {window.high / 1e3:.0f} kN of {standard}"


def summary(solution: Solution) -> dict[str, Any]:
    """The numbers of summary.json, keys with their units. A number that does not exist is None."""
    scene, records, force = solution.scene, solution.increments, solution.force
    top = int(np.argmax(force)) if records else None
    judged, reason = verdict(solution)
    radial = None if scene.interference is None else round(scene.interference, 12)  # 95 - 94.7 = 0.29999...
    return {
        "title": scene.title,
        "peak_force_N": None if top is None else float(force[top]),
        "peak_force_displacement_mm": None if top is None else float(solution.displacement[top]),
        "lowest_force_N": float(force.min()) if records else None,
        "final_force_N": float(force[-1]) if records else None,
        "max_von_mises_MPa": {
            body: {"value": at.value, "r_mm": at.r_mm, "z_mm": at.z_mm, "displacement_mm": at.displacement_mm}
            for body, at in solution.max_von_mises.items()
        },
        "interference_radial_mm": radial,
        "interference_diametral_mm": None if radial is None else 2.0 * radial,
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
    }


def versions() -> dict[str, str]:
    """Versions of what computes; nothing is imported for it, and what is not installed is left out."""
    found = {"macrofit": sys.modules["macrofit"].__version__, "python": platform.python_version()}
    for name, distribution in (("numpy", "numpy"), ("scipy", "scipy"), ("dolfinx", "fenics-dolfinx")):
        version = getattr(sys.modules.get(name), "__version__", None)
        try:
            found[name] = version or metadata.version(distribution)
        except metadata.PackageNotFoundError:
            continue
    petsc = sys.modules.get("petsc4py.PETSc")
    if petsc is not None:
        found["petsc"] = ".".join(str(part) for part in petsc.Sys.getVersion())
    return found


def sentences(numbers: dict[str, Any]) -> list[str]:
    """A summary in a few lines for people."""
    lines = []
    radial = numbers["interference_radial_mm"]
    if radial is not None:
        lines.append(interference_line(radial))
    if numbers["increments"]:
        lines.append(
            f"Peak force      {numbers['peak_force_N'] / 1e3:.5g} kN "
            f"at {numbers['peak_force_displacement_mm']:.6g} mm, "
            f"{numbers['final_force_N'] / 1e3:.5g} kN at the end"
        )
    for body, at in numbers["max_von_mises_MPa"].items():
        lines.append(
            f"Max von Mises   {at['value']:.1f} MPa in the {body} at r = {at['r_mm']:.2f} mm, "
            f"z = {at['z_mm']:.2f} mm, displacement {at['displacement_mm']:.6g} mm"
        )
    failed = numbers["unconverged_increments"]
    if failed:
        lines.append(f"Not converged   {failed} of {numbers['increments']} increments")
    judged = numbers["verdict"]
    reason = numbers["verdict_reason"]
    lines.append(f"Verdict         {judged['sentence'] if judged else f'none: {reason}.'}")
    return lines


def interference_line(radial: float) -> str:
    """The interference both ways, so that a radius is never taken for a diameter."""
    return f"Interference    {radial:.4g} mm on the radius, {2.0 * radial:.4g} mm on the diameter"


def first_touch(scene: Scene) -> float | None:
    """The first planned displacement [mm] at which the drawn, undeformed bodies overlap.

    None where they never do, or where a body comes from a file.
    """
    if isinstance(scene.axle, MeshFile) or isinstance(scene.wheel, MeshFile):
        return None
    seat = draw(scene.axle, "seat", Sizes.of(scene.mesh, "seat")).generatrix
    bore = draw(scene.wheel, "bore", Sizes.of(scene.mesh, "bore")).generatrix
    ends = (seat.breaks[[0, -1]], bore.breaks[[0, -1]])
    radial = scene.direction == "radial"
    for displacement in scene.displacements:
        shift, advance = (displacement, 0.0) if radial else (0.0, displacement)
        first, last = max(ends[0][0], ends[1][0] + shift), min(ends[0][1], ends[1][1] + shift)
        if first > last:
            continue
        s = np.linspace(first, last, max(2, round((last - first) / 0.1) + 1))
        gap = bore.height(s - shift) - seat.height(s) if radial else seat.height(s) - bore.height(s) - advance
        if gap.min() < 0.0:
            return displacement
    return None


def seat_ends(scene: Scene) -> FloatArray | None:
    """Facet ends of the seat [mm] from the scene alone, for a run that ended before its solution."""
    if not isinstance(scene.axle, MeshFile):
        return draw(scene.axle, "seat", (sizes := Sizes.of(scene.mesh, "seat"))).generatrix.nodes(sizes)
    if scene.mesh.axle is None:
        return None
    try:
        mesh = read_mesh(scene.mesh.axle, "axle")
    except MacrofitError:
        return None
    column = 1 if scene.direction == "radial" else 0
    coordinates: FloatArray = np.unique(mesh.points[mesh.edges["seat"], column])
    return coordinates
