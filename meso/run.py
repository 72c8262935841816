"""One friction test with its folder: opened, computed, written; a slide that is done stays whatever happens."""

from __future__ import annotations

import time
from pathlib import Path

from macrofit.base.files import alone_in, remove_drafts

from .friction_test import FrictionTest, engine_name, prepared, slid
from .monitor import Monitor
from .plates import make_plates
from .records import Slide
from .results.folder import envelopes, prepare, write_data, write_slide, write_summary
from .results.summary import plates_line, sentences, slide_line, summary
from .settings import Settings


def carry_out(settings: Settings, folder: Path, monitor: Monitor, *, figures: bool) -> list[str]:
    """Run the friction test, write its results into `folder`, and give the closing words.

    Raises:
        MesoError: what cannot be computed or written; the slides that were done are in the folder.
    """
    with alone_in(folder):
        remove_drafts(folder)
        return _carry_out(settings, folder, monitor, figures=figures)


def _carry_out(settings: Settings, folder: Path, monitor: Monitor, *, figures: bool) -> list[str]:
    """The friction test, its folder at hand."""
    prepare(folder, settings)
    coefficients = settings.contact.coefficients
    several = len(coefficients) > 1
    try:
        monitor.started(3 + len(coefficients))
        monitor.stage("plates")
        started = time.process_time()
        plates = make_plates(settings)
        packed = time.process_time()
        monitor.done(plates_line(plates))
        monitor.stage(f"{engine_name(settings)} engine")
        engine = prepared(plates)
        ready = time.process_time()
        monitor.done(f"Engine        {engine.name}, ready")
        slides: list[Slide] = []
        for slide in slid(plates, engine, coefficients, monitor.stage):
            write_slide(folder, slide, first=not slides, several=several)
            slides.append(slide)
            monitor.done(slide_line(slide))
        ended = time.process_time()
        monitor.stage("files and figures" if figures else "files")
        test = FrictionTest(
            settings=settings, plates=plates, slides=slides, packing_cpu_s=packed - started, setup_cpu_s=ready - packed
        )
        numbers = summary(test, ended - packed)
        tops = envelopes(plates)
        write_data(folder, plates, tops, slides)
        write_summary(folder, numbers)
        if figures:
            from .figures.plates import write_figures

            write_figures(folder, plates, tops, slides)
        monitor.done("Files         written")
    finally:
        monitor.finished()
    return [*sentences(numbers), f"Files           {folder}"]
