"""The command `macrofit-meso`: its files, what it prints, its exit codes, and what a run that ends early leaves."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from meso.cli import main
from meso.errors import StabilityError
from meso.plates import make_plates
from meso.settings import load

SMALL = (
    "plates.spheres=300", "plates.thickness=0.25", "plates.edge=0.5", "load.slide=0.5", "load.pressure=170",
    "engine.increment=0.02", "engine.samples=20",
)  # fmt: skip
SET = [part for key in SMALL for part in ("--set", key)]
RESULTS = {"settings.toml", "summary.json", "curve.csv", "squeeze.csv", "run.h5"}
FIGURES = {"surfaces.png", "plates.png", "forces.png"}
NUMBERS = {
    "meso_friction", "meso_friction_mean_of_ratio", "uncertainty", "micro_friction", "spheres", "bonds", "engine",
    "steps", "bond_steps_per_s", "unconverged_increments", "packing_cpu_s", "run_cpu_s", "largest_residual",
    "mean_normal_force_N", "mean_tangential_force_N", "approach_mm", "work", "packing", "roughness", "versions",
    "remark", "setup_cpu_s", "slides", "affine_fit", "meso_friction_resultant", "resonance",
}  # fmt: skip


@pytest.fixture(scope="session")
def packings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of flat packings for the tests of this file."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def place(packings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty current folder; the signals are given back."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MACROFIT_CACHE", str(packings))
    terminate = signal.getsignal(signal.SIGTERM)
    yield tmp_path
    signal.signal(signal.SIGTERM, terminate)


def meso(*arguments: object) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def rows(path: Path) -> np.ndarray:
    return np.loadtxt(path, delimiter=",", skiprows=1)


def test_help_names_every_command():
    shown = meso("--help")
    assert shown.exit_code == 0
    for command in ("run", "surface", "sample", "calibrate"):
        assert f"\n  {command} " in shown.stdout
        assert meso(command, "--help").exit_code == 0


def test_help_comes_without_anything_heavy():
    code = "import runpy, sys\nsys.argv[1:] = ['--help']\ntry:\n"
    code += "    runpy.run_module('meso', run_name='__main__')\n"
    code += "finally:\n    print({'numpy', 'numba', 'scipy', 'matplotlib', 'rich', 'msgspec'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"


def test_the_lines_in_the_docstring_of_the_package_run(place):
    import meso as package

    lines = [line.strip() for line in package.__doc__.splitlines() if line.startswith("    ")]
    (place / "plates.toml").write_text(
        "[plates]\nspheres = 300\nthickness = 0.25\nedge = 0.5\n[load]\nslide = 0.5\n[engine]\nincrement = 0.02\n"
    )
    assert len(lines) == 6
    exec("\n".join(lines), {"print": lambda *_: None})


# --- run


def test_a_run_writes_its_files_and_says_the_essence(place):
    shown = meso("run", *SET)
    assert shown.exit_code == 0, shown.stderr
    assert shown.stderr == ""
    folder = place / "meso-run"
    assert names(folder) == RESULTS | FIGURES
    numbers = json.loads((folder / "summary.json").read_text())
    assert set(numbers) >= NUMBERS
    stages = [line.split()[0] for line in shown.stdout.splitlines() if line.endswith(" s)")]
    assert stages == ["Plates", "Engine", "Micro", "Files"]
    assert f"Meso friction   {numbers['meso_friction']:.4f} ± {numbers['uncertainty']:.4f}" in shown.stdout
    assert shown.stdout.endswith("Files           meso-run\n")
    assert load(folder / "settings.toml") == load(None, SMALL)

    curve = rows(folder / "curve.csv")
    assert curve[-1, 0] == pytest.approx(0.5)
    assert curve[:, 1].mean() == pytest.approx(numbers["mean_normal_force_N"], rel=0.1)
    squeeze = rows(folder / "squeeze.csv")
    assert squeeze[-1, 0] == pytest.approx(numbers["approach_mm"])
    assert squeeze[-1, 1] == pytest.approx(170.0 * 0.25, rel=0.01)
    assert numbers["engine"] == "quasi-static"
    assert numbers["unconverged_increments"] == 0
    assert abs(numbers["work"]["imbalance"]) < 0.05
    assert numbers["setup_cpu_s"] + numbers["slides"][0]["slide_cpu_s"] <= numbers["run_cpu_s"] + 0.02
    assert numbers["packing"]["wheel"]["bonds"] + numbers["packing"]["axle"]["bonds"] == numbers["bonds"]
    assert numbers["roughness"]["axle"]["Sa_mm"] > 0.0


def test_a_run_without_figures_and_without_words(place):
    shown = meso("run", *SET, "-o", "out/deep", "--no-figures", "--quiet")
    assert shown.exit_code == 0, shown.stderr
    assert shown.stdout == ""
    assert names(place / "out" / "deep") == RESULTS
    shown = meso("run", *SET, "-o", "out/deep", "--no-figures")  # the folder is one of ours now
    assert shown.exit_code == 0, shown.stderr


def test_a_run_can_be_repeated_from_what_it_wrote(place):
    assert meso("run", *SET, "--micro-friction", "0.1,0.2", "--no-figures", "-o", "one").exit_code == 0
    assert meso("run", "one/settings.toml", "--no-figures", "-o", "two").exit_code == 0
    assert (place / "one" / "curve_0.2.csv").read_bytes() == (place / "two" / "curve_0.2.csv").read_bytes()


def test_several_micro_coefficients(place):
    shown = meso("run", *SET, "--micro-friction", "0.05,0.1,0.2", "--no-figures", "-o", "out")
    assert shown.exit_code == 0, shown.stderr
    folder = place / "out"
    assert names(folder) == RESULTS | {"curve_0.05.csv", "curve_0.1.csv", "curve_0.2.csv"}
    assert (folder / "curve.csv").read_bytes() == (folder / "curve_0.05.csv").read_bytes()
    numbers = json.loads((folder / "summary.json").read_text())
    assert numbers["micro_friction"] == 0.05
    assert [each["micro_friction"] for each in numbers["slides"]] == [0.05, 0.1, 0.2]
    assert numbers["meso_friction"] == numbers["slides"][0]["meso_friction"]
    fit = numbers["affine_fit"]
    for each in numbers["slides"]:
        line = fit["a"] * each["micro_friction"] + fit["b"]
        assert abs(line - each["meso_friction"]) <= fit["largest_residual"] * (1.0 + 1e-9)
    assert fit["a"] == pytest.approx(1.0, abs=0.1)
    assert f"meso = {fit['a']:.4f} micro" in shown.stdout


def test_the_explicit_engine_on_request(place):
    shown = meso("run", *SET, "--engine", "explicit", "--set", "engine.speed=1e5", "--no-figures", "-o", "out")
    assert shown.exit_code == 0, shown.stderr
    numbers = json.loads((place / "out" / "summary.json").read_text())
    assert numbers["engine"] == "explicit"
    settings = load(place / "out" / "settings.toml")
    assert settings.engine.name == "explicit"
    beams = numbers["bond_steps_per_s"] * numbers["slides"][0]["slide_cpu_s"] / numbers["slides"][0]["steps"]
    assert beams == pytest.approx(len(make_plates(settings).lattice.cols))


def test_the_data_of_a_run(place):
    h5py = pytest.importorskip("h5py")
    assert meso("run", *SET, "--micro-friction", "0.1,0.2", "--no-figures", "-o", "out").exit_code == 0
    numbers = json.loads((place / "out" / "summary.json").read_text())
    with h5py.File(place / "out" / "run.h5") as file:
        settings = tomllib.loads(file.attrs["settings"])
        assert settings["plates"]["spheres"] == 300
        for body, length in (("wheel", 0.5), ("axle", 1.0)):
            group = file[body]
            assert group["centres"].shape == (numbers["packing"][body]["spheres"], 3)
            assert group["radii"][:].mean() == pytest.approx(numbers["packing"][body]["mean_radius_mm"])
            assert group["surface"].attrs["unit"] == "mm"
            assert group["surface"].attrs["size_mm"] == pytest.approx((length, 0.5))
            assert group["surface"].shape == (int(length / 0.5) * 8 + 1, 9)
            # no sphere reaches beyond the envelope of its plate
            top = (group["centres"][:, 2] + group["radii"][:]).max() - group.attrs["thickness_mm"]
            assert group["envelope"][:].max() == pytest.approx(top, abs=1e-3)
        assert len(file["slides"]) == 2
        second = file["slides/1"]
        assert second.attrs["micro_friction"] == 0.2
        assert second.attrs["meso_friction"] == numbers["slides"][1]["meso_friction"]
        columns = ("displacement", "normal", "tangential", "friction", "lateral")
        table = np.stack([second[f"slide/{name}"][:] for name in columns])
        np.testing.assert_array_equal(table.T, rows(place / "out" / "curve_0.2.csv"))
        assert second["squeeze/normal"].attrs["unit"] == "N"


# --- mistakes and interruptions


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "none.toml"], "none.toml: cannot be read"),
        (["run", "--set", "plates.spheers=3"], "plates.spheers: unknown key (did you mean 'spheres'?)\n"),
        (["run", "--micro-friction", "nan"], "contact.micro_friction: nan is not a finite number"),
        (["run", "-o", "taken"], "taken: is not empty and holds no run of macrofit-meso"),
        (["run", "--set", "plates.spheres=10", "-o", "out"], "3 spheres of 480 um are too large"),
        (["surface", "--levels", "20"], "surface.levels: 20 must not exceed 10"),
        (["surface", "-o", "face.jpg"], "face.jpg: a surface is written as"),
        (["surface", "-o", "taken/notes.txt/face.png"], "taken/notes.txt/face.png: cannot be written"),
        (["sample", "-o", "plates.stl"], "plates.stl: spheres are written as .vtu or .vtk"),
        (["calibrate", "--poisson-ratio", "0.6"], "material: poisson_ratio = 0.6 is not in"),
    ],
)
def test_a_mistake_is_one_line_and_code_2(place, arguments, message):
    (place / "taken").mkdir()
    (place / "taken" / "notes.txt").write_text("mine")
    shown = meso(*arguments)
    assert shown.exit_code == 2
    assert shown.stderr.startswith("macrofit-meso: ")
    assert message in shown.stderr
    assert shown.stderr.count("\n") == 1
    assert names(place / "taken") == {"notes.txt"}


def test_what_is_no_number_is_refused():
    shown = meso("run", "--micro-friction", "0.1;0.2")
    assert shown.exit_code == 2
    assert "'0.1;0.2' is not a number" in shown.stderr


@pytest.fixture
def second_slide(monkeypatch):
    """What happens when the second slide is asked for."""
    import meso.run

    happens: list[BaseException] = []
    true = meso.run.slid

    def slid(*arguments):
        yield next(true(*arguments))
        raise happens[0]

    monkeypatch.setattr(meso.run, "slid", slid)
    return happens


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (StabilityError("the plates\nfly apart"), 2, "the plates fly apart\n"),
        (KeyboardInterrupt(), 130, "interrupted; the slides that were done are in out\n"),
    ],
)
def test_a_slide_that_is_done_stays(place, second_slide, error, code, message):
    second_slide.append(error)
    shown = meso("run", *SET, "--micro-friction", "0.1,0.2", "-o", "out")
    assert shown.exit_code == code
    assert shown.stderr == f"macrofit-meso: {message}"
    assert names(place / "out") == {"settings.toml", "squeeze.csv", "curve.csv", "curve_0.1.csv"}


def test_a_bug_shows_its_traceback(second_slide):
    second_slide.append(ZeroDivisionError("a mistake of ours"))
    shown = meso("run", *SET, "--micro-friction", "0.1,0.2", "-o", "out")
    assert shown.exit_code == 1
    assert isinstance(shown.exception, ZeroDivisionError)


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_with_130(place, packings, sign):
    long = [*SET, "--engine", "explicit", "--set", "engine.speed=100", "--micro-friction", "0.1,0.2", "-o", "out"]
    process = subprocess.Popen(
        [sys.executable, "-m", "meso", "run", *long],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | {"MACROFIT_CACHE": str(packings)},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "Plates          loading their engines\n"
        assert process.stdout.readline().startswith("Plates")
        assert process.stdout.readline().startswith("Engine")
        time.sleep(0.2)
        process.send_signal(sign)
        _, said = process.communicate(timeout=30.0)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == "macrofit-meso: interrupted; the slides that were done are in out\n"


def test_an_interruption_elsewhere_ends_with_130(monkeypatch):
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("meso.plates.make_plates", interrupted)
    shown = meso("sample")
    assert shown.exit_code == 130
    assert shown.stderr == "macrofit-meso: interrupted\n"


def test_a_damaged_cache_is_a_warning_on_one_line(place, packings, monkeypatch):
    from meso.packing.cache import flat_packing

    assert meso("run", *SET, "--quiet", "--no-figures").exit_code == 0  # fills the cache, if nothing has before
    shutil.copytree(packings, place / "cache")
    first, *_ = sorted((place / "cache" / "packings").iterdir())
    first.write_bytes(b"nothing")
    monkeypatch.setenv("MACROFIT_CACHE", str(place / "cache"))
    flat_packing.cache_clear()
    before = warnings.showwarning
    shown = meso("run", *SET, "--quiet", "--no-figures")
    assert shown.exit_code == 0
    assert shown.stdout == ""
    assert shown.stderr.startswith(f"macrofit-meso: warning: {first} is damaged")
    assert shown.stderr.count("\n") == 1
    assert warnings.showwarning is before


# --- surface, sample, calibrate


def test_a_surface_is_that_of_a_run(place):
    shown = meso("surface", "--body", "axle", "--seed", "5", "-o", "face.npy", "-o", "face.png", "-o", "face.stl")
    assert shown.exit_code == 0, shown.stderr
    assert names(place) == {"face.npy", "face.png", "face.stl"}
    assert "of the axle, 2 x 1 mm, 17 x 9 points" in shown.stdout
    from meso.surfaces.face import rough_face
    from meso.surfaces.roughness import measure

    face = rough_face(load().surface, "axle", 5, (2.0, 1.0))
    np.testing.assert_array_equal(np.load("face.npy"), face.heights)
    assert f"Sa {1e3 * measure(face).Sa:.3g} µm" in shown.stdout


def test_the_options_of_a_surface_reach_it(place):
    plain = ["--levels", "4", "--max-height", "0.01", "--hurst-exponent", "0.5"]
    other = ["--generator", "self_affine", "--rms-height", "0.002", "--form", "tiles"]  # of a strip it is the strip's
    for number, options in enumerate(([], plain, [*plain, "--seed", "9"], [*plain, *other])):
        assert meso("surface", *options, "-o", f"{number}.npy").exit_code == 0
    heights = [np.load(f"{number}.npy") for number in range(4)]
    assert [each.shape for each in heights] == [(9, 9), (17, 17), (17, 17), (17, 17)]
    assert not np.allclose(heights[1], heights[2])
    shown = meso("surface", *plain, *other)
    assert "Sq 2 µm" in shown.stdout
    assert len(names(place)) == 4  # nothing is written without -o


def test_a_sample_is_told_and_written(place):
    meshio = pytest.importorskip("meshio")
    shown = meso("sample", *SET, "-o", "plates.vtu", "-o", "plates.vtk", "-o", "plates.png")
    assert shown.exit_code == 0, shown.stderr
    assert names(place) == {"plates.vtu", "plates.vtk", "plates.png"}
    assert "solid fraction 0.6" in shown.stdout
    mesh = meshio.read("plates.vtu")
    radius, wheel = mesh.point_data["radius"], mesh.point_data["body"] == 0
    assert f"{wheel.sum()} spheres of {1e3 * radius[wheel].mean():.1f} µm" in shown.stdout
    assert mesh.points[wheel][:, 2].mean() > mesh.points[~wheel][:, 2].mean()
    # the plates touch: the gap between the closest spheres of the two is zero
    apart = mesh.points[wheel][:, None] - mesh.points[~wheel][None]
    gap = np.linalg.norm(apart, axis=2) - radius[wheel][:, None] - radius[~wheel][None]
    assert gap.min() == pytest.approx(0.0, abs=1e-9)
    # and the beams are where spheres of one plate touch
    i, j = mesh.cells_dict["line"].T
    assert np.all(wheel[i] == wheel[j])
    assert np.all(np.linalg.norm(mesh.points[i] - mesh.points[j], axis=1) <= radius[i] + radius[j] + 1e-12)


def test_a_calibration_is_written_with_its_figures(place, monkeypatch):
    from meso import cli
    from meso.lattice.calibration import read_calibration

    monkeypatch.setattr(cli, "RADIUS_RATIOS", (0.3, 0.5))
    monkeypatch.setattr(cli, "MODULI", (1.0, 2.0))
    shown = meso("calibrate", "--spheres", "200", "--packings", "2", "--poisson-ratio", "0.25", "-o", "steel")
    assert shown.exit_code == 0, shown.stderr
    assert names(place / "steel") == {
        "calibration.toml", "beams.toml", "influence_radius.png", "influence_modulus.png",
    }  # fmt: skip
    found = read_calibration((place / "steel" / "calibration.toml").read_text())
    assert found.poisson_ratio == 0.25
    assert (found.spheres, found.packings) == (200, 2)
    settings = load(place / "steel" / "beams.toml")
    assert settings.material.poisson_ratio == 0.25
    assert settings.beams == found.beams(206e3)
    assert f"Radius ratio    {found.radius_ratio:.4f} for a Poisson ratio of 0.25" in shown.stdout
    assert f"Scatter         {found.modulus_scatter:.1%} of the modulus" in shown.stdout
    shown = meso("calibrate", "--spheres", "200", "--packings", "1", "--no-figures", "-o", "plain")
    assert names(place / "plain") == {"calibration.toml", "beams.toml"}
