"""A page printed as PDF by what is there: a Chromium, or weasyprint."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from ..base.files import replacing
from ..errors import OutputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE_S = 120.0
"""How long a browser may take to print [s]."""


def write_pdf(page: Path) -> Path:
    """Print a page into a PDF beside it.

    Raises:
        OutputError: neither a browser nor weasyprint is here, or it fails.
    """
    target = page.with_suffix(".pdf")
    browser = found_browser()
    if browser is None and shutil.which("weasyprint") is None:
        raise OutputError(
            f"{target}: not written: there is neither chromium nor weasyprint here; install one of them, or print "
            f"{page} from a browser"
        )
    with replacing(target) as draft:
        _run(_printing(browser, page, draft), target)
        if not draft.read_bytes().startswith(b"%PDF"):
            raise OutputError(f"{target}: not written: {browser or 'weasyprint'} gave no PDF; print {page} by hand")
    return target


def found_browser() -> str | None:
    """A Chromium of this machine, which prints without a window."""
    return next((place for name in BROWSERS if (place := shutil.which(name)) is not None), None)


def headless(browser: str, profile: str) -> list[str]:
    """The command that starts a browser without a window, with a profile of its own and no network of its own."""
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []  # it refuses to run as root otherwise
    return [
        browser, "--headless", *sandbox, "--disable-gpu", "--disable-dev-shm-usage", "--disable-extensions",
        "--no-first-run", "--disable-background-networking", f"--user-data-dir={profile}",
    ]  # fmt: skip


def _printing(browser: str | None, page: Path, draft: Path) -> list[str]:
    if browser is None:
        return ["weasyprint", "--quiet", str(page), str(draft)]
    return [browser, "--no-pdf-header-footer", f"--print-to-pdf={draft.resolve()}", page.resolve().as_uri()]


def _run(command: list[str], target: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="macrofit-print-", ignore_cleanup_errors=True) as profile:
        if command[0] != "weasyprint":
            command = [*headless(command[0], profile), *command[1:]]
        try:
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, stdin=subprocess.DEVNULL)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{target}: not written: {command[0]}: {error}") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no word why"]
        raise OutputError(f"{target}: not written: {command[0]} failed: {said[0]}")
