"""Evaluation, tables of samples, and single predictions: on samples whose errors are known beforehand."""

from __future__ import annotations

import json
import os
import re
from dataclasses import fields, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from meso.settings import FaceKeys, Settings, SurfaceKeys, dump, load
from meso.surfaces.face import rough_face
from surrogate.cli import LOADING, LOADING_NETWORK, main
from surrogate.data.database import Database, Header, Samples
from surrogate.data.faces import generated_face, read_face
from surrogate.data.table import open_samples, read_table, write_table
from surrogate.errors import DatabaseError, EvaluationError, PredictionError
from surrogate.evaluation.errors import coverage, coverage_interval, relative_errors, slope_r2
from surrogate.evaluation.measured import arrange_tests, require_unseen
from surrogate.evaluation.parts import parts_lines, parts_report
from surrogate.evaluation.predicted import PredictedPairs, constant_ratio, foundation_alone, predict_tests
from surrogate.evaluation.report import evaluation_lines
from surrogate.evaluation.run import evaluate_network, evaluation_report
from surrogate.network.checkpoint import load_checkpoint, save_checkpoint
from surrogate.network.dataset import pair_tensors
from surrogate.network.score import predict_pairs
from surrogate.network.train import train_network

MICRO = (0.03, 0.05, 0.07, 0.09)
SETTINGS = dump(Settings(surface=SurfaceKeys(form="tiles")))
HEADER = Header(design="{}", settings=SETTINGS, code="abc", version="0", micro_frictions=4, squares=2)
PAIRS, PACKINGS, SCATTER = 60, 3, 0.02


def made(pairs: int = PAIRS, packings: int = PACKINGS, seed: int = 0, first: int = 50_000) -> Samples:
    """a = 1.03, b of each pair normal, each packing with its own relative error of SCATTER; real generated faces."""
    rng = np.random.default_rng(seed)
    count = pairs * packings
    rows = np.zeros(count, HEADER.row())
    pair = np.arange(count) // packings
    rows["id"] = np.arange(count)
    rows["packing_seed"] = np.arange(count)
    rows["wheel_seed"] = rows["axle_seed"] = first + pair
    rows["pressure"], rows["form"], rows["lay"] = 170.0, b"tiles", b"isotropic"
    rows["levels"], rows["max_height"], rows["hurst_exponent"] = 3, (0.01 + 1e-4 * pair), 0.8
    for i in range(count):
        keys = FaceKeys(form="tiles", levels=3, max_height=float(rows["max_height"][i]), hurst_exponent=0.8)
        for body in ("wheel", "axle"):
            rows[body][i] = generated_face(body, int(rows[f"{body}_seed"][i]), keys)
    rows["micro_friction"] = MICRO
    b = np.repeat(1e-3 * rng.standard_normal(pairs), packings)
    true = 1.03 * rows["micro_friction"] + b[:, None]
    rows["meso_friction"] = true * (1.0 + SCATTER * rng.standard_normal((count, 1)))
    rows["minimum_normal"] = 100.0
    rows["minimum_normal"][7:8, 2] = 0.0
    rows["engine"] = b"quasi-static"
    rows["remark"][packings : 2 * packings] = 'ä, "x"'.encode()
    return Samples(**{field.name: rows[field.name].copy() for field in fields(Samples)})


SAMPLES = made()
DATA = arrange_tests(SAMPLES)
TRUE = PredictedPairs("true", DATA.spread_out(DATA.meso.mean(1)), np.full((PAIRS, PACKINGS, 4), 1.0))


