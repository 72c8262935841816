"""Commands that take files of heights: what is assumed is said, what has no effect is refused, no input is lost."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scans
from click.testing import CliRunner, Result

from macrofit.friction import BuildContext, ProviderError, build
from meso.cli import main
from meso.errors import OutputError, SettingsError
from meso.measured.keys import ScanKeys
from meso.results.folder import prepare
from meso.results.summary import roughness_line
from meso.settings import decode, load
from meso.surfaces.surface import Surface
from surrogate.cli import main as network

STEP = (0.01, 0.01)


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two faces that say all, one that says nothing, and a strip of 6 mm."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    for name, shape in (("a.csv", (210, 110)), ("b.csv", (110, 110)), ("strip.csv", (600, 110))):
        (tmp_path / name).write_bytes(scans.csv(scans.textured(rng, shape, STEP), STEP))
    np.save(tmp_path / "bare.npy", scans.textured(rng, (110, 110), STEP))
    return tmp_path


def surface(*arguments: str) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, ["surface", *arguments])


def predict(*arguments: str) -> Result:
    return CliRunner(mix_stderr=False).invoke(network, ["predict", *arguments])


def told(shown: Result) -> str:
    """The one line with which a command refused."""
    assert shown.exit_code == 2, shown.stderr
    lines = shown.stderr.strip().splitlines()
    assert len(lines) == 1, shown.stderr
    return lines[0]


@pytest.mark.parametrize("name", ["a.csv", "../{}/a.csv", "link.csv"])
def test_an_output_never_overwrites_an_input(files: Path, name: str) -> None:
    (files / "link.csv").symlink_to(files / "a.csv")
    before = (files / "a.csv").read_bytes()
    for shown in (surface("--file", "a.csv", "-o", name.format(files.name)),
                  predict("--axle", "a.csv", "-o", name.format(files.name))):  # fmt: skip
        assert "is read by this command, and would be written over: give -o another name" in told(shown)
    assert (files / "a.csv").read_bytes() == before


def test_a_run_keeps_measured_faces_in_its_folder(files: Path) -> None:
    settings = decode({"surface": {"axle": "a.csv"}})
    prepare(files / "run", settings)
    (files / "run" / "curve_1.csv").write_bytes((files / "a.csv").read_bytes())
    with pytest.raises(OutputError, match=r"curve_1\.csv: is read by this command"):
        prepare(files / "run", decode({"surface": {"axle": "run/curve_1.csv"}}))
    assert (files / "run" / "curve_1.csv").exists()


def test_a_table_without_a_spacing_is_said_to_cover_the_face(files: Path) -> None:
    line = "no spacing is stated: taken to cover the face of 1 x 1 mm, its points 9.17 x 9.17 µm apart"
    assert f"Doubt           {line}" in surface("--file", "bare.npy").stdout
    shown = predict("--wheel", "bare.npy")
    assert shown.exit_code == 0, shown.stderr
    assert f"warning: bare.npy: {line}" in shown.stderr
    assert "Doubt" not in surface("--file", "bare.npy", "--spacing", "0.01").stdout


def test_a_strip_that_ends_is_said_to_be_reflected(files: Path) -> None:
    """As a press-fit says it."""
    shown = surface("--file", "strip.csv", "--body", "axle", "--use", "strip", "--seed", "5")
    assert "Doubt           tile 5 ends at 7 mm, and the strip at 6 mm: it is reflected there" in shown.stdout
    shown = predict("--axle", "strip.csv", "--use", "strip", "--axle-seed", "5")
    assert "warning: strip.csv: tile 5 ends at 7 mm, and the strip at 6 mm: it is reflected there" in shown.stderr
    shown = predict("--axle", "strip.csv", "--use", "strip", "--axle-seed", "4")
    assert shown.stderr.count("warning") == 0, shown.stderr


IDLE: dict[str, tuple[Callable[..., Result], tuple[str, ...], str]] = {
    "a generated height": (surface, ("--file", "a.csv", "--max-height", "0.01"), "--max-height: is for gen"),
    "a lay": (surface, ("--file", "a.csv", "--lay", "turned"), "--lay: is for generated faces"),
    "a seed": (surface, ("--file", "a.csv", "--seed", "4"), "--seed: the face is the middle of a.csv"),
    "a degree": (surface, ("--file", "a.csv", "--degree", "3"), "--degree: is for --remove polynomial"),
    "no file": (surface, ("--spacing", "0.01"), "--spacing: is for faces from files: leave it out, or give --file"),
    "neither file": (predict, ("--unit", "um"), "--unit: is for faces from files: leave it out, or give --axle"),
    "both files": (predict, ("--axle", "a.csv", "--wheel", "b.csv", "--levels", "4"), "--levels: is for gen"),
    "a place": (predict, ("--axle", "a.csv", "--axle-seed", "4"), "--axle-seed: the face is the middle of a.csv"),
    "another's key": (predict, ("--axle", "a.csv", "--set-wheel", "unit=um"), "--set-wheel: is for the file"),
    "a degree in a key": (predict, ("--axle", "a.csv", "--set-axle", "degree=3"), "degree: is for remove"),
    "no key": (predict, ("--axle", "a.csv", "--set-axle", "spacng=1"), "--set-axle spacng: unknown key (did"),
    "a contradiction": (predict, ("--axle", "a.csv", "--spacing", "1"), "leave the key out for this file"),
}  # fmt: skip


@pytest.mark.parametrize("case", IDLE)
def test_what_has_no_effect_is_refused_by_name(files: Path, case: str) -> None:
    command, arguments, message = IDLE[case]
    assert message in told(command(*arguments))


def test_a_level_face_from_a_file_is_no_generated_one(files: Path) -> None:
    assert surface("--file", "a.csv", "--form", "levelled").exit_code == 0


def test_each_file_has_keys_of_its_own(files: Path) -> None:
    """One says all, the other nothing; what both lack is an option of both."""
    np.save(files / "um.npy", 1e3 * np.load(files / "bare.npy"))
    shown = predict("--axle", "a.csv", "--wheel", "um.npy", "--set-wheel", "spacing=0.01", "--set-wheel", "unit=um")
    assert shown.exit_code == 0, shown.stderr
    assert "warning" not in shown.stderr
    plain = predict("--axle", "a.csv", "--wheel", "bare.npy", "--set-wheel", "spacing=0.01")
    assert shown.stdout.splitlines()[-4:] == plain.stdout.splitlines()[-4:]
    both = predict("--axle", "a.csv", "--wheel", "bare.npy", "--set-wheel", "spacing=0.01", "--set-axle", "invert=true")
    assert "File            axle: heights turned over (invert)" in both.stdout
    assert "wheel: heights turned over" not in both.stdout


def test_one_file_for_both_faces_is_told(files: Path) -> None:
    message = "a.csv: is the face of the axle and of the bore"
    assert f"warning: {message}" in predict("--axle", "a.csv", "--wheel", "a.csv").stderr
    context = BuildContext(seat_tiles=2, bore_tiles=2, youngs_modulus=206000.0, poisson_ratio=0.3)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        build("surrogate", {"surface": {"axle": "a.csv", "bore": "a.csv"}}, context)
    assert any(message in str(each.message) for each in caught)
    (files / "copy.csv").write_bytes((files / "a.csv").read_bytes())
    assert decode({"surface": {"axle": "copy.csv", "bore": "a.csv"}}).surface.shared_files() == ["copy.csv"]
    assert decode({"surface": {"axle": "b.csv", "bore": "a.csv"}}).surface.shared_files() == []


def test_no_name_is_no_folder(files: Path) -> None:
    (files / "s.toml").write_text('[surface]\naxle = ""\n')
    with pytest.raises(SettingsError, match=r"^surface\.axle: is empty"):
        load(files / "s.toml")


def test_keys_of_generated_faces_are_refused_where_there_is_none(files: Path) -> None:
    """Those of a preset, and defaults written out, are nobody's wish."""
    both = {"axle": "a.csv", "bore": "b.csv"}
    assert decode({"surface": {**both, "lay": "isotropic", "max_height": 0.04}}).surface.axle is not None
    assert decode({"surface": {"axle": "a.csv", "lay": "ground"}}).surface.lay == "ground"
    with pytest.raises(
        SettingsError, match=r"surface\.lay = 'turned' is for generated faces, and both come from files"
    ):
        decode({"surface": {**both, "lay": "turned"}})
    context = BuildContext(seat_tiles=2, bore_tiles=2, youngs_modulus=206000.0, poisson_ratio=0.3)
    with pytest.raises(ProviderError, match=r"friction\.options\.surface\.feed = 0\.3 is for generated faces"):
        build("surrogate", {"surface": {**both, "feed": 0.3}}, context)


def test_a_cast_is_kept_in_the_settings(files: Path) -> None:
    shown = surface("--file", "a.csv", "--invert", "-o", "turned.npy")
    assert "Done            heights turned over (invert)" in shown.stdout
    surface("--file", "a.csv", "-o", "straight.npy")
    assert np.allclose(np.load(files / "turned.npy"), -np.load(files / "straight.npy"), atol=1e-12)
    scan = decode({"surface": {"axle": {"files": ["a.csv"], "invert": True}}}).surface.measured("axle")
    assert isinstance(scan, ScanKeys)
    assert scan.invert


def test_a_hurst_exponent_outside_of_its_bounds_is_none() -> None:
    x = np.arange(65)
    waves = Surface(1e-3 * np.sin(0.5 * np.pi * x)[:, None] * np.ones(65), (1.0, 1.0))
    assert roughness_line(waves).endswith("Hurst exponent none (not self-affine)")
