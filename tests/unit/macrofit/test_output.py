"""The files of a run, what the summary says, and the figures (lightly)."""

from __future__ import annotations

import dataclasses
import json
import os
import resource
from contextlib import contextmanager
from pathlib import Path

import h5py
import meshio
import msgspec
import numpy as np
import pytest
from fakes import SEAT_RADIUS, fake_field, fake_increment, fake_scene, fake_solution
from matplotlib.figure import Figure
from matplotlib.image import imread

from macrofit.acceptance import verdict as press_fit_verdict
from macrofit.base.figure import png, save
from macrofit.base.files import replacing
from macrofit.bodies import outlook
from macrofit.errors import OutputError
from macrofit.figures import curves as plots
from macrofit.figures.body import (
    SHORTEST,
    _outline,
    _split,
    deformed,
    draw_axis,
    draw_yield,
    largest_node,
    pushed_to,
    whole_window,
)
from macrofit.figures.friction import FLATTEST
from macrofit.figures.stress import stress
from macrofit.monitor import Lines, Progress, Several
from macrofit.report import write_report
from macrofit.results import folder as output
from macrofit.results import summary as report
from macrofit.results.curves import read_curves, without_rounding
from macrofit.results.kinds import KINDS
from macrofit.scene import build_scene, load_scene
from macrofit.scene.keys import OutputKeys
from macrofit.solution import PairFrictionMap, Tiling
from macrofit.stress import _fields_at

HEADER = (
    "displacement_mm,force_N,normal_force_N,mean_friction,max_pressure_MPa,active_facets,"
    "sticking_facets,newton_iterations,wall_s"
)


