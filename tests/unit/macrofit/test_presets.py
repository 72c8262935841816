"""Presets: sizes relative to the scene's own, overruled key by key, and refused where they could do nothing."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from macrofit.errors import SceneError
from macrofit.presets import PRESETS, summary
from macrofit.scene import dump_scene, load_scene, scene_names


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("scene", scene_names())
def test_a_preset_scales_the_sizes_that_the_scene_has(scene: str, name: str) -> None:
    """Nothing but mesh sizes changes, and those by the preset's factors."""
    own, changed, preset = load_scene(scene), load_scene(scene, preset=name), PRESETS[name]
    assert changed.mesh.seat_facet == pytest.approx(preset.facet * own.mesh.seat_facet)
    assert changed.mesh.growth == pytest.approx(preset.growth * own.mesh.growth)
    if own.mesh.bore_facet is not None:
        assert changed.mesh.bore_facet == pytest.approx(preset.facet * own.mesh.bore_facet)
    sizes = ("seat_facet", "bore_facet", "corner_facet", "growth")
    restored = msgspec.structs.replace(changed.mesh, **{key: getattr(own.mesh, key) for key in sizes})
    assert msgspec.structs.replace(changed, mesh=restored) == own


def test_corners_have_their_own_factor(tmp_path: Path) -> None:
    """Of the seat's facets, or of corner_facet where the scene has it; discs, which may be arcs, keep one size."""
    fast, balanced = PRESETS["fast"].corner, PRESETS["balanced"].corner
    assert load_scene("wheelset", preset="fast").mesh.corner_facet == pytest.approx(fast)
    assert load_scene("hertz-sphere", preset="fast").mesh.corner_facet is None
    file = tmp_path / "own.toml"
    file.write_text(dump_scene(load_scene("wheelset", ["mesh.seat_facet=2", "mesh.corner_facet=0.3"])))
    assert load_scene(file, preset="fast").mesh.corner_facet == pytest.approx(0.3 * fast / balanced)
    assert load_scene(file, preset="balanced") == load_scene(file)


def test_an_override_of_a_size_has_the_last_word() -> None:
    """In any order, and without moving the preset's other sizes."""
    for overrides in (["mesh.seat_facet=0.7", "preset=fast"], ["preset=fast", "mesh.seat_facet=0.7"]):
        mesh = load_scene("wheelset", overrides).mesh
        assert mesh.seat_facet == 0.7
        assert mesh.corner_facet == load_scene("wheelset", preset="fast").mesh.corner_facet


def test_an_override_names_a_preset_too_and_the_last_one_counts() -> None:
    assert load_scene("wheelset", ["preset=fast"]) == load_scene("wheelset", preset="fast")
    assert load_scene("wheelset", ["preset=fast", "preset=accurate"], "fast") == load_scene("wheelset", (), "accurate")


def test_the_scene_written_out_holds_the_sizes(tmp_path: Path) -> None:
    scene = load_scene("wheelset", preset="accurate")
    file = tmp_path / "scene.toml"
    file.write_text(dump_scene(scene))
    assert "preset" not in file.read_text()
    assert load_scene(file) == scene


@pytest.mark.parametrize("overrides", [["preset=slow"], ["preset="]])
def test_an_unknown_preset_is_named(overrides: list[str]) -> None:
    with pytest.raises(SceneError, match=r"no preset '(slow)?'; there are fast, balanced, accurate"):
        load_scene("wheelset", overrides)


def test_meshes_from_files_cannot_be_refined(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text('mesh = { axle = "a.msh", wheel = "w.msh" }\nmotion = { travel = 10.0 }\n')
    load_scene(file)
    with pytest.raises(
        SceneError, match=r"^mesh\.axle, mesh\.wheel: the preset 'fast' cannot refine meshes from files"
    ):
        load_scene(file, preset="fast")


def test_a_wrong_size_is_still_named(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(dump_scene(load_scene("wheelset")).replace("seat_facet = 1.0", 'seat_facet = "fine"'))
    with pytest.raises(SceneError, match=r"^mesh.seat_facet: "):
        load_scene(file, preset="fast")


def test_presets_are_ordered_and_the_help_names_them_all() -> None:
    """Rising in cost, falling in the error of the force."""
    costs, errors = zip(*((p.cpu_s, p.force_error) for p in PRESETS.values()), strict=True)
    assert list(costs) == sorted(costs)
    assert list(errors) == sorted(errors, reverse=True)
    assert all(f"{name}: force" in summary() for name in PRESETS)
