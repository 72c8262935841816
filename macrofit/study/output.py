"""The files of a study: a row per run, a column per curve, the totals, the figures; and what is said meanwhile."""

from __future__ import annotations

import csv
import io
import shutil
import time
from collections import Counter
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from ..acceptance import Verdict, judge_scene
from ..base.files import remove_drafts, write_text, writing
from ..base.progress import duration, printable, say
from ..errors import OutputError
from ..results.doubts import doubtful_runs
from ..results.folder import JOURNAL, prepare, remove_page, write_numbers
from ..results.kinds import STUDY
from ..results.versions import session, versions
from ..solution import Extreme
from .fields import FIELDS
from .plan import Plan, PlannedRun
from .record import RunRecord, StudyFile, held_digests, is_study, total
from .statistics import BODIES, measured_samples, statistics, varied

STUDY_FILE, TOTALS = STUDY.mark, STUDY.numbers
ROWS, CURVES, RUNS = "study.csv", "curves.csv", "runs"
COUNTERS = ("newton_iterations", "provider_calls", "pairs_asked")
SAY_EVERY_S = 2.0


def open_study(folder: Path, plan: Plan, *, resume: bool) -> StudyFile:
    """Make the folder ready; with ``resume`` the finished runs in it count.

    Raises:
        OutputError: it holds something else, or unfinished runs of this study that ``resume`` would use.
    """
    path = folder / STUDY_FILE
    owned = is_study(path)
    prepare(folder, owned=owned)
    if not resume and owned and not (folder / TOTALS).exists():
        refuse_unfinished(folder, path, plan)
    kept = StudyFile(path, replace=not resume)
    remove_drafts(folder, folder / FIELDS)
    if resume:  # what is there stays until it is written anew: a run may still be refused
        return kept
    remove_page(folder)
    with writing(folder):
        for stale in (folder / ROWS, folder / CURVES, folder / TOTALS, *folder.glob("*.png")):
            stale.unlink(missing_ok=True)
        shutil.rmtree(folder / FIELDS, ignore_errors=True)
        for journal in (folder / RUNS).glob(f"*/{JOURNAL}"):
            shutil.rmtree(journal.parent)
    return kept


def refuse_unfinished(folder: Path, path: Path, plan: Plan) -> None:
    """See that the file of an unfinished study in a folder holds no run of this one.

    Raises:
        OutputError: it does.
    """
    held = held_digests(path) & {run.digest for run in plan.runs}
    if held:
        raise OutputError(
            f"{folder}: holds an unfinished study with {len(held)} of these runs; continue it with --resume, "
            f"choose another folder with -o, or delete this one"
        )


def run_folder(folder: Path, run: PlannedRun) -> Path:
    """Where `--keep` puts a run."""
    return folder / RUNS / f"{run.number:04d}"


def write_study(
    folder: Path,
    plan: Plan,
    records: Sequence[RunRecord],
    *,
    computed: int,
    costs: Sequence[tuple[int, int, float]],
) -> list[str]:
    """Write study.csv, curves.csv, study.json and the figures; gives the summary lines.

    costs: per rank, factorisations of bodies, assemblies and their CPU time [s], of this session alone.
    """
    from .figures import write_study_figures

    verdicts = [_verdict(plan, *pair) for pair in zip(plan.runs, records, strict=True)]
    rows = [_columns(plan), *(_row(plan, *each) for each in zip(plan.runs, records, verdicts, strict=True))]
    write_text(folder / ROWS, csv_text(rows))
    write_text(folder / CURVES, csv_text(_curves(plan, records)))
    figures = write_study_figures(folder, plan, records, verdicts)
    numbers = _totals(plan, records, computed, costs) | {"verdicts": _verdict_totals(plan, verdicts)}
    write_numbers(folder / TOTALS, numbers)  # last: its presence says that the study is complete
    drawn = ", ".join(path.name for path in figures)
    lines = [*_sentences(plan, records, numbers), *_accepted(verdicts)]
    return [*lines, f"Figures         {drawn}", f"Files           {folder}"]