@contextmanager
def small_files():
    """Files cannot grow beyond 4 kB: the error of a full disk without a disk.

    Not a fixture: pytest writes its own line, perhaps to a file, before it tears fixtures down.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_the_curve_is_on_disk_after_every_increment(tmp_path):
    curve = output.CurveFile(tmp_path)
    path = tmp_path / "fitting_curve.csv"
    assert path.read_text() == HEADER + "\n"
    for k in range(3):
        record = fake_increment(k, 0.1 * k, 1e5 / 3.0)
        curve.increment(record)
        row = path.read_text().splitlines()[k + 1].split(",")
        assert len(row) == len(HEADER.split(","))
        assert float(row[0]) == 0.1 * k  # to the bit
        assert float(row[1]) == 1e5 / 3.0
        assert int(row[5]) == record.active_facets
    curve.finished()
    curve.finished()
    displacement, force = output.read_curve(tmp_path)
    np.testing.assert_array_equal(displacement, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(force, [1e5 / 3.0] * 3)


def test_a_resumed_curve_has_every_increment_once(tmp_path):
    before = [fake_increment(k, float(k), 0.0) for k in range(3)]
    curve = output.CurveFile(tmp_path, before)
    for record in (*before, fake_increment(3, 3.0, 1.0)):  # told again of what is there already
        curve.increment(record)
    assert [record.index for record in curve.records] == [0, 1, 2, 3]
    np.testing.assert_array_equal(output.read_curve(tmp_path)[0], [0.0, 1.0, 2.0, 3.0])


def test_a_full_disk_leaves_whole_rows(tmp_path):
    with small_files():
        curve = output.CurveFile(tmp_path)

        def fill() -> None:
            for k in range(1000):
                curve.increment(fake_increment(k, 0.1 * k, 1e5 / 3.0))

        with pytest.raises(OutputError, match=r"fitting_curve\.csv: cannot be written: .*make room"):
            fill()
        assert len(output.read_curve(tmp_path)[0]) == len(curve.records)


def test_a_full_disk_leaves_the_earlier_file(tmp_path):
    with small_files():
        solution = fake_solution()
        (tmp_path / "interface.h5").write_bytes(b"earlier")
        with pytest.raises(OutputError, match=r"interface\.h5: cannot be written"):
            output.write_interface(tmp_path, solution.scene, solution.seat, solution.increments)
        with pytest.raises(OutputError, match=r"fitting_curve\.png: cannot be written"):
            plots.write_figures(tmp_path, solution)
        assert (tmp_path / "interface.h5").read_bytes() == b"earlier"
        assert os.listdir(tmp_path) == ["interface.h5"]


def test_what_fails_halfway_leaves_no_trace(tmp_path):
    (tmp_path / "a.txt").write_text("earlier")

    def write_half() -> None:
        with replacing(tmp_path / "a.txt") as draft:
            draft.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_half()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["earlier"]


def test_a_folder_with_something_else_is_refused(tmp_path):
    output.prepare(tmp_path / "new" / "deep", owned=False)
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="not empty and holds no run of macrofit"):
        output.prepare(tmp_path, owned=False)
    (tmp_path / "journal.bin").write_text("of another program")
    with pytest.raises(OutputError, match="not empty and holds no run of macrofit"):
        output.prepare(tmp_path, owned=False)
    output.prepare(tmp_path, owned=True)
    with pytest.raises(OutputError, match=r"thesis\.tex: cannot be written"):
        output.prepare(tmp_path / "thesis.tex", owned=False)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.what)
def test_a_folder_of_another_command_is_named(tmp_path, kind):
    """Begun or finished, it is refused by what it is, and so is its page where it is not finished or has none."""
    (tmp_path / kind.mark).write_bytes(b"macrofit ")
    for _ in ("begun", "finished"):
        with pytest.raises(OutputError, match=f": holds {kind.what}, of {kind.command}; choose another folder"):
            output.prepare(tmp_path, owned=False)
        (tmp_path / kind.numbers).write_text("{}")
    with pytest.raises(OutputError, match="curve.csv: cannot be" if kind.mark == "journal.bin" else "no fitting curve"):
        read_curves(tmp_path)
    if kind.mark == kind.numbers:
        with pytest.raises(OutputError, match=f": holds {kind.what}, which has no page"):
            write_report(tmp_path)
        return
    (tmp_path / kind.numbers).unlink()
    said = rf"{kind.what} that has not ended \({kind.numbers} is missing\); continue it with {kind.command} --resume"
    with pytest.raises(OutputError, match=said):
        write_report(tmp_path)


def test_clearing_removes_results_only(tmp_path):
    solution = fake_solution()
    output.write_fields(tmp_path, solution)
    output.write_summary(tmp_path, {})
    for page in ("report.html", "report.pdf"):
        (tmp_path / page).write_text("of them")
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "fields" / "view.pvsm").write_text("mine")
    output.clear(tmp_path)
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {"notes.txt", "view.pvsm"}


def test_the_scene_is_read_back_the_same(tmp_path):
    output.write_scene(tmp_path, fake_scene())
    assert load_scene(tmp_path / "scene.toml") == fake_scene()


def test_the_interface_has_every_increment_and_facet(tmp_path):
    solution = fake_solution()
    output.write_interface(tmp_path, solution.scene, solution.seat, solution.increments)
    with h5py.File(tmp_path / "interface.h5") as file:
        np.testing.assert_array_equal(file["displacement"], solution.displacement)
        np.testing.assert_array_equal(file["facet_start"], solution.seat[:-1])
        np.testing.assert_array_equal(file["facet_end"], solution.seat[1:])
        assert file["z"].shape == (10, 25)
        assert file["z"][3, 0] == -4.5
        for name in ("pressure", "traction", "slip", "accumulated_slip", "gap", "status", "friction"):
            for k, record in enumerate(solution.increments):
                np.testing.assert_array_equal(file[name][k], getattr(record.facets, name))
        assert file["pressure"].attrs["unit"] == "MPa"
        assert file["gap"].attrs["unit"] == "mm"
        assert "unit" in file["status"].attrs


@pytest.mark.parametrize("seat", [None, np.zeros(4)])
def test_an_unknown_seat_is_left_open(tmp_path, seat):
    output.write_interface(tmp_path, fake_scene(), seat, [fake_increment(0, 0.0, 0.0)])
    output.write_interface(tmp_path, fake_scene(), None, [])  # and no increment at all
    output.write_interface(tmp_path, fake_scene(), seat, [fake_increment(0, 0.0, 0.0)])
    with h5py.File(tmp_path / "interface.h5") as file:
        assert np.isnan(file["facet_start"]).all()
        assert file["pressure"].shape == (1, 25)


def test_the_seat_of_a_drawn_axle_is_known_beforehand():
    seat = outlook.seat_ends(fake_scene())
    np.testing.assert_allclose(seat, np.arange(-5.0, 20.5), atol=1e-12)


def test_fields_put_middles_where_vtk_wants_them(tmp_path):
    solution = fake_solution()
    keys = msgspec.structs.replace(solution.scene.output, fields=("displacement", "von_mises", "stress"))
    scene = msgspec.structs.replace(solution.scene, output=keys)
    output.write_fields(tmp_path, dataclasses.replace(solution, scene=scene))
    mesh = meshio.read(tmp_path / "fields" / "wheel_0000.vtu")
    (block,) = mesh.cells
    assert block.type == "triangle6"
    corner = mesh.points[block.data]
    for k, (a, b) in enumerate([(0, 1), (1, 2), (2, 0)]):
        np.testing.assert_array_equal(corner[:, 3 + k], 0.5 * (corner[:, a] + corner[:, b]))
    assert mesh.point_data["displacement"].shape == (9, 3)
    field = solution.fields[18.0]["wheel"]
    np.testing.assert_array_equal(mesh.point_data["von_mises"], field.von_mises)
    np.testing.assert_array_equal(mesh.point_data["stress_rz"], field.stress[:, 3])
    text = (tmp_path / "fields" / "wheel.pvd").read_text()
    assert 'timestep="18.0"' in text
    assert 'file="wheel_0000.vtu"' in text


def test_linear_triangles_are_written_and_drawn(tmp_path):
    bodies = {"axle": fake_field(quadratic=False), "wheel": fake_field(4.0, quadratic=False)}
    solution = dataclasses.replace(fake_solution(), fields={18.0: bodies})
    output.write_fields(tmp_path, solution)
    assert meshio.read(tmp_path / "fields" / "axle_0000.vtu").cells[0].type == "triangle"
    assert len(plots.write_figures(tmp_path, solution)) == 4


def test_only_the_fields_asked_for_are_written(tmp_path):
    output.write_fields(tmp_path, fake_solution())
    mesh = meshio.read(tmp_path / "fields" / "axle_0000.vtu")
    assert set(mesh.point_data) == {"displacement", "von_mises"}


def test_the_summary_has_its_numbers_and_is_plain_json(tmp_path):
    solution = dataclasses.replace(fake_solution(), energy_balance=float("nan"))
    numbers = report.summary(solution)
    output.write_summary(tmp_path, numbers)
    read = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert read["peak_force_N"] == read["final_force_N"] == 7.6e5
    assert read["peak_force_displacement_mm"] == 18.0
    assert read["interference_radial_mm"] == 0.15
    assert read["interference_diametral_mm"] == 0.3
    assert read["max_von_mises_MPa"]["axle"] == {
        "value": 512.9, "r_mm": 93.5, "z_mm": 1.0, "displacement_mm": 18.0
    }  # fmt: skip
    assert read["increments"] == 10
    assert read["unconverged_increments"] == 0
    assert read["newton_iterations"] == 30
    assert read["total_cpu_s"] == 1.75
    assert read["energy_balance"] is None
    assert {"macrofit", "python", "numpy"} <= set(read["versions"])
    assert read["verdict"]["en_13260"]["inside"]
    assert read["verdict_reason"] is None
    assert any("0.3 mm on the diameter" in line for line in report.sentences(numbers))


@pytest.mark.parametrize(
    ("final", "european", "russian"),
    [(0.84, False, False), (0.86, True, False), (1.0, True, True), (1.44, True, True), (1.46, False, True)],
)
def test_the_windows_of_the_standards(final, european, russian):
    """EN 13260: 0.85 to 1.45 times 4e-3 d MN; GOST 11018: 392 to 588 kN per 100 mm, 0.98 to 1.47 of it."""
    nominal = 4e-3 * 2.0 * SEAT_RADIUS * 1e6
    judged, _ = press_fit_verdict(fake_solution(force=np.linspace(0.0, final * nominal, 10)))
    assert judged.final_force == pytest.approx(final * nominal)
    assert judged.en_13260.inside is european
    assert judged.gost_11018.inside is russian
    assert ("inside" in judged.sentence) is (european or russian)


def test_a_reversal_ends_what_is_judged():
    scene = fake_scene(displacements=[0.0, 6.0, 12.0, 18.0, 12.0, 6.0])
    judged, _ = press_fit_verdict(fake_solution(scene, np.array([0.0, 2e5, 5e5, 7e5, -9e5, -4e5])))
    assert judged.final_force == 7e5
    assert judged.check("oscillation_depth").value == 0.0


def test_no_verdict_without_a_press_fit():
    """Without two radii there is none; without a curve it is without windows, and says why."""
    disc = {"shape": "disc", "radius": 10.0, "thickness": 5.0}
    axial = build_scene({"axle": disc, "wheel": disc, "motion": {"travel": 0.1, "increment": 0.1}})
    assert report.summary(fake_solution(axial))["verdict"] is None
    assert "not drawn with two radii" in report.summary(fake_solution(axial))["verdict_reason"]
    shrunk = fake_scene(start=2.0, travel=6.0)
    for solution, reason in [
        (fake_solution(shrunk), "not pushed on from the entrance"),
        (fake_solution(force=np.zeros(10)), "no force"),
        (fake_solution(fake_scene(travel=6.0), np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])), "by 6 mm only"),
    ]:
        numbers = report.summary(solution)
        assert reason in numbers["verdict_reason"]
        assert numbers["verdict"]["word"] in ("undecided", "refused")
        assert numbers["verdict"]["en_13260"] is None
        assert "final_force" not in [check["name"] for check in numbers["verdict"]["checks"]]


def test_first_touch_of_drawn_bodies():
    """The taper (95 at z = 0, 94.5 at z = -5) reaches the bore's 94.85 mm at z = -1.5."""
    fine = fake_scene(displacements=np.round(np.arange(-4.0, 1.0, 0.1), 1).tolist())
    assert outlook.first_touch(fine) == pytest.approx(-1.4, abs=1e-9)
    sphere = {"shape": "disc", "radius": 10.0, "thickness": 9.0, "crown_radius": 20.0}
    flat = {"shape": "disc", "radius": 10.0, "thickness": 9.0}
    pressed = build_scene({"axle": sphere, "wheel": flat, "motion": {"start": 0.0, "travel": 0.3, "increment": 0.1}})
    assert outlook.first_touch(pressed) == pytest.approx(0.1)
    loose = build_scene({"axle": {"seat_radius": 95.0, "seat_length": 20.0},
                         "wheel": {"bore_radius": 95.1, "hub_length": 20.0, "hub_outer_radius": 140.0},
                         "motion": {"travel": 5.0}})  # fmt: skip
    assert outlook.first_touch(loose) is None


