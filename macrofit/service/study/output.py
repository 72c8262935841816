"""The files of a study of wheelsets in service: a row per run, the spread, a figure; and what is said meanwhile."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...base.files import remove_drafts, write_text, writing
from ...base.progress import printable
from ...results.doubts import doubtful_runs
from ...results.folder import prepare, remove_page, write_numbers
from ...results.kinds import SERVICE_STUDY
from ...results.versions import session, versions
from ...study.output import RUNS, csv_text, refuse_unfinished
from ...study.plan import Plan
from ...study.statistics import statistics
from ..output import NUMBERS
from .record import MEASURES, ServiceRecord, ServiceStudyFile, is_service_study, measured

STUDY_FILE, TOTALS = SERVICE_STUDY.mark, SERVICE_STUDY.numbers
ROWS, FIGURE = "service-study.csv", "service-study.png"
SHOWN = {
    "friction_work_N_mm": ("Friction work", 1e-3, "J"),
    "front_slip_range_mm": ("Front slip", 1e3, "um"),
    "inner_slip_range_mm": ("Inner slip", 1e3, "um"),
    "axial_stress_amplitude_MPa": ("Axial stress", 1.0, "MPa, amplitude"),
    "crossland": ("Crossland", 1.0, "of the limit"),
    "ruiz_MPa2_mm": ("Ruiz", 1.0, "MPa2 mm"),
}
"""What is said of all runs: its name, factor and unit."""


def open_service_study(folder: Path, plan: Plan, *, resume: bool) -> ServiceStudyFile:
    """Make the folder ready; with ``resume`` the finished runs in it count.

    Raises:
        OutputError: it holds something else, or unfinished runs of this study that ``resume`` would use.
    """
    path = folder / STUDY_FILE
    owned = is_service_study(path)
    prepare(folder, owned=owned)
    if owned and not resume and not (folder / TOTALS).exists():
        refuse_unfinished(folder, path, plan)
    kept = ServiceStudyFile(path, replace=not resume)
    remove_drafts(folder)
    if not resume:
        remove_page(folder)
        with writing(folder):
            for stale in (ROWS, TOTALS, FIGURE):
                (folder / stale).unlink(missing_ok=True)
            for numbers in (folder / RUNS).glob(f"*/{NUMBERS}"):
                shutil.rmtree(numbers.parent)
    return kept


def told_of(record: ServiceRecord) -> str:
    """What is said of a run when it has come in."""
    work = record.values["friction_work_N_mm"]
    return "ended early" if work is None else f"friction work {1e-3 * work:8.4g} J"


def write_service_study(folder: Path, plan: Plan, records: Sequence[ServiceRecord]) -> list[str]:
    """Write the table, the totals and the figure; gives the summary lines.

    Raises:
        OutputError: a file cannot be written.
    """
    from .figures import write_service_figure

    write_text(folder / ROWS, csv_text(_table(plan, records)))
    write_service_figure(folder / FIGURE, plan, records)
    totals = _totals(plan, records)
    write_numbers(folder / TOTALS, totals)  # last: its presence says that the study is complete
    return [*_sentences(records, totals), f"Figures         {FIGURE}", f"Files           {folder}"]


def _table(plan: Plan, records: Sequence[ServiceRecord]) -> list[list[str]]:
    rows = [["run", "label", *plan.keys, *MEASURES, "verdict", "doubts", "ended", "cpu_s"]]
    for run, record in zip(plan.runs, records, strict=True):
        cells = [str(run.number), run.label, *(run.values.get(key, "") for key in plan.keys)]
        cells += ["" if value is None else repr(value) for value in record.values.values()]
        rows.append([*cells, record.verdict, str(len(record.doubts)), record.ended or "", f"{record.cpu_s:.3f}"])
    return rows


def _totals(plan: Plan, records: Sequence[ServiceRecord]) -> dict[str, Any]:
    pairs = list(zip(plan.runs, records, strict=True))
    samples = {name: measured(plan, records, name) for name in MEASURES}
    return {
        "scene": printable(plan.source),
        "title": plan.title,
        "keys": list(plan.keys),
        "runs": [
            {"run": run.number, "label": run.label, "values": run.values, "digest": run.digest} for run, _ in pairs
        ],
        "statistics": {name: statistics(values) for name, values in samples.items() if len(values)},
        "verdicts": dict(Counter(record.verdict for record in records)),
        "ended": {str(run.number): record.ended for run, record in pairs if record.ended},
        "doubts": {str(run.number): record.doubts for run, record in pairs if record.doubts},
        "runs_cpu_s": sum({record.digest: record.cpu_s for record in records}.values()),
        "versions": versions(),
        "provenance": session(),
    }


def _sentences(records: Sequence[ServiceRecord], totals: dict[str, Any]) -> list[str]:
    each = totals["runs_cpu_s"] / len({record.digest for record in records})
    lines = [f"Runs            {len(records)}, {each:.2f} CPU s each"]
    for name, (word, factor, unit) in SHOWN.items():
        found = totals["statistics"].get(name)
        if found is not None:
            low, mean, high, spread = (factor * found[key] for key in ("min", "mean", "max", "standard_deviation"))
            several = f"{low:.4g} to {high:.4g}, mean {mean:.4g} ± {spread:.2g}" if found["runs"] > 1 else f"{mean:.4g}"
            lines.append(f"{word:<15} {several} {unit}")
    words = ", ".join(f"{count} {word}" for word, count in totals["verdicts"].items())
    lines.append(f"Verdict         {words}")
    if totals["ended"]:
        first, why = next(iter(totals["ended"].items()))
        lines.append(f"Ended early     {len(totals['ended'])} runs; run {first}: {why}")
    return lines + doubtful_runs([record.doubts for record in records])
