"""The checks of the stability sweep of the plates see planted faults, and pass what is right."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meso import kernels
from meso.engines import quasistatic
from meso.engines.quasistatic import QuasiStatic
from meso.errors import MesoError
from meso.plates import Plates, make_plates
from meso.settings import load
from meso.surfaces.surface import generator

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.benchmarks import _meso_checks as checks
from tests.benchmarks import _meso_laws as laws
from tests.benchmarks.meso_stability import frictions, main, swept

TILE = ("surface.generator=self_affine", "surface.form=tiles")  # levelled: an approach of 4 um touches in few places
KEYS = ("plates.spheres=400", "load.interference=0.004", "engine.increment=0.02", *TILE)
SLIDE = ("load.slide=0.2", "engine.samples=20", "engine.speed=100000")


@pytest.fixture(scope="module")
def plates() -> Plates:
    return make_plates(load(None, [*KEYS, *SLIDE]))


def with_keys(plates: Plates, *keys: str) -> Plates:
    return replace(plates, settings=load(None, [*KEYS, *SLIDE, *keys]))


@pytest.mark.parametrize("engine", ["quasi-static", "explicit"])
def test_a_right_slide_passes(plates: Plates, engine: str) -> None:
    found = checks.verdict(with_keys(plates, f"engine.name={engine}"))
    assert found.faults == []
    assert found.slide is not None
    assert found.slide.engine == engine


def bent(change: Callable[..., None]) -> Callable[..., Any]:
    """`kernels.solve_increment` whose outcome is changed before the engine sees it."""
    settle = kernels.solve_increment

    def planted(*arguments: Any) -> Any:
        outcome = settle(*arguments)
        change(*(arguments[k] for k in (2, 7, 14, 15, 16)))  # live, forces, trial, normal, sums
        return outcome

    return planted


def less_tangential(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    sums[0] *= 0.9


def forgotten_contact(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    loudest = live[np.argmax(np.abs(forces[live]).max(axis=1))]
    sums[:3] -= forces[loudest]
    forces[loudest] = 0.0


def beyond_coulomb(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    forces[live, 0] *= 3.0
    sums[0] *= 3.0


def pulling(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    forces[live] *= -1.0
    sums[:3] *= -1.0


def more_stored(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    sums[4] *= 1.2


def gained(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    sums[3] = -1e-3


def overspent(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    sums[3] *= 5.0


def not_finite(live: Any, forces: Any, trial: Any, normal: Any, sums: Any) -> None:
    sums[0] = np.nan


FAULTS = (less_tangential, forgotten_contact, beyond_coulomb, pulling, more_stored, gained, overspent, not_finite)


@pytest.mark.parametrize("change", FAULTS)
def test_planted_faults_of_increments_are_seen(
    plates: Plates, monkeypatch: pytest.MonkeyPatch, change: Callable[..., None]
) -> None:
    monkeypatch.setattr(kernels, "solve_increment", bent(change))
    assert checks.verdict(plates).kind == "wrong"


def test_forces_lost_between_the_plates_are_seen(plates: Plates, monkeypatch: pytest.MonkeyPatch) -> None:
    from meso.engines.linear import Linear

    advance = Linear.advance

    def leaking(self: Linear, *arguments: Any, **more: Any) -> Any:
        sums = advance(self, *arguments, **more)
        return replace(sums, force=1.01 * sums.force)

    monkeypatch.setattr(Linear, "advance", leaking)
    faults = checks.verdict(with_keys(plates, "engine.name=explicit")).faults
    assert any("momentum" in fault or "drive" in fault for fault in faults)


def test_overlaps_nobody_knows_of_are_seen(plates: Plates, monkeypatch: pytest.MonkeyPatch) -> None:
    from meso.lattice.candidates import ContactCandidates

    rest = Plates.candidates

    def few(self: Plates, *arguments: Any, **more: Any) -> ContactCandidates:
        all_of_them = rest(self, *arguments, **more)
        return ContactCandidates(**{name: values[::3] for name, values in vars(all_of_them).items()})

    monkeypatch.setattr(Plates, "candidates", few)
    assert any("overlap" in fault for fault in checks.verdict(with_keys(plates, "engine.name=explicit")).faults)
    assert any("overlap" in fault for fault in checks.verdict(plates).faults)


def test_contacts_left_out_of_an_increment_are_found(plates: Plates, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though all that do not touch at its start are left out; and where nobody looks, it is seen."""
    monkeypatch.setattr(quasistatic, "CLOSE", 0.0)
    monkeypatch.setattr(checks.WatchedIncrements, "EVERY", 1)
    fine = with_keys(plates, "engine.increment=0.004")
    assert checks.verdict(fine).faults == []
    monkeypatch.setattr(quasistatic._Run, "_left_out", lambda *_: False)
    assert any("overlap" in fault for fault in checks.verdict(fine).faults)


