"""Plates are as stiff as their material, whatever their size: pulled by another solve than the one that scaled them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.meso_modulus import pulled
from found import Found

from meso.calibrate import tensile_test
from meso.errors import SettingsError
from meso.lattice.calibration import steel
from meso.lattice.lattice import build, turned_over
from meso.lattice.modulus import own_modulus, scaled_to
from meso.material import Beams, Material
from meso.packing.cache import flat_packing
from meso.plates import make_plates
from meso.settings import load

PRINTED = ("plates.thickness=0.4", "surface.max_height=0.04")
STEEL = Material().youngs_modulus


@pytest.mark.parametrize("spheres", [500, 1000, 3000])
def test_plates_are_as_stiff_as_steel(spheres: int, found: Found) -> None:
    """Conjugate gradients leave 1e-7 of the modulus, the factor is cut to six digits; the bar asked for is 2 %."""
    plates = make_plates(load(None, [*PRINTED, f"plates.spheres={spheres}"]))
    for packing, lattice in plates.bodies.values():
        assert found("modulus of a rough plate, of the material's", abs(pulled(packing, lattice) - 1.0), 1e-5)
        assert lattice.modulus == pytest.approx(STEEL, rel=1e-6)  # as a run says it, without pulling once more
    before = make_plates(load(None, [*PRINTED, f"plates.spheres={spheres}", "plates.modulus=beams"]))
    assert before.wheel.scaling == 1.0
    assert pulled(before.wheel_packing, before.wheel) == pytest.approx(1.0 / plates.wheel.scaling, rel=1e-5)
    assert np.array_equal(before.wheel.anchors, plates.wheel.anchors)  # the bars behind are as they were


def test_few_spheres_are_too_stiff_unscaled() -> None:
    """Without scaling plates of 500 spheres are 30 to 70 % too stiff: what the scaling is for."""
    plates = make_plates(load(None, ["plates.thickness=0.4", "plates.spheres=500"]))
    assert 0.55 < plates.wheel.scaling < 0.8
    assert 0.55 < plates.axle.scaling < 0.8


def test_cubes_are_as_stiff_as_steel() -> None:
    """As `calibrate` tests them, by its direct solve."""
    box = flat_packing(400, (1.0, 1.0), 1.0, 0)
    scaled = scaled_to(STEEL, box, build(box, Material(), steel()))
    beams = Beams(youngs_modulus=steel().youngs_modulus * scaled.scaling, radius_ratio=steel().radius_ratio)
    assert tensile_test(box, beams).youngs_modulus == pytest.approx(STEEL, rel=1e-5)


def test_the_modulus_knows_no_side() -> None:
    """Turned over, or with its spheres in another order, a plate gets the same factor to the last bit."""
    box = flat_packing(300, (1.0, 1.0), 0.4, 0)
    lattice = build(box, Material(), steel(), cube=1.0)
    scaled = scaled_to(STEEL, box, lattice)
    assert scaled_to(STEEL, box, turned_over(lattice, 0.8)).scaling == scaled.scaling
    mirrored = replace(box, centres=(box.centres * [1.0, -1.0, 1.0] + [0.0, 1.0, 0.0])[::-1], radii=box.radii[::-1])
    assert scaled_to(STEEL, mirrored, build(mirrored, Material(), steel())).scaling == scaled.scaling
    assert own_modulus(box, scaled) == pytest.approx(STEEL, rel=1e-5)


def test_beams_too_thin_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("meso.lattice.equilibrium.ITERATIONS", 5)
    box = flat_packing(300, (1.0, 1.0), 0.4, 0)
    with pytest.raises(SettingsError, match=r"take a larger beams\.radius_ratio"):
        own_modulus(box, build(box, Material(), steel()))
