"""The table of a convergence for people, and its numbers for programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.files import write_json
from ..presets import PRESETS
from ..results.doubts import doubtful_lines
from ..results.foresight import foreseen
from ..results.kinds import CONVERGENCE
from ..results.versions import versions
from ..scene import dump_scene
from .estimate import GROWING, SHARP, Estimate

if TYPE_CHECKING:
    from .run import Convergence

NUMBERS = CONVERGENCE.numbers


def write_convergence(folder: Path, found: Convergence) -> None:
    """Write convergence.json.

    Raises:
        OutputError: it cannot be written.
    """
    write_json(folder / NUMBERS, numbers(found))


def numbers(found: Convergence) -> dict[str, Any]:
    """What convergence.json holds; errors are relative, None where there is no limit."""
    return {
        "title": found.scene.title,
        "tolerance": found.tolerance,
        "preset_within_tolerance": found.meeting,
        "scene_within_tolerance": within(found),
        "quantities": {each.quantity.key: _quantity(each, found) for each in found.estimates},
        "runs": {name: {"dofs": run.dofs, "cpu_s": run.cpu_s} for name, run in found.runs.items()},
        "scene": dump_scene(found.scene),
        "versions": versions(),
    }


def _quantity(each: Estimate, found: Convergence) -> dict[str, Any]:
    key = each.quantity.key
    return {
        "label": each.quantity.label,
        "unit": each.quantity.unit,
        "value": each.value,
        "error": each.error,
        "mesh_error": each.mesh_error,
        "step_error": each.step_error,
        "observed_order": each.order,
        "remark": each.remark,
        "preset_errors": {name: errors.get(key) for name, errors in found.presets.items()},
    }


def within(found: Convergence) -> bool:
    """Whether the scene as given is within the tolerance in all that has a limit."""
    return all(each.error is None or each.error <= found.tolerance for each in found.estimates)


def sentences(found: Convergence) -> list[str]:
    """The table and what follows from it, in lines."""
    heads = ["", "value", "error", "of mesh", "of step", "order", *found.presets]
    rows = [heads, *(_row(each, found) for each in found.estimates)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(heads))]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]).rstrip()
        for row in rows
    ]
    return [*lines, *_conclusions(found), *doubtful_lines(foreseen(found.scene))]


def _row(each: Estimate, found: Convergence) -> list[str]:
    order = f"{each.order:.1f}" if each.order is not None else each.remark
    value = f"{each.value:.5g} {each.quantity.unit}"
    errors = [_share(each.error), _share(each.mesh_error), _share(each.step_error)]
    presets = [_share(errors.get(each.quantity.key)) for errors in found.presets.values()]
    return [each.quantity.label, value, *errors, order, *presets]


def _share(error: float | None) -> str:
    """A relative error in per cent."""
    if error is None:
        return "-"
    return f"{100.0 * error:.2g} %" if error >= 1e-6 else "< 0.0001 %"


def _conclusions(found: Convergence) -> list[str]:
    goal = f"{100.0 * found.tolerance:.3g} %"
    lines = [f"Scene           {'within' if within(found) else 'not within'} {goal} as it is"]
    if found.meeting is not None:
        lines.append(f"Preset          {found.meeting} is within {goal}: --preset {found.meeting}")
    else:
        lines.append(
            f"Preset          none is within {goal}, {list(PRESETS)[-1]} neither: shorten mesh.seat_facet, "
            f"mesh.corner_facet and motion.increment, or ask for less with --tolerance"
        )
    remarks = {each.remark for each in found.estimates}
    if SHARP in remarks:
        lines.append(
            "Sharp corner    the largest stress grows with every finer mesh, so it has no order and no error; give the "
            "corner its radius (axle.taper_blend, wheel.chamfer_blend)"
        )
    if GROWING in remarks:
        lines.append(
            "Still grows     the largest stress grows with every finer mesh: an edge is sharp (chamfer and blend it, "
            "or wheel.rear_edge_blend), or its arc has too few facets (mesh.corner_facet)"
        )
    return lines