def test_lines_and_bar_say_where_the_wheel_is(capsys):
    pytest.importorskip("rich")
    monitor = Several(Lines(), Progress())
    monitor.started(fake_scene(), 2, 1234)
    monitor.increment(dataclasses.replace(fake_increment(1, 2.0, 1.5e5), cutbacks=3, converged=False))
    monitor.finished()
    monitor.finished()
    lines = capsys.readouterr().out.splitlines()
    assert "A short fit: 2 increments, 1234 degrees of freedom" in lines[0]
    assert "2/2" in lines[1]
    assert " 150 kN" in lines[1]
    assert "cutbacks 3  not converged" in lines[1]


def test_figures_are_drawn(tmp_path):
    paths = plots.write_figures(tmp_path, fake_solution())
    assert {path.name for path in paths} == {
        "fitting_curve.png", "interface.png", "stress.png", "stress_entrance.png"
    }  # fmt: skip
    for path in paths:
        assert path.read_bytes()[:4] == b"\x89PNG"


def test_rounding_is_no_force_for_people():
    """A wheel that cools in place needs no force: what is left of 1e-9 of the normal forces is said and drawn as 0."""
    force, normal = np.array([1.8e-8, -9e-9, 2.0, 5e5]), np.array([0.0, 8e6, 8e6, 8e6])
    assert without_rounding(force, normal).tolist() == [0.0, 0.0, 2.0, 5e5]
    assert without_rounding(force[:0], normal[:0]).tolist() == []


