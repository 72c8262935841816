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


def test_damaged_meshes(tmp_path: Path) -> None:
    """400 cases of one seed; each says its number where it fails. None takes 5 s."""
    files = sound_files(tmp_path, MESHES)
    for path in files:
        check_sound(read_mesh(str(path), "wheel"))
    refused = 0
    for case in range(CASES):
        rng = np.random.default_rng([SEED, case])
        path = files[case % len(files)]
        broken = tmp_path / f"broken{path.suffix}"
        broken.write_bytes(damage(path.read_bytes(), rng))
        started = time.perf_counter()
        try:
            check_sound(read_mesh(str(broken), "wheel"))
        except MeshError as error:
            refused += 1
            assert "\n" not in str(error), f"case {case}"
        except Exception as error:
            raise AssertionError(f"case {case}, from {path.name}: {error!r}") from error
        assert time.perf_counter() - started < 5.0, f"case {case}"
    assert refused > CASES // 3
