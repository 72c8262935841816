"""The design of the samples, one sample, and the farm: the same content whoever computes, whatever ends it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest

from macrofit.base.farm import ProcessFarm, SerialFarm
from meso.friction_test import run
from meso.surfaces.face import rough_face
from surrogate.data.database import read_database
from surrogate.data.design import FINEST_LEVEL, FRICTION_RANGE, Design
from surrogate.data.generate import generate_samples
from surrogate.data.journal import journal_of
from surrogate.data.sample import design_on_preset, design_tasks, header_of, plate_settings
from surrogate.errors import DatabaseError, DesignError

SMALL = plate_settings(["plates.spheres=500", "engine.samples=40"])
PAIRS = 6
COMMAND = [sys.executable, "-m", "surrogate", "generate", "--spheres", "500", "--set", "engine.samples=40"]
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    """Six pairs of the plain design, by this process."""
    path = tmp_path_factory.mktemp("farm") / "here.h5"
    generate_samples(path, Design(), SMALL, PAIRS, SerialFarm())
    return read_database(path)


def assert_same(found, wanted) -> None:
    """The same samples; to rounding, since this process has loaded other libraries than a worker of the farm."""
    one, other = found.samples, wanted.samples
    assert one.id.tolist() == other.id.tolist()
    assert np.array_equal(one.wheel, other.wheel)
    assert np.array_equal(one.axle, other.axle)
    assert np.array_equal(one.micro_friction, other.micro_friction)
    np.testing.assert_allclose(one.meso_friction, other.meso_friction, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(one.mean_normal, other.mean_normal, rtol=1e-4)
    assert found.failures == wanted.failures


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


# --- the design


def test_the_design_fills_its_ranges_evenly():
    points = Design().points(256)
    height = np.log([point.max_height for point in points])
    exponent = [point.hurst_exponent for point in points]
    friction = np.array([point.micro_friction for point in points])
    for values, (low, high) in (
        (height, np.log((0.005, 0.04))),
        (exponent, (0.5, 1.0)),
        (friction[:, 0], (0.01, 0.05)),
        (friction[:, 1], (0.05, 0.09)),
    ):
        place = (np.sort(values) - low) / (high - low)
        # a scrambled net: each of 256 equal parts holds one point
        assert np.array_equal(np.floor(256 * place), np.arange(256))
    assert sum(point.levels == 3 for point in points) == 128
    assert FRICTION_RANGE == (0.01, 0.09)


def test_more_pairs_and_other_surfaces_continue_one_design():
    first = Design().points(50)
    assert Design().points(20) == first[:20]
    assert Design(first_surface=20).points(30) == first[20:]
    assert Design(seed=1).points(20) != first[:20]
    assert len(Design(seed=1).points(1)) == 1


def test_a_split_by_pair_is_a_split_by_seed():
    design = Design(first_surface=100, first_packing=50, packings=3)
    tasks = list(design_tasks(design, SMALL, 40, header_of(design, SMALL)))
    assert [task.id for task in tasks] == list(range(120))
    for task in tasks:
        surface, packing = task.settings.surface, task.settings.plates.packing_seed
        assert surface.wheel_seed == surface.axle_seed == 65536 * (100 + task.id // 3) + 65532  # a strip each
        assert 50 <= packing < 50 + Design().packing_seeds
        task.settings.check()
    for pair in range(40):
        same = tasks[3 * pair : 3 * pair + 3]
        assert len({task.settings.plates.packing_seed for task in same}) == 3
        assert len({(task.settings.surface, task.settings.contact) for task in same}) == 1
    few = Design(packings=3, packing_seeds=8)  # two blocks of three
    assert [few.packing_seed(pair, k) for pair in range(3) for k in range(3)] == [0, 1, 2, 3, 4, 5, 0, 1, 2]


def test_no_two_samples_share_what_a_strip_depends_on():
    """Each pair has a strip of its own; beyond 65536 pairs places on one are 4 tiles apart: 2 of the axle, 1 beside."""
    design = Design(first_surface=65530)
    seeds = [design.surface_seed(pair, "strip") for pair in range(65546)]
    assert len(set(seeds)) == len(seeds)
    assert [divmod(seed, 65536) for seed in seeds[:7]] == [*((65530 + k, 65532) for k in range(6)), (0, 65528)]
    assert divmod(Design(first_surface=2**30 - 1).surface_seed(0, "strip"), 65536) == (65535, 0)
    for form in ("tiles", "levelled"):
        assert [design.surface_seed(pair, form) for pair in range(3)] == [65530, 65531, 65532]


def test_fixed_values():
    design = Design(max_height=(0.02, 0.02), hurst_exponent=(0.8, 0.8), levels=(3,), micro_friction=(0.03, 0.05, 0.07))
    points = design.points(4)
    assert all(point == points[0] for point in points)
    assert points[0].max_height == 0.02
    assert points[0].micro_friction == (0.03, 0.05, 0.07)
    assert header_of(design, SMALL).micro_frictions == 3


BAD = {
    "--max-height": {"max_height": (0.04, 0.005)},
    "--levels": {"levels": (3, FINEST_LEVEL + 1)},
    "--hurst": {"hurst_exponent": (0.5, 1.1)},
    "--pressure": {"pressure": (300.0, 30.0)},
    "--micro-friction": {"micro_friction": (0.07, 0.03)},
    "--micro-friction ": {"micro_friction": 0},
    "--packings": {"packings": 0},
    "--first-surface": {"first_surface": -1},
    "--seed": {"seed": -1},
}


@pytest.mark.parametrize("option", BAD)
def test_a_design_that_cannot_be(option):
    with pytest.raises(DesignError, match=option.strip()):
        Design(**BAD[option])


def test_keys_of_the_design_are_refused_among_the_settings():
    for override in (
        "surface.levels=3",
        "surface={levels=4}",
        "contact.micro_friction=0.07",
        "plates.packing_seed=0",
        "plates.axle_packing_seed=0",
    ):
        with pytest.raises(DesignError, match=override.partition("=")[0]):
            plate_settings([override])
    with pytest.raises(DesignError, match=r"plates\.sphere: unknown key \(did you mean 'spheres'"):
        plate_settings(["plates.sphere=3"])


def test_a_preset_has_one_roughness_and_its_plates():
    design = design_on_preset("as-published", first_surface=7)
    assert {(p.max_height, p.levels, p.hurst_exponent) for p in design.points(5)} == {(0.04, 3, 0.8)}
    settings = plate_settings(["plates.spheres=500"], "as-published")
    header = header_of(design, settings)
    plates = header.plates
    assert (plates.spheres, plates.thickness, plates.external_face, plates.form) == (500, 0.4, "beams", "tiles")
    assert (plates.engine, plates.speed, plates.dynamic) == ("explicit", 10_000.0, True)
    tasks = list(design_tasks(design, settings, 2, header))
    assert [task.settings.surface.wheel_seed for task in tasks] == [7, 8]
    assert {task.settings.surface.max_height for task in tasks} == {0.04}


def test_ranges_that_are_given_go_before_the_presets():
    design = design_on_preset("as-published", max_height=(0.01, 0.02), hurst_exponent=None)
    assert (design.max_height, design.levels, design.hurst_exponent) == ((0.01, 0.02), (3,), (0.8, 0.8))
    assert design_on_preset("slow") == Design()


# --- a sample


def test_a_sample_is_the_friction_test_of_its_settings(database):
    samples, pair = database.samples, 3
    settings = plate_settings(["plates.spheres=500", "engine.samples=40"])
    settings = msgspec.structs.replace(
        settings,
        surface=msgspec.structs.replace(
            settings.surface,
            wheel_seed=int(samples.wheel_seed[pair]),
            axle_seed=int(samples.axle_seed[pair]),
            levels=int(samples.levels[pair]),
            max_height=float(samples.max_height[pair]),
            hurst_exponent=float(samples.hurst_exponent[pair]),
        ),
        plates=msgspec.structs.replace(settings.plates, packing_seed=int(samples.packing_seed[pair])),
        contact=msgspec.structs.replace(settings.contact, micro_friction=tuple(samples.micro_friction[pair].tolist())),
    )
    test = run(settings)
    for k, slide in enumerate(test.slides):
        assert samples.meso_friction[pair, k] == slide.curve.coefficient
        assert samples.meso_friction_mean_of_ratio[pair, k] == slide.curve.mean_of_ratio
        assert samples.uncertainty[pair, k] == slide.curve.uncertainty
        assert samples.mean_normal[pair, k] == slide.curve.mean_normal
        assert samples.minimum_normal[pair, k] == slide.curve.normal.min() <= slide.curve.mean_normal
        assert samples.approach[pair, k] == slide.squeeze.displacement[-1] > 0.0
        assert samples.engine[pair, k].decode() == slide.engine
        # the account of the slide closes with what is stored here: drive = friction + change of what is stored
        kept = samples.friction_loss[pair, k] + samples.stored_energy[pair, k]
        assert kept == pytest.approx(slide.work.drive, rel=1e-2)  # the quasi-static engine's own imbalance
    for body, size in (("wheel", (1.0, 1.0)), ("axle", (2.0, 1.0))):
        face = rough_face(settings.surface, body, 65536 * pair + 65532, size)
        finer = 32 // 2 ** int(samples.levels[pair])
        stored = getattr(samples, body)[pair]
        assert np.array_equal(stored[::finer, ::finer], face.heights.astype(np.float32))
        packing = getattr(test.plates, f"{body}_packing")
        tops = getattr(samples, f"{body}_envelope")[pair]
        assert tops.shape == (64 * int(size[0]) + 1, 65)
        assert np.array_equal(tops, packing.envelope(tops.shape).astype(np.float32))


def test_a_failure_is_kept_and_does_not_stop_the_rest(tmp_path, monkeypatch):
    """Surfaces of the second pair are deeper than their plate."""
    path, points = tmp_path / "a.h5", Design().points

    def one_too_deep(design: Design, pairs: int) -> list[object]:
        return [msgspec.structs.replace(p, max_height=0.9) if i == 1 else p for i, p in enumerate(points(pairs))]

    monkeypatch.setattr(Design, "points", one_too_deep)
    for _ in range(2):
        generate_samples(path, Design(), SMALL, 3, SerialFarm())
        found = read_database(path)
        assert found.samples.id.tolist() == [0, 2]
        assert list(found.failures) == [1]
        assert "in a plate 300 um thick" in found.failures[1]


def test_nothing_but_failures_is_an_error(tmp_path):
    """One line with the reason, exit code 2; the reasons are kept, and the same command says the same."""
    path = tmp_path / "a.h5"
    for _ in range(2):
        with pytest.raises(DatabaseError, match=r"not one of 2 samples could be computed, .* the surface"):
            generate_samples(path, Design(max_height=(0.8, 0.9)), SMALL, 2, SerialFarm())
    assert len(read_database(path).failures) == 2


def test_a_bug_is_not_a_failure(tmp_path, monkeypatch):
    def broken(settings: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("surrogate.data.sample.run", broken)
    with pytest.raises(ZeroDivisionError):
        generate_samples(tmp_path / "a.h5", Design(), SMALL, 1, SerialFarm())


# --- the farm


def test_two_processes_make_the_same_and_none_is_left(database, tmp_path):
    path = tmp_path / "a.h5"
    before = set(children(os.getpid()))
    generate_samples(path, Design(), SMALL, PAIRS, ProcessFarm(2))
    assert_same(read_database(path), database)
    left = [pid for pid in set(children(os.getpid())) - before if "resource_tracker" not in cmdline(pid)]
    assert left == []


def cmdline(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text()


def test_another_design_or_other_plates_are_refused(tmp_path):
    path = tmp_path / "a.h5"
    generate_samples(path, Design(), SMALL, 1, SerialFarm())
    with pytest.raises(DatabaseError, match=r"max_height was \[0.005, 0.04\], now \[0.01, 0.04\]"):
        generate_samples(path, Design(max_height=(0.01, 0.04)), SMALL, 1, SerialFarm())
    with pytest.raises(DatabaseError, match="spheres = 500"):
        generate_samples(path, Design(), plate_settings(["plates.spheres=600"]), 1, SerialFarm())


@pytest.mark.slow
def test_killed_with_its_processes_and_gone_on_with(database, tmp_path):
    """Only the first process is killed: the others must end by themselves, and the lock with them."""
    path = tmp_path / "a.h5"
    command = [*COMMAND, "-o", str(path), "--pairs", str(PAIRS), "--jobs", "2"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    while not journal_of(path).exists() and process.poll() is None:
        time.sleep(0.002)
    workers: list[int] = []
    while process.poll() is None and len(workers) < 3:  # both, and what looks after their semaphores
        workers = children(process.pid)
        time.sleep(0.002)
    while process.poll() is None and not len(read_database(path).samples):
        time.sleep(0.002)
    assert process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    seen = read_database(path).samples.id.tolist()
    patience = time.monotonic() + 10.0
    while any(alive(pid) for pid in workers):
        assert time.monotonic() < patience
        time.sleep(0.02)
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert f"{PAIRS} of {PAIRS}" in done.stdout or len(seen) == PAIRS
    assert read_database(path).content_hash[:20] in done.stdout
    assert_same(read_database(path), database)
    assert os.listdir(tmp_path) == ["a.h5"]


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(("how", "jobs"), [(signal.SIGINT, 2), (signal.SIGTERM, 1)])
def test_interrupted(how, jobs, tmp_path):
    """Ctrl-C reaches the whole group of processes; one line is said, and the same command would go on."""
    path = tmp_path / "a.h5"
    command = [*COMMAND, "-o", str(path), "--pairs", "100", "--jobs", str(jobs)]
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while not (journal_of(path).exists() and len(read_database(path).samples)):
        assert process.poll() is None
        time.sleep(0.02)
    if how == signal.SIGINT:
        os.killpg(process.pid, how)
    else:
        process.send_signal(how)
    _, told = process.communicate(timeout=20.0)
    assert process.returncode == 130
    assert (
        told
        == f"macrofit-surrogate: interrupted; what was computed is kept beside {path}, and the same command goes on\n"
    )
    assert len(read_database(path).samples) > 0


def test_the_command_says_what_is_wrong(tmp_path):
    def said(*options: str) -> str:
        done = subprocess.run([*COMMAND, "-o", "a.h5", *options], cwd=ROOT, capture_output=True, text=True)
        assert done.returncode == 2
        assert not (ROOT / "a.h5").exists()
        return done.stderr

    assert said("--pairs", "1", "--set", "surface.levels=3").startswith("macrofit-surrogate: --set surface.levels: ")
    assert "--max-height" in said("--pairs", "1", "--max-height", "a")
    assert "--pressure = (300.0, 30.0)" in said("--pairs", "1", "--design", "wide", "--pressure", "300,30")
