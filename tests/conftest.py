"""The same tests on one rank, on several processes (pytest -n) and under mpirun; nothing waits for ever.

Under mpirun a failure on any rank ends the job. Under `-n` a test that hangs ends its process alone, with its
traceback: it counts as failed, and the others go on.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import pytest
from found import Figures, Found
from launcher import Mpirun, launcher_environment

LIMIT_S = 120.0
SLOW_LIMIT_S = 300.0

UNDER_MPIRUN = any(name in os.environ for name in ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE"))
if UNDER_MPIRUN:
    from mpi4py import MPI

    WORLD: Any = MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None
else:
    WORLD = None

_stderr: IO[str] | None = None


FIGURES = Figures()  # of all processes; kept in the one that starts the others


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--figures", type=Path, metavar="FILE.json", help="write what the tests found, with its bar")


def pytest_configure(config: pytest.Config) -> None:
    """Keep a copy of the real stderr: during a test pytest has another file in its place."""
    global _stderr
    _stderr = os.fdopen(os.dup(2), "w")


def pytest_sessionfinish(session: pytest.Session) -> None:
    target = session.config.getoption("--figures")
    is_first = not hasattr(session.config, "workerinput") and (WORLD is None or WORLD.rank == 0)
    if target is not None and is_first:
        FIGURES.write(target)


def _abort(text: str) -> None:
    """End every rank: the others may be waiting for this one in a collective call."""
    print(f"\nrank {WORLD.rank} of {WORLD.size} failed\n{text}", file=_stderr, flush=True)
    WORLD.Abort(1)


def _with_output(report: pytest.TestReport | pytest.CollectReport) -> str:
    sections = "".join(f"\n--- {title} ---\n{content}" for title, content in report.sections)
    return f"{report.nodeid}\n{report.longreprtext}{sections}"


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """What a test found has come with its report, from whatever process it ran in."""
    if report.when == "teardown":
        FIGURES.take(report.user_properties)
    if WORLD is not None and report.failed:
        _abort(_with_output(report))


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if WORLD is not None and report.failed:
        _abort(_with_output(report))


def pytest_internalerror(excrepr: object) -> None:
    if WORLD is not None:
        _abort(str(excrepr))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """A test that hangs shows where, on each rank, and ends the run."""
    limit = SLOW_LIMIT_S if item.get_closest_marker("slow") else LIMIT_S
    faulthandler.dump_traceback_later(limit, exit=True, file=_stderr or sys.__stderr__)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Destructors of PETSc objects are collective: collect them on all ranks at the same place."""
    yield
    if WORLD is not None:
        gc.collect()
        WORLD.Barrier()


@pytest.fixture
def found(request: pytest.FixtureRequest) -> Found:
    """Records a value with its bar: `assert found("Hertz, contact radius", error, 0.01)`."""
    return Found(request.node.nodeid, request.node.user_properties)


@pytest.fixture
def shared_tmp_path(request: pytest.FixtureRequest) -> Path:
    """An empty folder, the same on every rank."""
    if WORLD is None:
        return Path(request.getfixturevalue("tmp_path"))
    own = str(request.getfixturevalue("tmp_path")) if WORLD.rank == 0 else None
    return Path(WORLD.bcast(own, root=0))


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Processes started by the test heed Ctrl-C, also where a shell started the tests with SIGINT ignored (`cmd &`)."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def mpirun() -> Mpirun:
    """A launcher for tests that themselves run on one rank: gives the finished process with its output."""
    environment = launcher_environment()

    def launch(
        ranks: int, *arguments: str | Path, timeout: float = 60.0, cwd: Path | None = None
    ) -> subprocess.CompletedProcess[str]:
        command = ["timeout", f"{timeout:g}", "mpirun", "-n", str(ranks), sys.executable]
        command += [str(argument) for argument in arguments]
        return subprocess.run(
            command, cwd=cwd, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )

    return launch
