"""The page of a folder, written; and its PDF."""

from __future__ import annotations

from pathlib import Path

from ..base.files import check_regular, write_text
from ..errors import OutputError
from ..results.folder import PAGE, SCENE, SUMMARY
from ..results.kinds import CONVERGENCE, IDENTIFICATION, SERVICE, SERVICE_STUDY, STUDY, kind_of
from .page import MOST_BYTES, rendered
from .pdf import write_pdf


def write_report(
    folder: Path,
    target: Path | None = None,
    *,
    pdf: bool = False,
    standard: str | None = None,
    wheel: str | None = None,
) -> list[str]:
    """Write the page of a run, a study, a service computation or a study of such; with ``pdf`` a PDF beside it.

    Gives the lines that say so.

    Args:
        folder: what `macrofit run`, `macrofit study` or `macrofit service` has written.
        target: the file [report.html in the folder].
        pdf: print it too; a browser or weasyprint does that.
        standard: a standard of this name, or of this file, in place of that of the run's verdict.
        wheel: type of wheel in it.

    Raises:
        MacrofitError: the folder holds none of them, its files are damaged, or nothing here can make a PDF (the page is
            written all the same).
    """
    target = target or folder / PAGE
    if target.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{target}: is no name of a page; end it with .html, and --pdf prints it beside it")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name a file in it")
    write_text(target, _page(folder, standard, wheel))
    lines = [f"Report          {target}"]
    if pdf:
        lines.append(f"PDF             {write_pdf(target)}")
    return lines


def _page(folder: Path, standard: str | None, wheel: str | None) -> str:
    judged = standard is not None or wheel is not None
    if (folder / SERVICE.numbers).is_file():
        if judged:
            raise OutputError(f"{folder}: is no press fit alone, but its service; leave --standard and --wheel out")
        from .service import service_page

        return rendered("service.html", service_page(folder))
    if (folder / STUDY.numbers).is_file():
        if judged:
            raise OutputError(f"{folder}: is a study, whose runs are judged already; leave --standard and --wheel out")
        from .study import study_page

        return rendered("study.html", study_page(folder))
    if (folder / SERVICE_STUDY.numbers).is_file():
        if judged:
            raise OutputError(f"{folder}: is a study of wheelsets in service; leave --standard and --wheel out")
        from .service_study import service_study_page

        return rendered("service_study.html", service_study_page(folder))
    if wheel is not None and standard is None:
        raise OutputError("--wheel: is a type of wheel in a standard; name it with --standard")
    _check_run(folder)
    from .run import run_page

    return rendered("run.html", run_page(folder, standard=standard, wheel=wheel))


def _check_run(folder: Path) -> None:
    """See that the folder is that of a run which has ended.

    Raises:
        OutputError: it is not.
    """
    if not folder.is_dir():
        raise OutputError(f"{folder}: is no folder; give one that macrofit run, study or service has written")
    kind = kind_of(folder)
    if kind is not None and kind in (IDENTIFICATION, CONVERGENCE):
        raise OutputError(f"{folder}: holds {kind.what}, which has no page; report a run, a study or a service")
    if kind is not None and not (folder / kind.numbers).is_file():
        raise OutputError(
            f"{folder}: holds {kind.what} that has not ended ({kind.numbers} is missing); "
            f"continue it with {kind.command} --resume"
        )
    for missing in (SCENE, SUMMARY):
        if not (folder / missing).is_file():
            raise OutputError(f"{folder}: holds no run of macrofit, no study and no service ({missing} is missing)")
    check_regular(folder / SUMMARY, MOST_BYTES)