def test_figures_without_contact_or_fields(tmp_path):
    solution = dataclasses.replace(fake_solution(force=np.zeros(10)), fields={}, max_von_mises={})
    assert [path.name for path in plots.write_figures(tmp_path, solution)] == ["fitting_curve.png"]


def test_the_curve_marks_its_peak_and_a_window_that_fits():
    figure = plots.fitting_curve(fake_solution())
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert "peak 760 kN at 18 mm" in texts
    assert any("EN 13260" in text for text in texts)
    far = plots.fitting_curve(fake_solution(force=np.linspace(0.0, 1e4, 10)))
    assert not any("EN 13260" in text.get_text() for text in far.axes[0].texts)


@pytest.mark.parametrize("top", [1400.0, 1800.0, 2700.0])
def test_the_words_on_the_windows_do_not_cover_the_curve(top):
    figure, axes = plots.curve_sheet()
    x = np.linspace(0.0, 180.0, 181)
    axes.plot(x, top * x / 180.0)
    judged, _ = press_fit_verdict(fake_solution())
    plots.draw_windows(axes, judged, [(x, top * x / 180.0)])
    plots.label_curve(axes, "")
    figure.draw_without_rendering()
    line = axes.transData.transform(np.column_stack([x, top * x / 180.0]))
    assert len(axes.texts) == 2
    for text in axes.texts:
        box = text.get_window_extent()
        inside = (line[:, 0] > box.x0) & (line[:, 0] < box.x1) & (line[:, 1] > box.y0) & (line[:, 1] < box.y1)
        assert not inside.any()


