"""What grows with the plates: which spheres may meet is found among the faces alone, and a factor has to fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from macrofit.base import cholmod
from meso.errors import MesoError
from meso.lattice import kernels
from meso.lattice.candidates import Faces
from meso.lattice.cholmod import factor
from meso.plates import Plates, make_plates
from meso.settings import load


@pytest.fixture(scope="module", params=[0.0, 0.02, 0.08])
def plates(request: pytest.FixtureRequest) -> Plates:
    return make_plates(load(None, ["plates.spheres=900", f"surface.max_height={request.param}"]))


@pytest.mark.parametrize("slide", [0.0, 0.6, 2.5])
def test_first_touch_among_the_faces_is_that_among_all_spheres(plates: Plates, slide: float) -> None:
    faces, order = plates.faces, np.argsort(plates.faces.axle[:, 1])
    among_all = kernels.first_touch(
        faces.wheel, faces.wheel_radii, faces.axle, faces.axle_radii, order, slide
    )  # beyond the axle's plate at 2.5 mm: -inf
    assert faces.first_touch(slide) == among_all


@pytest.mark.parametrize(("low", "high", "margin"), [(-0.006, 0.0, 0.003), (-0.05, 0.02, 0.0), (0.1, 0.1, 0.0)])
def test_encounters_of_the_faces_are_those_of_all_spheres(
    plates: Plates, low: float, high: float, margin: float
) -> None:
    faces, order = plates.faces, np.argsort(plates.faces.axle[:, 1])
    heights = plates.first_touch + low, plates.first_touch + high
    pair, span = kernels.find_candidates(
        faces.wheel, faces.wheel_radii, faces.axle, faces.axle_radii, order, *heights, 1.0, margin
    )
    found = faces.candidates(heights, 1.0, margin, plates.settings.material, 1.0, 0.8)
    everyone = {(i, j + plates.wheel.nodes, *ends) for (i, j), ends in zip(pair.tolist(), span.tolist(), strict=True)}
    those = zip(found.pair.tolist(), found.first.tolist(), found.last.tolist(), strict=True)
    assert {(*ends, first, last) for ends, first, last in those} == everyone
    assert len(found.pair) == len(pair)


def test_no_encounter_of_plates_far_apart(plates: Plates) -> None:
    assert isinstance(plates.faces, Faces)
    assert len(plates.candidates(1.0, 2.0, 0.0).pair) == 0


def test_entries_and_operations_of_a_dense_factor() -> None:
    size = 30
    a = np.random.default_rng(0).normal(size=(size, size))
    dense = factor(sparse.csr_matrix(a @ a.T + size * np.eye(size)), np.arange(size // 6), block=6)
    assert dense.entries == size**2  # one supernode, stored as a square
    assert dense.flops == sum(length**2 for length in range(1, size + 1))


def test_a_factor_that_does_not_fit_is_refused_before_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    lattice = make_plates(load(None, ["plates.spheres=900"])).wheel
    monkeypatch.setattr(cholmod, "free_memory", lambda: 2.0**20)
    with pytest.raises(MesoError, match=r"contact nodes take .* GiB, and 0\.0 GiB are free: take fewer spheres"):
        factor(lattice.stiffness(), np.arange(20))


def test_free_memory_is_that_of_the_system() -> None:
    assert 2.0**20 < cholmod.free_memory() < 2.0**50
