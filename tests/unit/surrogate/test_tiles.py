"""The tiles of a press-fit: the network's own bits whatever was asked before, and what is computed how often."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from untrained import untrained

import surrogate.tiles
from macrofit.base.arrays import IntArray
from meso.measured.keys import ScanKeys
from meso.settings import FaceKeys
from meso.surfaces.face import rough_face
from surrogate.data.faces import generated_face, generated_faces, sampled_heights
from surrogate.data.samples import Plates
from surrogate.errors import CheckpointError, PredictionError
from surrogate.network import inference
from surrogate.network.checkpoint import CNNOptions, Control, EnsembleOptions, Provenance, save_checkpoint
from surrogate.network.predict import Prediction, Predictor
from surrogate.tiles import FACES_TOGETHER, KEPT, Tiles, load_predictor, shared_tiles

POINTS, SEED = 9, 3
COUNTS = 14, 11
KEYS: dict[str, Any] = {"levels": 3, "max_height": 0.03, "hurst_exponent": 0.7}
SURFACE = FaceKeys(**KEYS)
SEAT, BORE = (tiles.ravel() for tiles in np.meshgrid(*map(np.arange, COUNTS), indexing="ij"))


def network(options: EnsembleOptions | CNNOptions, path: Path, control: Control = "displacement") -> Predictor:
    """Of random weights: every layer counts, and no two members agree."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = options.build_network()
        if isinstance(options, EnsembleOptions):
            for parameter in model.parameters():
                torch.nn.init.normal_(parameter, std=0.3)
            model.lost.fill_(0.6)
    about = Provenance(
        options=options, faces="generated", database="", seed=0, training=0, validation=0, points=POINTS,
        plates=Plates(control=control), surface_seeds=(0, 999), packing_seeds=(0, 9), max_height=(0.0, 1.0),
        levels=(3,), hurst_exponent=(0.0, 1.0), micro_friction=(0.0, 1.0),
        validation_error={}, validation_r2=0.0, versions={},
    )  # fmt: skip
    save_checkpoint(path, model, about)
    return Predictor(path)