def test_samples_are_dealt_by_pair_and_packing() -> None:
    order = np.random.default_rng(1).permutation(len(SAMPLES))
    shuffled = Samples(**{name: column[order] for name, column in vars(SAMPLES).items()})
    for data in (DATA, arrange_tests(SAMPLES)):
        assert data.meso.shape == (PAIRS, PACKINGS, 4)
        assert np.array_equal(data.meso[2, 1], SAMPLES.meso_friction[7])
        assert np.array_equal(data.samples.wheel_seed, 50_000 + np.repeat(np.arange(PAIRS), PACKINGS))
        assert np.argwhere(~data.in_contact).tolist() == [[2, 1]]
    mixed = arrange_tests(shuffled)
    assert np.array_equal(np.sort(mixed.meso, axis=1), np.sort(DATA.meso, axis=1))
    assert np.array_equal(mixed.samples.wheel, DATA.samples.wheel)


def test_the_noise_floor_is_the_error_of_who_knows_the_mean() -> None:
    # E |x - mean| of a normal distribution: sqrt(2/pi) sigma; 60 pairs tell it to about 8 %
    assert DATA.noise_floor == pytest.approx(np.full(4, np.sqrt(2.0 / np.pi) * SCATTER), rel=0.2)
    many = arrange_tests(made(40, 12, seed=3))
    known = PredictedPairs("mean", many.spread_out(many.meso.mean(1)))
    # the mean of 12 is known to 1/sqrt(12): against one packing sqrt(1 - 1/12) of the floor
    assert relative_errors(many, known)[0].mean() == pytest.approx(many.noise_floor.mean() * np.sqrt(11 / 12), rel=0.03)
    assert np.isnan(arrange_tests(made(5, 1)).noise_floor).all()


def test_errors_are_against_each_packing_and_against_their_mean() -> None:
    off = PredictedPairs("off", 1.1 * TRUE.mean)
    one, all_packings = relative_errors(DATA, off)
    assert all_packings == pytest.approx(np.full((PAIRS, 4), 0.1))
    assert one.shape == (PAIRS, PACKINGS, 4)
    assert one[4, 2, 1] == pytest.approx(abs(off.mean[4, 2, 1] / DATA.meso[4, 2, 1] - 1.0))


def test_a_network_is_asked_on_the_grid_it_was_trained_on() -> None:
    trained = train_network(SAMPLES, points=17, members=2, epochs=2)
    told = pair_tensors(SAMPLES, points=17)
    mean, spread = (values.double().numpy() for values in predict_pairs(trained.model, told))
    said = predict_tests(trained.model, trained.provenance, DATA)
    assert said.mean == pytest.approx(DATA.spread_out(mean), abs=1e-7)  # of other batches
    assert said.spread == pytest.approx(DATA.spread_out(spread), abs=1e-7)


def test_no_other_constant_ratio_does_better() -> None:
    best = relative_errors(DATA, constant_ratio(DATA))[0].mean()
    ratio = constant_ratio(DATA).mean[0, 0, 0] / MICRO[0]
    for c in np.linspace(0.98, 1.08, 41):
        other = PredictedPairs("", np.broadcast_to(c * DATA.micro, DATA.meso.shape))
        assert relative_errors(DATA, other)[0].mean() >= best - 1e-15
    assert ratio == pytest.approx(1.03, abs=0.01)


def test_the_bend_is_the_distance_from_a_straight_line() -> None:
    assert DATA.bend.max() < 1e-15  # made as lines
    bent = DATA.meso.copy()
    bent[3, 1] += np.array([1.0, -1.0, -1.0, 1.0]) * 1e-4  # at equal steps no line is nearer to this than zero
    found = replace(DATA, meso=bent).bend
    assert found[3, 1] == pytest.approx(1e-4)
    assert np.delete(found.ravel(), 3 * PACKINGS + 1).max() < 1e-15


def test_r2_is_of_the_intercept() -> None:
    first = PredictedPairs("", DATA.meso)
    assert slope_r2(DATA, first) == pytest.approx(1.0)
    assert slope_r2(DATA, PredictedPairs("", 2.0 * DATA.micro + DATA.meso)) == pytest.approx(1.0)  # a is free
    assert slope_r2(DATA, PredictedPairs("", DATA.meso + 1e-3)) < 0.5
    assert slope_r2(DATA, constant_ratio(DATA)) < 0.1


