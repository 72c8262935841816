"""Any scene and any settings of the plates are written as TOML and read back equal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from macrofit.base.toml import parse_toml
from macrofit.scene import build_scene, dump_scene, load_scene, scene_names
from meso.settings import decode, dump

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
scalars = st.one_of(
    st.booleans(), st.integers(-(2**53), 2**53), st.floats(allow_nan=False, allow_infinity=False), texts
)
options = st.dictionaries(
    texts,
    st.recursive(scalars, lambda inner: st.one_of(st.lists(inner), st.dictionaries(texts, inner)), max_leaves=8),
    max_size=5,
)
"""Options of a provider: lists of tables, keys that need quotes and tables within tables among them."""


def lengths(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, width=64)


def as_json(record: Any) -> bytes:
    return msgspec.json.encode(record, order="deterministic")


scenes = st.fixed_dictionaries(
    {
        "title": texts,
        "axle": st.fixed_dictionaries(
            {
                "seat_radius": lengths(90.0, 110.0),
                "seat_length": lengths(100.0, 200.0),
                "tail_length": st.just(0.0) | lengths(1e-3, 90.0),
            },
            optional={"inner_radius": st.just(0.0) | lengths(1e-3, 40.0), "taper_height": st.just(0.0)},
        ),
        "wheel": st.fixed_dictionaries(
            {
                "bore_radius": lengths(112.0, 113.0),
                "hub_length": lengths(50.0, 300.0),
                "hub_outer_radius": lengths(150.0, 300.0),
            }
        ),
        "motion": st.one_of(
            st.fixed_dictionaries({"travel": lengths(1.0, 90.0), "increment": lengths(0.01, 5.0)}),
            st.fixed_dictionaries({"displacements": st.lists(lengths(0.0, 90.0), min_size=1, max_size=5, unique=True)}),
        ),
    },
    optional={
        "friction": st.fixed_dictionaries({"provider": texts, "options": options}),
        "output": st.fixed_dictionaries({"frames": st.integers(0, 99), "fields": st.just(["stress"])}),
    },
)


@settings(deadline=None)
@given(scenes)
def test_a_scene_is_read_back_equal(tables: dict[str, Any]) -> None:
    scene = build_scene(tables)
    text = dump_scene(scene)
    assert build_scene(parse_toml(text, "scene.toml")) == scene
    assert as_json(build_scene(parse_toml(text, "scene.toml"))) == as_json(scene)  # 1 is not 1.0, 0.0 is not -0.0


def test_built_in_scenes_are_read_back_equal(tmp_path: Path) -> None:
    for name in scene_names():
        scene = load_scene(name)
        (tmp_path / "scene.toml").write_text(dump_scene(scene), encoding="utf-8")
        assert load_scene(tmp_path / "scene.toml") == scene


coefficients = lengths(0.01, 0.5)
several = st.lists(coefficients, min_size=1, max_size=3, unique=True)
strengths = st.fixed_dictionaries({"tensile_strength": lengths(1.0, 1e6), "shear_strength": lengths(1.0, 1e6)})
plates = st.fixed_dictionaries(
    {},
    optional={
        "title": texts,
        "surface": st.fixed_dictionaries({"max_height": lengths(1e-4, 0.05), "wheel_seed": st.integers(0, 2**31)}),
        "material": st.fixed_dictionaries({"youngs_modulus": lengths(1e3, 1e6), "poisson_ratio": lengths(-0.9, 0.49)}),
        "beams": st.fixed_dictionaries({"youngs_modulus": lengths(1.0, 1e8), "radius_ratio": lengths(0.1, 1.0)}),
        "contact": st.fixed_dictionaries({"micro_friction": coefficients | several}),
        "engine": st.fixed_dictionaries({"safety": lengths(0.1, 1.0)}, optional={"breakage": strengths}),
    },
)


@settings(deadline=None)
@given(plates)
def test_settings_of_the_plates_are_read_back_equal(tables: dict[str, Any]) -> None:
    found = decode(tables)
    assert decode(parse_toml(dump(found), "settings.toml")) == found