def test_spheres_that_press_beyond_their_window_are_kept() -> None:
    """Friction carries them along by more than the margin of the candidates."""
    found = next(islice(frictions(generator("stability")), 45, None))()
    assert found.faults == []


def test_a_squeeze_that_breaks_beams_says_what_it_reached(plates: Plates) -> None:
    soft = "engine.breakage={tensile_strength=6000.0, shear_strength=6000.0}"
    keys = (*KEYS[:1], *KEYS[2:], *SLIDE)
    slide = checks.verdict(replace(plates, settings=load(None, [*keys, soft]))).slide
    assert slide is not None
    reached = slide.squeeze.normal[-1] / plates.area
    assert slide.remark.startswith(f"squeezed to {reached:.3g} MPa, where ")


def test_wrong_loads_are_seen(plates: Plates) -> None:
    slide = checks.verdict(plates).slide
    assert slide is not None
    assert checks.load_faults(slide, with_keys(plates, "load.interference=0.005"))
    pressed = replace(plates, settings=load(None, [*KEYS[:1], *KEYS[2:], *SLIDE]))
    assert checks.load_faults(slide, pressed)


def test_reservations_are_not_faults(plates: Plates) -> None:
    found = checks.verdict(with_keys(plates, "contact.micro_friction=0.0", "engine.increment=0.1"))
    assert found.kind in ("said", "answered")
    assert checks.Verdict(said="a remark").kind == "said"


def test_errors_of_several_lines_and_exceptions_are_faults() -> None:
    assert checks.refused(MesoError("one line")).kind == "error"
    assert checks.refused(MesoError("two\nlines")).kind == "wrong"

    def family(rng: np.random.Generator) -> Iterator[Any]:
        yield lambda: 1 / 0
        yield lambda: checks.Verdict()

    tally = swept(family, None)
    assert (tally.kinds["wrong"], tally.kinds["answered"]) == (1, 1)
    assert "ZeroDivisionError" in tally.troubles[0]


def test_what_is_not_refused_is_a_fault() -> None:
    assert laws.impossible("load.pressure=100", laws.PLATES)().kind == "wrong"
    assert laws.impossible("load.pressure=-1", laws.PLATES)().kind == "error"


def test_asymmetry_is_seen(plates: Plates) -> None:
    stiffer = plates.axle.beams * np.array([1.0, 1.0, 1.0, 1.0, 1.3, 1.3])
    other = replace(plates, axle=replace(plates.axle, beams=stiffer))
    assert laws.alike(plates, other, QuasiStatic, "stiffer axle").kind == "wrong"


def test_a_drifting_lattice_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    first = next(iter(laws.million(np.random.default_rng(1), steps=3000)))
    assert first().kind == "answered"
    from meso.engines.linear import Linear

    advance = Linear.advance
    monkeypatch.setattr(Linear, "advance", lambda self, steps, speed: advance(self, steps, speed, damping=1.0))
    assert first().kind == "wrong"


def test_one_family_prints_its_row(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--quick", "--only", "nonsense"]) == 0
    assert "| nonsense |" in capsys.readouterr().out
