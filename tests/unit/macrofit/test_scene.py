"""Scenes: read strictly, every wrong key named, written back to the same scene."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest

from macrofit.errors import SceneError
from macrofit.scene import build_scene, dump_scene, idle_keys, json_schema, load_scene, scene_names


def keys(table: dict[str, Any], prefix: str = "") -> list[str]:
    """Dotted names of all keys."""
    found: list[str] = []
    for key, value in table.items():
        name = f"{prefix}{key}"
        found += keys(value, f"{name}.") if isinstance(value, dict) and key != "options" else [name]
    return found


WHEELSET = msgspec.to_builtins(load_scene("wheelset"))
EVERY_KEY = sorted(set(keys(WHEELSET)))


@pytest.mark.parametrize("name", scene_names())
def test_built_in_scenes_survive_a_round_trip(name: str) -> None:
    scene = load_scene(name)
    assert build_scene(tomllib.loads(dump_scene(scene))) == scene
    assert scene.title


@pytest.mark.parametrize("key", EVERY_KEY)
def test_every_key_with_a_wrong_type_is_named(key: str) -> None:
    wrong = "{ strange = 1 }" if key not in ("friction.options",) else "7"
    with pytest.raises(SceneError, match=rf"^{key}(\.strange|\.law)?: ") as caught:
        load_scene("wheelset", [f"{key}={wrong}"])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", [key for key in EVERY_KEY if "." in key and not key.startswith("friction.options")])
def test_every_key_misspelt_is_named(key: str) -> None:
    with pytest.raises(SceneError, match=rf"^{key}x: unknown key"):
        load_scene("wheelset", [f"{key}x=1"])


NUMBERS = [
    key
    for key in EVERY_KEY
    if isinstance(msgspec.to_builtins(load_scene("wheelset")).get(key.split(".")[0]), dict)
    and key.split(".")[0] in ("axle", "wheel", "mesh", "motion")
    and "material" not in key
    and not key.endswith(
        (".shape", "mesh.axle", "mesh.wheel", "mesh.order", "max_cutbacks", "displacements", "web_offset")
    )
]


@pytest.mark.parametrize("key", NUMBERS)
def test_every_length_negative_or_endless_is_named(key: str) -> None:
    """motion.start may be negative, and then travel, too."""
    if key not in ("motion.start", "motion.travel"):
        with pytest.raises(SceneError, match=rf"^{key}: "):
            load_scene("wheelset", [f"{key}=-1.0"])
    for value in ("nan", "inf"):
        with pytest.raises(SceneError, match=rf"^{key}: .*not a finite number"):
            load_scene("wheelset", [f"{key}={value}"])


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("wheel.bore_radius=90.0", r"^wheel\.bore_radius: .*interference of 5 mm, beyond small strain"),
        ("wheel.bore_radius=94.7mm", r"^wheel\.bore_radius: "),
        ("wheel.hub_outer_radius=94.0", r"^wheel\.hub_outer_radius: 94\.0 must be above the bore"),
        ("wheel.rim_inner_radius=100.0", r"^wheel\.rim_inner_radius: "),
        ("wheel.rim_width=10.0", r"^wheel\.rim_width: "),
        ("wheel.web_offset=90.0", r"^wheel\.web_offset: "),
        ("wheel.chamfer_blend=5000", r"^wheel\.chamfer_blend: .*reaches"),
        ("axle.taper_blend=5000", r"^axle\.taper_blend: .*reaches"),
        ("axle.lead_radius=94.5", r"^axle\.lead_radius: "),
        ("axle.inner_radius=94.5", r"^axle\.inner_radius: "),
        ("axle.tail_radius=100.0", None),
        ("axle.taper_height=0.0", r"^axle\.lead_radius: 95\.0 is wider than the bore, 94\.7"),
        ("axle.taper_height=0.1", r"^axle\.lead_radius: 94\.9 is wider than the bore, 94\.7"),
        ("wheel.chamfer_height=0.0", None),
        ("motion.travel=-1", r"^motion\.travel: .*lies before"),
        ("motion.increment=1e-9", r"^motion\.increment: .*at most a million"),
        ("output.fields_at=[500.0]", r"^output\.fields_at: 500\.0 is outside the motion"),
        ("mesh.order=3", r"^mesh\.order: "),
        ("contact.theta=0.5", r"^contact\.theta: "),
        ("solver=\"sparse\"", r"^solver: "),
        ("axle.shape=\"cube\"", r"^axle\.shape: .*try shaft, wheel or disc"),
        ("axle.shape=\"disc\"", r"^axle\."),
        ("wheel.material.poisson_ratio=0.5", r"^wheel\.material\.poisson_ratio: "),
        ("wheel.material.youngs_modulus=0", r"^wheel\.material\.youngs_modulus: "),
        ("nonsense", "an override is written key=value"),
    ],
)  # fmt: skip
def test_impossible_scenes(override: str, message: str | None) -> None:
    if message is None:
        load_scene("wheelset", [override])
        return
    with pytest.raises(SceneError, match=message) as caught:
        load_scene("wheelset", [override])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("scene", "override", "told"),
    [
        ("lame-rings", "axle.tail_blend=5e-324", "axle.tail_blend: 4.94066e-324 is lost beside axle.seat_radius, 95, "),
        ("lame-rings", "axle.seat_radius=1e-12", "axle.seat_radius: 1e-12 is lost beside axle.seat_length, 40, "),
        ("lame-rings", "wheel.hub_length=1e-300", "wheel.hub_length: 1e-300 is lost beside wheel.hub_outer_radius, "),
        ("wheelset", "axle.lead_length=1e15", "axle.seat_radius: 95 is lost beside axle.lead_length, 1e+15, "),
        ("contact-patch", "wheel.contact_radius=1e-9", "wheel.contact_radius: 1e-09 is lost beside wheel.radius, "),
        ("hertz-sphere", "wheel.crown_radius=1e12", None),
        ("wheelset", "axle.taper_blend=1e-4", None),
    ],
)
def test_a_length_that_is_lost_beside_the_others(scene: str, override: str, told: str | None) -> None:
    """The first three ended in a division by nothing, in gmsh's abort and in an IndexError."""
    if told is None:
        load_scene(scene, [override])
        return
    with pytest.raises(SceneError) as caught:
        load_scene(scene, [override])
    assert str(caught.value).startswith(told)


