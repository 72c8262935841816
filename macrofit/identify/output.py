"""The files of an identification: its numbers, the two curves, a figure; and its summary in lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..base.figure import BLUE, VERMILION, save, sheet
from ..base.files import write_json, write_text
from ..base.ranks import made_by_first, raise_together
from ..base.toml import last_part
from ..monitor import lines_of_first
from ..results.folder import prepare_for_all
from ..results.kinds import IDENTIFICATION
from ..results.versions import versions
from .fit import Identification, identify
from .measured import Reading, read_measured

NUMBERS, CURVES, FIGURE = IDENTIFICATION.numbers, "identified_curve.csv", "identification.png"
MISFIT = 0.1
"""Residual over the largest force above which a value is doubtful [-]."""
COVERED = 0.2
"""Share of the scene's motion that a curve should cover [-]."""
ASSUMPTIONS = (
    "standard_error is sqrt(sigma^2 / J'J) of the measured points: it takes their errors as independent, of one "
    "spread, and the scene (drawing, interference, surfaces) as exact. standard_error_correlated allows for residuals "
    "whose neighbours are alike, as those are where other surfaces were measured than computed."
)


def carry_out_identification(
    source: str,
    curve: Path,
    comm: MPI.Comm,
    folder: Path,
    *,
    overrides: tuple[str, ...],
    key: str | None,
    bounds: tuple[float, float] | None,
    quiet: bool,
    reading: Reading | None = None,
    free_shift: bool = False,
) -> list[str]:
    """Identify, write into ``folder``, and give the summary lines (rank 0). Collective.

    Raises:
        MacrofitError: on all ranks together.
    """
    measured = made_by_first(comm, lambda: read_measured(curve, reading))
    prepare_for_all(comm, folder, NUMBERS)
    say = lines_of_first(comm, quiet=quiet)
    say(f"Curve           {measured.taken}")
    found = identify(source, measured, overrides, key, bounds, comm, say, free_shift=free_shift)
    lines: list[str] = []
    with raise_together(comm):
        if comm.rank == 0:
            lines = write_identification(folder, found, str(curve))
    return lines


def write_identification(folder: Path, found: Identification, curve: str) -> list[str]:
    """Write identification.json, identified_curve.csv and the figure; gives the summary lines.

    Raises:
        OutputError: a file cannot be written.
    """
    fit = found.fit
    rows = np.column_stack([found.displacement, found.measured, fit.fitted, fit.residual])
    text = "\n".join(",".join(repr(float(value)) for value in row) for row in rows)
    write_text(folder / CURVES, f"displacement_mm,measured_N,fitted_N,residual_N\n{text}\n")
    save(figure(found), folder / FIGURE, trim=True)
    write_json(folder / NUMBERS, numbers(found, curve))
    return [*sentences(found), f"Files           {folder}"]


def numbers(found: Identification, curve: str) -> dict[str, Any]:
    """What identification.json holds."""
    fit = found.fit
    return {
        "key": found.key,
        "value": fit.value,
        "standard_error": fit.standard_error,
        "standard_error_correlated": fit.standard_error_correlated,
        "neighbour_correlation": fit.correlation,
        "interval_95": [fit.value - 1.96 * fit.standard_error, fit.value + 1.96 * fit.standard_error],
        "assumptions": ASSUMPTIONS,
        "residual_deviation_N": fit.sigma,
        "largest_measured_force_N": float(np.abs(found.measured).max()),
        "bounds": list(found.bounds),
        "points": len(found.measured),
        "points_left_out": found.left_out,
        "curve": curve,
        "curve_taken": found.taken,
        "units_assumed": list(found.assumed),
        "shift_mm": found.shift,
        "shift_standard_error_mm": found.shift_error,
        "proposed_shift_mm": None if found.proposal is None else found.proposal.shift,
        "doubts": doubts(found),
        "provider": found.scene.friction.provider,
        "options": found.scene.friction.options,
        "trials": [{"value": value, "sum_of_squares_N2": squares} for value, squares in fit.trials],
        "factorisations": found.factorisations,
        "versions": versions(),
    }


def sentences(found: Identification) -> list[str]:
    """The result in a few lines for people."""
    fit = found.fit
    top = float(np.abs(found.measured).max())
    lines = [
        f"Identified      {found.key} = {fit.value:.5g} ± {fit.standard_error:.2g} (standard error), {found.runs} runs",
        f"Residual        {fit.sigma / 1e3:.4g} kN, {fit.sigma / top:.2%} of the largest force, "
        f"{len(found.measured)} points",
    ]
    if found.shift_error is not None:
        lines.append(f"Shift           {found.shift:+.4g} ± {found.shift_error:.2g} mm added to the displacements")
    if found.left_out:
        lines.append(f"Left out        {found.left_out} points outside the displacements of the scene")
    if fit.correlation > 2.0 / np.sqrt(len(found.measured)):
        lines.append(
            f"Correlated      neighbouring residuals are alike ({fit.correlation:.2f}): more than noise is left; "
            f"± {fit.standard_error_correlated:.2g} allows for it"
        )
    if found.proposal is not None:
        lines.append(
            f"Offset          displacements shifted by {found.proposal.shift:+.3g} mm would leave a residual of "
            f"{found.proposal.deviation / 1e3:.3g} kN and give {fit.value + found.proposal.step:.4g}: if the record "
            f"may have begun late or early, repeat with --free-shift"
        )
    return [*lines, *(f"Doubtful        {line}" for line in doubts(found))]


def doubts(found: Identification) -> list[str]:
    """What makes the value doubtful, a line each."""
    lines = list(found.doubts)
    share = found.fit.sigma / float(np.abs(found.measured).max())
    if share > MISFIT:
        lines.append(
            f"the curve of the scene is not the measured one: {share:.0%} of the largest force is left; check units, "
            f"columns, offset and drawing"
        )
    whole, covered = float(np.ptp(found.scene.displacements)), float(np.ptp(found.displacement))
    if covered < COVERED * whole:
        lines.append(
            f"the measured curve covers {covered:.3g} of {whole:.4g} mm of the scene's motion"
            + ("; its displacements are taken for mm, which the file does not say" if "mm" in found.assumed else "")
        )
    return lines


def figure(found: Identification) -> Any:
    """Measured and fitted force against displacement, and the residual below."""
    drawn, (upper, lower) = sheet(7.0, 6.0, rows=2)
    fit = found.fit
    name = last_part(found.key)
    upper.plot(found.displacement, found.measured / 1e3, ".", color=VERMILION, ms=3, label="measured")
    label = f"fitted, {name} = {fit.value:.4g} ± {fit.standard_error:.1g}"
    upper.plot(found.displacement, fit.fitted / 1e3, color=BLUE, lw=1.6, label=label)
    upper.legend(frameon=False, fontsize=9)
    upper.set_ylabel("pushing force [kN]")
    lower.axhline(0.0, color=BLUE, lw=1.0)
    lower.axhspan(-fit.sigma / 1e3, fit.sigma / 1e3, color=BLUE, alpha=0.12, lw=0)
    lower.plot(found.displacement, fit.residual / 1e3, ".", color=VERMILION, ms=3)
    lower.set_ylabel("measured - fitted [kN]")
    lower.set_xlabel("displacement of the wheel [mm]")
    if found.scene.title:
        upper.set_title(found.scene.title, fontsize=10)
    return drawn
