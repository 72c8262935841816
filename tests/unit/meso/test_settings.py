"""Settings of a friction test: what is written is read back, and what cannot be computed is named."""

from __future__ import annotations

import pytest

from meso.errors import SettingsError
from meso.settings import Breakage, Settings, decode, dump, load

RICH = {
    "title": 'Quotes ", back\\slash, line\nbreak, é, \x7f and \u2028',
    "surface": {"wheel_seed": 4294967295, "generator": "self_affine", "levels": 5, "hurst_exponent": 0.35},
    "plates": {"spheres": 777, "external_face": "beams", "external_modulus": "paper", "edge": 0.1 + 0.2},
    "material": {"youngs_modulus": 7e4, "density": 2.7e-9},
    "contact": {"micro_friction": [0.03, 0.07, 1e-7]},
    "load": {"interference": 0.006, "slide": 0.123456789012345},
    "beams": {"youngs_modulus": 1.25e6, "radius_ratio": 0.4},
    "engine": {"time_step": 1e-9, "breakage": {"tensile_strength": 1e4, "shear_strength": 2.5e3}},
}


@pytest.mark.parametrize("tables", [{}, RICH])
def test_what_is_dumped_is_loaded(tables, tmp_path):
    settings = decode(tables)
    path = tmp_path / "settings.toml"
    path.write_text(dump(settings), encoding="utf-8")
    assert load(path) == settings


def test_every_default_is_written_out():
    text = dump(Settings())
    for key in (
        "wheel_seed = 1",
        "spheres = 3000",
        "youngs_modulus = 206000.0",
        "micro_friction = 0.07",
        "slide = 1.0",
    ):
        assert f"\n{key}\n" in text
    assert "None" not in text
    assert "null" not in text


def test_the_rich_settings_are_what_was_asked_for():
    settings = decode(RICH)
    assert settings.contact.coefficients == (0.03, 0.07, 1e-7)
    assert settings.engine.breakage == Breakage(tensile_strength=1e4, shear_strength=2.5e3)
    assert Settings().contact.coefficients == (0.07,)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"lode": {}}, "lode: unknown key (did you mean 'load'?)"),
        ({"plates": {"spheers": 3}}, "plates.spheers: unknown key (did you mean 'spheres'?)"),
        ({"surface": {"zzz": 3}}, "surface.zzz: unknown key (known keys: form, generator, "),
        ({"material": {"young_modulus": 3.0}}, "material.young_modulus: unknown key (did you mean 'youngs_modulus'?)"),
        (
            {"engine": {"breakage": {"tensile_strenght": 1.0, "shear_strength": 1.0}}},
            "engine.breakage.tensile_strenght: unknown key (did you mean 'tensile_strength'?)",
        ),
        ({"contact": {"micro_friction": "slippery"}}, "contact.micro_friction: must be "),
        ({"engine": {"samples": 12.5}}, "engine.samples: must be a whole number"),
        ({"engine": {"name": "magic"}}, "engine.name: 'magic' is none of"),
        ({"plates": 3}, "plates: must be "),
    ],
)
def test_a_wrong_key_or_type_is_named(tables, message):
    with pytest.raises(SettingsError) as caught:
        decode(tables)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


BOUNDED = {
    "surface.levels": (0, 11),
    "surface.max_height": (-1e-9, 1.1),
    "surface.rms_height": (-1e-9, 1.1),
    "surface.hurst_exponent": (-0.01, 1.01),
    "surface.roll_off": (0.0, 4.1),
    "surface.feed": (0.0, -1.0),
    "surface.groove_depth": (-1e-9, 1.1),
    "surface.anisotropy": (0.9, 1001.0),
    "surface.wheel_seed": (-1, 2**32),
    "surface.axle_seed": (-1, 2**32),
    "plates.spheres": (0, 10**7),
    "plates.packing_seed": (-1, 2**32),
    "plates.axle_packing_seed": (-1, 2**32),
    "plates.thickness": (0.0, 1.0),
    "plates.edge": (0.0, -1.0),
    "plates.cube": (0.0, 0.3),
    "contact.micro_friction": (-0.01, 2.01, [0.1, -0.1], []),
    "contact.normal_stiffness": (0.0, -1.0),
    "contact.tangential_ratio": (0.0, -1.0),
    "load.pressure": (0.0, -1.0),
    "load.slide": (0.0, 0.5),
    "load.interference": (0.0, -1.0),
    "engine.samples": (9, 10**7),
    "engine.increment": (0.0, -1.0),
    "engine.tolerance": (0.0, -1.0),
    "engine.resonance": (0.0, -1.0, 101.0),
    "engine.speed": (0.0, -1.0, 3.1e6),
    "engine.approach_speed": (0.0, -1.0, 3.1e6),
    "engine.damping_length": (0.0, -1.0),
    "engine.squeeze_damping": (0.0, -1.0),
    "engine.safety": (0.0, 1.01),
    "engine.time_step": (0.0, -1.0),
    "engine.breakage.tensile_strength": (0.0, -1.0),
    "engine.breakage.shear_strength": (0.0, -1.0),
    "material.youngs_modulus": (0.0, -1.0),
    "material.poisson_ratio": (-1.0, 0.5),
    "material.density": (0.0, -1.0),
    "beams.youngs_modulus": (0.0, -1.0),
    "beams.radius_ratio": (0.0, -1.0),
    "beams.poisson_ratio": (-1.0, 0.5),
}
WHOLE = {"levels", "wheel_seed", "axle_seed", "spheres", "packing_seed", "axle_packing_seed", "samples"}


