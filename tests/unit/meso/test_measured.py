"""Measured surfaces: every format alike, what is wrong mended or refused by name, tiles cut from strips and patches."""

from __future__ import annotations

import io
import re
import sys
import tomllib
import zipfile
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from types import ModuleType

import msgspec
import numpy as np
import pytest
import scans
from click.testing import CliRunner

from macrofit.friction import BuildContext, ProviderError, TilePairs, build, load
from macrofit.friction.conformance import check
from macrofit.results.journal import file_digests
from macrofit.scene.load import build_scene
from meso.cli import main
from meso.errors import SettingsError, SurfaceError
from meso.measured.clean import lay
from meso.measured.keys import ScanKeys
from meso.measured.raw import length_unit
from meso.measured.read import read_scan
from meso.settings import FaceKeys, Settings, SurfaceKeys, decode, dump
from meso.settings import load as load_settings
from meso.surfaces import measured as laying
from meso.surfaces.face import rough_face
from meso.surfaces.measured import area_means, as_surface, covering, doubts_of, measured_face, pieces_of, scan_of
from meso.surfaces.roughness import measure
from meso.surfaces.surface import tile_seed
from surrogate.network.predict import Predictor
from surrogate.pair import predict_pair

STEP = (0.01, 0.0125)
SHAPE = (210, 90)  # 2.1 x 1.125 mm
SIZES = {"axle": (2.0, 1.0), "wheel": (1.0, 1.0)}


@pytest.fixture(scope="module")
def heights() -> np.ndarray:
    return scans.textured(np.random.default_rng(3), SHAPE, STEP)


@pytest.fixture(scope="module")
def network() -> Predictor:
    return Predictor()


def keys(path: Path, **more: object) -> ScanKeys:
    given = {"spacing": STEP} if path.suffix == ".npy" else {}
    return ScanKeys(**{"files": (str(path),), "use": "face"} | given | more)


def written(folder: Path, name: str, table: np.ndarray, step: tuple[float, float] = STEP) -> Path:
    path = folder / name
    path.write_bytes(scans.WRITERS[name](table, step))
    return path


def predicted(predictor: Predictor, scan: ScanKeys) -> float:
    """Coefficient of the face as the axle's, on a generated wheel."""
    return float(predict_pair(predictor, (0.07,), SurfaceKeys(axle=scan)).mean[0])


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("name", scans.WRITERS)
def test_one_surface_is_the_same_in_every_format(
    heights: np.ndarray, network: Predictor, tmp_path: Path, name: str, missing: bool
) -> None:
    """Coarsest steps of a height: 1e-10 m in the files of whole numbers, single precision in others."""
    table = heights.copy()
    if missing:
        table[40:43, 10:14] = table[199, 3] = np.nan
    path, first = written(tmp_path, name, table), written(tmp_path, "a.npy", table)
    scan, true = scan_of(keys(path), 0), scan_of(keys(first, unit="mm"), 0)
    assert scan.heights.shape == SHAPE
    assert scan.spacing == pytest.approx(STEP, rel=1e-6)
    assert np.abs(scan.heights - true.heights).max() < 2e-7
    assert measure(as_surface(scan)).Sq == pytest.approx(measure(as_surface(true)).Sq, rel=1e-6)
    assert predicted(network, keys(path)) == pytest.approx(predicted(network, keys(first)), abs=1e-6)
    assert any("missing: 13 points" in line for line in scan.done) is missing


def test_the_surface_is_turned_where_its_y_runs_along_the_slide(heights: np.ndarray, tmp_path: Path) -> None:
    path = written(tmp_path, "a.sur", heights.T, STEP[::-1])
    with pytest.raises(SurfaceError, match=r"1.125 mm along the slide and 2.1 mm across, .* is along = 'y' right"):
        measured_face(keys(path), "axle", 0, SIZES["axle"])
    found = measured_face(keys(path, along="y"), "axle", 0, SIZES["axle"])
    straight = measured_face(keys(written(tmp_path, "a.npy", heights)), "axle", 0, SIZES["axle"])
    assert np.allclose(found.heights, straight.heights, atol=2e-7)