def words_of(axes):
    return [text.get_text() for text in axes.texts]


def test_the_stress_picture_names_what_it_shows():
    """Bodies, push and the largest stress; true to scale."""
    solution = fake_solution()
    axes, bar = stress(solution).axes
    said = words_of(axes)
    assert {"axle", "wheel", "push"} <= set(said)
    assert any("largest of the run" in text for text in said)
    assert "MPa" in bar.get_ylabel()
    low, high = axes.get_ylim()
    across, up = (axes.get_position().size * axes.figure.get_size_inches()).tolist()
    z0, z1 = axes.get_xlim()
    assert across / (z1 - z0) == pytest.approx(up / (high - low))


@pytest.mark.parametrize(
    ("keys", "displacement", "pushes"),
    [
        ((), 180.0, True),
        (("motion.release=true",), 179.9, False),
        (("motion.displacements=[10, 40, 30]",), 30.0, False),
        (("motion.displacements=[10, 40, 30, 35]",), 35.0, True),
        (("motion.start=90", "motion.travel=100"), 90.0, True),
        (("motion.start=90", "motion.travel=100", "wheel.temperature=200", "motion.cooling=3"), 90.0, False),
        (("contact.direction=axial",), 180.0, False),
    ],
)
def test_a_push_leads_forwards(keys, displacement, pushes):
    """Not to where the press lets go, pulls, or a wheel cools in place."""
    scene = load_scene("press-and-pull" if "displacements" in "".join(keys) else "wheelset", keys)
    assert pushed_to(scene, displacement) is pushes


@pytest.mark.parametrize("away", [0.0, 0.05])
def test_a_released_press_is_shown_without_a_push(away):
    solution = fake_solution(fake_scene(travel=18.0, increment=2.0, release=True))
    fields = {18.0 - away: solution.fields[18.0]}
    axes, _ = stress(dataclasses.replace(solution, fields=fields)).axes
    assert ("push" in words_of(axes)) is (away == 0.0)