def with_value(key: str, value: object) -> dict[str, object]:
    """Tables with one key set, and what else the key needs."""
    *tables, last = key.split(".")
    needed = {"engine.breakage": {"tensile_strength": 1.0, "shear_strength": 1.0}}
    needed["beams"] = {"youngs_modulus": 5e6, "radius_ratio": 0.33}
    tree: dict[str, object] = {**needed.get(".".join(tables), {}), last: value}
    for table in reversed(tables):
        tree = {table: tree}
    return tree


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in BOUNDED.items() for value in values])
def test_a_value_out_of_bounds_is_named(key, value):
    with pytest.raises(SettingsError, match=key.rpartition(".")[2]):
        decode(with_value(key, value))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("key", [key for key in BOUNDED if key.rpartition(".")[2] not in WHOLE])
def test_no_number_is_nan_or_infinite(key, value):
    with pytest.raises(SettingsError, match=key.rpartition(".")[2]):
        decode(with_value(key, value))


def test_every_number_of_the_settings_is_in_these_tests():
    import msgspec

    found = set()
    for name, table in msgspec.to_builtins(Settings()).items():
        if isinstance(table, dict):
            found |= {f"{name}.{key}" for key, value in table.items() if not isinstance(value, str)}
    assert found - {"engine.breakage", "surface.axle", "surface.bore"} <= set(BOUNDED)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"load": {"slide": 0.5}}, "a whole number of plates.edge"),
        ({"load": {"interference": 0.01, "control": "force"}}, "load.interference is not used"),
        ({"engine": {"name": "quasi-static", "breakage": {"tensile_strength": 1, "shear_strength": 1}}}, "asks for"),
        ({"plates": {"cube": 0.2}}, "plates.cube = 0.2 mm must be larger than plates.thickness = 0.3 mm"),
    ],
)
def test_values_that_do_not_go_together(tables, message):
    with pytest.raises(SettingsError, match=message):
        decode(tables)


def test_self_affine_surfaces_slide_any_distance():
    assert decode({"load": {"slide": 0.5}, "surface": {"generator": "self_affine"}}).load.slide == 0.5


def test_overrides_change_keys(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text('title = "own"\n[load]\npressure = 100\n[plates]\nspheres = 50\n')
    overrides = [
        "load.pressure=200", "contact.micro_friction=[0.1, 0.2]", "engine.name=explicit", "title=plain words",
        "engine.breakage={tensile_strength = 1.0, shear_strength = 2}", "engine.breakage.shear_strength=3",
    ]  # fmt: skip
    settings = load(path, overrides)
    assert settings.load.pressure == 200.0
    assert settings.plates.spheres == 50
    assert settings.contact.coefficients == (0.1, 0.2)
    assert settings.engine.name == "explicit"
    assert settings.title == "plain words"
    assert settings.engine.breakage == Breakage(tensile_strength=1.0, shear_strength=3.0)


@pytest.mark.parametrize("override", ["load.pressure", "=3", "load.pressure.more=3", "load.presure=3"])
def test_a_bad_override_is_said(override):
    with pytest.raises(SettingsError):
        load(None, ["load.pressure=170", override])


def test_a_bad_file_is_said(tmp_path):
    for name, content, message in (
        ("missing.toml", None, "cannot be read"),
        ("bytes.toml", b"\xff\xfe", "cannot be read"),
        ("broken.toml", b"title = ", "not valid TOML"),
    ):
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(SettingsError, match=message) as caught:
            load(path)
        assert str(path) in str(caught.value)


def test_the_fingerprint_leaves_the_title_out():
    plain = Settings()
    assert decode({"title": "another"}).fingerprint == plain.fingerprint
    assert decode({"load": {"pressure": 171.0}}).fingerprint != plain.fingerprint
