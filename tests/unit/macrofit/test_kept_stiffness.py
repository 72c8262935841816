"""Stiffnesses that are kept: the same bits as assembled anew, and never those of another mesh, order or material."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from macrofit.base import kept
from macrofit.bodies import fenics, stiffness
from macrofit.bodies.discretisation import Discretisation
from macrofit.bodies.stiffness import elastic_space
from macrofit.bodies.triangles import MeshData
from macrofit.scene.material import Material

STEEL = Material(youngs_modulus=206e3, poisson_ratio=0.3)
RING = MeshData(
    points=np.array([[10.0, 0.0], [20.0, 0.0], [20.0, 10.0], [10.0, 10.0]]),
    triangles=np.array([[0, 1, 2], [0, 2, 3]]),
    edges={"seat": np.array([[0, 3]]), "held": np.array([[0, 1]])},
)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MACROFIT_CACHE", str(tmp_path))
    return tmp_path / "stiffness"


@pytest.fixture
def assembled(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What dolfinx was asked to assemble."""
    asked: list[Any] = []
    discretise = fenics.discretise
    monkeypatch.setattr(fenics, "discretise", lambda *given: asked.append(given) or discretise(*given))
    return asked


def arrays(space: Discretisation) -> list[Any]:
    K = space.stiffness
    return [space.nodes, space.cells, *space.edges.values(), K.data, K.indices, K.indptr]


def same(a: Discretisation, b: Discretisation) -> bool:
    pairs = zip(arrays(a), arrays(b), strict=True)
    named = (a.order, [*a.edges], a.stiffness.shape) == (b.order, [*b.edges], b.stiffness.shape)
    return named and all(x.dtype == y.dtype and np.array_equal(x, y) for x, y in pairs)


@pytest.mark.parametrize("order", [1, 2])
def test_a_body_is_assembled_once(cache: Path, assembled: list[Any], order: int) -> None:
    first, second = (elastic_space(RING, order, STEEL) for _ in range(2))
    assert len(assembled) == len(list(cache.iterdir())) == 1
    assert same(first, second)
    assert np.array_equal(first.edge_nodes("seat"), second.edge_nodes("seat"))


def test_all_that_decides_a_stiffness_is_in_its_name(cache: Path, assembled: list[Any]) -> None:
    moved = replace(RING, points=RING.points + np.array([1.0, 0.0]))
    turned = replace(RING, triangles=RING.triangles[::-1])
    named = replace(RING, edges={"bore": RING.edges["seat"], "held": RING.edges["held"]})
    elsewhere = replace(RING, edges={"seat": np.array([[1, 2]]), "held": RING.edges["held"]})
    softer, other = Material(youngs_modulus=205e3, poisson_ratio=0.3), Material(youngs_modulus=206e3, poisson_ratio=0.2)
    asked = [(data, 2, STEEL) for data in (RING, moved, turned, named, elsewhere)]
    asked += [(RING, 1, STEEL), (RING, 2, softer), (RING, 2, other)]
    made = [elastic_space(*each) for each in asked]
    assert len(assembled) == len(list(cache.iterdir())) == len(asked)
    assert all(same(elastic_space(*each), space) for each, space in zip(asked, made, strict=True))
    assert len(assembled) == len(asked)


def test_the_assembler_is_in_the_name_too(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Versions of the packages, and the code that asks them: each gives another name."""
    names = set()
    for changed in (None, *stiffness.PACKAGES, *stiffness.CODE):
        monkeypatch.setattr(stiffness.metadata, "version", lambda name, changed=changed: str(name == changed))
        monkeypatch.setattr(Path, "read_bytes", lambda file, changed=changed: str(file.name == changed).encode())
        stiffness._assembler.cache_clear()
        names.add(stiffness._file(RING, 2, (1.0, 1.0)))
    stiffness._assembler.cache_clear()
    assert len(names) == 1 + len(stiffness.PACKAGES) + len(stiffness.CODE)
    assert all((Path(stiffness.__file__).with_name(name)).is_file() for name in stiffness.CODE)


def test_a_damaged_stiffness_is_assembled_again(cache: Path, assembled: list[Any]) -> None:
    first = elastic_space(RING, 2, STEEL)
    (file,) = cache.iterdir()
    data = file.read_bytes()
    file.write_bytes(data[:-700] + bytes([data[-700] ^ 1]) + data[-699:])
    with pytest.warns(UserWarning, match="is damaged and is made again"):
        assert same(elastic_space(RING, 2, STEEL), first)
    assert same(elastic_space(RING, 2, STEEL), first)
    assert len(assembled) == 2


def test_what_is_large_or_has_no_place_is_not_kept(
    cache: Path, assembled: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "LARGEST", 100)
    elastic_space(RING, 2, STEEL)
    assert not cache.exists()
    monkeypatch.setattr(stiffness, "cache_folder", lambda: None)
    elastic_space(RING, 2, STEEL)
    assert len(assembled) == 2
