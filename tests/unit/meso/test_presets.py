"""Presets of the plates: what lies over what, from the file, the command line and the options of a provider."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest
from click.testing import CliRunner

from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, build, load_options
from meso.cli import main
from meso.errors import SettingsError
from meso.presets import DEFAULT, PRESETS
from meso.provider import TileFriction, slide_cpu_s
from meso.settings import Settings, load

CONTEXT = BuildContext(seat_tiles=4, bore_tiles=4, youngs_modulus=206e3, poisson_ratio=0.3)
WHEELSET = BuildContext(seat_tiles=191, bore_tiles=182, youngs_modulus=206e3, poisson_ratio=0.3)


def test_as_published_is_what_the_paper_prints() -> None:
    settings = load(preset="as-published")
    plates, engine, surface = settings.plates, settings.engine, settings.surface
    assert (plates.spheres, plates.thickness, plates.external_face, plates.external_modulus) == (
        1000, 0.4, "beams", "paper",
    )  # fmt: skip
    assert (engine.name, engine.speed, settings.load.pressure) == ("explicit", 10_000.0, 170.0)
    assert (surface.form, surface.generator, surface.levels) == ("tiles", "diamond_square", 3)
    assert (surface.max_height, surface.hurst_exponent) == (0.04, 0.8)


def test_the_default_preset_is_the_defaults() -> None:
    assert load(preset=DEFAULT) == load() == Settings()


def test_a_key_that_is_given_goes_before_the_presets(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    file.write_text("[plates]\nspheres = 500\n[load]\nslide = 2.0\n")
    settings = load(file, ["engine.speed=20000"], "as-published")
    assert (settings.plates.spheres, settings.plates.thickness) == (500, 0.4)
    assert (settings.engine.speed, settings.engine.name) == (20_000.0, "explicit")
    assert (settings.load.slide, settings.load.pressure) == (2.0, 170.0)
    assert PRESETS["as-published"].tables["plates"]["spheres"] == 1000  # as it was


def test_a_preset_that_is_none_is_named() -> None:
    with pytest.raises(SettingsError, match="no preset 'as-printed' of plates; take slow or as-published"):
        load(preset="as-printed")


def test_the_command_takes_a_preset(tmp_path: Path) -> None:
    words = ["run", "--preset", "as-published", "--no-figures", "--quiet", "-o", str(tmp_path / "out")]
    quick = ["--set", "plates.spheres=400", "--set", "engine.samples=20", "--set", "engine.speed=1e5"]
    assert CliRunner().invoke(main, words + quick, catch_exceptions=False).exit_code == 0
    written = load(tmp_path / "out" / "settings.toml")
    assert written == load(None, [*quick[1::2]], "as-published")


@pytest.mark.parametrize(
    "options", [{"plates": "as-published"}, {"plates": {"preset": "as-published"}}], ids=["by name", "as a key"]
)
def test_the_provider_takes_a_preset(options: dict[str, object]) -> None:
    provider = build("dem", {**options, "surface": {"levels": 4}, "cache": False}, CONTEXT)
    assert isinstance(provider, TileFriction)
    shared = provider.shared
    wanted = load(None, ["surface.levels=4"], "as-published")
    assert (shared.plates, shared.engine, shared.surface, shared.load) == (
        wanted.plates, wanted.engine, wanted.surface, wanted.load,
    )  # fmt: skip


def test_keys_beside_the_name_of_a_preset_go_before_its_own() -> None:
    provider = build("dem", {"plates": {"preset": "as-published", "spheres": 500}, "cache": False}, CONTEXT)
    assert isinstance(provider, TileFriction)
    assert (provider.shared.plates.spheres, provider.shared.plates.external_face) == (500, "beams")


@pytest.mark.parametrize(
    ("plates", "told"),
    [
        ("as-printed", "there is no preset 'as-printed' of plates; take slow or as-published"),
        ({"preset": 3}, "friction.options.plates.preset = 3: take slow or as-published"),
        ({"preset": "as-published", "sphere": 3}, r"plates\.sphere: unknown key \(did you mean 'spheres'"),
    ],
)
def test_a_preset_that_is_none_is_the_options_error(plates: object, told: str) -> None:
    with pytest.raises(ProviderError, match=told) as caught:
        load_options("dem", {"plates": plates})
    assert "\n" not in str(caught.value)


def test_hours_are_told_before_they_begin() -> None:
    with pytest.warns(UserWarning, match=r"17381 pairs of tiles may meet, .* about 0\.4 CPU s: 2 CPU hours") as told:
        build("dem", {"plates": "as-published", "cache": False}, WHEELSET)
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        build("dem", {"plates": "as-published", "cache": False}, CONTEXT)


def test_the_estimate_grows_with_spheres_and_time() -> None:
    """Measured: 0.03, 0.10, 0.6 s for 400, 1000, 3000 spheres slid slowly, 0.4 s as published, 0.25 s at 20 m/s."""
    slow = [slide_cpu_s(load(None, [f"plates.spheres={count}"])) for count in (400, 1000, 3000)]
    published = [slide_cpu_s(load(None, [f"engine.speed={speed}"], "as-published")) for speed in (10_000, 20_000)]
    assert slow == pytest.approx([0.03, 0.10, 0.6], rel=0.3)
    assert published == pytest.approx([0.4, 0.25], rel=0.3)


def test_a_multiple_of_the_resonance_takes_the_place_of_the_presets_speed() -> None:
    engine = load(None, ["engine.resonance=1.5"], "as-published").engine
    assert (engine.resonance, engine.name) == (1.5, "explicit")