@pytest.fixture(scope="module", params=["displacement", "force"])
def energy(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Predictor:
    options = EnsembleOptions(stiffness=[3e4, 1e5], load=170.0, members=3)
    return network(options, tmp_path_factory.mktemp("network") / "energy.safetensors", request.param)


@pytest.fixture(scope="module", params=[1, 3], ids=["alone", "several"])
def paper(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Predictor:
    options = CNNOptions(POINTS, members=request.param)
    return network(options, tmp_path_factory.mktemp("network") / "paper.safetensors")


def tiles(asked: Predictor) -> Tiles:
    return Tiles(asked, SEED, SURFACE, COUNTS)


def directly(asked: Predictor, micro: float) -> Prediction:
    """Of all pairs, from all faces."""
    axles, wheels = (
        np.stack([generated_face(body, 65536 * SEED + tile, SURFACE, POINTS) for tile in range(count)])  # type: ignore[arg-type]
        for body, count in zip(("axle", "wheel"), COUNTS, strict=True)
    )
    return asked(wheels, axles, BORE, SEAT, micro)


def same(whole: Prediction, rows: IntArray, part: Prediction) -> bool:
    return all(
        np.array_equal(getattr(whole, name)[rows], getattr(part, name)) for name in ("mean", "spread", "in_contact")
    )


def diagonal(place: int) -> IntArray:
    """The pairs that touch when the wheel is on so many tiles of the seat."""
    return np.flatnonzero(place == SEAT + BORE)


ROWS = np.arange(len(SEAT))
MIXED = np.random.default_rng(1).permutation(ROWS)
BATCHES: dict[str, list[IntArray]] = {
    "pressed": [diagonal(place) for place in range(sum(COUNTS) - 1)],
    "in large steps": [diagonal(place) for place in range(0, sum(COUNTS) - 1, 5)],
    "drawn off": [diagonal(place) for place in reversed(range(sum(COUNTS) - 1))],
    "first of two ranks": [np.array_split(diagonal(place), 2)[0] for place in range(sum(COUNTS) - 1)],
    "second of two ranks": [np.array_split(diagonal(place), 2)[1] for place in range(sum(COUNTS) - 1)],
    "one by one": list(MIXED[:, None]),
    "all": [ROWS],
    "with pairs twice": [np.tile(MIXED[:40], 3), MIXED],
    "at random": np.array_split(MIXED, 7),
}


@pytest.mark.parametrize("batches", BATCHES.values(), ids=BATCHES.keys())
def test_the_networks_own_bits_in_any_batches(energy: Predictor, batches: list[IntArray]) -> None:
    """For two micro coefficients in turn, which change places from batch to batch."""
    whole = {micro: directly(energy, micro) for micro in (0.03, 0.08)}
    assert len(np.unique(whole[0.03].mean)) == len(ROWS)
    assert 0 < whole[0.03].in_contact.sum() < len(ROWS) or energy.provenance.plates.control == "force"
    asked = tiles(energy)
    for number, rows in enumerate(batches):
        for micro in (0.03, 0.08)[:: 1 - 2 * (number % 2)]:
            assert same(whole[micro], rows, asked.predict(SEAT[rows], BORE[rows], micro))


def test_the_papers_network_is_asked_itself(paper: Predictor) -> None:
    whole, asked = directly(paper, 0.05), tiles(paper)
    for rows in (MIXED[:20], MIXED[10:30]):
        asked.expect(SEAT[rows], BORE[rows], np.zeros_like(SEAT[rows]))
        assert same(whole, rows, asked.predict(SEAT[rows], BORE[rows], 0.05))
    assert asked.prepared == 0
    assert not asked._expected


def test_the_papers_network_looks_at_each_face_once(paper: Predictor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its convolutions cost a hundred times what joining two faces does."""
    looked: list[str] = []
    face_part = Predictor.face_part

    def counted(self: Predictor, body: Any, face: Any) -> Any:
        looked.append(body)
        return face_part(self, body, face)

    monkeypatch.setattr(Predictor, "face_part", counted)
    asked = tiles(paper)
    for micro in (0.03, 0.09):
        asked.predict(SEAT, BORE, micro)
    assert (looked.count("axle"), looked.count("wheel")) == COUNTS


def test_each_pair_and_each_face_once(energy: Predictor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is asked again, and for another micro coefficient; no pair that is not asked for."""
    drawn: list[tuple[str, int]] = []
    slid: list[int] = []
    name = "slide_by_ends" if energy.provenance.plates.control == "force" else "slide_foundations"
    slide = getattr(inference, name)

    def counted(body: Any, seed: int, count: int, *keys: Any) -> Any:
        drawn.extend((body, seed + k) for k in range(count))
        return generated_faces(body, seed, count, *keys)

    def sliding(options: Any, pairs: Any, *given: Any) -> Any:
        slid.append(len(pairs.wheel))
        return slide(options, pairs, *given)

    monkeypatch.setattr("surrogate.tiles.generated_faces", counted)
    monkeypatch.setattr(inference, name, sliding)
    asked, pairs = tiles(energy), 0
    for rows in BATCHES["pressed"]:
        pairs += len(rows)
        for micro in (0.03, 0.08):
            asked.predict(SEAT[rows], BORE[rows], micro)
            assert asked.prepared == sum(slid) == pairs
    assert asked.faces == len(drawn) == len(set(drawn)) == sum(COUNTS)
    if name == "slide_by_ends":  # each wheel's tile on each tile of the seat and on what follows the last, once
        assert asked._ends is not None
        assert asked._ends.count == (COUNTS[0] + 1) * COUNTS[1]


@pytest.mark.parametrize("block", [1, 3])
def test_ends_are_shared_where_faces_go_on(energy: Predictor, monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    """A strip whose pieces differ in one bit of one height shares nothing, and tiles of their own never do."""
    monkeypatch.setattr(surrogate.tiles, "FACES_TOGETHER", block)
    asked = tiles(energy)
    asked.predict(SEAT, BORE, 0.03)
    assert asked._ends is not None

    def off(body: Any, seed: int, count: int, *keys: Any) -> Any:
        faces = generated_faces(body, seed, count, *keys)
        if body == "axle" and seed <= 65536 * SEED + 5 < seed + count:
            faces[65536 * SEED + 5 - seed, 3, 4] += 1e-7
        return faces

    monkeypatch.setattr("surrogate.tiles.generated_faces", off)
    rough = tiles(energy)
    rough.predict(SEAT, BORE, 0.03)
    assert rough._ends is None
    assert Tiles(energy, SEED, FaceKeys(**KEYS, form="tiles"), COUNTS)._ends is None


def test_expected_pairs_come_with_the_next_ones(energy: Predictor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each once, in one call, with the bits they have by themselves; what is expected again costs nothing."""
    calls: list[int] = []
    prepare = inference.TrainedEnsemble.prepare

    def counted(model: Any, wheels: Any, axles: Any, wheel: IntArray, *given: Any, **named: Any) -> Any:
        calls.append(len(wheel))
        return prepare(model, wheels, axles, wheel, *given, **named)

    monkeypatch.setattr(inference.TrainedEnsemble, "prepare", counted)
    asked, rows, more = tiles(energy), diagonal(5), np.concatenate([diagonal(5), diagonal(6)])
    level = np.zeros_like(SEAT)
    for _ in range(3):
        asked.expect(SEAT[more], BORE[more], level[more])
    asked.expect(np.array([-1, 0, COUNTS[0]]), np.array([0, COUNTS[1], 0]), np.zeros(3, dtype=np.int64))
    assert not calls
    found = asked.predict(SEAT[rows], BORE[rows], 0.03)
    assert calls == [len(more)]
    later = asked.predict(SEAT[diagonal(6)], BORE[diagonal(6)], 0.08)
    asked.expect(SEAT[more], BORE[more], level[more])
    asked.predict(SEAT[more], BORE[more], 0.05)
    assert calls == [len(more)]
    assert not asked._expected  # nothing is kept of what is done
    assert same(directly(energy, 0.03), rows, found)
    assert same(directly(energy, 0.08), diagonal(6), later)


def test_faces_are_made_in_blocks(energy: Predictor, paper: Predictor) -> None:
    """Of a strip, where they share most of their work; others, and for convolutions, are made one by one."""
    counts = 3 * FACES_TOGETHER, FACES_TOGETHER + 5
    asked = Tiles(energy, SEED, SURFACE, counts)
    asked.predict(np.array([FACES_TOGETHER + 3]), np.array([FACES_TOGETHER + 2]), 0.05)
    assert asked.faces == FACES_TOGETHER + 5
    alone = Tiles(energy, SEED, FaceKeys(**KEYS, form="tiles"), counts)
    alone.predict(np.array([FACES_TOGETHER + 3]), np.array([FACES_TOGETHER + 2]), 0.05)
    assert alone.faces == 2
    convolved = Tiles(paper, SEED, SURFACE, counts)
    convolved.predict(np.array([FACES_TOGETHER + 3]), np.array([FACES_TOGETHER + 2]), 0.05)
    assert convolved.faces == 2


@pytest.mark.parametrize("use", ["face", "strip"])
def test_measured_faces_made_together(use: Any, tmp_path: Path) -> None:
    """A face is the middle of its file for each tile, which pieces of a longer one are not."""
    np.save(tmp_path / "a.npy", np.random.default_rng(4).standard_normal((1001, 121)))
    scan = ScanKeys(files=(str(tmp_path / "a.npy"),), unit="um", spacing=0.01, use=use).found()
    faces = generated_faces("axle", 65536 * SEED + 3, 3, FaceKeys(axle=scan), POINTS)
    for k, face in enumerate(faces):
        assert np.array_equal(face, generated_face("axle", 65536 * SEED + 3 + k, FaceKeys(axle=scan), POINTS))


@pytest.mark.parametrize("points", [9, 17, 26])
@pytest.mark.parametrize(
    "kind",
    [{}, {"levels": 5, "lay": "turned"}, {"levels": 4, "lay": "ground"}, {"generator": "self_affine"},
     {"form": "tiles"}, {"form": "levelled"}],
)  # fmt: skip
def test_faces_made_together_have_the_bits_of_those_made_alone(kind: dict[str, Any], points: int) -> None:
    keys = FaceKeys(**kind)
    for body, size in (("wheel", (1.0, 1.0)), ("axle", (2.0, 1.0))):
        faces = generated_faces(body, 65536 * SEED + 7, 6, keys, points)  # type: ignore[arg-type]
        for k, face in enumerate(faces):
            alone = rough_face(keys, body, 65536 * SEED + 7 + k, size)  # type: ignore[arg-type]
            assert np.array_equal(face, sampled_heights(alone, points))
            assert np.array_equal(inference.upper_roughness(faces)[k], inference.upper_roughness(face[None])[0])


@pytest.mark.parametrize(
    ("seat", "bore", "told"),
    [
        (14, 0, r"there is no tile 14 of the axle; they are numbered 0 \.\.\. 13"),
        (65536, 0, "there is no tile 65536 of the axle"),
        (-1, 3, "there is no tile -1 of the axle"),
        (0, 11, r"there is no tile 11 of the wheel; they are numbered 0 \.\.\. 10"),
        (0, -1, "there is no tile -1 of the wheel"),
    ],
)
def test_a_tile_that_is_none(energy: Predictor, paper: Predictor, seat: int, bore: int, told: str) -> None:
    """Neither is it another one, counted from the end, nor does it leave traces."""
    for asked in (tiles(energy), tiles(paper)):
        with pytest.raises(PredictionError, match=told):
            asked.predict(np.array([1, seat, 2]), np.array([1, bore, 2]), 0.05)
        with pytest.raises(PredictionError, match=told):
            asked.heights("axle", seat) if "axle" in told else asked.heights("wheel", bore)
        assert (asked.prepared, asked.faces) == (0, 0)


def test_tiles_have_no_numbers_beyond_those_of_surfaces(energy: Predictor) -> None:
    with pytest.raises(PredictionError, match=r"no tile 65536 of the wheel; they are numbered 0 \.\.\. 65535"):
        Tiles(energy, SEED, SURFACE, (2, 70000)).heights("wheel", 65536)


def test_a_surface_that_cannot_be_made(energy: Predictor) -> None:
    asked = Tiles(energy, SEED, FaceKeys(**KEYS | {"hurst_exponent": 1.5}), COUNTS)
    with pytest.raises(PredictionError, match="surface of the wheel: hurst_exponent"):
        asked.predict(SEAT[:1], BORE[:1], 0.05)


def test_a_micro_coefficient_that_is_none(energy: Predictor, paper: Predictor) -> None:
    for asked in (tiles(energy), tiles(paper)):
        with pytest.raises(PredictionError, match="micro coefficient is not finite"):
            asked.predict(SEAT[:1], BORE[:1], float("nan"))


def test_faces_are_those_of_the_seeds_and_read_only(energy: Predictor) -> None:
    asked = tiles(energy)
    for body, tile in (("axle", 13), ("wheel", 10)):
        face = asked.heights(body, tile)  # type: ignore[arg-type]
        assert np.array_equal(face, generated_face(body, 65536 * SEED + tile, SURFACE, POINTS))  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="read-only"):
            face[0, 0] = 1.0


def test_a_network_is_read_again_if_its_file_changed(tmp_path: Path) -> None:
    path = Path(untrained(tmp_path / "m.safetensors"))
    first = load_predictor(path)
    assert load_predictor(path) is first
    untrained(path, stiffness=1e4)
    os.utime(path, ns=(0, 0))  # whatever the clock says
    second = load_predictor(path)
    assert second.provenance != first.provenance
    path.unlink()
    with pytest.raises(CheckpointError, match="there is no such file"):
        load_predictor(path)
    assert load_predictor(None).provenance == Predictor().provenance


def test_the_last_tiles_are_kept_and_no_others(energy: Predictor, paper: Predictor) -> None:
    first = shared_tiles(energy, SEED, SURFACE, COUNTS)
    assert shared_tiles(energy, SEED, SURFACE, COUNTS) is first
    others = [
        (paper, SEED, SURFACE, COUNTS),
        (energy, SEED + 1, SURFACE, COUNTS),
        (energy, SEED, FaceKeys(**KEYS | {"levels": 2}), COUNTS),
        (energy, SEED, SURFACE, (14, 12)),
    ]
    for other in others:
        assert shared_tiles(*other) is not first
    assert shared_tiles(energy, SEED, SURFACE, COUNTS) is first
    for seed in range(KEPT):
        shared_tiles(energy, SEED + 2 + seed, SURFACE, COUNTS)
    assert surrogate.tiles.shared_tiles.cache_info().currsize == KEPT
    assert shared_tiles(energy, SEED, SURFACE, COUNTS) is not first
