"""Whatever stands where a file should: every reader answers in one line, and none waits or fills the memory."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fuzz
import h5py
import numpy as np
import pytest

from macrofit.base.errors import MacrofitError
from macrofit.base.toml import read_toml
from macrofit.bodies.mesh import read_mesh
from macrofit.friction import load
from macrofit.identify.measured import read_measured
from macrofit.scene import load_scene
from surrogate.data.database import FORMAT, read_database
from surrogate.data.faces import read_face
from surrogate.data.samples import SCHEMA
from surrogate.data.table import read_table
from surrogate.network.checkpoint import load_checkpoint

READERS: dict[str, Callable[[Path], Any]] = {
    "scene.toml": read_toml,
    "scene": load_scene,
    "mesh.msh": lambda path: read_mesh(str(path), "axle"),
    "table.csv": lambda path: load("table", {"file": str(path)}),
    "curve.csv": read_measured,
    "heights.npy": lambda path: read_face(path, "wheel"),
    "heights.csv": lambda path: read_face(path, "wheel"),
    "samples.csv": read_table,
    "samples.h5": read_database,
    "network.safetensors": load_checkpoint,
}


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def loop(path: Path) -> None:
    path.symlink_to(path)


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(10 * 10**9)


ODD = [pipe, endless, loop, sparse, Path.mkdir, Path.touch, lambda path: None]


@pytest.mark.parametrize("make", ODD, ids=["pipe", "endless", "loop", "sparse", "folder", "empty", "none"])
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_is_refused_in_one_line(tmp_path: Path, name: str, make: Callable[[Path], None]) -> None:
    path = tmp_path / name
    make(path)
    started = time.perf_counter()
    if "scene" in name and make is Path.touch:
        assert read_toml(path) == {}
        return
    with pytest.raises(MacrofitError) as caught:
        READERS[name](path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert time.perf_counter() - started < 5.0


def test_a_database_that_claims_more_than_it_stores_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["format"], file.attrs["schema"] = FORMAT, SCHEMA
        file.create_dataset("samples/wheel", shape=(10**8, 33, 33), chunks=(8, 33, 33), dtype="<f4")
        file.create_dataset("failures/id", data=np.zeros(3))
    with pytest.raises(MacrofitError, match="samples/wheel claims 436 GB and stores 0 bytes"):
        read_database(tmp_path / "a.h5")


@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_damaged_and_odd_files_end_in_a_line_or_the_right_numbers(tmp_path: Path, kind: str) -> None:
    """Seeded; thousands are in the benchmark `strangers`."""
    counted = fuzz.run(kind, range(400), tmp_path)
    assert counted.wrong == []
    assert counted.read >= 40
    assert counted.refused >= 40
