"""The compiled forms: silent when cold, and mended where a killed compilation left its source behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMPILE = "from macrofit.body import compile_form; compile_form(1)"


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
        assert len(libraries) == 2
        for path in [*libraries, *(tmp_path / "fenics").glob("*.cached")]:
            path.unlink()