@pytest.mark.parametrize(("low", "said"), [(-5.0, ["axis of rotation"]), (0.0, ["axis of rotation"]), (90.0, [])])
def test_the_axis_is_named_where_it_is_seen(low, said):
    axes = Figure().add_subplot()
    draw_axis(axes, (np.array([low, 0.0]), np.array([100.0, 50.0])))
    assert words_of(axes) == said


def test_both_ends_of_the_contact_are_zoomed_on_one_scale():
    solution = fake_solution()
    entrance, leading, _ = stress(solution, zoom=6.0).axes
    assert "seat's entrance" in entrance.get_title()
    assert "leading edge" in leading.get_title()
    held = np.flatnonzero(solution.increments[-1].facets.pressure > 0.0)
    for axes, end in ((entrance, solution.seat[held[0]]), (leading, solution.seat[held[-1] + 1])):
        assert np.mean(axes.get_xlim()) == pytest.approx(end)
    drawn = [each for axes in (entrance, leading) for each in axes.collections if each.get_array() is not None]
    limits = {each.get_clim() for each in drawn}
    assert len(limits) == 1


def test_the_yield_stress_of_an_elastic_body_is_a_line():
    """Between the largest stress and the least; beyond them, and without a yield stress, there is none."""
    field = fake_field()
    low, high = float(field.von_mises.min()), float(field.von_mises.max())
    for bound, count in ((0.5 * (low + high), 1), (1.1 * high, 0), (None, 0)):
        axes = Figure().add_subplot()
        draw_yield(axes, field, whole_window([field]), bound)
        assert (len(axes.collections) > 0) == (count > 0)


