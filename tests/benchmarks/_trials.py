"""Runs of the commands as a user starts them: watched, interrupted, and their folders compared."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from launcher import launcher_environment  # noqa: E402

MARK = "MACROFIT_TRIAL"
"""Variable by which the processes of a trial are found, whatever group or session their launcher gives them."""

PATIENCE_S = 10.0
"""How long the processes of a run may take to be gone once it was interrupted [s]."""


@dataclass(kw_only=True)
class Trial:
    """A command on some ranks, with its output in files: a pipe would be held open by processes left behind."""

    words: Sequence[str | Path]
    folder: Path
    ranks: int = 1
    more: Mapping[str, str] = field(default_factory=dict)
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)
    process: subprocess.Popen[bytes] | None = None

    def start(self) -> Trial:
        """Begin."""
        launcher = ["mpirun", "-n", str(self.ranks)] if self.ranks > 1 else []
        environment = launcher_environment() | {MARK: self.mark} | dict(self.more)
        with (self.folder / f"{self.mark}.out").open("wb") as out, (self.folder / f"{self.mark}.err").open("wb") as err:
            self.process = subprocess.Popen(
                [*launcher, sys.executable, "-m", *map(str, self.words)],
                cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=out, stderr=err, start_new_session=True,
            )  # fmt: skip
        return self

    def members(self) -> list[int]:
        """Numbers of all processes of the trial that are there and no zombies."""
        wanted, found = f"{MARK}={self.mark}".encode(), []
        for entry in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if wanted in (entry / "environ").read_bytes().split(b"\0"):
                    found.append(int(entry.name))
        return found

    def of_ranks(self) -> list[int]:
        """Numbers of the processes that compute."""
        assert self.process is not None
        return [pid for pid in self.members() if self.ranks == 1 or self._computes(pid)]

    def _computes(self, pid: int) -> bool:
        with suppress(OSError):
            return Path(f"/proc/{pid}/cmdline").read_bytes().startswith(sys.executable.encode())
        return False

    def signal(self, number: int, pid: int | None = None) -> bool:
        """Send a signal to the launcher, or to another process; whether it was still there."""
        assert self.process is not None
        if self.process.poll() is not None:
            return False
        with suppress(ProcessLookupError):
            os.kill(self.process.pid if pid is None else pid, number)
            return True
        return False

    def gone(self, patience_s: float) -> float | None:
        """Wait for all its processes to end; how long that took [s], None where some had to be killed."""
        assert self.process is not None
        started = time.monotonic()
        while time.monotonic() - started < patience_s:
            if self.process.poll() is not None and not self.members():
                return time.monotonic() - started
            time.sleep(0.02)
        for pid in self.members():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()
        return None

    @property
    def code(self) -> int | None:
        """How it ended."""
        assert self.process is not None
        return self.process.returncode

    def said(self, stream: str = "err") -> str:
        """What it wrote."""
        return (self.folder / f"{self.mark}.{stream}").read_text(errors="replace")


def complaints(text: str) -> list[str]:
    """The lines that the commands themselves say: not those of the launcher."""
    return [line for line in text.splitlines() if line.startswith("macrofit") and "warning:" not in line]


def differences(folder: Path, other: Path) -> list[str]:
    """Names of the results of two runs that are not the same to the bit, but for their times."""
    found = []
    for name, read in READERS.items():
        try:
            if read(folder / name) != read(other / name):
                found.append(name)
        except (OSError, ValueError, KeyError) as error:
            found.append(f"{name} ({type(error).__name__})")
    fields = [sorted(path.name for path in (each / "fields").glob("*")) for each in (folder, other)]
    if fields[0] != fields[1]:
        return [*found, "fields"]
    return found + [
        name for name in fields[0] if (folder / "fields" / name).read_bytes() != (other / "fields" / name).read_bytes()
    ]


def _curve(path: Path) -> list[str]:
    return [line.rpartition(",")[0] for line in path.read_text().splitlines()]


def _summary(path: Path) -> dict[str, Any]:
    numbers: dict[str, Any] = json.loads(path.read_bytes())
    return {key: value for key, value in numbers.items() if key not in TIMES}


def _interface(path: Path) -> dict[str, tuple[tuple[int, ...], bytes]]:
    found: dict[str, tuple[tuple[int, ...], bytes]] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            values = np.asarray(item)
            found[name] = values.shape, values.tobytes()

    with h5py.File(path) as file:
        file.visititems(take)
    return found


TIMES = ("setup_cpu_s", "increments_cpu_s", "stress_cpu_s", "total_cpu_s", "counters", "provenance")
"""Parts of summary.json that tell of the work, not of the result."""

READERS = {"fitting_curve.csv": _curve, "summary.json": _summary, "interface.h5": _interface}
