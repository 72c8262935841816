"""The compiled forms: silent when cold, and mended where a killed compilation left its source behind."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from macrofit.bodies import fenics
from macrofit.bodies.fenics import is_sound_library

FACTORS = """
import numpy as np, resource, scipy.sparse as sp
from macrofit.bodies.fenics import Factor

line = sp.diags([-1.0, 2.1, -1.0], [-1, 0, 1], shape=(60, 60))
matrix = sp.kronsum(line, line, format="csr")

def resident(times):
    for _ in range(times):
        Factor(matrix).solve(np.ones(3600))
    return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() / 2**20

before = resident(3)
print(resident(10) - before)
"""
COMPILE = """
import numpy as np
from macrofit.bodies.elasticity import weak_form
from macrofit.bodies.fenics import discretise
from macrofit.bodies.triangles import MeshData

corner = np.array([[1.0, 0.0], [2.0, 0.0], [1.0, 1.0]])
discretise(MeshData(points=corner, triangles=np.array([[0, 1, 2]]), edges={}), 1, weak_form, (1.0, 1.0))
"""


@pytest.mark.slow
def test_cold_and_broken_cache(tmp_path: Path) -> None:
    """Twice: with an empty cache, and with sources but no libraries, for which the compiler waits ten seconds."""
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", COMPILE],
            env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100, check=True,
        )  # fmt: skip
        assert done.stdout + done.stderr == ""
        libraries = list((tmp_path / "fenics").glob("*.so"))
        assert libraries
        for path in [*libraries, *(tmp_path / "fenics").glob("*.cached")]:
            path.unlink()


def test_factors_leave_the_memory() -> None:
    """A Schur complement of 800 unknowns takes 5 MiB, twice in its factor: ten that stayed would add 100 MiB."""
    done = subprocess.run(
        [sys.executable, "-c", FACTORS],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True, timeout=100,
    )  # fmt: skip
    assert float(done.stdout) < 25.0


def compiled(cache: Path, code: str = COMPILE) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"XDG_CACHE_HOME": str(cache)},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100,
    )  # fmt: skip


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:20000])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def flipped(path: Path) -> None:
    """One bit in the middle, where the code is."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.slow
def test_damaged_libraries_are_compiled_anew(tmp_path: Path) -> None:
    """Cut short, a library killed the process (SIGBUS) or failed for ever; a flipped bit would give wrong numbers."""
    assert compiled(tmp_path).returncode == 0
    whole = {path: path.read_bytes() for path in (tmp_path / "fenics").glob("*.so")}
    assert whole
    for damage in (cut, emptied, flipped, Path.unlink):
        for path in whole:
            damage(path)
        done = compiled(tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", ""), damage
        assert all(is_sound_library(path) for path in whole)
    for path in (tmp_path / "fenics").glob("*.sha256"):  # compiled by somebody else: the length alone tells
        path.unlink()
    cut(next(iter(whole)))
    assert compiled(tmp_path).returncode == 0


def test_cache_that_cannot_be_written(tmp_path: Path) -> None:
    """Forms are compiled all the same, in a temporary folder that is gone afterwards, and one line says so."""
    code = COMPILE + "import os; print(os.environ['XDG_CACHE_HOME'])"
    done = compiled(Path("/proc/nowhere"), code)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("cannot be written") == 1
    assert "Traceback" not in done.stderr
    assert not Path(done.stdout.strip()).exists()


def others_may_read(path: Path) -> bool:
    """Whether any user can come to this place: a tree below /root, say, is root's alone."""
    return all(folder.stat().st_mode & 0o005 == 0o005 for folder in (path, *path.parents))


@pytest.mark.skipif(os.getuid() != 0 or shutil.which("setpriv") is None, reason="only root can be another user")
@pytest.mark.skipif(not others_may_read(Path(__file__).resolve().parent), reason="the tree is root's alone")
def test_user_without_a_home() -> None:
    """A service user that no table knows and that has no HOME."""
    code = "from macrofit.base.caches import ensure_cache; ensure_cache(); import os; print(os.path.expanduser('~'))"
    done = subprocess.run(
        ["setpriv", "--reuid", "12345", "--regid", "12345", "--clear-groups", sys.executable, "-c", code],
        env={"PATH": os.environ["PATH"]}, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("/")
    assert done.stderr.count("cannot be written") == 1


@pytest.mark.slow
def test_two_that_compile_wait_for_each_other(tmp_path: Path) -> None:
    """Ranks, or two first runs, where a compilation was killed: nobody takes the other's source for a leftover."""
    compiled(tmp_path)
    for path in [*(tmp_path / "fenics").glob("*.so"), *(tmp_path / "fenics").glob("*.cached")]:
        path.unlink()
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    both = [
        subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", COMPILE],
            env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )
        for _ in range(2)
    ]  # fmt: skip
    assert [each.communicate(timeout=100)[0] for each in both] == [b"", b""]
    assert [each.returncode for each in both] == [0, 0]


def test_nobody_waits_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For a process that compiles and was stopped, say; and where files cannot be locked."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(fenics, "LONGEST_WAIT_S", 0.1)
    with fenics._alone(), fenics._alone():  # two files, as if of two processes
        assert (tmp_path / "fenics" / "macrofit.lock").exists()
    monkeypatch.setattr(fenics, "LONGEST_WAIT_S", 1e9)
    with fenics._alone():
        pass

    def refused(*_: object) -> None:
        raise OSError("no locks here")

    monkeypatch.setattr(fenics.fcntl, "flock", refused)
    with fenics._alone():
        pass