def test_coverage_counts_all_packings() -> None:
    spread = DATA.spread_out(np.abs(DATA.meso - TRUE.mean).max(1) / 1.645)
    assert coverage(DATA, replace(TRUE, spread=1.001 * spread)) == pytest.approx(np.ones(4))
    assert coverage(DATA, replace(TRUE, spread=0.999 * spread)) == pytest.approx(np.full(4, 2.0 / 3.0))


@pytest.mark.parametrize(("share", "pairs", "expected"), [
    (0.9, 100, (0.826, 0.945)), (1.0, 7, (0.646, 1.0)), (0.0, 10, (0.0, 0.278)), (0.81, 21, (0.600, 0.923)),
])  # fmt: skip
def test_of_few_pairs_coverage_is_known_within_bounds(share: float, pairs: int, expected: tuple[float, float]) -> None:
    """Bounds of the tables of Wilson's interval."""
    assert coverage_interval(share, pairs) == pytest.approx(expected, abs=1e-3)


def test_the_foundation_alone_knows_no_answer() -> None:
    other = replace(DATA, meso=np.zeros_like(DATA.meso))
    said = foundation_alone(DATA, "generated", 170.0).mean
    assert np.array_equal(said, foundation_alone(other, "generated", 170.0).mean)
    slope = foundation_alone(DATA, "generated", 170.0).mean - DATA.micro
    assert np.ptp(slope, axis=(1, 2)).max() < 1e-8
    assert slope.std() > 1e-4


def test_the_report_has_what_was_promised() -> None:
    said = replace(TRUE, spread=0.02 * TRUE.mean)
    result = evaluation_report(DATA, said, [constant_ratio(DATA)], {"network": "x"})
    assert result["samples"] == PAIRS * PACKINGS * 4
    assert (result["pairs"], result["packings"], result["lost_contact"]) == (PAIRS, PACKINGS, 1)
    one = relative_errors(DATA, said)[0]
    assert result["mean_relative_error"] == pytest.approx(one.mean())
    assert result["median_relative_error"] == pytest.approx(np.median(one))
    assert result["baseline_mean_relative_error"] == pytest.approx(
        relative_errors(DATA, constant_ratio(DATA))[0].mean()
    )
    assert result["mean_relative_error_all_packings"] == pytest.approx(0.0)
    assert 0.8 < result["coverage_90"] < 1.0
    assert result["noise_floor"] == pytest.approx(DATA.noise_floor.mean())
    row = result["by_micro_friction"]["0.07"]
    assert row["mean_relative_error"] == pytest.approx(one[..., 2].mean())
    assert {"median_relative_error", "baseline_mean_relative_error", "constant ratio"} <= set(row)
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize(
    ("spoiled", "message"),
    [
        (made(1), "one pair"),
        (Samples(**{name: column[:-1] for name, column in vars(SAMPLES).items()}), "2 to 3 packings"),
        (
            replace(SAMPLES, micro_friction=SAMPLES.micro_friction + np.arange(len(SAMPLES))[:, None]),
            "--micro-friction",
        ),
    ],
)
def test_samples_that_judge_nothing(spoiled: Samples, message: str) -> None:
    with pytest.raises(EvaluationError, match=message):
        arrange_tests(spoiled)