def test_a_bore_too_narrow_to_enter() -> None:
    with pytest.raises(SceneError, match=r"^wheel\.chamfer_height: the bore's mouth.*shrink fit"):
        load_scene("wheelset", ["wheel.chamfer_height=0", "axle.taper_height=0.1"])


def test_a_wheel_run_into_the_shoulder() -> None:
    with pytest.raises(SceneError, match=r"^motion\.travel: 200\.0 runs the wheel past the end of the seat"):
        load_scene("wheelset", ["axle.tail_radius=100.0", "motion.travel=200"])


def test_missing_key_and_missing_table() -> None:
    with pytest.raises(SceneError, match=r"^axle\.seat_radius: missing"):
        build_scene({"axle": {"seat_length": 1.0}, "wheel": {}, "motion": {}})
    with pytest.raises(SceneError, match=r"^motion: missing"):
        build_scene({"axle": WHEELSET["axle"], "wheel": WHEELSET["wheel"]})


def test_a_file_that_is_not_text(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_bytes(bytes(range(128, 256)))
    with pytest.raises(SceneError, match="cannot be read as text"):
        load_scene(tmp_path / "scene.toml")


def test_no_such_scene() -> None:
    with pytest.raises(SceneError, match=r"no scene .wheelsett..*wheelset"):
        load_scene("wheelsett")


def test_a_list_of_displacements_stands_alone() -> None:
    with pytest.raises(SceneError, match=r"^motion\.displacements: leave out start, travel and increment"):
        load_scene("wheelset", ["motion.displacements=[1.0, 2.0]"])
    scene = load_scene("wheelset", ["motion.start=0", "motion.travel=0", "motion.displacements=[20.0, 21.0, 20.5]"])
    assert scene.displacements == (20.0, 21.0, 20.5)
    with pytest.raises(SceneError, match="two equal displacements"):
        load_scene("wheelset", ["motion.start=0", "motion.travel=0", "motion.displacements=[20.0, 20.0]"])


def test_displacements_end_at_the_travel() -> None:
    scene = load_scene("wheelset", ["motion.start=1.5", "motion.travel=4.0", "motion.increment=1.0"])
    assert scene.displacements == (1.5, 2.5, 3.5, 4.0)
    assert load_scene("wheelset").displacements[-2:] == (179.0, 180.0)
    assert len(load_scene("wheelset").displacements) == 181


def schema_keys() -> dict[str, dict[str, Any]]:
    tables = json_schema()["$defs"]
    return {f"{name}.{key}": it for name, table in tables.items() for key, it in table["properties"].items()}


def test_the_schema_says_what_every_key_is() -> None:
    """In words, and for a number with its unit; [-] where it has none."""
    assert json_schema()["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    keys = schema_keys()
    assert len(keys) > 60
    assert [name for name, key in keys.items() if len(key.get("description", "")) < 14] == []
    numbers = [name for name, key in keys.items() if "number" in str(key) or "integer" in str(key)]
    assert [name for name in numbers if not re.search(r"\[.+\]", keys[name]["description"])] == []


def test_the_schema_bounds_every_number_that_one_key_can_bound() -> None:
    free = {"Hub.web_offset", "Motion.start", "Motion.travel", "Motion.displacements", "OutputKeys.fields_at"}
    free |= {"ServiceKeys.lateral_force", "ServiceKeys.torque", "ServiceKeys.rim_offset"}  # of either sign
    keys = schema_keys()
    numbers = {name for name, key in keys.items() if "'number'" in str(key) or "'integer'" in str(key)}
    assert {name for name in numbers if "inimum" not in str(keys[name])} == free


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("axle.seat_radius=-1", "axle.seat_radius: -1 must be positive"),
        ("axle.lead_radius=0.0", "axle.lead_radius: 0.0 must be positive"),
        ("wheel.rim_width=-2.5", "wheel.rim_width: -2.5 must not be negative"),
        ("axle.material.poisson_ratio=0.5", "axle.material.poisson_ratio: 0.5 must be below 0.5"),
        ("wheel.material.youngs_modulus=0", "wheel.material.youngs_modulus: 0 must be positive"),
        ("motion.max_cutbacks=-1", "motion.max_cutbacks: -1 must not be negative"),
        ("motion.displacements=[]", "motion.displacements: is empty"),
        ("axle.seat_radius=nan", "axle.seat_radius: nan is not a finite number"),
        ("motion.travel=inf", "motion.travel: inf is not a finite number"),
        ("motion.displacements=[0.0, nan]", "motion.displacements: nan is not a finite number"),
        ("mesh.seat_facet='1'", "mesh.seat_facet: must be a number, not text"),
    ],
)
def test_a_bound_is_said_in_one_line(override: str, told: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene("wheelset", [override])
    assert str(caught.value) == told


@pytest.mark.parametrize(
    ("overrides", "idle"),
    [
        ("contact.penalty_stiffness=1e7", "contact.penalty_stiffness"),
        ("contact.formulation=penalty contact.gamma0=10 contact.theta=1", "contact.gamma0 contact.theta"),
        ("axle.taper_height=0", "axle.taper_blend"),
        ("wheel.chamfer_height=0", "wheel.chamfer_blend"),
        (
            "wheel.web_thickness=0",
            "wheel.web_blend wheel.rim_inner_radius wheel.rim_outer_radius wheel.rim_width",
        ),
        ("output.fields=[] output.frames=3", "output.frames"),
        ("", ""),
    ],
)
def test_a_key_that_does_nothing_is_said(overrides: str, idle: str) -> None:
    lines = idle_keys(load_scene("wheelset", ["axle.lead_radius=90", *overrides.split()]))
    assert [line.partition(" = ")[0] for line in lines] == idle.split()
    assert all(re.search(r" = \S+ does nothing (without|under) \S+", line) for line in lines)


@pytest.mark.parametrize("name", scene_names())
@pytest.mark.parametrize("preset", [None, "fast", "balanced", "accurate"])
def test_every_key_of_a_shipped_scene_does_something(name: str, preset: str | None) -> None:
    assert idle_keys(load_scene(name, preset=preset)) == []