def test_tilt_offset_and_curvature_do_not_count(heights: np.ndarray, network: Predictor, tmp_path: Path) -> None:
    """A tilt of 10 um/mm that is left in moves the coefficient by 0.01."""
    x, y = (STEP[k] * np.arange(SHAPE[k]) for k in (0, 1))
    odd = heights + 0.3 + 0.01 * x[:, None] + 0.007 * y - (y - 0.5) ** 2 / (2 * 90.0)
    flat, bent = written(tmp_path, "a.npy", heights), written(tmp_path, "a.x3p", odd)
    assert predicted(network, keys(bent)) == pytest.approx(predicted(network, keys(flat)), abs=1e-6)
    left = predicted(network, keys(bent, remove="none"))
    assert abs(left - predicted(network, keys(flat))) > 3e-3
    bow = written(tmp_path, "b.sdf", odd + 0.02 * (x[:, None] - 1.0) ** 3)
    assert predicted(network, keys(bow, remove="polynomial", degree=3)) == pytest.approx(
        predicted(network, keys(flat, remove="polynomial", degree=3)), abs=1e-4
    )


def test_spikes_are_mended_and_grooves_are_not(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    smooth = scans.turned(rng, (400, 200), (0.005, 0.005))
    whole = scan_of(keys(written(tmp_path, "a.sur", smooth, (0.005, 0.005))), 0)
    assert whole.done == ("form removed: cylinder",)
    assert lay(whole)[0] > 85.0
    assert lay(whole)[1] > 0.5
    places = rng.integers(2, 190, (60, 2)).T
    spiky = smooth.copy()
    spiky[places[0], places[1]] += rng.choice([-1.0, 1.0], 60) * 0.3
    scan = scan_of(keys(written(tmp_path, "a.x3p", spiky, (0.005, 0.005))), 0)
    assert any(line.startswith("spikes: ") for line in scan.done)
    assert measure(as_surface(scan)).Sq == pytest.approx(measure(as_surface(whole)).Sq, rel=0.01)


@pytest.mark.parametrize("inverted", [1, 2, 3])
def test_an_inverted_surface_of_digital_surf_is_turned_back(heights: np.ndarray, tmp_path: Path, inverted: int) -> None:
    """Upside down, and then along x or y as well."""
    data = bytearray(scans.sur(heights, STEP))
    data[290] = inverted
    (tmp_path / "a.sur").write_bytes(data)
    turned = {1: heights, 2: heights[::-1], 3: heights[:, ::-1]}[inverted]
    raw = read_scan(tmp_path / "a.sur")
    assert np.allclose(raw.heights * raw.unit, -turned, atol=2e-7)


def test_rows_of_alicona_are_padded(heights: np.ndarray, tmp_path: Path) -> None:
    raw = read_scan(written(tmp_path, "a.al3d", heights[:209]))
    assert np.allclose(raw.heights * raw.unit, heights[:209], atol=1e-7)


def rewritten(data: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """An X3P archive with another index."""
    target = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            new.writestr(name, change(old.read(name)) if name == "main.xml" else old.read(name))
    return target.getvalue()


def test_the_index_of_an_archive_has_an_offset_and_no_declarations(heights: np.ndarray, tmp_path: Path) -> None:
    """Declarations can name other files, and make a small index fill the memory."""
    data, path = scans.x3p(heights, STEP), tmp_path / "a.x3p"
    path.write_bytes(rewritten(data, lambda text: text.replace(b"<Offset>0<", b"<Offset>1e-6<")))
    assert np.allclose(read_scan(path).heights, 1e-3 * heights + 1e-6, atol=1e-12)
    path.write_bytes(rewritten(data, lambda text: text.replace(b"?>", b'?><!DOCTYPE p [<!ENTITY a "b">]>', 1)))
    with pytest.raises(SurfaceError, match="its index has declarations of its own"):
        read_scan(path)


def test_a_head_says_how_far_a_table_reaches_and_few_points_are_no_grid(tmp_path: Path) -> None:
    head = "rows along x = 0 ... 2 mm, 5 columns along y = 0 ... 1 mm"
    np.savetxt(tmp_path / "a.csv", np.arange(45.0).reshape(9, 5), delimiter=",", header=head)
    assert read_scan(tmp_path / "a.csv").spacing == (0.25, 0.25)
    np.savetxt(tmp_path / "a.xyz", np.arange(10.0)[:, None] * [1.0, 1.0, 1e-3])
    with pytest.raises(SurfaceError, match="its 10 points fill a grid of 10 x 10 to less than a quarter"):
        read_scan(tmp_path / "a.xyz")


def test_small_spikes_are_found_beside_large_ones_and_on_a_tilted_face(tmp_path: Path) -> None:
    """Sixty spikes of 4 mm in a corner bend the form, and hide one of 30 um in the first round."""
    step = (0.005, 0.005)
    table = scans.textured(np.random.default_rng(5), (300, 300), step)
    table += 0.3 * step[0] * np.arange(300)[:, None]
    whole = scan_of(keys(written(tmp_path, "a.sur", table, step)), 0)
    table[2:42:5, 2:42:5] += 4.0
    table[150, 150] += 0.03
    found = scan_of(keys(written(tmp_path, "a.x3p", table, step)), 0)
    assert "spikes: 65 points" in " ".join(found.done)
    assert np.abs(found.heights - whole.heights).max() < 0.01


def test_a_border_that_was_not_measured_is_cut_off(heights: np.ndarray, tmp_path: Path) -> None:
    table = np.pad(heights, ((4, 2), (0, 3)), constant_values=np.nan)
    scan = scan_of(keys(written(tmp_path, "a.x3p", table)), 0)
    assert scan.done[0] == "6 rows and 3 columns cut off at the border, mostly missing"
    assert np.allclose(scan.heights, scan_of(keys(written(tmp_path, "a.npy", heights)), 0).heights, atol=1e-6)


REFUSED = {
    "all missing": (lambda h: h * np.nan, {}, "none of its heights is a finite number"),
    "many missing": (lambda h: np.where(np.arange(h.size).reshape(h.shape) % 3, h, np.nan), {}, "33% of its points"),
    "flat": (lambda h: 0.0 * h + 1.0, {}, "all its heights are the same"),
    "µm for mm": (lambda h: 1e3 * h, {}, "are the heights in a smaller unit"),
    "m for mm": (lambda h: 1e-3 * h, {}, "are the heights in a larger unit"),
    "a line": (lambda h: h[:, 0], {}, "takes at least 2 x 2 points"),
    "no spacing": (lambda h: h, {"spacing": None}, "the distance of its points is not known"),
    "spacing in µm": (lambda h: h, {"spacing": 10.0}, "spacing is in mm; is it in m or µm"),
    "spacing in m": (lambda h: h, {"spacing": 1e-5}, "spacing is in mm; is it in m or µm"),
    "small": (lambda h: h[:150], {}, "covers 1.5 mm along the slide and 1.125 mm across, a tile needs 2 x 1 mm"),
    "noise": (lambda h: h + (np.random.default_rng(1).random(h.shape) < 0.1), {}, "are spikes"),
    "a profile": (lambda h: h[:, :2], {}, "too few for remove = 'cylinder': are they some profiles"),
    "a long filter": (lambda h: h, {"filter": 8.0}, "filter = 8 mm is longer than its 2.1 x 1.125 mm"),
    "two files": (lambda h: h, {"use": "strip", "files": ("a", "b")}, "use = 'strip' takes one file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused_by_name(heights: np.ndarray, tmp_path: Path, case: str) -> None:
    spoil, more, message = REFUSED[case]
    path = tmp_path / "a.npy"
    np.save(path, spoil(heights))
    with pytest.raises(SurfaceError, match=message):
        measured_face(keys(path, **more), "axle", 0, SIZES["axle"])


DOUBTED = {
    "along the slide": (lambda h: scans.turned(np.random.default_rng(2), (110, 110), STEP).T, {}, "is along right"),
    "a tenth": (lambda h: 0.02 * h, {}, "which is rare on machined faces"),
    "coarse": (lambda h: h[::16, ::16], {"spacing": 0.16}, "coarser than the means"),
    "a hole": (lambda h: np.where(np.add(*np.indices(h.shape)) % 12, h, np.nan), {}, "missing: 8.3% of the points"),
    "saturated": (lambda h: np.minimum(h, 0.0025), {}, "of its points have exactly its highest height"),
    "steep": (lambda h: h + np.random.default_rng(4).normal(0.0, 0.008, h.shape), {}, "its slope Sdq is"),
}


@pytest.mark.parametrize("case", DOUBTED)
def test_what_may_be_wrong_is_said(heights: np.ndarray, tmp_path: Path, case: str) -> None:
    spoil, more, message = DOUBTED[case]
    path = tmp_path / "a.npy"
    np.save(path, spoil(heights))
    assert message in " ".join(scan_of(keys(path, **more), 0).doubts)


def test_filled_points_are_said_before_a_run(heights: np.ndarray, tmp_path: Path) -> None:
    """Once for each file, and with a filter too; sound files say nothing."""
    holes, spikes = heights.copy(), heights.copy()
    holes[50:53, 40:42], spikes[60, 50] = np.nan, 1.0
    for name, surface in (("sound", heights), ("holes", holes), ("spikes", spikes)):
        np.save(tmp_path / f"{name}.npy", surface)
    files = tuple(str(tmp_path / f"{name}.npy") for name in ("sound", "holes", "spikes"))
    for more in ({}, {"filter": 0.25}):
        face = FaceKeys(axle=ScanKeys(files=files, spacing=STEP, use="patches", **more))
        told = doubts_of(face, {"axle": 9, "wheel": 9}, 1.0)
        assert [line.partition(", ")[0] for line in told] == [
            f"{files[1]}: missing: 6 points (0.00032 of all)",
            f"{files[2]}: spikes: 1 points (5.3e-05 of all)",
        ]


def test_contradictions_and_other_files_are_refused(heights: np.ndarray, tmp_path: Path) -> None:
    path = written(tmp_path, "a.sur", heights)
    for more, message in (
        ({"unit": "mm"}, "unit = 'mm' is asked for, and the file says another one"),
        ({"spacing": 0.02}, "spacing = 0.02, 0.02 mm is asked for, and the file says 0.01, 0.0125 mm"),
    ):
        with pytest.raises(SurfaceError, match=message):
            scan_of(keys(path, **more), 0)
    whole = path.read_bytes()
    others = {
        "cut.sur": whole[:-9],
        "head.sur": whole[:300],
        "empty.sur": b"",
        "odd.opd": b"1234",
        "pack.sur": b"DSCOMP",
    }
    others |= {"zip.x3p": b"PK\x03\x04 1", "none.xyz": b"1 2\n", "odd.xyz": b"0 0 1\n1 0 1\n0 .4 1\n1 1 1\n2 .1 0\n"}
    others["big.sdf"] = scans.sdf(heights, STEP).replace(b"NumPoints   = 210", b"NumPoints   = 10000000000")
    for name, data in others.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(SurfaceError, match=name.replace(".", r"\.")) as caught:
            scan_of(keys(tmp_path / name), 0)
        assert "\n" not in str(caught.value)


def test_points_in_a_text_and_a_unit_in_bytes_are_known(heights: np.ndarray, tmp_path: Path) -> None:
    """Instruments write x, y, z into .txt as well; other programs put a text into an .npz as bytes."""
    x, y = np.meshgrid(*(step * np.arange(count) for step, count in zip(STEP, SHAPE, strict=True)), indexing="ij")
    np.savetxt(tmp_path / "a.txt", np.stack([x.ravel(), y.ravel(), heights.ravel()], axis=1), header="x y z")
    raw = read_scan(tmp_path / "a.txt")
    assert raw.spacing == pytest.approx(STEP)
    assert np.allclose(raw.heights, heights)
    some = np.delete(np.stack([x.ravel(), y.ravel(), heights.ravel()], axis=1), [7, 40, 41], axis=0)
    np.savetxt(tmp_path / "c.csv", some, delimiter=",", header="x [mm], y [mm], z [um]")  # without a signal, no point
    raw = read_scan(tmp_path / "c.csv")
    assert (raw.spacing, raw.unit) == (pytest.approx(STEP), 1e-3)
    assert np.flatnonzero(np.isnan(raw.heights)).tolist() == [7, 40, 41]
    assert np.nanmax(np.abs(raw.heights - heights)) < 1e-12
    np.savetxt(tmp_path / "d.txt", np.round(heights[:, :3], 3))  # rows of few heights are no places
    assert read_scan(tmp_path / "d.txt").heights.shape == (SHAPE[0], 3)
    np.savetxt(tmp_path / "b.txt", heights[:, :3])
    assert read_scan(tmp_path / "b.txt").heights.shape == (SHAPE[0], 3)
    np.savez(tmp_path / "a.npz", heights=heights, spacing=STEP, unit=np.bytes_("um"))
    assert read_scan(tmp_path / "a.npz").unit == 1e-3


UNITS = {
    "µm": 1e-3,
    "μm": 1e-3,
    "um": 1e-3,
    "microns": 1e-3,
    "~m": 1e-3,
    "Å": 1e-7,
    "MM": 1.0,
    "[nm]": 1e-6,
    "inch": 25.4,
    "Nanometers": 1e-6,
}


@pytest.mark.parametrize("written", UNITS)
def test_a_unit_of_length_is_known_however_it_is_written(written: str) -> None:
    assert length_unit(f"{written}\x00\x00") == UNITS[written]


@pytest.mark.parametrize("written", ["Mm", "mN", "N", "s", "V", "µ"])
def test_a_unit_of_something_else_is_refused(written: str) -> None:
    with pytest.raises(SurfaceError, match=f"unit '{written}' is not one of length"):
        length_unit(written)


# --- tiles of strips and patches


@pytest.fixture(scope="module")
def strip(tmp_path_factory: pytest.TempPathFactory) -> ScanKeys:
    table = scans.textured(np.random.default_rng(8), (1000, 105), (0.01, 0.01))  # 10 x 1.05 mm
    return keys(written(tmp_path_factory.mktemp("strip"), "a.sur", table, (0.01, 0.01)), use="auto").found()


def test_a_strip_lies_in_place(strip: ScanKeys) -> None:
    fourth, fifth = (measured_face(strip, "axle", tile_seed(7, k), (2.0, 1.0)).heights for k in (3, 4))
    assert np.allclose(fourth[16:], fifth[:17], rtol=0, atol=1e-15)
    assert np.array_equal(fourth, measured_face(strip, "axle", tile_seed(1, 3), (2.0, 1.0)).heights)
    raw = scan_of(strip, 0).heights
    point = raw[347:353, 49:56]  # the mean over 62.5 um about x = 3.5, y = 0.5 + 0.025
    assert fourth[8, 8] == pytest.approx(point.mean(), abs=2e-4)
    last = measured_face(strip, "axle", tile_seed(1, 9), (2.0, 1.0)).heights
    assert np.allclose(last[17:], last[:16][::-1], rtol=0, atol=1e-12)
    with pytest.raises(SurfaceError, match="is 10 mm long, and tile 20 begins at 20 mm"):
        measured_face(strip, "axle", tile_seed(1, 20), (2.0, 1.0))


@pytest.fixture(scope="module")
def patches(tmp_path_factory: pytest.TempPathFactory) -> ScanKeys:
    folder, rng = tmp_path_factory.mktemp("patches"), np.random.default_rng(9)
    files = []
    for k in range(3):
        files.append(folder / f"{k}.x3p")
        files[-1].write_bytes(scans.x3p(scans.textured(rng, (200, 200), (0.005, 0.005)), (0.005, 0.005)))
    return ScanKeys(files=tuple(map(str, files))).found()


def test_patches_are_dealt_to_a_strip_by_the_seed(patches: ScanKeys) -> None:
    """Neighbours share what they overlap; another draw is another strip; the variance is that of the patches."""
    faces = [measured_face(patches, "axle", tile_seed(1, k), (2.0, 1.0)).heights for k in range(60)]
    assert np.allclose(faces[5][16:], faces[6][:17], rtol=0, atol=1e-15)
    assert np.array_equal(faces[7], measured_face(patches, "axle", tile_seed(1, 7), (2.0, 1.0)).heights)
    for other in (tile_seed(2, 7), tile_seed(1, 9)):
        assert not np.allclose(faces[7], measured_face(patches, "axle", other, (2.0, 1.0)).heights, atol=1e-4)
    bore = measured_face(patches, "wheel", tile_seed(1, 7), (1.0, 1.0)).heights
    assert not np.allclose(faces[7][:17], bore, atol=1e-4)
    alone = [ScanKeys(files=(name,), use="face") for name in patches.files]
    means = [measured_face(each, "wheel", 0, (1.0, 1.0)).heights for each in alone]
    there = np.mean([np.mean(face**2) for face in means])
    assert np.mean([np.mean(face[:16] ** 2) for face in faces]) == pytest.approx(there, rel=0.1)
    steps = np.concatenate([np.diff(face[:17], axis=0).ravel() for face in faces])
    assert np.abs(steps).max() < 3.0 * max(np.abs(np.diff(face, axis=0)).max() for face in means)


def test_a_measured_face_is_levelled_where_it_is_asked_for(strip: ScanKeys, network: Predictor) -> None:
    """By the plates and by the prediction for them."""
    scan = msgspec.structs.replace(strip, remove="none")
    left, level = (SurfaceKeys(form=form, axle=scan, axle_seed=tile_seed(1, 2)) for form in ("strip", "levelled"))
    found, flat = (rough_face(each, "axle", each.axle_seed, SIZES["axle"]) for each in (left, level))
    assert np.allclose(flat.heights, found.levelled().heights, atol=1e-15)
    assert not np.allclose(flat.heights, found.heights, atol=1e-5)
    points = network.provenance.points
    predicted_faces = [predict_pair(network, (0.07,), each).axle for each in (left, level)]
    for face, known in zip(predicted_faces, (found, flat), strict=True):
        assert np.allclose(face, known.resampled((2 * points - 1, points)).heights, atol=1e-8)


def test_a_scan_too_coarse_for_a_small_tile_is_refused(heights: np.ndarray, tmp_path: Path) -> None:
    path = written(tmp_path, "a.npy", heights[::16, ::8])
    coarse = keys(path, spacing=(0.16, 0.1))
    assert measured_face(coarse, "wheel", 0, (1.0, 1.0)).size == (1.0, 1.0)
    with pytest.raises(SurfaceError, match=r"its points are 0\.16 mm apart, a tile needs 0\.125 mm or less"):
        measured_face(coarse, "wheel", 0, (0.5, 0.5))


def test_overlaps_have_the_variance_of_the_patches(patches: ScanKeys, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces of white noise of variance 1: so is a strip of them; with a linear fade it has 8/9."""
    rng = np.random.default_rng(4)

    def noise(scan: object, laid: object, along: np.ndarray, y: np.ndarray, piece: float) -> np.ndarray:
        return rng.standard_normal((len(along), len(y)))

    monkeypatch.setattr(laying, "_read", noise)
    faces = [measured_face(patches, "wheel", tile_seed(1, k), (1.0, 1.0)).heights for k in range(60)]
    assert np.mean(np.square(faces)) == pytest.approx(1.0, abs=0.04)


def test_a_piece_is_reflected_in_both_directions(patches: ScanKeys) -> None:
    scan, y = scan_of(patches, 0), np.linspace(0.0, 1.0, 17)
    straight, turned, mirrored = (
        laying._read(scan, laying._Piece(0, (0.0, 0.0), flipped), y, y, 1.0)
        for flipped in ((False, False), (True, False), (False, True))
    )
    assert np.allclose(turned, straight[::-1], atol=1e-12)
    assert np.allclose(mirrored, straight[:, ::-1], atol=1e-12)
    assert not np.allclose(straight, straight[:, ::-1], atol=1e-4)


def test_pieces_are_told_as_they_lie(patches: ScanKeys, strip: ScanKeys) -> None:
    """Where a piece overlaps with no other and is not reflected, the face is the patch that is named for it."""
    size, seen = (2.0, 1.0), 0
    for tile in range(0, 300, 3):  # patches are as wide as a tile, so that a piece begins at 0 on its patch
        face = measured_face(patches, "axle", tile_seed(1, tile), size).heights
        told = pieces_of(patches, "axle", tile_seed(1, tile), size)
        assert told[0].startswith("0 ... ")
        assert " ... 2 mm of the tile: " in told[-1]
        for line in told:
            found = re.fullmatch(r"(\S+) \.\.\. (\S+) mm of the tile: (\S+) from 0 mm along and 0 mm across", line)
            if found is None or float(found.group(2)) - float(found.group(1)) < 0.99:
                continue
            x = np.arange(33) / 16.0
            alone = np.flatnonzero((x > float(found.group(1)) + 0.26) & (x < float(found.group(2)) - 0.26))
            scan = scan_of(patches, patches.files.index(found.group(3)))
            patch = area_means(scan, x[alone] - float(found.group(1)), np.arange(17) / 16.0, 1.0 / 16.0)
            assert np.allclose(face[alone], patch, atol=1e-12)
            seen += 1
    assert seen > 5
    assert pieces_of(strip, "axle", tile_seed(1, 2), size) == ()


def test_each_patch_is_read_once_however_many_there_are(
    patches: ScanKeys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tiles of both bodies in turn, as a run asks for them; every one takes all the patches of its body."""
    read: list[Path] = []

    def counted(path: Path) -> object:
        read.append(path)
        return read_scan(path)

    monkeypatch.setattr("meso.surfaces.measured.read_scan", counted)
    both = {}
    for body in ("axle", "wheel"):
        files = [tmp_path / f"{body}{k}.x3p" for k in range(6)]
        for k, file in enumerate(files):
            file.write_bytes(Path(patches.files[k % 3]).read_bytes())
        both[body] = ScanKeys(files=tuple(map(str, files))).found()
    for tile in range(3):
        for body, keys in both.items():
            measured_face(keys, body, tile_seed(1, tile), (1.0, 1.0))  # type: ignore[arg-type]
    assert len(read) == len(set(read)) == 12


def test_the_coarser_file_is_the_face_itself(tmp_path: Path) -> None:
    face = rough_face(Settings().surface, "wheel", 5, (1.0, 1.0))
    np.save(tmp_path / "w.npy", face.heights)
    scan, told = covering(ScanKeys(files=(str(tmp_path / "w.npy"),), use="face", remove="none"), (1.0, 1.0))
    assert told[0].startswith(
        "no spacing is stated: taken to cover the face of 1 x 1 mm, its points 125 x 125 µm apart"
    )
    assert np.allclose(measured_face(scan, "wheel", 0, (1.0, 1.0)).resampled((9, 9)).heights, face.heights, atol=1e-15)


# --- settings, scenes, providers


def test_settings_know_the_digest_and_the_folder(strip: ScanKeys, tmp_path: Path) -> None:
    data = Path(strip.files[0]).read_bytes()
    (tmp_path / "a.sur").write_bytes(data)
    (tmp_path / "s.toml").write_text('[surface]\naxle = "a.sur"\nbore = { files = ["a.sur"], use = "patches" }\n')
    settings = load_settings(tmp_path / "s.toml")
    found = settings.surface.measured("axle")
    assert found is not None
    assert (found.files, found.sha256) == ((str(tmp_path / "a.sur"),), strip.sha256)
    (tmp_path / "again.toml").write_text(dump(settings))
    assert load_settings(tmp_path / "again.toml") == settings
    assert settings.fingerprint != Settings().fingerprint
    (tmp_path / "a.sur").write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    with pytest.raises(SettingsError, match=r"surface\.axle\.sha256: the content of .*a\.sur is another"):
        load_settings(tmp_path / "again.toml")
    other = load_settings(tmp_path / "s.toml")
    assert other.fingerprint != settings.fingerprint
    with pytest.raises(SurfaceError, match="its content is another than that with the digest"):
        rough_face(settings.surface, "axle", 3, (2.0, 1.0))
    for table, message in (
        ({"axle": []}, r"surface\.axle: is empty"),
        ({"axle": ""}, r"surface\.axle: is empty"),
        ({"axle": "none.sur"}, r"surface\.axle: none\.sur: cannot be read"),
        ({"bore": {"files": []}}, r"surface\.bore\.files: is empty"),
        ({"axle": {"files": ["a"], "unit": "ft"}}, "surface.axle.unit"),
    ):
        with pytest.raises(SettingsError, match=message):
            decode({"surface": table})


CONTEXT = BuildContext(seat_tiles=6, bore_tiles=6, youngs_modulus=206000.0, poisson_ratio=0.3)


def options(strip: ScanKeys, patches: ScanKeys) -> dict[str, object]:
    return {"surface": {"axle": strip.files[0], "bore": list(patches.files)}, "micro_friction": 0.07}


def test_a_scene_names_its_files(strip: ScanKeys, patches: ScanKeys, tmp_path: Path) -> None:
    """Whatever compares scenes, a resumed run with its journal or ranks with each other, compares these digests."""
    for k, name in enumerate((strip.files[0], *patches.files)):
        (tmp_path / f"{k}{Path(name).suffix}").write_bytes(Path(name).read_bytes())
    surface = {"axle": "0.sur", "bore": ["1.x3p", "2.x3p", "3.x3p"]}
    tables = tomllib.loads((resources.files("macrofit.scene") / "library" / "wheelset.toml").read_text())
    scene = build_scene(tables | {"friction": {"provider": "surrogate", "options": {"surface": surface}}}, tmp_path)
    digests = file_digests(scene)
    assert sorted(digests.values()) == sorted((*strip.sha256, *patches.sha256))
    (tmp_path / "2.x3p").write_bytes(b"another")
    changed = [key for key, value in file_digests(scene).items() if digests[key] != value]
    assert changed == ["friction.options.surface.bore.1"]


def test_the_network_takes_measured_faces(strip: ScanKeys, patches: ScanKeys) -> None:
    provider = build("surrogate", options(strip, patches), CONTEXT)
    check(provider, 6, 6)
    with pytest.warns(UserWarning, match="is 10 mm long, the axle has 15 tiles: it is reflected there"):
        build("surrogate", options(strip, patches), msgspec.structs.replace(CONTEXT, seat_tiles=15))
    with pytest.raises(ProviderError, match="is 10 mm long, and tile 39 begins at 39 mm"):
        build("surrogate", options(strip, patches), msgspec.structs.replace(CONTEXT, seat_tiles=40))
    with pytest.raises(ProviderError, match=r"friction\.options\.surface\.axle: no\.sur: cannot be read"):
        load("surrogate", {"surface": {"axle": "no.sur"}})


@pytest.mark.parametrize(("rough", "refused"), [(2.0, False), (5.0, True)])
def test_a_strip_is_unlike_those_learned_from_where_most_of_it_is(rough: float, refused: bool, tmp_path: Path) -> None:
    """A rough place on a seat does not refuse the run: the network tells of its pairs one by one."""
    table = scans.textured(np.random.default_rng(8), (1000, 105), (0.01, 0.01))
    table *= 12.0
    table[: round(100 * rough)] *= 2.0  # more than the 22 um learned from, also as means over a grid
    file = written(tmp_path, "a.sur", table, (0.01, 0.01))
    asked = {"surface": {"axle": {"files": [str(file)], "remove": "none"}}}
    if not refused:
        build("surrogate", asked, CONTEXT)
        return
    with pytest.raises(ProviderError, match="the axle's face is rougher than any learned from"):
        build("surrogate", asked, CONTEXT)


def test_the_plates_take_measured_faces(strip: ScanKeys, patches: ScanKeys) -> None:
    more = {"plates": {"spheres": 400}, "engine": {"increment": 0.02}, "cache": False}
    provider = build("dem", options(strip, patches) | more, CONTEXT)
    one, none = np.array([3]), np.zeros(1)
    answer = provider.coefficients(TilePairs(one, one - 1, none, none))
    assert 0.05 < answer[0] < 0.1
    with pytest.raises(ProviderError, match="begins at 39 mm"):
        build("dem", options(strip, patches), msgspec.structs.replace(CONTEXT, seat_tiles=40))


def test_the_command_shows_a_file(strip: ScanKeys, patches: ScanKeys, tmp_path: Path) -> None:
    def said(*arguments: object) -> str:
        shown = CliRunner().invoke(main, ["surface", *map(str, arguments)])
        assert shown.exit_code == 0, shown.output
        return shown.stdout

    out = said("--file", strip.files[0], "--body", "axle", "--use", "strip", "--seed", 3, "-o", tmp_path / "s.png")
    for words in ("10 x 1.05 mm, 1000 x 105 points", "form removed: cylinder", "Sq 1.6 µm", "Lay             none"):
        assert words in out
    assert (tmp_path / "s.png").read_bytes().startswith(b"\x89PNG")
    out = said(*(part for name in patches.files for part in ("--file", name)), "--filter", 0.8)
    assert out.count("waves above 0.8 mm filtered out") == 3
    wrong = CliRunner().invoke(main, ["surface", "--file", strip.files[0], "--unit", "nm"])
    assert wrong.exit_code != 0


def test_other_files_are_left_to_surface_topography(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its interface as of version 1.27: a reader in a context, heights (nx, ny), sizes in the unit."""

    class Found:
        unit, physical_sizes = "µm", (1100.0, 1000.0)

        def heights(self) -> np.ndarray:
            return np.ma.masked_greater(np.arange(110.0 * 100).reshape(110, 100) % 7, 5.5)

        def topography(self) -> Found:
            return self

        def __enter__(self) -> Found:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    path = tmp_path / "a.opd"
    path.write_bytes(b"anything")
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with pytest.raises(SurfaceError, match=r"a\.opd: files \.opd are read by SurfaceTopography, which is not there"):
        scan_of(keys(path), 0)
    there = ModuleType("SurfaceTopography")
    there.open_topography = lambda name: Found()  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "SurfaceTopography", there)
    raw = read_scan(path)
    assert raw.unit == 1e-3
    assert raw.spacing == pytest.approx((0.01, 0.01))
    assert np.isnan(raw.heights).sum() == (np.arange(11000) % 7 == 6).sum()
    there.open_topography = lambda name: 1 / 0  # type: ignore[attr-defined]
    with pytest.raises(SurfaceError, match="does not read it"):
        read_scan(path)

    def binary(name: str) -> None:
        raise ValueError("tried all: " + "\x00\x1b\ufffd\n" * 1000)

    there.open_topography = binary  # type: ignore[attr-defined]
    with pytest.raises(SurfaceError, match="does not read it") as caught:
        read_scan(path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500
    there.open_topography = lambda name: Found()  # type: ignore[attr-defined]
    monkeypatch.setattr(Found, "_file_extensions", ["hgt"], raising=False)  # takes any square block of bytes
    with pytest.raises(SurfaceError, match=r"it has no mark of a \.opd file, and would be taken for hgt"):
        read_scan(path)
