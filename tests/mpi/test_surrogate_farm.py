"""The farm over the ranks of mpirun: the same content as one process, also after a kill."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from launcher import Mpirun, launcher_environment

from surrogate.data.database import read_database

PAIRS = 6
ROOT = Path(__file__).parents[2]
COMMAND = ["-m", "surrogate", "generate", "--spheres", "500", "--set", "engine.samples=40", "--pairs", str(PAIRS)]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Made twice: code that numba has just compiled may round another way than the same code from its cache."""
    folder = tmp_path_factory.mktemp("alone")
    for path in (folder / "first.h5", folder / "a.h5"):
        command = [sys.executable, *COMMAND, "-o", str(path), "--jobs", "1", "--quiet"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return read_database(folder / "a.h5")


def test_ranks_make_the_same(alone, tmp_path, mpirun: Mpirun):
    path = tmp_path / "a.h5"
    done = mpirun(3, *COMMAND, "-o", path, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert read_database(path).content_hash == alone.content_hash
    assert os.listdir(tmp_path) == ["a.h5"]
    assert done.stdout.count("Content") == 1


def test_a_mistake_is_said_once(tmp_path, mpirun: Mpirun):
    done = mpirun(2, *COMMAND, "-o", tmp_path / "a.h5", "--levels", "9", cwd=ROOT, timeout=30.0)
    assert done.returncode == 2
    assert done.stderr.count("macrofit-surrogate: ") == 1
    assert "--levels" in done.stderr


@pytest.mark.slow
def test_killed_and_gone_on_with(alone, tmp_path, mpirun: Mpirun):
    """mpirun itself is killed, with kill -9, as a batch system does; its ranks must not go on without it."""
    path, delays = tmp_path / "a.h5", random.Random(3)
    journal = path.with_name("a.h5.journal")
    job = subprocess.Popen(
        ["mpirun", "-n", "3", sys.executable, *COMMAND, "-o", str(path)],
        cwd=ROOT, env=launcher_environment(),
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while not (journal.exists() and len(read_database(path).samples)):
        assert job.poll() is None
        time.sleep(0.02)
    time.sleep(delays.uniform(0.0, 0.1))
    job.kill()
    job.wait()
    patience = time.monotonic() + 20.0
    while True:  # the ranks see that mpirun is gone after a moment, and let the database go
        done = mpirun(3, *COMMAND, "-o", path, cwd=ROOT)
        if done.returncode == 0:
            break
        assert "another process is writing it" in done.stderr
        assert time.monotonic() < patience
    assert read_database(path).content_hash == alone.content_hash
