"""Decks of Abaqus and CalculiX are read, or refused with what to write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from decks import AREA, READ, REFUSED, plain

from macrofit.bodies.mesh import read_mesh
from macrofit.bodies.triangles import doubled_area
from macrofit.errors import MeshError


def write(folder: Path, text: str) -> str:
    path = folder / "ring.inp"
    path.write_bytes(text.encode("latin-1"))
    return str(path)


@pytest.mark.parametrize("dialect", READ)
def test_a_dialect_is_read(dialect: str, tmp_path: Path) -> None:
    """Area, bore and pushed face of the ring, to the rounding of its numbers."""
    data = read_mesh(write(tmp_path, READ[dialect]()), "wheel")
    assert 0.5 * np.abs(doubled_area(data.points, data.triangles)).sum() == pytest.approx(AREA, rel=1e-12)
    for name, length in (("bore", 30.0), ("pushed", 30.0)):
        ends = data.points[data.edges[name]]
        assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(length, rel=1e-12)
    assert data.points[data.edges["bore"]][..., 0] == pytest.approx(50.0)


@pytest.mark.parametrize("mistake", REFUSED)
def test_a_mistake_is_refused_in_one_line(mistake: str, tmp_path: Path) -> None:
    text, message = REFUSED[mistake]
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(write(tmp_path, text()), "wheel")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("mesh.wheel: ")


def test_a_moved_instance_and_a_file_in_metres(tmp_path: Path) -> None:
    moved = plain().replace("*HEADING\na ring\n", "*INSTANCE, NAME=A, PART=B\n0., 5.\n*END INSTANCE\n")
    assert read_mesh(write(tmp_path, moved), "wheel").points[:, 1].max() == pytest.approx(5.0)
    inches = read_mesh(write(tmp_path, plain()), "wheel", "in")
    assert inches.points[:, 0].min() == pytest.approx(50.0 * 25.4)


def test_an_included_file_is_read(tmp_path: Path) -> None:
    head, _, tail = plain().partition("*ELEMENT")
    (tmp_path / "cells.inc").write_text("*ELEMENT" + tail)
    assert len(read_mesh(write(tmp_path, head + "*INCLUDE, INPUT=cells.inc\n"), "wheel").triangles) == 36
    (tmp_path / "cells.inc").write_text("*INCLUDE, INPUT=cells.inc\n")
    with pytest.raises(MeshError, match="without end"):
        read_mesh(write(tmp_path, head + "*INCLUDE, INPUT=cells.inc\n"), "wheel")
