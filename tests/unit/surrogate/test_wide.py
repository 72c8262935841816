"""Pressure and modulus, constant force, lays and small roughness: what the wide design and its network add."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import torch
from mpi4py import MPI

from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, TilePairs, build
from macrofit.identify.fit import identify
from macrofit.identify.measured import Measured
from macrofit.results.doubts import DoubtfulRun, allow_none, doubts
from macrofit.scene import load_scene
from macrofit.solve import solve
from meso.friction_test import run
from meso.measured.keys import ScanKeys
from meso.settings import FaceKeys, SurfaceKeys, load
from meso.surfaces.face import rough_face
from surrogate.data.design import Design
from surrogate.data.faces import generated_face
from surrogate.data.plates import Plates
from surrogate.data.sample import design_on_preset, design_tasks, header_of, plate_settings
from surrogate.errors import DesignError, PredictionError, SurrogateError
from surrogate.levels import PressureLevels
from surrogate.network.devices import chosen_device
from surrogate.network.foundation import Foundation
from surrogate.network.predict import Predictor
from surrogate.pair import outside_heights, predict_pair
from surrogate.provider import TileNetwork

NO = np.zeros(1, dtype=np.int64)


def wide(**options: Any) -> Design:
    return design_on_preset("slow", "wide", **options)


@pytest.fixture(scope="module")
def shipped() -> Predictor:
    return Predictor()


def one_pair(predictor: Predictor, keys: FaceKeys, micro: float = 0.07, **how: Any) -> Any:
    """The answer for the faces of seed 9."""
    wheel, axle = (generated_face(body, 9, keys, predictor.provenance.points) for body in ("wheel", "axle"))
    return predictor(wheel[None], axle[None], NO, NO, micro, **how)


def provider(youngs_modulus: float = 206e3, **options: Any) -> TileNetwork:
    context = BuildContext(seat_tiles=8, bore_tiles=8, youngs_modulus=youngs_modulus, poisson_ratio=0.3)
    made = build("surrogate", options, context)
    assert isinstance(made, TileNetwork)
    return made


def asked(pressure: float) -> TilePairs:
    return TilePairs(np.arange(4), np.arange(4)[::-1].copy(), np.full(4, pressure), np.zeros(4))


# The design


def test_a_wide_design_fills_its_ranges() -> None:
    points = wide().points(256)
    for name, (low, high) in {"max_height": (0.001, 0.1), "pressure": (20.0, 520.0)}.items():
        values = np.array([getattr(point, name) for point in points])
        assert low <= values.min() < 1.1 * low
        assert 0.9 * high < values.max() <= high
        assert np.median(values) == pytest.approx(np.sqrt(low * high), rel=0.05)  # by ratio
    lays = [point.face.get("lay") for point in points]
    assert lays.count(None) == pytest.approx(2 * 256 / 3, abs=4)
    assert lays.count("turned") == pytest.approx(256 / 6, abs=4)
    assert [point.face["form"] for point in points].count("strip") == pytest.approx(128, abs=2)
    micros = np.array([point.micro_friction for point in points])
    assert micros.min() < 0.0102
    assert micros.max() > 0.295
    assert micros[:, 0].max() < np.sqrt(0.01 * 0.3) < micros[:, 1].min()


def test_every_face_of_a_wide_design_can_be_made() -> None:
    """Grooves are never narrower than the grid holds."""
    for point in wide().points(64):
        keys = FaceKeys(levels=point.levels, max_height=point.max_height, **point.face)  # type: ignore[arg-type]
        rough_face(keys, "axle", 1, (2.0, 1.0))


def test_pressures_of_a_design_can_be_limited() -> None:
    pressures = [point.pressure or 0.0 for point in wide(pressure=(30.0, 300.0)).points(256)]
    assert min(pressures) == pytest.approx(30.0, rel=0.02)
    assert max(pressures) == pytest.approx(300.0, rel=0.02)


def test_the_design_sets_what_it_varies() -> None:
    settings = plate_settings(["load.control=force"])
    design = wide()
    tasks = list(design_tasks(design, settings, 8, header_of(design, settings)))
    loads = {task.settings.load.pressure for task in tasks}
    assert len(loads) == 8
    assert {task.settings.load.control for task in tasks} == {"force"}
    assert {task.settings.surface.form for task in tasks} == {"strip", "tiles"}
    with pytest.raises(DesignError, match=r"load.pressure: leave it out, --design varies it"):
        plate_settings(["load.pressure=100"], design=design)


# The physics


@pytest.mark.parametrize("slope", [-0.02, 0.01, 0.05])
def test_at_constant_force_a_ramp_costs_its_slope(slope: float) -> None:
    """A flat face on a ramp is lifted by slope x slide: b is the slope, whatever the stiffness and the load."""
    x = torch.linspace(0.0, 2.0, 33)[:, None].expand(33, 17)
    faces = torch.zeros(1, 17, 17), (slope * x)[None].clone()
    for force in (30.0, 300.0):
        slide = Foundation([3e4, 1e5], 170.0).slide(*faces, torch.tensor([force]), torch.tensor([True]))
        assert slide.b[0].tolist() == pytest.approx([slope, slope], abs=2e-6)
        assert slide.load[0].tolist() == pytest.approx([1.0, 1.0], abs=1e-4)
        assert slide.least[0].tolist() == pytest.approx([1.0, 1.0], abs=1e-4)


def test_pairs_of_both_kinds_and_of_many_loads_go_together() -> None:
    rng = torch.Generator().manual_seed(1)
    wheel, axle = 0.004 * torch.rand(4, 17, 17, generator=rng), 0.004 * torch.rand(4, 33, 17, generator=rng)
    force, free = torch.tensor([30.0, 170.0, 30.0, 300.0]), torch.tensor([True, False, False, True])
    foundation = Foundation([3e4, 1e5], 170.0)
    together = foundation.slide(wheel, axle, force, free)
    for pair in range(4):
        row = slice(pair, pair + 1)
        alone = foundation.slide(wheel[row], axle[row], force[row], free[row])
        for one, all_of_them in zip(alone, together, strict=True):
            assert one[0].tolist() == pytest.approx(all_of_them[pair].tolist(), rel=1e-4, abs=1e-7)


def test_load_goes_with_pressure_over_modulus() -> None:
    on_steel = Plates().on_steel(np.array([170.0]))
    assert on_steel == pytest.approx(170.0)
    assert Plates(youngs_modulus=70e3).on_steel(np.array([170.0 * 70.0 / 206.0])) == pytest.approx(on_steel)


def test_plates_depend_on_pressure_over_modulus_alone() -> None:
    coefficients = []
    for pressure, modulus in ((150.0, 206e3), (50.0, 206e3 / 3.0), (75.0, 206e3)):
        keys = {"load.pressure": pressure, "material.youngs_modulus": modulus, "plates.spheres": 400}
        keys |= {"engine.increment": 0.05, "load.control": "force"}
        (slide,) = run(load(None, [f"{key}={value}" for key, value in keys.items()])).slides
        coefficients.append(slide.curve.coefficient)
    hard, soft, light = coefficients
    assert soft == pytest.approx(hard, rel=1e-6)
    assert light != pytest.approx(hard, rel=1e-4)


# The network that comes with the package


def test_the_spread_has_a_floor(shipped: Predictor) -> None:
    """Packings of smooth faces differ by half a per cent of 0.07; a spread in proportion to R would say a hundredth."""
    smooth = one_pair(shipped, FaceKeys(max_height=0.001), control="force")
    assert 2e-4 < smooth.spread[0] < 2e-3
    assert smooth.mean[0] == pytest.approx(0.0715, abs=0.002)


def test_packings_of_rough_faces_differ_in_their_slope_too(shipped: Predictor) -> None:
    """Spread of a, from that at 0 and at 0.3: above 0.004 at R = 80 µm, as packings differ there, little at 1 µm."""
    of_a = []
    for height in (0.001, 0.08):
        small, large = (
            one_pair(shipped, FaceKeys(max_height=height), control="force", micro=micro).spread[0]
            for micro in (0.0, 0.3)
        )
        of_a.append(np.sqrt(large**2 - small**2) / 0.3)
    assert of_a[0] < 0.003
    assert 0.004 < of_a[1] < 0.03


def test_faces_are_judged_by_what_the_network_sees(shipped: Predictor) -> None:
    assert one_pair(shipped, FaceKeys(), control="force").seen.all()
    assert not one_pair(shipped, FaceKeys(max_height=0.4), control="force").seen.any()


def test_what_is_known_of_pressures_depends_on_what_is_held(shipped: Predictor) -> None:
    about = shipped.provenance
    steel = msgspec.structs.replace(about.plates, control="force")
    assert about.unlike(msgspec.structs.replace(steel, pressure=30.0)) == []
    assert about.unlike(msgspec.structs.replace(steel, pressure=100.0, youngs_modulus=70e3)) == []
    low, high = about.pressures["force"]
    for pressure, inside in ((0.97 * low, True), (0.93 * low, False), (1.03 * high, True), (1.07 * high, False)):
        assert (about.unlike(msgspec.structs.replace(steel, pressure=pressure)) == []) is inside
    (said,) = about.unlike(msgspec.structs.replace(steel, pressure=300.0, youngs_modulus=70e3))
    assert "pressure = 300 (883 on steel)" in said
    (said,) = about.unlike(msgspec.structs.replace(steel, pressure=30.0, control="displacement"))
    assert said.startswith("pressure = 30 with control = 'displacement' is outside ")
    assert said.endswith(f"(with control = 'force' it knows {low:.3g} ... {high:.3g})")
    (said,) = about.unlike(msgspec.structs.replace(steel, spheres=500))
    assert "plates.spheres" in said


def test_faces_of_files_are_compared_with_those_learned_from(tmp_path: Path, shipped: Predictor) -> None:
    """Five times as rough as any is another unit; one high peak is told too, though the rms height is inside."""
    rng, learned = np.random.default_rng(1), (0.005, 0.04)
    face = rng.standard_normal((33, 33)).astype(np.float32)
    for rms, told in ((0.004, 0), (0.012, 1)):
        assert len(outside_heights(rms * face, "wheel", "w.npy", learned)) == told
    for rms, unit in ((0.05, "is it in µm"), (4e-5, "is it in m, or flat")):
        with pytest.raises(PredictionError, match=rf"w\.npy: its rms height is .*{unit}"):
            outside_heights(rms * face, "wheel", "w.npy", learned)
    wave = 0.08 * np.sin(2.0 * np.pi * np.arange(101) / 100.0)
    np.save(tmp_path / "w.npy", np.broadcast_to(wave[:, None], (101, 101)))
    scan = ScanKeys(files=(str(tmp_path / "w.npy"),), use="face", spacing=0.01, remove="none")
    outside = predict_pair(shipped, (0.07,), SurfaceKeys(bore=scan), control="force").outside
    assert any("from nominal is higher than any learned from" in line for line in outside)


# The provider


def test_levels_are_within_the_tolerance() -> None:
    levels = PressureLevels(20.0, 520.0)
    pressure = np.geomspace(18.0, 560.0, 999)
    served = levels.pressure(levels.of(pressure))
    inside = (pressure > 20.0) & (pressure < 520.0)
    assert np.abs(served / pressure - 1.0)[inside].max() < 0.106
    assert levels.of(np.array([0.0, 20.0, 1e9])).tolist() == [0, 0, levels.count - 1]
    assert levels.pressure(np.array([levels.count - 1]))[0] / 520.0 == pytest.approx(1.0, abs=0.106)  # none is beyond


def test_pairs_are_asked_anew_where_they_leave_a_level() -> None:
    made = provider()
    assert made.depends_on == {"tiles", "pressure"}
    first = made.coefficients(asked(150.0))
    assert made.coefficients(asked(152.0)).tolist() == first.tolist()
    assert made.counters["asked_anew"] == 0
    assert made.coefficients(asked(60.0)).tolist() != first.tolist()
    assert made.counters["asked_anew"] == 4
    assert made.coefficients(asked(150.0)).tolist() == first.tolist()  # whatever was asked before
    assert made.counters["asked_anew"] == 8


def test_a_softer_solid_has_the_coefficients_of_p_over_e() -> None:
    softer = provider(103e3).coefficients(asked(75.0))
    assert softer.tolist() == provider().coefficients(asked(150.0)).tolist()
    assert softer.tolist() != provider().coefficients(asked(75.0)).tolist()
    assert softer.tolist() == provider(206e3 / 3.0).coefficients(asked(50.0)).tolist()


def test_pressures_beyond_the_levels_have_levels_of_their_own() -> None:
    levels = PressureLevels(20.0, 520.0)
    pressure = np.array([0.0, 0.3, 1.0, 5.0, 17.9, 18.1, 100.0, 560.0, 580.0, 2000.0, 9000.0])
    level = levels.beyond(pressure)
    assert level[[0, 5, 6, 7]].tolist() == levels.of(pressure[[0, 5, 6, 7]]).tolist()
    assert (level[1:5] < 0).all()
    assert (level[8:] >= levels.count).all()
    served = levels.pressure(level)
    assert served[3:5] == pytest.approx([5.0, 17.9], rel=0.106)
    assert served[8:10] == pytest.approx([580.0, 2000.0], rel=0.106)
    assert served[[1, 2, 10]] == pytest.approx([1.0, 1.0, 5000.0], rel=0.106)  # where the plates end
    assert levels.octaves(np.array([0.0, 5.0, 19.0, 550.0, 1040.0])).tolist() == [0.0, 2.0, 0.0, 0.0, 1.0]


def test_pressures_beyond_those_learned_from_are_counted() -> None:
    made = provider()
    end = made.coefficients(asked(20.0)).tolist()
    for pressure, counted in ((0.0, 0), (25.0, 0), (5.0, 4), (900.0, 8)):
        answer = made.coefficients(asked(pressure)).tolist()
        assert (answer == end) is (pressure < 20.0)
        assert made.counters["clamped"] == counted
    assert "clamped" not in provider(pressure=170.0).counters


@pytest.mark.filterwarnings("ignore:friction provider")
def test_plates_answer_for_the_pressure_of_a_pair() -> None:
    """Those that the network has not seen alone, and not at the 170 MPa that plates have by themselves."""
    small: dict[str, Any] = {"plates": {"spheres": 400}, "engine": {"increment": 0.05}}
    made = provider(103e3, fallback="dem", dem=small)
    levels = made.tiles.pressures
    assert levels is not None
    on_steel = made.tiles.predictor.provenance.at_modulus(1.0, 103e3)
    own = float(levels.pressure(levels.beyond(np.array([1000.0 * on_steel])))[0]) / on_steel
    context = BuildContext(seat_tiles=8, bore_tiles=8, youngs_modulus=103e3, poisson_ratio=0.3)
    dem = build("dem", small | {"load": {"pressure": own, "control": "force"}}, context)
    network = provider(103e3).coefficients(asked(75.0))
    both = asked(75.0)._replace(pressure=np.array([75.0, 1000.0, 75.0, 1000.0]))
    assert own == pytest.approx(1000.0, rel=0.106)
    expected = [network[0], dem.coefficients(both)[1], network[2], dem.coefficients(both)[3]]
    assert made.coefficients(both).tolist() == expected
    assert made.counters["clamped"] == 2
    assert made.outside(both) == {}


def test_what_a_network_does_not_know_is_said_by_how_much() -> None:
    """In MPa of the axle's material; for each halving of the pressure 1.8 %, which is what it is worth within."""
    low, high = provider().outside(asked(5.0)), provider(103e3).outside(asked(1040.0))
    (pressures,) = (reason for reason in low if reason.startswith("unknown pressures"))
    assert low[pressures] == pytest.approx(np.full(4, 0.018 * 2.0), rel=1e-2)
    (pressures,) = (reason for reason in high if reason.startswith("unknown pressures"))
    assert "beyond the 10 to 26" in pressures
    assert high[pressures] == pytest.approx(np.full(4, 0.018 * 2.0), rel=1e-2)
    assert not any(off.any() for off in provider().outside(asked(150.0)).values())
    with pytest.warns(UserWarning, match="asked nevertheless"):
        other = provider(micro_friction=0.4, fallback="warning").outside(asked(150.0))
    assert {reason.partition(":")[0]: off.max() for reason, off in other.items()} == {
        "unknown faces": 0.0, "unknown inputs": 0.2, "unknown pressures": 0.0,
    }  # fmt: skip


