"""The section of a scene: every key of its shapes on it, to scale, and no label over another."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import msgspec
import pytest
from click.testing import CliRunner, Result
from matplotlib.text import Text

from macrofit.cli import main
from macrofit.drafts.write import drawing
from macrofit.figures.dimensions import unmeasured, views
from macrofit.figures.section import bounds, outline, rows, section
from macrofit.scene import Scene, build_scene, load_scene, scene_names
from macrofit.scene.keys import MeshFile

MESHES = Path(__file__).parents[3] / "meshes"
NARROW = {
    "axle": {
        "seat_radius": 60.0, "seat_length": 100.0, "taper_length": 6.0, "taper_height": 0.4, "taper_blend": 80.0,
        "lead_length": 40.0, "lead_radius": 55.0, "tail_length": 60.0, "tail_radius": 50.0, "tail_blend": 6.0,
        "inner_radius": 20.0, "taper": 0.003,
    },
    "wheel": {
        "bore_radius": 60.0, "hub_length": 90.0, "hub_outer_radius": 95.0, "bore_taper": 0.003, "chamfer_length": 5.0,
        "chamfer_height": 0.6, "chamfer_blend": 60.0, "rear_edge_blend": 3.0, "web_thickness": 15.0, "web_offset": 8.0,
        "web_blend": 10.0, "rim_inner_radius": 180.0, "rim_outer_radius": 220.0, "rim_width": 80.0,
    },
    "motion": {"travel": 90.0},
}  # fmt: skip
"""A scene with every key of shaft and wheel."""


def macrofit(*arguments: object) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


def from_files() -> Scene:
    files = {"axle": str(MESHES / "axle.msh"), "wheel": str(MESHES / "wheel.msh")}
    return build_scene({"mesh": files, "motion": {"travel": 50.0}})


def scenes() -> dict[str, Scene]:
    drafts = {kind: build_scene(drawing(kind)) for kind in ("hub", "wheel", "hollow-axle")}
    built_in = {name: load_scene(name) for name in scene_names()}
    return {**built_in, **drafts, "narrow": build_scene(NARROW), "files": from_files()}


def texts(figure: Any) -> list[Text]:
    """All that is written on a figure."""
    return [text for text in figure.findobj(Text) if text.get_text().strip() and text.get_visible()]


@pytest.mark.parametrize("name", scenes())
def test_no_label_lies_over_another_or_beside_the_sheet(name: str) -> None:
    figure = section(scenes()[name])
    figure.draw_without_rendering()
    boxes = [(text.get_text(), Text.get_window_extent(text)) for text in texts(figure)]
    width, height = figure.get_size_inches() * figure.dpi
    for label, box in boxes:
        assert box.x0 >= 0.0, label
        assert box.y0 >= 0.0, label
        assert box.x1 <= width, label
        assert box.y1 <= height, label
    for (one, a), (other, b) in combinations(boxes, 2):
        across, up = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert across <= 1.0 or up <= 1.0, f"{one!r} lies over {other!r}"


@pytest.mark.parametrize("name", scenes())
def test_every_key_of_the_shapes_is_there_with_its_value(name: str) -> None:
    scene = scenes()[name]
    written = " ".join(text.get_text() for text in texts(section(scene)))
    for table, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        for key in () if isinstance(body, MeshFile) else body.__struct_fields__:
            value = getattr(body, key)
            if key != "material":
                assert f"{table}.{key} " + ("left out" if value is None else f"= {value:g}") in written


def test_a_key_that_is_given_is_measured_and_not_just_listed() -> None:
    scene = build_scene(NARROW)
    drawn = views(scene, bounds([outline(scene, "axle", 0.0), outline(scene, "wheel", 0.0)]))
    assert unmeasured(scene, drawn) == ["axle.profile left out", "wheel.profile left out", "wheel.temperature = 0"]
    measured = msgspec.structs.replace(scene, axle=msgspec.structs.replace(scene.axle, profile="/far/away/seat.csv"))
    assert unmeasured(measured, drawn)[0] == "axle.profile = seat.csv"


def test_dimensions_are_as_long_as_their_keys() -> None:
    """Along z and from the axis: the drawing is to scale, and each line measures what it says."""
    scene = build_scene(NARROW)
    for view in views(scene, (-100.0, 200.0, 0.0, 220.0)):
        for span in (*view.below, *view.above, *view.left, *view.right):
            assert span.high - span.low == pytest.approx(float(span.label.partition(" = ")[2]))


def test_lengths_whose_words_would_meet_go_to_rows_of_their_own() -> None:
    scene = load_scene("wheelset")
    (whole, *_) = views(scene, (-200.0, 300.0, 0.0, 460.0))
    placed = {span.label.partition(" = ")[0]: row for span, row in rows(whole.above, 0.01)}
    assert sorted(placed.values()) == [0, 1, 2]
    assert placed["wheel.web_thickness"] == 0


def test_check_draws_only_where_it_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    drawn = macrofit("check", "wheelset", "-o", "section.svg", "--set", "axle.seat_radius=95.125")
    assert drawn.exit_code == 0, drawn.stderr
    assert "Section         section.svg" in drawn.stdout
    assert "axle.seat_radius = 95.125" in (tmp_path / "section.svg").read_text()  # the labels are text
    assert "Section" not in macrofit("check", "wheelset").stdout


@pytest.mark.parametrize("name", ["section", "section.toml", "section.docx"])
def test_a_drawing_of_no_format_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    drawn = macrofit("check", "wheelset", "-o", tmp_path / name)
    assert drawn.exit_code == 2
    assert "end its name with .svg, .pdf, .png" in drawn.stderr
    assert drawn.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("title", ["$x", "a\nb", "T" * 200, r"\frac{1}"])
def test_a_title_may_be_anything(title: str, tmp_path: Path) -> None:
    scene = msgspec.structs.replace(load_scene("wheelset"), title=title)
    section(scene).draw_without_rendering()


def test_the_holes_of_a_mesh_are_drawn() -> None:
    """Two loops for a ring of elements: a hollow body that is closed has an outline inside."""
    import numpy as np

    from macrofit.figures.section import _rings

    ring = np.array(
        [(k, (k + 1) % 4, 4 + k) for k in range(4)] + [((k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    )
    assert sorted(len(each) for each in _rings(ring)) == [4, 4]
