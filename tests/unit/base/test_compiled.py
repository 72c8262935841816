"""Compiled code that was damaged is compiled anew; what is whole is loaded."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

MODULE = """
from numba import njit
from macrofit.base.compiled import check_compiled

@njit(cache=True)
def square(x):
    return x * x

check_compiled(square)
"""
USE = "import laws; print(laws.square(3.0), sum(laws.square.stats.cache_hits.values()))"


def used(folder: Path, code: str = USE) -> str:
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=100)
    assert done.stderr == ""
    return done.stdout.strip()


def turned(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
@pytest.mark.parametrize(
    "damage", [lambda data: b"", lambda data: data[: len(data) // 2], turned, lambda data: bytes(len(data))],
    ids=["emptied", "cut off", "a bit", "zeros"],
)  # fmt: skip
def test_damaged_compiled_code_is_compiled_anew(ending: str, damage: Callable[[bytes], bytes], tmp_path: Path) -> None:
    (tmp_path / "laws.py").write_text(MODULE)
    assert used(tmp_path) == "9.0 0"
    assert used(tmp_path) == "9.0 1"
    (file,) = (path for path in (tmp_path / "cache").rglob(f"laws.square*{ending}"))
    file.write_bytes(damage(file.read_bytes()))
    assert used(tmp_path) == "9.0 0"
    assert used(tmp_path) == "9.0 1"


def test_what_a_killed_process_compiled_is_taken(tmp_path: Path) -> None:
    """Its files have no check sums yet, and are whole."""
    (tmp_path / "laws.py").write_text(MODULE)
    assert used(tmp_path, "import laws, os; laws.square(3.0); os._exit(0)") == ""
    assert not list((tmp_path / "cache").rglob("*.sums.nbi"))
    assert used(tmp_path) == "9.0 1"


def test_damaged_check_sums_vouch_for_nothing(tmp_path: Path) -> None:
    (tmp_path / "laws.py").write_text(MODULE)
    assert used(tmp_path) == "9.0 0"
    (sums,) = (tmp_path / "cache").rglob("laws.sums.nbi")
    for damaged in (b"\xff" + sums.read_bytes()[1:], b"", sums.read_bytes()[:-3]):
        sums.write_bytes(damaged)
        assert used(tmp_path) == "9.0 0"
        assert used(tmp_path) == "9.0 1"
