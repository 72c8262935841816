"""The batch script of docs/cluster.md, on two ranks without Slurm: it begins a study, and goes on with it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "cluster.md"
RANGE = "friction.options.coefficient=0.05:0.15:0.01"
SMALL = "--preset fast --set motion.increment=20 --set output.stress=false --quiet"


def batch_script() -> str:
    (script,) = re.findall(r"```sh\n(#!/bin/bash\n.*?)```", PAGE.read_text(), re.DOTALL)
    return script


@pytest.mark.skipif("OMPI_COMM_WORLD_SIZE" in os.environ, reason="starts ranks of its own")
def test_the_batch_script_begins_and_goes_on(tmp_path: Path) -> None:
    """Submitted for two runs, then for all: the second job computes what is missing."""
    script = batch_script()
    assert RANGE in script
    home = tmp_path / "home"
    tools = home / "macrofit" / ".venv" / "bin"
    tools.mkdir(parents=True)
    (tools / "activate").write_text(f'PATH="{tools}:$PATH"\n')
    (tools / "macrofit").write_text(f'#!/bin/sh\nexec {sys.executable} -m macrofit "$@" {SMALL}\n')
    (tools / "mpirun").write_text('#!/bin/sh\nPATH="${PATH#*:}" exec mpirun -n 2 "$@"\n')
    for tool in ("macrofit", "mpirun"):
        (tools / tool).chmod(0o755)
    for text, computed, resumed in ((script.replace("0.15:0.01", "0.06:0.01"), 2, 0), (script, 9, 2)):
        (tmp_path / "press.sh").write_text(text.replace("macrofit study", f"{tools}/macrofit study"))
        done = subprocess.run(
            ["bash", "press.sh"], cwd=tmp_path, env=os.environ | {"HOME": str(home)},
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        totals = json.loads((tmp_path / "study" / "study.json").read_text())
        assert (len(totals["runs"]), totals["resumed_runs"]) == (computed + resumed, resumed)
        assert totals["ranks"] == 2
