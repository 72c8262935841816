"""One run with its folder: opened, computed, written; what was accepted stays whatever happens."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from mpi4py import MPI

from .acceptance import Standard
from .base.files import remove_drafts
from .base.ranks import raise_together
from .bodies.outlook import seat_ends
from .errors import MacrofitError
from .friction import GivenFriction, ScriptFriction
from .monitor import Monitor, Several, Silent, on_screen
from .results.doubts import allow_none
from .results.folder import (
    FIELDS,
    JOURNAL,
    SUMMARY,
    CurveFile,
    clear,
    prepare,
    write_fields,
    write_interface,
    write_scene,
    write_summary,
)
from .results.journal import Journal, is_journal
from .results.summary import sentences, summary
from .results.versions import provenance
from .scene import Scene, with_script_friction
from .solution import Solution
from .solve import solve


def carry_out(
    scene: Scene,
    comm: MPI.Comm,
    folder: Path,
    *,
    resume: bool,
    quiet: bool,
    friction: GivenFriction | None = None,
    strict: bool = False,
    standard: Standard | None = None,
) -> list[str]:
    """Solve the scene, write its results into ``folder``, and give the summary lines (rank 0). Collective.

    Only rank 0 writes, and no other run may write into the folder until all is written. ``friction`` is an object in
    place of the scene's [friction], see `solve`; it must state a ``digest``, for the folder keeps a journal. The
    verdict is by ``standard``, EN 13260 where it is left out.

    Raises:
        MacrofitError: on all ranks together; what was accepted stays in the folder.
        DoubtfulRun: ``strict``, and there are doubts about the run (see `doubts`); all results are in the folder.
    """
    if friction is not None:
        script = ScriptFriction(friction)
        script.required_digest()
        scene = with_script_friction(scene, script)
    curve: CurveFile | None = None
    with raise_together(comm):
        if comm.rank == 0:
            journal, curve = open_folder(folder, scene, resume=resume)
        else:
            journal = Journal.elsewhere()
    screen = on_screen(quiet=quiet or curve is None, planned=len(scene.displacements) + scene.motion.release)
    monitor: Monitor = Silent() if curve is None else Several(screen, curve)
    lines: list[str] = []
    with journal:
        try:
            solution = solve(scene, comm, monitor, journal, friction=friction)
        except BaseException:
            if curve is not None:
                save_accepted(folder, scene, curve, monitor)
            raise
        with raise_together(comm):  # the journal's lock is held until all is written: no other run gets in between
            if comm.rank == 0:
                lines = write_results(folder, solution, friction, strict=strict, standard=standard)
    return lines


def open_folder(folder: Path, scene: Scene, *, resume: bool) -> tuple[Journal, CurveFile]:
    """Make the folder ready; its journal, and its curve with what a resumed run already has.

    Raises:
        OutputError: see `prepare`, `Journal.start` and `Journal.resume`.
    """
    path = folder / JOURNAL
    owned = is_journal(path)
    prepare(folder, owned=owned)
    if resume and owned:
        journal = Journal.resume(path, scene)
    else:
        journal = Journal.start(path, scene, replace=(folder / SUMMARY).exists())
        clear(folder)
    remove_drafts(folder, folder / FIELDS)
    write_scene(folder, scene)
    return journal, CurveFile(folder, [record for record, _ in journal.records()])


def save_accepted(folder: Path, scene: Scene, curve: CurveFile, monitor: Monitor) -> None:
    """Keep the interface of a run that ends early; a second failure must not hide the first."""
    with suppress(MacrofitError):
        monitor.finished()
    with suppress(MacrofitError):
        if curve.records:
            write_interface(folder, scene, seat_ends(scene), curve.records)


def write_results(
    folder: Path,
    solution: Solution,
    friction: GivenFriction | None = None,
    *,
    strict: bool = False,
    standard: Standard | None = None,
) -> list[str]:
    """Write what is left when all increments are done; gives the summary lines.

    ``friction`` is the object that a script gave in place of the scene's.

    Raises:
        OutputError: a file cannot be written.
        DoubtfulRun: ``strict``, and there are doubts about the run.
    """
    from .figures.curves import write_figures

    origin = solution.origin()
    made = provenance(solution.scene, friction) | ({"friction": origin} if origin else {})
    numbers = summary(solution, standard) | {"provenance": made}
    write_interface(folder, solution.scene, solution.seat, solution.increments, solution.friction)
    write_fields(folder, solution)
    write_figures(folder, solution)
    write_summary(folder, numbers)
    if strict:
        allow_none(numbers["doubts"], folder)
    return [*sentences(numbers), f"Files           {folder}"]
