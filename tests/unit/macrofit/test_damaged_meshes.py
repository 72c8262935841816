"""Damaged meshes are read as sound ones or refused in one line: no traceback, no hang."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from damaged import check_sound, damage, sound_files

from macrofit.bodies.mesh import read_mesh
from macrofit.errors import MeshError

MESHES = Path(__file__).parents[3] / "meshes"
SEED, CASES = 13, 400


def outcome(path: Path) -> str:
    """What reading it says: nothing where it is sound, one line where it is refused."""
    try:
        check_sound(read_mesh(str(path), "wheel"))
    except MeshError as error:
        return str(error)
    return ""


def test_damaged_meshes(tmp_path: Path) -> None:
    """400 cases of one seed; each says its number where it fails. None takes 5 s."""
    files = sound_files(tmp_path, MESHES)
    assert [outcome(path) for path in files] == [""] * len(files)
    refused = 0
    for case in range(CASES):
        path = files[case % len(files)]
        broken = tmp_path / f"broken{path.suffix}"
        broken.write_bytes(damage(path.read_bytes(), np.random.default_rng([SEED, case])))
        started = time.perf_counter()
        try:
            said = outcome(broken)
        except Exception as error:
            raise AssertionError(f"case {case}, from {path.name}: {error!r}") from error
        assert "\n" not in said, f"case {case}"
        assert time.perf_counter() - started < 5.0, f"case {case}"
        refused += bool(said)
    assert CASES // 3 < refused < CASES