LITTLE = ("motion.travel=60", "motion.increment=6", "mesh.seat_facet=4", "mesh.coarse=40", "output.stress=false")


@pytest.mark.parametrize(
    ("overrides", "doubted"),
    [
        ((), {}),
        (("wheel.bore_radius=94.995",), {"unknown pressures": "37 of 37 pairs of tiles at 60 mm, with 100% of"}),
        (("friction.options={micro_friction=0.4,fallback='warning'}",), {"unknown inputs": "45 of 45 pairs"}),
    ],
)
@pytest.mark.filterwarnings("ignore:friction provider 'surrogate'")
def test_a_press_fit_says_where_the_network_was_asked_for_what_it_does_not_know(
    overrides: tuple[str, ...], doubted: dict[str, str]
) -> None:
    fit = solve(load_scene("wheelset", [*LITTLE, "friction.provider=surrogate", *overrides]), MPI.COMM_SELF)
    said = [sentence for sentence in doubts(fit) if sentence.startswith("unknown")]
    assert {sentence.partition(":")[0] for sentence in said} == set(doubted)
    for sentence in said:
        head, _, told = sentence.partition(": ")
        assert told.startswith(doubted[head])
        assert "fallback = 'dem'" in told
        with pytest.raises(DoubtfulRun, match="unknown"):
            allow_none(said, "here")