@pytest.fixture(scope="module")
def networks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Networks of both kinds and a table, trained on nothing worth mentioning."""
    folder = tmp_path_factory.mktemp("networks")
    training = made(40, 1, first=0)
    paths = {"table": folder / "table.csv"}
    for name in ("energy", "paper"):
        paths[name] = folder / f"{name}.safetensors"
        trained = train_network(training, name, epochs=1)
        save_checkpoint(paths[name], trained.model, trained.provenance)
    write_table(Database(HEADER, made(6), {}, "hash"), paths["table"])
    return paths


def test_an_evaluation_leaves_its_report_and_figures(networks: dict[str, Path], tmp_path: Path) -> None:
    result, written = evaluate_network(
        networks["table"], networks["energy"], [networks["paper"]] * 2, tmp_path / "a" / "b"
    )
    assert [path.name for path in written] == ["evaluation.json", "configurations.png", "scatter.png", "errors.png"]
    assert json.loads(written[0].read_text()) == result
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written[1:])
    assert list(result["beside"]) == ["foundation alone", "paper", "paper 2"]
    assert result["beside"]["paper"] == result["beside"]["paper 2"] != result["beside"]["foundation alone"]


def test_surfaces_that_were_learned_judge_nothing(networks: dict[str, Path], tmp_path: Path) -> None:
    write_table(Database(HEADER, made(4, first=37), {}, "hash"), tmp_path / "t.csv")
    with pytest.raises(EvaluationError, match=r"seed 37 .* learned"):
        evaluate_network(tmp_path / "t.csv", networks["energy"], [], tmp_path)


def test_packings_that_were_learned_do_not_judge_a_network_of_envelopes(networks: dict[str, Path]) -> None:
    _, about = load_checkpoint(networks["energy"])
    seen = replace(SAMPLES, packing_seed=np.full(len(SAMPLES), about.packing_seeds[1]))
    require_unseen(seen, about)
    with pytest.raises(EvaluationError, match=r"packings of seed 39 .* --first-packing beyond 39"):
        require_unseen(seen, msgspec.structs.replace(about, faces="envelope"))


def test_a_strip_that_was_learned_is_known_by_any_place_on_it(networks: dict[str, Path]) -> None:
    """Learned: strips 7 to 9. Tiles by themselves have other streams, whatever their seeds."""
    _, about = load_checkpoint(networks["energy"])
    seeds = (65536 * 7 + 65532, 65536 * 9 + 65532)
    about = msgspec.structs.replace(
        about, surface_seeds=seeds, plates=msgspec.structs.replace(about.plates, form="strip")
    )
    for strip, known in ((6, False), (7, True), (9, True), (10, False)):
        seen = replace(SAMPLES, wheel_seed=np.full(len(SAMPLES), 65536 * strip), axle_seed=SAMPLES.axle_seed * 0)
        require_unseen(seen, about)  # tiles
        seen = replace(seen, form=np.full(len(SAMPLES), b"strip"))
        if known:
            with pytest.raises(EvaluationError, match=f"strips of seed {strip} .* --first-surface beyond 9"):
                require_unseen(seen, about)
        else:
            require_unseen(seen, about)


def test_parts_have_errors_floors_and_coverage_of_their_own() -> None:
    """Half of the pairs at 20 MPa, half at 200; errors of 3 and 1 % from 0.05 on, and of 50 % below."""
    light = np.arange(PAIRS) < PAIRS // 2
    remark = np.zeros_like(SAMPLES.remark)
    remark[1 : 10 * PACKINGS : PACKINGS] = b"x"  # of one packing of ten pairs
    samples = replace(SAMPLES, pressure=np.where(np.repeat(light, PACKINGS), 20.0, 200.0), remark=remark)
    data = arrange_tests(samples)
    share = np.where(light, 0.03, 0.01)[:, None] * np.array([50.0, 1.0, 1.0, 1.0])
    share[:, 0] = 0.5
    mean = data.spread_out(data.meso.mean(1) * (1.0 + share))
    parts = parts_report(data, PredictedPairs("known", mean, np.where(light, 1.0, 0.0)[:, None, None] + 0.0 * mean))
    found = {name: parts[name] for name in ("all", "p 20-30 MPa", "p 100-200 MPa", "tiles", "micro 0.03")}
    assert [row["pairs"] for row in found.values()] == [60, 30, 30, 60, 60]
    assert [row["error"] for row in found.values()] == pytest.approx([0.02, 0.03, 0.01, 0.02, 0.5])
    assert [row["coverage_90"] for row in found.values()] == pytest.approx([0.5, 1.0, 0.0, 0.5, 0.5], abs=0.1)
    assert found["tiles"]["coverage_interval"] == coverage_interval(found["tiles"]["coverage_90"], 60)
    doubtful, settled = parts["doubtful"], parts["settled"]
    assert (doubtful["pairs"], settled["pairs"]) == (10, 50)
    assert (doubtful["error"], settled["error"]) == pytest.approx((0.03, (20 * 0.03 + 30 * 0.01) / 50))
    tests = parts["settled tests"]
    assert (tests["pairs"], tests["floor"]) == (60, pytest.approx(found["all"]["floor"], rel=0.1))
    assert found["all"]["standard_error"] == pytest.approx(0.01 / np.sqrt(59.0))
    assert found["all"]["floor"] == pytest.approx(SCATTER * np.sqrt(2.0 / np.pi) / np.sqrt(PACKINGS), rel=0.15)
    assert found["all"]["error_over_mean"] == pytest.approx(0.02, rel=0.05)
    assert len(parts_lines(parts)) == len(parts) + 3
    about = {"network": "n", "faces": "generated"}
    predicted = PredictedPairs("known", mean, 0.0 * mean + 1.0)
    lines = evaluation_lines(evaluation_report(data, predicted, [], about))
    assert lines[1].startswith(
        "In its range    2.00 ± 0.13 % against the mean over packings, micro from 0.05 on (floor "
    )
    assert lines[2].startswith("Relative error  ")
    assert evaluation_lines(evaluation_report(DATA, TRUE, [], about))[1].startswith("Relative error  ")
    assert parts_report(DATA, TRUE) == {}  # all at one pressure


def test_of_a_pair_the_settled_tests_are_judged_by_themselves() -> None:
    """One packing of every third pair is doubtful and far off: an error of all tests, not of the settled ones."""
    remark, meso = np.zeros_like(SAMPLES.remark), SAMPLES.meso_friction.copy()
    remark[:: 3 * PACKINGS], meso[:: 3 * PACKINGS] = b"x", 1.5 * meso[:: 3 * PACKINGS]
    pressure = np.linspace(20.0, 200.0, len(SAMPLES))
    height = np.where(np.arange(len(SAMPLES)) < 20 * PACKINGS, 0.06, 0.01)
    data = arrange_tests(replace(SAMPLES, remark=remark, meso_friction=meso, pressure=pressure, max_height=height))
    right = arrange_tests(SAMPLES).meso.mean(1)
    parts = parts_report(data, PredictedPairs("right", data.spread_out(right), 0.05 * data.spread_out(right)))
    assert parts["all"]["error"] > 0.03
    assert parts["settled tests"]["error"] < 0.01
    assert (parts["settled tests"]["pairs"], parts["R from 50 µm, settled tests"]["pairs"]) == (PAIRS, 20)
    assert parts["settled tests"]["coverage_90"] > parts["all"]["coverage_90"] + 0.05


def test_what_few_packings_leave_to_chance_is_no_error_of_the_network() -> None:
    """Who knows the mean over all packings errs by the floor, and who is off by 5 % by little more than that."""
    samples = made(200, PACKINGS, seed=6)
    data = arrange_tests(replace(samples, pressure=np.where(np.arange(len(samples)) < 300, 20.0, 200.0)))
    b = 1e-3 * np.random.default_rng(6).standard_normal(200)
    true = data.spread_out(1.03 * data.micro + b[:, None])
    for off in (0.0, 0.05):
        all_pairs = parts_report(data, PredictedPairs("off", (1.0 + off) * true, np.ones(true.shape)))["all"]
        assert all_pairs["error"] ** 2 == pytest.approx(all_pairs["floor"] ** 2 + off**2, rel=0.15)
        assert all_pairs["error_beyond_floor"] == pytest.approx(off, abs=0.004)


def test_a_table_comes_back_to_the_bit(tmp_path: Path) -> None:
    write_table(Database(HEADER, SAMPLES, {}, "hash"), tmp_path / "t.csv")
    found = open_samples(tmp_path / "t.csv")
    assert (found.header, found.content_hash) == (HEADER, "hash")
    for name, column in vars(SAMPLES).items():
        stored = getattr(found.samples, name)
        assert stored.dtype == column.dtype
        if name.endswith("envelope"):
            assert stored.shape == (len(SAMPLES), 0, 0)
        else:
            assert np.array_equal(stored, column), name


def test_a_pair_of_which_a_packing_failed_is_left_out(networks: dict[str, Path], tmp_path: Path) -> None:
    """In a table too, which says nothing of failures."""
    samples = made(6)
    kept = {name: column[np.arange(18) != 7] for name, column in vars(samples).items()}
    header = msgspec.structs.replace(HEADER, design='{"packings": 3}')
    found = Database(header, Samples(**kept), {7: "it does not come to rest"}, "hash")
    assert found.whole_pairs.id.tolist() == [0, 1, 2, 3, 4, 5, *range(9, 18)]
    write_table(found, tmp_path / "t.csv")
    result, _ = evaluate_network(tmp_path / "t.csv", networks["energy"], [], tmp_path / "out")
    assert (result["pairs"], result["packings"]) == (5, 3)


def test_a_compressed_table_is_the_same_table(networks: dict[str, Path], tmp_path: Path) -> None:
    found = Database(HEADER, made(3), {}, "hash")
    plain, packed = tmp_path / "t.csv", tmp_path / "t.csv.gz"
    for path in (plain, packed):
        write_table(found, path)
    assert packed.stat().st_size < 0.5 * plain.stat().st_size
    assert np.array_equal(open_samples(packed).samples.meso_friction, found.samples.meso_friction)
    again = tmp_path / "AGAIN.CSV.GZ"
    write_table(found, again)
    assert np.array_equal(open_samples(again).samples.meso_friction, found.samples.meso_friction)
    assert again.read_bytes() == packed.read_bytes()  # no time in it
    whole = packed.read_bytes()
    for content, told in ((whole[: len(whole) // 2], "cut short"), (b"no gzip", "no compressed table")):
        packed.write_bytes(content)
        with pytest.raises(DatabaseError, match=told):
            open_samples(packed)


def test_friction_tests_of_other_plates_judge_nothing(networks: dict[str, Path], tmp_path: Path) -> None:
    settings = dump(load(None, ["plates.thickness=0.4", "surface.form=tiles"]))
    header = msgspec.structs.replace(HEADER, settings=settings)
    write_table(Database(header, made(4), {}, "hash"), tmp_path / "t.csv")
    told = r"t\.csv: is of other plates than the network has learned from: plates\.thickness = 0\.4 is not 0\.3$"
    with pytest.raises(EvaluationError, match=told):
        evaluate_network(tmp_path / "t.csv", networks["energy"], [], tmp_path)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda text: text.replace(b"quasi-static", b"explicit", 1), "changed or damaged"),
        (lambda text: text[:-40], "changed or damaged"),
        (lambda text: b"\x89HDF\r\n" + text, "is no table"),
        (lambda text: text.replace(b'"header"', b'"head"', 1), "damaged table"),
        (lambda text: text.replace(b'"content_hash":"hash"', b'"content_hash":"bash"', 1), "changed or damaged"),
    ],
)
def test_a_table_that_was_touched_is_refused(spoil, message, tmp_path) -> None:
    path = tmp_path / "t.csv"
    write_table(Database(HEADER, made(2), {}, "hash"), path)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(DatabaseError, match=message):
        read_table(path)


@pytest.mark.parametrize("body", ["wheel", "axle"])
@pytest.mark.parametrize("levels", [2, 3, 5])
def test_faces_are_those_of_the_plates(body, levels, tmp_path) -> None:
    keys = SurfaceKeys(levels=levels, max_height=0.03, hurst_exponent=0.6)
    face = rough_face(keys, body, 9, (1.0, 1.0) if body == "wheel" else (2.0, 1.0))
    found = generated_face(body, 9, keys)
    assert found.shape == ((33, 33) if body == "wheel" else (65, 33))
    finer = 32 // 2**levels
    assert np.array_equal(found[::finer, ::finer], face.heights.astype(np.float32))
    np.save(tmp_path / "face.npy", face.heights)
    np.savetxt(tmp_path / "face.csv", face.heights, delimiter=",", header="heights [mm]", fmt="%.17g")
    for name in ("face.npy", "face.csv"):
        assert np.array_equal(read_face(tmp_path / name, body), found)


def test_files_that_are_no_faces(tmp_path: Path) -> None:
    bad = np.zeros((17, 9))
    bad[3, 4] = np.nan
    cases = {"nan.npy": bad, "square.npy": np.zeros((9, 9)), "object.npy": np.array([{}, 1], dtype=object)}
    cases |= {
        "complex.npy": np.ones((65, 33), complex),
        "text.npy": np.full((65, 33), "1"),
        "far.npy": 1e4 * np.ones((65, 33)),
    }
    cases |= {"truth.npy": np.ones((65, 33), bool)}
    for name, table in cases.items():
        np.save(tmp_path / name, table)
    claims = np.lib.format.header_data_from_array_1_0(np.zeros((10**8, 1))) | {"shape": (10**8, 33)}
    with (tmp_path / "claims.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, claims)
        file.write(bytes(80))
    texts = {
        "text": "a,b\n",
        "ragged": "1,2\n1\n",
        "mixed": "1,2\nx,1\n",
        "bar": "# h [bar]\n1,2\n",
        "late": "1,2\n1,2\nend\n",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.csv").write_text(text)
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.npy").mkdir()
    expected = {
        "nan.npy": "nan.npy: all its heights are the same",
        "square.npy": "2 mm long",
        "object.npy": "it holds objects, which are not loaded",
        "text.csv": "no table of heights",
        "complex.npy": "its numbers are complex128, not real ones",
        "text.npy": "its numbers are <U1, not real ones",
        "truth.npy": "its numbers are bool, not real ones",
        "claims.npy": "its head states 100000000x33 of float64, and 80 bytes follow",
        "far.npy": "all its heights are the same",
        "ragged.csv": "line 2: has 1 heights, others 2",
        "mixed.csv": "line 2: is no row of heights: 'x,1'",
        "bar.csv": "unit 'bar' is not one of length",
        "late.csv": "line 3: is no row of heights: 'end'",
        "pipe.csv": "is a pipe, not a file",
        "folder.npy": "is a folder, not a file",
        "absent.csv": "cannot be read",
    }
    for name, message in expected.items():
        with pytest.raises(PredictionError, match=message):
            read_face(tmp_path / name, "axle")


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("µm", 1e3), ("m", 1e-3), ("um", 1e3), (None, 1.0)])
@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), (" ", "."), ("\t", ",")])
def test_heights_name_their_unit(tmp_path: Path, unit: str | None, factor: float, separator: str, decimal: str) -> None:
    face = generated_face("wheel", 3, FaceKeys(levels=4, hurst_exponent=0.7))
    rows = [separator.join(f"{factor * value:.9g}".replace(".", decimal) for value in row) for row in face.tolist()]
    head = [] if unit is None else ["# measured on 3 May", f"# heights [{unit}]"]
    (tmp_path / "w.csv").write_text("\n".join([*head, *rows]), encoding="utf-8-sig")
    assert np.allclose(read_face(tmp_path / "w.csv", "wheel"), face, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1e-3, r"a\.npy: its Sq is 0\.00\d+ µm, machined faces have .*; are the heights in a larger unit"),
        (0.0, "all its heights are the same, or lie in one plane"),
        (1e3, "are the heights in a smaller unit"),
        (0.05, "warning: the axle's face is smoother than any learned from"),
    ],
)
def test_heights_in_another_unit_are_noticed(
    networks: dict[str, Path], tmp_path: Path, factor: float, told: str
) -> None:
    """Smoother by far than anything learned from: 0.0715 +- 0.0002 without a word is no answer."""
    face = generated_face("axle", 3, FaceKeys(levels=4, hurst_exponent=0.7)).astype(float)
    np.save(tmp_path / "a.npy", face * factor + 1e-7 * np.arange(65)[:, None])
    code, said = run("predict", "-n", networks["energy"], "--axle", tmp_path / "a.npy")
    assert re.search(told, said), said
    assert code == (0 if "warning" in told else 2)


def run(*arguments: object) -> tuple[int, str]:
    answer = CliRunner().invoke(main, [str(argument) for argument in arguments], catch_exceptions=False)
    return answer.exit_code, answer.output


def test_the_command_predicts_from_seeds_and_from_files(networks: dict[str, Path], tmp_path: Path) -> None:
    seeds = ("predict", "-n", networks["energy"], "--wheel-seed", 3, "--axle-seed", 4, "--max-height", 0.012)
    code, said = run(*seeds, "-o", tmp_path / "p.csv")
    assert code == 0
    rows = np.loadtxt(tmp_path / "p.csv", delimiter=",", skiprows=1)
    assert rows.shape == (4, 5)
    assert rows[:, 0].tolist() == list(MICRO)
    assert np.all(rows[:, 3] < rows[:, 1])
    assert f"{rows[2, 1]:.4f}" in said
    assert run(*seeds, "--micro-friction", "2.5")[0] == 2
    keys = {"levels": 3, "max_height": 0.012, "hurst_exponent": 0.8}
    np.save(tmp_path / "w.npy", generated_face("wheel", 3, FaceKeys(**keys)))
    np.save(tmp_path / "a.npy", generated_face("axle", 4, FaceKeys(**keys)))
    files = ("--wheel", tmp_path / "w.npy", "--axle", tmp_path / "a.npy", "-o", tmp_path / "q.csv")
    files += ("--remove", "none", "--grid", 5)  # as the network takes them
    assert run("predict", "-n", networks["energy"], *files)[0] == 0
    assert np.array_equal(np.loadtxt(tmp_path / "q.csv", delimiter=",", skiprows=1), rows)
    assert run(*seeds, "-o", tmp_path / "p.png")[0] == 0
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


def test_what_was_never_seen_is_said(networks: dict[str, Path]) -> None:
    code, said = run("predict", "-n", networks["energy"], "--max-height", 0.5, "--micro-friction", "0.07,0.9")
    assert code == 0
    assert "warning: max_height = 0.5 is outside 0.01 ... 0.0139" in said
    assert "warning: micro_friction = 0.9" in said


def test_a_mistake_is_one_line_and_exit_code_2(networks: dict[str, Path], tmp_path: Path) -> None:
    (tmp_path / "weights.safetensors").write_bytes(b"\x80\x04K\x01.")
    for arguments, message in (
        (("predict", "-n", tmp_path / "weights.safetensors"), "nothing else is ever loaded"),
        (("predict", "--levels", 40), "levels"),
        (("evaluate", tmp_path / "none.csv", "-n", networks["energy"]), "cannot be read"),
        (("evaluate", networks["table"], "-n", networks["energy"], "-o", networks["table"]), "cannot be written"),
        (("table", tmp_path / "none.h5", "-o", tmp_path / "t.csv"), "no such database"),
    ):
        code, said = run(*arguments)
        assert (code, message in said) == (2, True), said
        assert len([line for line in said.strip().splitlines() if line not in (LOADING, LOADING_NETWORK)]) == 1