def test_steps_of_several_displacements_do_not_cover_each_other():
    """A row for each, on one scale."""
    figure = plots.interface(fake_solution())
    rows = figure.axes[: len(figure.axes) // 2]
    assert [len(axes.patches) for axes in rows] == [1] * len(rows)
    assert len(rows) > 1
    assert len({axes.get_ylim() for axes in rows}) == 1
    assert len({axes.get_position().y0 for axes in rows}) == len(rows)


@pytest.mark.parametrize(
    ("titles", "title", "labels"),
    [
        (["A", "B"], "", ["A", "B"]),
        (["A", "A"], "A", ["one", "two"]),
        (["", ""], "", ["one", "two"]),
        (["A", "A", "B"], "", ["A (one)", "A (two)", "B"]),
    ],
)
def test_curves_are_called_by_titles_not_by_paths(titles, title, labels):
    assert plots.called(["one", "two", "three"][: len(titles)], titles) == (title, labels)


def test_an_overlay_has_the_windows_where_all_seats_are_of_one_diameter():
    same, _ = press_fit_verdict(fake_solution())
    other = msgspec.structs.replace(same, seat_diameter_mm=150.0)
    assert plots.common_window([same, None, same]) == same
    assert plots.common_window([same, other]) is None
    assert plots.common_window([None]) is None


def test_a_quadratic_triangle_is_shown_as_four(tmp_path):
    cells = np.array([[0, 1, 2, 3, 4, 5]])
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [0.0, 0.5], [0.5, 0.0]])
    a, b, c = (points[_split(cells)[:, k]] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    np.testing.assert_allclose(area, 0.125)
    assert {tuple(sorted(edge)) for edge in _outline(cells).tolist()} == {
        (0, 5), (1, 5), (1, 3), (2, 3), (2, 4), (0, 4)
    }  # fmt: skip


def test_curves_of_several_folders_in_one_figure(tmp_path):
    for name in ("a", "b"):
        output.prepare(tmp_path / name, owned=False)
        curve = output.CurveFile(tmp_path / name)
        curve.increment(fake_increment(0, 0.0, 1.0))
        curve.increment(fake_increment(1, 1.0, 2.0))
    target = plots.compare([tmp_path / "a", tmp_path / "b"], tmp_path / "both.png")
    assert target.read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(OutputError, match=r"none.*cannot be read"):
        plots.compare([tmp_path / "none"], target)


def test_a_study_is_plotted_with_the_labels_of_its_runs(tmp_path):
    """Runs of one motion share a column of displacements, others have each their own, of any length."""
    (tmp_path / "curves.csv").write_text(
        "displacement_mm,force_N run 1: mu = 0.1,force_N run 2\n0.0,0.0,0.0\n1.0,2.0,3.0\n"
    )
    first, second = read_curves(tmp_path)
    assert (first.label, second.label) == (f"{tmp_path.name}, mu = 0.1", f"{tmp_path.name}, run 2")
    np.testing.assert_array_equal([second.displacement, second.force], [[0.0, 1.0], [0.0, 3.0]])
    (tmp_path / "curves.csv").write_text(
        "displacement_mm run 1,force_N run 1: x,displacement_mm run 2,force_N run 2: y\n0.0,1.0,0.0,2.0\n5.0,3.0,,\n"
    )
    first, second = read_curves(tmp_path)
    np.testing.assert_array_equal([first.displacement, first.force], [[0.0, 5.0], [1.0, 3.0]])
    np.testing.assert_array_equal([second.displacement, second.force], [[0.0], [2.0]])
    assert plots.compare([tmp_path], tmp_path / "both.png").is_file()


@pytest.mark.parametrize(
    "text",
    ["", "a,b\n1,2\n", "force_N run 1\n1\n", "displacement_mm,force_N run 1\n0\n", "displacement_mm,force_N r\n0,x\n"],
)
def test_curves_that_are_no_study_are_refused(tmp_path, text):
    (tmp_path / "curves.csv").write_text(text)
    with pytest.raises(OutputError, match=r"curves\.csv: is not the curves of a study"):
        read_curves(tmp_path)


# A coefficient of friction that varies


def with_pairs(uncertainty: float = 0.005, lasting: bool = True):
    """The fake run with pairs of tiles of 1 mm: those that seat (from -5 mm) and bore (20 mm) face up to 18 mm."""
    solution = fake_solution()
    tiling = Tiling(size=1.0, seat_origin=-5.0, seat_tiles=25, bore_ends=(-20.0, 0.0), bore_tiles=20, radial=True)
    seat, bore = (axis.ravel() for axis in np.mgrid[0:25, 0:20])
    met = seat + bore < 23
    values = 0.05 + 0.002 * seat[met] + 0.001 * bore[met]
    friction = PairFrictionMap(
        tiling=tiling,
        seat=seat[met],
        bore=bore[met],
        coefficient=values,
        uncertainty=np.full(values.size, uncertainty),
        lasting=lasting,
    )
    return dataclasses.replace(solution, friction=friction)


@pytest.mark.parametrize("solution", [with_pairs(), with_pairs(np.nan), with_pairs(lasting=False)])
def test_the_pairs_are_written_and_drawn(tmp_path, solution):
    pairs = solution.friction
    output.write_interface(tmp_path, solution.scene, solution.seat, solution.increments, pairs)
    with h5py.File(tmp_path / "interface.h5") as file:
        group = file["pairs"]
        for name in ("seat", "bore", "coefficient", "uncertainty"):
            np.testing.assert_array_equal(group[name][()], getattr(pairs, name))
            assert group[name].attrs["unit"]
        assert group.attrs["seat_origin_mm"] == -5.0
        assert (group.attrs["tile_size_mm"], group.attrs["lasting"]) == (1.0, pairs.lasting)
    assert tmp_path / "friction.png" in plots.write_figures(tmp_path, solution)
    assert (tmp_path / "friction.png").stat().st_size > 10_000
    figure = plots.friction(solution, pairs)
    *rows, drawn = figure.axes[:4]
    stated = np.isfinite(pairs.uncertainty).any() and pairs.lasting
    assert [len(axes.patches) for axes in rows] == [2 if stated else 1] * 3  # line, and band
    image = drawn.images[0].get_array()
    assert image.shape == (20, 23)
    assert np.ma.count(image) == pairs.seat.size
    assert image[4, 7] == 0.05 + 0.002 * 7 + 0.001 * 4
    assert "[-]" in figure.axes[-1].get_ylabel()
    assert ("latest" in figure.axes[-1].get_ylabel()) == (not pairs.lasting)


def test_a_uniform_run_has_no_pairs(tmp_path):
    solution = fake_solution()
    output.write_interface(tmp_path, solution.scene, solution.seat, solution.increments, solution.friction)
    with h5py.File(tmp_path / "interface.h5") as file:
        assert "pairs" not in file
    assert tmp_path / "friction.png" not in plots.write_figures(tmp_path, solution)


def test_more_frames_than_increments_are_all_of_them() -> None:
    """2^63 - 1 of them were an IndexError, after the last increment."""
    travels = fake_scene().displacements
    for frames in (len(travels), 2 * len(travels), 2**63 - 1):
        scene = msgspec.structs.replace(fake_scene(), output=OutputKeys(frames=frames))
        assert _fields_at(scene, travels) == list(range(len(travels)))


def test_pictures_are_written_as_they_are_drawn(tmp_path: Path) -> None:
    """Every pixel, as another program reads it, and the size on paper."""
    picture = np.random.default_rng(0).integers(0, 256, (7, 5, 3), dtype=np.uint8)
    (tmp_path / "a.png").write_bytes(png(picture))
    assert np.array_equal(np.rint(255.0 * imread(tmp_path / "a.png")), picture)
    figure = Figure(figsize=(2.0, 1.0), dpi=150)
    figure.add_subplot().plot([0.0, 1.0])
    figure.savefig(tmp_path / "theirs.png")
    save(figure, tmp_path / "ours.png")
    assert np.array_equal(imread(tmp_path / "ours.png"), imread(tmp_path / "theirs.png")[..., :3])
    density = int.from_bytes((tmp_path / "ours.png").read_bytes()[41:45], "big")
    assert density == pytest.approx(150.0 / 0.0254, abs=0.5)  # dots per metre


@pytest.mark.parametrize("title", ["pay $5 for x_{ and $6", "$x_{$"])
def test_a_dollar_in_a_title_is_no_formula(tmp_path: Path, title: str) -> None:
    """It was a traceback of matplotlib at the end of a run."""
    solution = with_pairs()
    scene = msgspec.structs.replace(solution.scene, title=title)
    assert len(plots.write_figures(tmp_path, dataclasses.replace(solution, scene=scene))) == 5


def test_the_largest_stress_of_a_window_is_in_it() -> None:
    field = fake_field()
    place = deformed(field)
    order = np.argsort(field.von_mises)
    window = (place[order[0]] - 0.1, place[order[0]] + 0.1)
    body, found, value = largest_node({"axle": field}, window)
    assert (body, found.tolist(), value) == ("axle", place[order[0]].tolist(), field.von_mises[order[0]])


def test_the_whole_window_has_room_for_the_push() -> None:
    low, high = whole_window([fake_field()])
    points = deformed(fake_field())
    assert points[:, 1].min() - low[1] > SHORTEST * np.ptp(points[:, 1])
    assert high[1] > points[:, 1].max()


def test_a_wheel_that_rests_is_told_by_its_increment() -> None:
    """While it cools, the displacement is the same in all increments."""
    solution = fake_solution()
    records = [fake_increment(0, 5.0, 1e5), fake_increment(1, 5.0, 2e5), fake_increment(2, 6.0, 3e5)]
    resting = dataclasses.replace(solution, increments=records)
    said = [words_of(axes)[0] for axes in plots.interface(resting).axes if words_of(axes)]
    assert said == ["5 mm, increment 1", "5 mm, increment 2", "6 mm"]


def test_rounding_is_not_drawn_as_variation_of_friction() -> None:
    solution = with_pairs(np.nan)
    rows = plots.friction(solution, solution.friction).axes
    low, high = rows[0].get_ylim()
    assert high - low == pytest.approx(FLATTEST)