def test_one_pressure_for_all() -> None:
    made = provider(pressure=170.0, control="force")
    assert made.depends_on == {"tiles"}
    assert made.coefficients(asked(60.0)).tolist() == made.coefficients(asked(150.0)).tolist()


@pytest.mark.parametrize("micro", [0.107, 0.29])
def test_micro_coefficients_of_real_seats_are_inside(micro: float) -> None:
    assert np.all(np.abs(provider(micro_friction=micro).coefficients(asked(150.0)) / micro - 1.05) < 0.15)
    with pytest.raises(ProviderError, match=r"micro_friction = 0.4 is outside 0.01"):
        provider(micro_friction=0.4)


def test_what_matches_uniform_friction_is_found_inside() -> None:
    """Uniform 0.11 on `wheelset`: about 0.106 by the network, which counts no pair unlike those it has learned from."""
    uniform = solve(load_scene("wheelset", [*LITTLE, "friction.options.coefficient=0.11"]), MPI.COMM_SELF)
    measured = Measured(uniform.displacement[1:], uniform.force[1:])
    rough = [*LITTLE, "friction.provider=surrogate"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = identify("wheelset", measured, rough, comm=MPI.COMM_SELF).fit.value
        again = solve(load_scene("wheelset", [*rough, f"friction.options.micro_friction={found}"]), MPI.COMM_SELF)
    assert found == pytest.approx(0.106, abs=0.002)
    assert again.counters["provider_out_of_range"] == 0
    assert again.force[-1] == pytest.approx(uniform.force[-1], rel=0.01)


# The device


def test_a_device_that_is_not_there() -> None:
    assert chosen_device("cpu") == "cpu"
    with pytest.raises(SurrogateError, match="--device tape: is no device of torch"):
        chosen_device("tape")
    if not torch.cuda.is_available():
        with pytest.raises(SurrogateError, match="--device cuda: there is no GPU"):
            chosen_device("cuda")
