"""What a friction test leaves behind: folder, curves, summary, data, pictures, progress."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest

from macrofit.base import figure
from meso.errors import OutputError
from meso.figures import plates as plots
from meso.figures import render as picture
from meso.monitor import Lines, Progress, Silent, on_screen
from meso.records import Breaks, Curve, Slide, Work
from meso.results import folder as output
from meso.results import summary as report
from meso.settings import Settings, decode, load
from meso.surfaces.surface import Surface


def curve(normal: list[float], tangential: list[float], way: float = 1.0) -> Curve:
    """Forces at evenly spaced places, each for its share of the way."""
    n = len(normal)
    step = way / n
    return Curve(
        displacement=step * np.arange(1, n + 1), start=0.0, normal=np.array(normal), tangential=np.array(tangential),
        height=np.zeros(n), share=np.full(n, 1.0 / n), tangential_work=step * float(np.sum(tangential)),
        lateral=0.5 * np.array(tangential),
    )  # fmt: skip


def slide(micro: float = 0.07, meso: float = 0.08, **changed: object) -> Slide:
    """A slide with a meso coefficient of exactly this."""
    normal = 4 * [100.0, 150.0, 50.0, 100.0]  # eight rows are the least for an uncertainty
    given = {
        "micro_friction": micro, "engine": "quasi-static", "squeeze": curve([0.0, 50.0], [0.0, 1.0], way=0.01),
        "curve": curve(normal, [meso * 100.0 + d for d in 4 * (2.0, -2.0, 1.0, -1.0)]),
        "work": Work(drive=8.0, friction=7.0, elastic=0.5, contact=0.25),
        "steps": 12, "bond_steps": 0, "unconverged_increments": 0, "largest_residual": 1e-4, "cpu_s": 0.5,
    }  # fmt: skip
    return Slide(**(given | changed))


def read_csv(path):
    header, *rows = path.read_text().splitlines()
    return header, np.array([[float(cell) for cell in row.split(",")] for row in rows])


# --- folder


def test_a_new_folder_gets_the_settings_and_they_load(tmp_path):
    settings = decode({"load": {"pressure": 99.5}})
    output.prepare(tmp_path / "a" / "b", settings)
    assert load(tmp_path / "a" / "b" / "settings.toml") == settings


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "settings.toml").write_text("title = 'mine'\n")
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(OutputError, match="is not empty and holds no run of macrofit-meso; choose another"):
        output.prepare(tmp_path, Settings())
    assert (tmp_path / "settings.toml").read_text() == "title = 'mine'\n"
    assert (tmp_path / "summary.json").exists()


def test_the_results_of_an_earlier_run_go_and_the_rest_stays(tmp_path):
    output.prepare(tmp_path, Settings())
    ours = ["summary.json", "curve.csv", "curve_0.07.csv", "squeeze.csv", "run.h5", "breaks_0.1.csv", *output.FIGURES]
    theirs = ["notes.txt", "my.png", "curves.csv"]
    for name in (*ours, *theirs):
        (tmp_path / name).write_text("x")
    output.prepare(tmp_path, Settings())
    assert {path.name for path in tmp_path.iterdir()} == {"settings.toml", *theirs}


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="file: cannot be written"):
        output.prepare(tmp_path / "file", Settings())


# --- curves


def test_the_curve_keeps_every_digit(tmp_path):
    rough = slide(curve=curve([1 / 3, 0.0, 2e17], [1e-300, 5.0, 0.1]))
    output.write_slide(tmp_path, rough, first=True, several=False)
    header, rows = read_csv(tmp_path / "curve.csv")
    assert header == "displacement_mm,normal_force_N,tangential_force_N,friction,lateral_force_N"
    forces = (rough.curve.normal, rough.curve.tangential, rough.curve.friction, rough.curve.lateral)
    columns = (rough.curve.displacement, *forces)
    np.testing.assert_array_equal(rows, np.stack(columns, axis=1))  # nan where there is no contact
    assert np.isnan(rows[1, 3])
    header, rows = read_csv(tmp_path / "squeeze.csv")
    assert header.startswith("approach_mm,")
    np.testing.assert_array_equal(rows[:, 0], rough.squeeze.displacement)
    assert {path.name for path in tmp_path.iterdir()} == {"curve.csv", "squeeze.csv"}


def test_of_several_slides_each_has_its_curve_and_the_first_the_plain_name(tmp_path):
    for number, (micro, meso) in enumerate([(0.03, 0.04), (0.07, 0.08)]):
        output.write_slide(tmp_path, slide(micro, meso), first=number == 0, several=True)
    assert {path.name for path in tmp_path.glob("curve*")} == {"curve.csv", "curve_0.03.csv", "curve_0.07.csv"}
    plain, first, second = (read_csv(tmp_path / f"curve{name}.csv")[1] for name in ("", "_0.03", "_0.07"))
    np.testing.assert_array_equal(plain, first)
    assert second[0, 2] - first[0, 2] == pytest.approx(4.0)


def test_broken_beams_are_listed(tmp_path):
    breaks = Breaks(
        time=[1e-6, 2e-6], slide=[0.1, 0.2], mode=["tension", "shear"], place=[(0.1, 0.2, 0.3), (1.0, 2.0, 3.0)]
    )
    output.write_slide(tmp_path, slide(breaks=breaks), first=True, several=False)
    lines = (tmp_path / "breaks_0.07.csv").read_text().splitlines()
    assert lines == [
        "time_s,slide_mm,mode,x_mm,y_mm,z_mm",
        "1e-06,0.1,tension,0.1,0.2,0.3",
        "2e-06,0.2,shear,1.0,2.0,3.0",
    ]


# --- numbers


def test_the_numbers_of_a_slide():
    numbers = report.slide_numbers(slide(steps=1000, bond_steps=4_000_000, engine="explicit", remark="why"))
    assert numbers["meso_friction"] == pytest.approx(0.08, rel=1e-14)  # mean T 8 N over mean N 100 N
    assert numbers["mean_tangential_force_N"] == pytest.approx(8.0)
    assert numbers["mean_normal_force_N"] == pytest.approx(100.0)
    assert numbers["meso_friction_mean_of_ratio"] == pytest.approx((10 / 100 + 6 / 150 + 9 / 50 + 7 / 100) / 4)
    assert numbers["approach_mm"] == pytest.approx(0.01)
    assert numbers["bond_steps_per_s"] == pytest.approx(8e6)
    assert numbers["work"]["friction_N_mm"] == 7.0
    assert numbers["work"]["imbalance"] == pytest.approx(0.25 / 8.0)
    assert numbers["remark"] == "why"
    assert report.slide_numbers(slide())["bond_steps_per_s"] is None
    assert report.slide_numbers(slide())["remark"] is None


def test_the_affine_fit_is_that_of_the_slides():
    line = [slide(micro, 1.03 * micro - 0.002) for micro in (0.01, 0.07, 0.15)]
    fit = report.affine(line)
    assert fit == pytest.approx((1.03, -0.002, 0.0), abs=1e-13)
    bent = report.affine([*line, slide(0.3, 1.03 * 0.3 - 0.002 + 0.01)])
    assert 1e-3 < bent.largest_residual < 1e-2


@pytest.mark.parametrize(
    "slides",
    [[slide()], [slide(0.07), slide(0.07)], [slide(0.03), slide(0.07, curve=curve([0.0] * 4, [0.0] * 4))]],
    ids=["one", "the same twice", "no contact"],
)
def test_no_line_through_less_than_two_points(slides):
    assert report.affine(slides) is None


def test_what_does_not_exist_is_null(tmp_path):
    output.write_summary(tmp_path, report.slide_numbers(slide(curve=curve([0.0] * 4, [0.0] * 4))))
    numbers = json.loads((tmp_path / "summary.json").read_text())
    assert numbers["meso_friction"] is None
    assert numbers["uncertainty"] is None


def closing_words(*slides: Slide, resonance: dict[str, float] | None = None) -> str:
    fit = report.affine(slides)
    sq = {"Sq_mm": 3e-3, "filtered": {"Sq_mm": 8e-4}}
    rough = sq | {"profile": {"Ra_mm": 6.1e-4}, "envelope": {"Sq_mm": 0.024, "filtered": {"Sq_mm": 0.023}}}
    numbers = {
        "slides": [report.slide_numbers(each) for each in slides], "packing_cpu_s": 0.25, "run_cpu_s": 1.5,
        "affine_fit": None if fit is None else fit._asdict(), "roughness": dict.fromkeys(("wheel", "axle"), rough),
        "resonance": resonance,
    }  # fmt: skip
    return "\n".join(report.sentences(numbers))


def test_the_closing_words():
    words = closing_words(slide())
    assert "Meso friction   0.0800 ± " in words
    assert "for micro 0.07: mean T 8 N over mean N 100 N" in words
    assert "about 0.11 for micro 0.07; slid slowly, pairs of this model give 1.02 to 1.05 times the micro" in words
    assert "quasi-static; 0.25 s of CPU for the plates, 1.50 s for the rest" in words
    assert "Affine" not in words
    said = "axle: Ra 0.61 µm; Sq 3 µm, 0.8 behind the filter of 0.8 mm; envelope of its spheres 24 and 23 µm"
    assert f"Roughness       {said}" in words


def test_plates_that_sway_are_not_compared_with_slow_ones():
    words = closing_words(slide(engine="explicit"), resonance={"f_d_mm_s": 9e3})
    assert "about 0.11 for micro 0.07, and so does the preset as-published" in words
    assert "slid slowly" not in words


def test_the_closing_words_of_several():
    far = slide(0.5, 0.51, engine="explicit", remark="no equilibrium")
    words = closing_words(slide(0.1, 0.11), far)
    assert "Affine fit      meso = 1.0000 micro +0.0100\n" in words
    assert "Lalleman" not in words  # says nothing about other micro coefficients
    assert "Doubt           micro 0.5: no equilibrium" in words
    assert "quasi-static and explicit" in words


def test_the_closing_words_of_beams_that_broke():
    breaks = Breaks(time=[1e-6], slide=[0.1], mode=["shear"], place=[(0.1, 0.2, 0.3)])
    words = closing_words(slide(breaks=breaks))
    assert "Broken beams    micro 0.07: 1\n" in words
    assert "Lalleman" not in words  # their plates do not break
    assert "Broken" not in closing_words(slide())


def test_the_closing_words_without_contact():
    words = closing_words(slide(curve=curve([0.0] * 4, [0.0] * 4)))
    assert "none for micro 0.07: the plates do not touch" in words
    assert "nan" not in words


# --- surfaces


@pytest.fixture
def tilted() -> Surface:
    return Surface(np.arange(12.0).reshape(4, 3) * 1e-3 / 7.0, (1.5, 1.0))


@pytest.mark.parametrize("suffix", [".npy", ".csv"])
def test_heights_are_read_back(tilted, tmp_path, suffix):
    path = output.write_surface(tmp_path / f"face{suffix}", tilted, 0.3)
    read = np.load(path) if suffix == ".npy" else np.loadtxt(path, delimiter=",")
    np.testing.assert_array_equal(read, tilted.heights)


def test_a_hull_is_closed_and_has_the_volume_of_the_plate(tilted, tmp_path):
    meshio = pytest.importorskip("meshio")
    mesh = meshio.read(output.write_surface(tmp_path / "face.vtk", tilted, 0.3))
    a, b, c = np.moveaxis(mesh.points[mesh.cells_dict["triangle"]], 1, 0)
    volume = np.sum(a * np.cross(b, c)) / 6.0
    assert volume == pytest.approx(1.5 * (0.3 + tilted.heights.mean()), rel=1e-6)  # a tilted plane


def test_a_surface_of_another_kind_of_file_is_refused(tilted, tmp_path):
    with pytest.raises(OutputError, match=r"is written as \.png, \.npy, \.csv, \.stl"):
        output.write_surface(tmp_path / "face.jpg", tilted, 0.3)
    assert not list(tmp_path.iterdir())


# --- pictures


def test_a_sphere_is_a_disc_of_its_size_and_colour():
    image, (left, right, bottom, top) = picture.draw(
        picture.View(), np.array([[3.0, 2.0, 1.0]]), np.array([0.5]), np.array([[1.0, 0.0, 0.0]]), 200
    )
    pixel = (right - left) / image.shape[1]
    assert (top - bottom) / image.shape[0] == pytest.approx(pixel)
    area = image[..., 3].sum() / 255.0 * pixel**2
    assert area == pytest.approx(np.pi * 0.25, rel=0.01)
    middle = image[image.shape[0] // 2, image.shape[1] // 2]
    assert middle[3] == 255
    assert middle[0] > 2.0 * middle[1]


def test_light_comes_from_the_left_and_from_above():
    image, _ = picture.draw(picture.View(), np.zeros((1, 3)), np.array([0.5]), np.array([[0.5, 0.5, 0.5]]), 100)
    tone = image[..., 0].astype(int)
    half = tone.shape[1] // 2
    assert tone[:, :half].sum() > 1.1 * tone[:, half:].sum()
    assert tone[: tone.shape[0] // 2].sum() > 1.1 * tone[tone.shape[0] // 2 :].sum()


def test_what_is_nearer_hides_what_is_behind():
    view = picture.View(azimuth=0.0, elevation=0.0)  # seen along +y
    colours = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for behind in (1.0, -1.0):
        centres = np.array([[0.0, 0.0, 0.0], [0.0, behind, 0.0]])
        image, _ = picture.draw(view, centres, np.array([0.5, 0.5]), colours, 50)
        red, blue = image[image.shape[0] // 2, image.shape[1] // 2, [0, 2]].astype(int)
        assert (red > blue) == (behind > 0.0)


def test_the_picture_is_the_right_way_up():
    view = picture.View()
    assert view.flat([0.0, 0.0, 1.0])[1] > 0.0
    assert view.flat([1.0, 0.0, 0.0])[0] > 0.0
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(view.axes) == pytest.approx(1.0)
    centres = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    image, _ = picture.draw(view, centres, np.array([0.5, 0.5]), np.array([[1.0, 0, 0], [0, 0, 1.0]]), 50)
    upper = image[: image.shape[0] // 2].astype(int)
    assert upper[..., 2].sum() > upper[..., 0].sum()  # the blue one is above


def test_only_what_is_inside_is_left_out():
    rng = np.random.default_rng(0)
    centres, radii = rng.random((4000, 3)), np.full(4000, 0.02)
    shown = picture.outside(picture.View(), centres, radii)
    assert 0.1 < shown.mean() < 0.6
    x, y, z = centres.T
    assert shown[(x > 0.93) | (y < 0.07) | (z > 0.93)].all()
    assert not shown[(x < 0.8) & (y > 0.2) & (z < 0.8)].any()


# --- figures


@pytest.mark.parametrize(
    "slides",
    [
        [slide()],
        [slide(0.01 * k, 0.01 * k) for k in range(9)],
        [slide(curve=curve([0.0] * 4, [0.0] * 4))],
        [slide(curve=curve([100.0, 1e-9, 100.0, 100.0], [8.0, 7.0, 8.0, 8.0]))],
    ],
    ids=["one", "nine", "no contact", "contact nearly lost"],
)
def test_forces_are_drawn(slides, tmp_path):
    path = figure.save(plots.forces(slides), tmp_path / "forces.png")
    assert path.read_bytes()[:4] == b"\x89PNG"


def test_the_mean_and_its_band_are_in_the_figure():
    one = slide()
    axes = plots.forces([one]).axes[2]
    patch = axes.patches[0]
    band = (patch.get_transform() - axes.transData).transform_path(patch.get_path()).get_extents().intervaly
    error = one.curve.uncertainty
    assert error > 1e-3
    np.testing.assert_allclose(band, [0.08 - error, 0.08 + error])
    assert any(np.allclose(line.get_ydata(), 0.08) for line in axes.lines)


def test_a_loss_of_contact_does_not_rule_the_scale():
    n = 100
    lost = curve([100.0] * (n - 1) + [1e-9], [8.0] * n)
    high = plots.forces([slide(curve=lost)]).axes[2].get_ylim()[1]
    assert high < 1.0


def test_the_map_shows_heights_in_micrometres(tilted):
    drawn = plots.surface(tilted, "A face")
    axes, bar = drawn.axes
    assert bar.get_ylabel() == "height [µm]"
    assert bar.get_ylim() == pytest.approx((0.0, 11.0 / 7.0))
    assert axes.images[0].get_extent() == pytest.approx((0.0, 1.5, 0.0, 1.0))
    assert axes.images[0].origin == "lower"
    rgb = axes.images[0].get_array()  # the last row is the highest y
    assert rgb[-1, -1].sum() > rgb[0, 0].sum()


# --- progress


def test_lines_tell_what_is_done_and_how_long_it_took():
    stream = io.StringIO()
    monitor = Lines(stream)
    monitor.started(2)
    monitor.stage("plates")
    assert stream.getvalue() == ""
    monitor.done("Plates        3 spheres")
    monitor.finished()
    text = stream.getvalue()
    assert text.startswith("Plates        3 spheres  (0.0")
    assert text.endswith(" s)\n")


def test_the_monitor_suits_the_output(monkeypatch):
    assert isinstance(on_screen(quiet=True), Silent)
    for terminal, kind in ((True, Progress), (False, Lines)):
        monkeypatch.setattr("sys.stdout", type("Screen", (io.StringIO,), {"isatty": lambda self, yes=terminal: yes})())
        monitor = on_screen(quiet=False)
        assert isinstance(monitor, kind)
    monitor = Progress()
    monitor.started(1)
    monitor.stage("[plates]")  # no markup
    monitor.done("[plates]")
    monitor.finished()
    monitor.finished()


def test_the_curve_of_the_slide_is_the_one_in_the_words():
    line = report.slide_line(slide(steps=258))
    assert line.startswith("Micro 0.07    meso 0.0800 ± ")
    assert line.endswith("quasi-static, 258 increments")
    assert report.slide_line(slide(steps=9, bond_steps=9)).endswith("9 steps")
