"""A run's folder belongs to one run at a time, until its results are written."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fakes import fake_solution
from mpi4py import MPI
from small import small_press

import macrofit.run
from macrofit.errors import OutputError
from macrofit.results.folder import read_curve
from macrofit.run import carry_out, open_folder
from macrofit.scene import Scene, dump_scene, load_scene


def test_folder_is_locked_while_results_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second run that comes between the last increment and the last file is refused."""
    scene, refused = small_press(), []

    def write_results(folder: Path, *_: object, **__: object) -> list[str]:
        with pytest.raises(OutputError, match="another process is writing it"):
            open_folder(folder, scene, resume=False)
        refused.append(folder)
        return []

    def solve(given: Scene, *_: object, **__: object) -> object:
        return fake_solution(given)

    monkeypatch.setattr(macrofit.run, "write_results", write_results)
    monkeypatch.setattr(macrofit.run, "solve", solve)
    carry_out(scene, MPI.COMM_SELF, tmp_path / "out", resume=False, quiet=True)
    assert refused == [tmp_path / "out"]


@pytest.mark.parametrize("delay_s", [0.0, 0.4, 1.0])
def test_two_runs_into_one_folder(delay_s: float, tmp_path: Path) -> None:
    """One is refused, or comes when the other is done; either way all files are of one run."""
    frictions = (0.1, 0.2)
    started = []
    for mu in frictions:
        scene = tmp_path / f"{mu}.toml"
        scene.write_text(dump_scene(small_press(f"friction.options.coefficient={mu}", "motion.increment=1")))
        command = [sys.executable, "-m", "macrofit", "run", str(scene), "-o", str(tmp_path / "out"), "--quiet"]
        started.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True))
        time.sleep(delay_s)
    said = [each.communicate(timeout=60)[1] for each in started]
    codes = [each.returncode for each in started]
    assert sorted(codes) in ([0, 0], [0, 2]), said
    for code, text in zip(codes, said, strict=True):
        assert ("another process is writing it" in text) is (code == 2)
    kept = load_scene(tmp_path / "out" / "scene.toml").friction.options["coefficient"]
    if 2 in codes:
        assert kept == frictions[codes.index(0)]
    displacement, force = read_curve(tmp_path / "out")
    numbers = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert numbers["increments"] == len(displacement)
    assert numbers["peak_force_N"] == np.max(force)
