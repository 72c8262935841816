"""What must not matter to two plates: which one is the wheel, left and right; and the work, accounted for.

Swap and mirror are those of the stress cases (`tests/benchmarks/_meso_laws.py`), on every external face, both engines.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks._meso_laws import exchanged, mirrored
from found import Found

from meso.engines.explicit import Explicit
from meso.engines.quasistatic import QuasiStatic
from meso.plates import Plates, make_plates
from meso.records import Slide
from meso.settings import load

FACES = [("solid", "series"), ("solid", "paper"), ("beams", "series"), ("beams", "paper")]
KEYS = ("plates.spheres=600", "load.interference=0.006", "surface.wheel_seed=3", "engine.samples=100")
TIGHT = ("engine.tolerance=1e-9", "engine.increment=0.01", "engine.speed=40000")
CHANGES = {"the plates swapped": exchanged, "left and right mirrored": mirrored}


def slid(plates: Plates, engine: str, time_step: float | None) -> tuple[Slide, float | None]:
    """A slide; the explicit engine takes the time step given, for its limit is found to 0.5 % only."""
    if engine == "quasi-static":
        return QuasiStatic(plates).slide(0.07), None
    explicit = Explicit(plates)
    explicit.time_step = explicit.time_step if time_step is None else time_step
    return explicit.slide(0.07), explicit.time_step


@pytest.mark.parametrize("face", FACES, ids=" ".join)
@pytest.mark.parametrize("engine", ["quasi-static", "explicit"])
def test_swap_and_mirror(engine: str, face: tuple[str, str], found: Found) -> None:
    """Half a turn about y brings the axle's plate over the wheel's; a mirror turns the lateral force round.

    The bar is rounding that has grown along the slide: 1e-9 of the coefficient and of the mean N.
    """
    soft = [f"plates.external_face={face[0]}", f"plates.external_modulus={face[1]}", f"engine.name={engine}"]
    plates = make_plates(load(None, [*KEYS, *TIGHT, *soft]))
    one, step = slid(plates, engine, None)
    assert np.abs(one.curve.lateral).max() > 1e-3 * one.curve.mean_normal
    for name, change in CHANGES.items():
        other, _ = slid(change(plates), engine, step)
        away = abs(other.curve.coefficient / one.curve.coefficient - 1.0)
        assert found(f"{name}, {engine}, {' '.join(face)} face: coefficient", away, 1e-9)
        assert np.abs(other.curve.normal - one.curve.normal).max() < 1e-9 * one.curve.mean_normal
        assert np.abs(other.curve.lateral + one.curve.lateral).max() < 1e-9 * one.curve.mean_normal


@pytest.mark.parametrize("face", FACES, ids=" ".join)
@pytest.mark.parametrize("engine", ["quasi-static", "explicit"])
def test_the_work_is_accounted_for(engine: str, face: tuple[str, str], found: Found) -> None:
    """Drive = friction + damping + what is stored: within 1 % on every face."""
    soft = [f"plates.external_face={face[0]}", f"plates.external_modulus={face[1]}", f"engine.name={engine}"]
    slide, _ = slid(make_plates(load(None, [*KEYS, *soft])), engine, None)
    assert found(f"work unaccounted for, {engine}, {' '.join(face)} face", abs(slide.work.imbalance), 0.01)