class StudyProgress:
    """One line per finished run, at most every SAY_EVERY_S where there are many; with the time left."""

    def __init__(self, plan: Plan, *, already: int, quiet: bool) -> None:
        self.labels = {run.digest: run.label for run in plan.runs}
        self.total, self.count, self.already, self.quiet = len(self.labels), already, already, quiet
        self._begin, self._said = time.monotonic(), 0.0
        if already and not quiet:
            say(f"{already} of {self.total} runs are there already")

    def finished(self, digest: str, told: str, behind: int = 0) -> None:
        """A run has come in, with what is told of it, and so many more of its group that are told next."""
        self.count += 1
        now = time.monotonic()
        last = self.count == self.total
        if self.quiet or (self.total > 20 and not last and now - self._said < SAY_EVERY_S):
            return
        self._said = now
        each = (now - self._begin) / (self.count + behind - self.already)
        remaining = "" if last else f"  {duration(each * (self.total - self.count))} left"
        say(f"run {self.count:{len(str(self.total))}d}/{self.total}  {told}  {self.labels[digest]}{remaining}")


def csv_text(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as the text of a CSV file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _columns(plan: Plan) -> list[str]:
    return [
        "run", "label", *plan.keys, "peak_force_N", "peak_force_displacement_mm", "final_force_N",
        *(f"{body}_{name}" for body in BODIES for name in ("max_von_mises_MPa", "r_mm", "z_mm", "displacement_mm")),
        *(f"{body}_plastic_strain" for body in BODIES), "plastic_work_N_mm", "increments", *COUNTERS, "cutbacks",
        "unconverged_increments", "doubts", "verdict", "refused_for", "cpu_s",
    ]  # fmt: skip


def _row(plan: Plan, run: PlannedRun, record: RunRecord, verdict: Verdict | None) -> list[str]:
    force, place = record.peak
    cells = [str(run.number), run.label, *(run.values.get(key, "") for key in plan.keys)]
    cells += [repr(force), repr(place), repr(record.force_N[-1])]
    for body in BODIES:
        cells += _place(record.max_von_mises.get(body))
    cells += [repr(record.plastic_strain[body]) if body in record.plastic_strain else "" for body in BODIES]
    cells.append(repr(record.plastic_work))
    cells += [str(len(record.force_N)), *(str(record.counters.get(name, "")) for name in COUNTERS)]
    cells += [str(record.cutbacks), str(record.unconverged), str(len(record.doubts))]
    cells += ["", ""] if verdict is None else [verdict.word, " ".join(check.name for check in verdict.failed)]
    return [*cells, f"{record.cpu_s:.3f}"]


def _verdict(plan: Plan, run: PlannedRun, record: RunRecord) -> Verdict | None:
    """The same verdict that the run's own summary.json has."""
    largest = {body: at.value for body, at in record.max_von_mises.items()}
    return judge_scene(run.scene, record.displacement, record.force, largest, plan.standard, holds=record.holds)[0]


def _verdict_totals(plan: Plan, verdicts: Sequence[Verdict | None]) -> dict[str, Any]:
    """How many runs have which verdict, and why each run that is refused is; empty where nothing can be judged."""
    judged = [verdict for verdict in verdicts if verdict is not None]
    return {} if not judged else {
        "standard": judged[0].standard,
        "runs": dict(Counter(verdict.word for verdict in judged)),
        "windows": _windows(verdicts),
        "refused_for": {
            str(run.number): [check.name for check in verdict.failed]
            for run, verdict in zip(plan.runs, verdicts, strict=True)
            if verdict is not None and verdict.word == "refused"
        },
    }  # fmt: skip


def _windows(verdicts: Sequence[Verdict | None]) -> dict[str, Any]:
    """The windows of the final force that all runs have, by their standards."""
    from ..figures.curves import common_window

    shared = common_window(verdicts)
    known = {} if shared is None else {"EN 13260": shared.en_13260, "GOST 11018": shared.gost_11018}
    return {name: {"low_N": each.low, "high_N": each.high} for name, each in known.items() if each is not None}


def _accepted(verdicts: Sequence[Verdict | None]) -> list[str]:
    """A line with the number of runs of each verdict and of each reason."""
    judged = [verdict for verdict in verdicts if verdict is not None]
    if not judged:
        return []
    words = Counter(verdict.word for verdict in judged)
    reasons = Counter(check.name.replace("_", " ") for verdict in judged for check in verdict.failed)
    counted = ", ".join(f"{count} {word}" for word, count in words.items())
    why = ", ".join(f"{name} ({count})" for name, count in reasons.most_common())
    return [f"Verdict         {judged[0].standard}: {counted}{f'; refused for {why}' if why else ''}"]


def _place(at: Extreme | None) -> list[str]:
    return [""] * 4 if at is None else [repr(v) for v in (at.value, at.r_mm, at.z_mm, at.displacement_mm)]


def _curves(plan: Plan, records: Sequence[RunRecord]) -> list[list[str]]:
    """Displacement [mm] and a column of forces [N] per run; runs of different motions each have both columns."""
    forces = [[repr(force) for force in record.force_N] for record in records]
    places = [[repr(place) for place in record.displacement_mm] for record in records]
    names = [f"force_N run {run.number}: {run.label}".rstrip(": ") for run in plan.runs]
    if all(place == places[0] for place in places):
        columns, head = [places[0], *forces], ["displacement_mm", *names]
    else:
        columns = [column for pair in zip(places, forces, strict=True) for column in pair]
        head = [name for run, force in zip(plan.runs, names, strict=True)
                for name in (f"displacement_mm run {run.number}", force)]  # fmt: skip
    return [head, *(list(row) for row in zip_longest(*columns, fillvalue=""))]


def _totals(
    plan: Plan, records: Sequence[RunRecord], computed: int, costs: Sequence[tuple[int, int, float]]
) -> dict[str, Any]:
    sample = varied(plan, records)
    different = list({record.digest: record for record in records}.values())
    return {
        "scene": printable(plan.source),
        "title": plan.title,
        "keys": list(plan.keys),
        "runs": [
            {"run": run.number, "label": run.label, "values": run.values, "provider": run.scene.friction.provider,
             "options": run.scene.friction.options, "digest": run.digest} for run in plan.runs
        ],
        "statistics": {name: statistics(values) for name, values in measured_samples(sample).items()},
        "computed_runs": computed,
        "resumed_runs": len(different) - computed,
        "ranks": len(costs),
        "assemblies_per_rank": [each[1] for each in costs],
        "factorisations_per_rank": [each[0] for each in costs],  # of bodies, in this session
        "assembly_cpu_s": sum(each[2] for each in costs),
        "runs_cpu_s": sum(record.cpu_s for record in different),
        "newton_iterations": total(different, "newton_iterations"),
        "pairs_asked": total(different, "pairs_asked"),
        "unconverged_increments": sum(record.unconverged for record in different),
        "doubts": {str(run.number): record.doubts for run, record in zip(plan.runs, records, strict=True)
                   if record.doubts},
        "versions": versions(),
        "provenance": session(),
    }  # fmt: skip


def _sentences(plan: Plan, records: Sequence[RunRecord], numbers: dict[str, Any]) -> list[str]:
    each = numbers["runs_cpu_s"] / len({run.digest for run in plan.runs})
    assemblies, factorisations = (max(numbers[f"{what}_per_rank"]) for what in ("assemblies", "factorisations"))
    times = "once" if assemblies == 1 else f"{assemblies} times"
    lines = [f"Runs            {len(records)}, {each:.2f} CPU s each; bodies assembled {times} on a rank, "
             f"{factorisations} factorisations"]  # fmt: skip
    words = {"peak_force_N": ("Peak force", 1e-3, "kN"), "axle_max_von_mises_MPa": ("Stress, axle", 1.0, "MPa"),
             "wheel_max_von_mises_MPa": ("Stress, wheel", 1.0, "MPa")}  # fmt: skip
    for name, (word, scale, unit) in words.items():
        found = numbers["statistics"].get(name)
        if found is not None:
            low, mean, high = (scale * found[key] for key in ("min", "mean", "max"))
            several = f"{low:.5g} to {high:.5g} {unit}, mean " if found["runs"] > 1 else ""
            lines.append(f"{word:<15} {several}{mean:.5g} {unit}")
    if numbers["unconverged_increments"]:
        lines.append(f"Not converged   {numbers['unconverged_increments']} increments")
    return lines + doubtful_runs([record.doubts for record in records])
