"""What a service computation writes: summary.json, seat.csv, its figure, and lines for people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..base.files import write_text
from ..results.versions import versions
from ..scene import dump_scene
from .bonded import OUTSIDE, Bonded, Edge
from .wheelset import Wheelset

SEAT = "seat.csv"
"""Values along the seat, one row for each facet."""


def bonded_numbers(whole: Wheelset, found: Bonded) -> dict[str, Any]:
    """The numbers of summary.json, keys with their units."""
    keys = whole.loads.keys
    return {
        "title": whole.scene.title,
        "displacement_mm": whole.displacement,
        "journal_force_N": keys.journal_force,
        "journal_moment_N_mm": keys.journal_moment,
        "lateral_force_N": keys.lateral_force,
        "torque_N_mm": keys.torque,
        "bonded": {edge.name: _edge(edge) for edge in found.edges},
        "scene": dump_scene(whole.scene),
        "versions": versions(),
    }


def _edge(edge: Edge) -> dict[str, float | None]:
    return {
        "z_mm": edge.z,
        "nominal_stress_MPa": edge.nominal_stress,
        "stress_concentration": edge.concentration,
        "shear_power": edge.shear_power,
    }


def bonded_columns(found: Bonded) -> dict[str, FloatArray]:
    """The columns of seat.csv of the bonded solution, at the angle 0 of the load."""
    return {
        "z_mm": found.z,
        "nominal_stress_MPa": found.nominal,
        "bonded_bending_stress_MPa": found.bending,
        "bonded_normal_MPa": 2.0 * found.harmonics[1].stress[:, 0].real,
        "bonded_shear_MPa": 2.0 * found.harmonics[1].stress[:, 3].real,
    }


def write_columns(path: Path, columns: dict[str, FloatArray]) -> None:
    """Write columns as CSV.

    Raises:
        OutputError: it cannot be written.
    """
    rows = np.stack(list(columns.values()), axis=1).tolist()
    lines = [",".join(columns), *(",".join(repr(value) for value in row) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def bonded_sentences(numbers: dict[str, Any]) -> list[str]:
    """The bonded solution in a few lines for people."""
    lines = [
        f"Loads           {numbers['journal_force_N'] / 1e3:.4g} kN on the journal and the rail, "
        f"{numbers['journal_moment_N_mm'] / 1e6:.4g} kN m at the front end of the axle"
    ]
    for name, edge in numbers["bonded"].items():
        lines.append(
            f"{name.capitalize() + ' edge':<15} nominal bending stress {edge['nominal_stress_MPa']:.1f} MPa "
            f"at z = {edge['z_mm']:.1f} mm{_bonded_said(edge)}"
        )
    return lines


def _bonded_said(edge: dict[str, float | None]) -> str:
    said = []
    if edge["stress_concentration"] is not None:
        said.append(f"{edge['stress_concentration']:.2f} times as much {OUTSIDE:g} mm beside the hub")
    if edge["shear_power"] is not None:
        said.append(f"shear as the distance to the power {edge['shear_power']:.2f}")
    return f"; bonded: {', '.join(said)}" if said else ""
