"""The provider `dem`: a friction test for each pair of tiles, made once and kept.

The plates are as small as plates get (400 spheres, 0.5 mm, ten increments: 0.02 s). Their coefficients mean little:
corners up to 0.02 mm high put them on slopes, so that the micro coefficient must be large to keep them above 0.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI

from macrofit.base.provenance import reached, source
from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, FrictionField, TilePairs, build, load, names, tile_overlaps
from macrofit.friction.conformance import check
from macrofit.scene import Scene, build_scene
from macrofit.solve import solve
from meso import coefficient_cache, friction_test
from meso.coefficient_cache import fingerprint
from meso.engines.quasistatic import Unsettled
from meso.errors import SettingsError
from meso.lattice.lattice import Lattice
from meso.packing.deal import packing_of
from meso.packing.pack import Packing
from meso.plates import Plates, make_plate
from meso.provider import DirectDem, TileFriction
from meso.records import Slide
from meso.settings import Settings, decode
from meso.surfaces.surface import Body, tile_seed

SMALL: dict[str, Any] = {
    "micro_friction": 0.2,
    "surface": {"levels": 1},
    "plates": {"spheres": 400, "thickness": 0.25},
    "engine": {"increment": 0.05},
}
PAIRS = ((2, 5), (0, 1), (2, 3))


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """In ten increments the toy plates leave a good part of the work unaccounted for."""
    monkeypatch.setattr("meso.provider.UNBALANCED", 1.0)


def made(cache_dir: Path | None = None, tile_size: float = 0.5, modulus: float = 206e3, **options: Any) -> TileFriction:
    context = BuildContext(
        seat_tiles=8,
        bore_tiles=8,
        tile_size=tile_size,
        youngs_modulus=modulus,
        poisson_ratio=0.3,
        cache_dir=None if cache_dir is None else str(cache_dir),
    )
    provider = build("dem", SMALL | options, context)
    assert isinstance(provider, TileFriction)
    return provider


def asked(*pairs: tuple[int, int]) -> TilePairs:
    seat, bore = np.array(pairs, dtype=np.int64).T
    return TilePairs(seat, bore, np.full(len(pairs), 100.0), np.zeros(len(pairs)))


def answers(provider: TileFriction, *pairs: tuple[int, int]) -> list[float]:
    return provider.coefficients(asked(*pairs)).tolist()


def file_of(provider: TileFriction, seat: int, bore: int) -> Path:
    assert provider.cache is not None
    return provider.cache.file(provider.settings(seat, bore))


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[float]:
    """The answers to PAIRS of a provider without a cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MACROFIT_CACHE", str(tmp_path_factory.getbasetemp() / "packings"))
        return answers(made(), *PAIRS)


# The answer


def test_it_is_installed() -> None:
    assert ("dem", "meso.provider:DirectDem") in [(found.name, found.target) for found in names()]


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("kept", [False, True], ids=["computed each time", "from the cache"])
def test_it_keeps_the_contract_to_the_bit(kept: bool, tmp_path: Path) -> None:
    provider = made(tmp_path if kept else None)
    check(provider, seat_tiles=3, bore_tiles=3, batch=4, tolerance=0.0)
    files = len(list(tmp_path.rglob("*.json")))
    assert (provider.runs == files <= 9) if kept else (provider.runs > 9 and files == 0)


def test_it_is_the_friction_test_of_both_surfaces(expected: list[float]) -> None:
    """To the bit, whatever other pairs of the same tiles came before; the settings are written out by hand."""
    settings = decode(
        {
            "surface": {"levels": 1, "axle_seed": 3 * 65536 + 2, "wheel_seed": 3 * 65536 + 5},
            "plates": {
                "spheres": 400,
                "thickness": 0.25,
                "edge": 0.5,
                "packing_seed": packing_of(3, 5),
                "axle_packing_seed": packing_of(3, 2),
            },
            "material": {"youngs_modulus": 206e3, "poisson_ratio": 0.3},
            "contact": {"micro_friction": 0.25},
            "load": {"pressure": 120.0, "slide": 0.5},
            "engine": {"increment": 0.05},
        }
    )
    provider = made(seed=3, micro_friction=0.25, load={"pressure": 120.0})
    answer = answers(provider, (7, 5), (2, 0), (2, 5))[2]
    slide = friction_test.run(settings).slides[0]
    assert answer == slide.curve.coefficient
    assert answer not in expected
    entry = provider.entry(2, 5)
    assert entry.settings == settings == provider.settings(2, 5)
    assert (entry.engine, entry.remark, entry.unconverged_increments) == ("quasi-static", "", 0)
    assert entry.mean_normal == slide.curve.mean_normal
    assert entry.mean_tangential == pytest.approx(answer * entry.mean_normal, rel=1e-14)
    assert entry.uncertainty == slide.curve.uncertainty > 0.0
    assert entry.largest_residual == slide.largest_residual > 0.0


def test_each_tile_has_a_surface_of_its_own() -> None:
    seeds = {tile_seed(seed, tile) for seed in (0, 1, 7, 65535) for tile in (0, 1, 180, 65535)}
    assert len(seeds) == 16
    assert (min(seeds), max(seeds)) == (0, 2**32 - 1)
    both = made().settings(4, 6).surface
    assert (both.axle_seed, both.wheel_seed) == (65540, 65542)


@pytest.mark.parametrize(("seed", "tile"), [(-1, 0), (65536, 0), (1, -1), (1, 65536)])
def test_seeds_and_tiles_are_bounded(seed: int, tile: int) -> None:
    with pytest.raises(SettingsError, match="65535"):
        tile_seed(seed, tile)


def test_a_tile_without_a_seed_is_the_providers_error() -> None:
    with pytest.raises(ProviderError, match="friction provider 'dem': there is no tile 65536"):
        made().settings(65536, 0)
    with pytest.raises(ProviderError, match=r"friction\.options\.seed = -1"):
        DirectDem(seed=-1)


def test_repeated_pairs_are_computed_once() -> None:
    provider = made()
    first, second, third = answers(provider, (1, 1), (0, 1), (1, 1))
    assert first == third != second
    assert provider.runs == 2


def test_packings_are_dealt_to_the_tiles() -> None:
    """Each tile has its own, or one of k that every block of k tiles gets once; one is what is asked for."""
    each = [packing_of(1, tile) for tile in range(200)]
    assert len(set(each)) == 200
    assert not set(each) & {packing_of(2, tile) for tile in range(200)}
    assert not set(each) & {packing_of(1, tile, packing_seed=1) for tile in range(200)}
    few = [packing_of(1, tile, packings=16) for tile in range(64)]
    assert all(len(set(few[k : k + 16])) == 16 for k in range(0, 64, 16))
    assert set(few) == {packing_of(2, tile, packings=16) for tile in range(16)}  # the same ones for every seed
    assert few[:16] != few[16:32]
    assert {packing_of(seed, 5, packings=1, packing_seed=9) for seed in range(3)} == {9}
    assert packing_of(1, 0) == 1982462498  # the same on every machine, with every numpy
    provider = made(packings=16)
    found = provider.settings(2, 5).plates
    assert (found.axle_packing_seed, found.packing_seed) == (few[2], few[5])


def test_packings_do_not_move_all_tiles_alike() -> None:
    """Two choices of the packings: the mean over nine pairs of tiles moves less where each tile has its own."""
    pairs = [(seat, bore) for seat in range(3) for bore in range(3)]

    def mean(seed: int, **options: Any) -> float:
        return float(np.mean(answers(made(plates={"packing_seed": seed} | SMALL["plates"], **options), *pairs)))

    def moved(**options: Any) -> float:
        means = [mean(seed, **options) for seed in range(4)]
        return float(np.std(means))

    assert moved() < moved(packings=1)


def test_a_tile_keeps_its_plate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine pairs of three tiles and three take six plates."""
    made_now: list[str] = []

    def counted(settings: Settings, body: Body) -> tuple[Packing, Lattice]:
        made_now.append(body)
        return make_plate(settings, body)

    monkeypatch.setattr("meso.provider.make_plate", counted)
    answers(made(), *((seat, bore) for seat in range(3) for bore in range(3)))
    assert sorted(made_now) == 3 * ["axle"] + 3 * ["wheel"]


def test_a_negative_coefficient_counts_as_none(tmp_path: Path) -> None:
    """Small plates on a slope give back more than so little friction takes."""
    provider = made(tmp_path, micro_friction=0.0, packings=1)
    with pytest.warns(UserWarning, match=r"seat tile 3 and bore tile 0 comes out as -0\.0\d+ \+- ") as told:
        given = answers(provider, (3, 0), (3, 1))
    assert given == [0.0, 0.0]
    assert (provider.clipped, len(told)) == (2, 1)
    assert provider.entry(3, 0).coefficient < 0.0


@pytest.mark.parametrize("kept", [False, True], ids=["computed now", "from the cache"])
def test_work_that_is_missing_is_told_once_and_counted(
    kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if kept:
        answers(made(tmp_path), *PAIRS)
    provider = made(tmp_path)
    missing = [abs(provider.entry(*pair).imbalance) for pair in PAIRS]
    monkeypatch.setattr("meso.provider.UNBALANCED", float(np.median(missing)))
    with pytest.warns(UserWarning, match=r"is doubtful, and so may others be: \d+% of the work is unaccounted") as told:
        answers(provider, *PAIRS)
    assert (provider.doubtful, provider.counters["doubtful"], len(told)) == (1, 1, 1)


# Options


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (
            {"sede": 1},
            "friction.options.sede: unknown option .*Its options: micro_friction, seed, packings, cache, surface",
        ),
        ({"seed": 1.5}, "friction.options.seed: "),
        ({"seed": 65536}, "friction.options.seed = 65536 is out of bounds: take 0 ... 65535"),
        ({"micro_friction": -0.1}, "friction.options.micro_friction: -0.1 must not be negative"),
        ({"micro_friction": [0.1, 0.2]}, "friction.options.micro_friction: "),
        ({"plates": 3}, "friction.options.plates: "),
        ({"plates": {"sphere": 3}}, "friction.options.plates.sphere: unknown key (did you mean 'spheres'?)"),
        ({"plates": {"spheres": 0}}, "friction.options.plates.spheres: 0 must not be below 1"),
        ({"plates": {"spheres": "many"}}, "friction.options.plates.spheres: must be"),
        ({"plates": {"edge": 1.0}}, "friction.options.plates.edge: leave it out, it is the length of a tile"),
        ({"load": {"slide": 1.0}}, "friction.options.load.slide: leave it out"),
        ({"surface": {"axle_seed": 1}}, "friction.options.surface.axle_seed: leave it out, it follows from"),
        ({"surface": {"wheel_seed": 1}}, "friction.options.surface.wheel_seed: leave it out"),
        ({"contact": {"micro_friction": 0.1}}, "friction.options.contact.micro_friction: leave it out"),
    ],
)
def test_refused_options_name_the_key(options: dict[str, object], told: str) -> None:
    with pytest.raises(ProviderError, match=re.escape(told).replace(r"\.\*", ".*")) as caught:
        load("dem", options)
    assert "'dem'" in str(caught.value)


def test_a_material_without_beams_is_refused_before_the_run() -> None:
    context = BuildContext(seat_tiles=1, bore_tiles=1, youngs_modulus=206e3, poisson_ratio=0.28)
    with pytest.raises(ProviderError, match=r"'dem' cannot be built: material: .*poisson_ratio = 0\.28"):
        build("dem", {}, context)


def test_plates_are_as_large_as_a_tile_and_of_the_axle() -> None:
    settings = made(tile_size=0.75, modulus=150e3).shared
    assert (settings.plates.edge, settings.load.slide) == (0.75, 0.75)
    assert settings.material.youngs_modulus == 150e3


# The cache


@pytest.mark.usefixtures("quiet")
def test_what_is_kept_is_not_run_again(tmp_path: Path, expected: list[float]) -> None:
    first, second = made(tmp_path), made(tmp_path)
    assert answers(first, *PAIRS) == expected
    assert answers(second, *PAIRS) == expected
    assert (first.runs, second.runs) == (3, 0)
    assert second.entry(2, 5) == first.entry(2, 5)
    assert len(list(tmp_path.rglob("*"))) == 1 + 1 + 2 + 3  # coefficients/key/axle_seed/wheel_seed.json, no drafts


def test_a_reader_needs_nothing_of_the_package(tmp_path: Path, expected: list[float]) -> None:
    provider = made(tmp_path)
    answers(provider, (2, 5))
    entry = msgspec.json.decode(file_of(provider, 2, 5).read_bytes())["entry"]
    assert entry["coefficient"] == expected[0]
    assert entry["settings"]["surface"]["axle_seed"] == 65538
    assert {"uncertainty", "mean_normal", "mean_tangential", "engine", "unconverged_increments"} <= set(entry)


@pytest.mark.usefixtures("quiet")
def test_nothing_is_kept_unless_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert made(cache=False, cache_dir=tmp_path / "cache").cache is None
    assert made().cache is None
    answers(made(), (0, 1))
    assert list(tmp_path.iterdir()) == []


def _digit(data: bytes) -> bytes:
    """Another last digit of the coefficient: right in form, caught by its checksum alone."""
    return re.sub(rb'("coefficient": [\d.]+)(\d)', lambda m: m[1] + (b"1" if m[2] == b"2" else b"2"), data, count=1)


DAMAGES = {
    "empty": lambda data, other: b"",
    "torn": lambda data, other: data[: len(data) // 2],
    "noise": lambda data, other: bytes(range(256)),
    "a digit": lambda data, other: _digit(data),
    "another form": lambda data, other: b'{"coefficient": 0.1}',
    "of another pair": lambda data, other: other,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
def test_a_damaged_file_is_made_again(damage: Any, tmp_path: Path, expected: list[float]) -> None:
    first = made(tmp_path)
    answers(first, *PAIRS)
    file = file_of(first, 2, 5)
    whole = file.read_bytes()
    file.write_bytes(damage(whole, file_of(first, 2, 3).read_bytes()))
    assert file.read_bytes() != whole
    second = made(tmp_path)
    with pytest.warns(UserWarning, match=r"65541-[0-9a-f]{8}\.json is damaged and is computed again") as told:
        assert answers(second, *PAIRS) == expected
    assert (second.runs, len(told)) == (1, 1)
    assert file.read_bytes() == whole


TWO = """
import sys, warnings
import numpy as np
from macrofit.friction import BuildContext, TilePairs, build
context = BuildContext(
    seat_tiles=8, bore_tiles=8, tile_size=0.5, youngs_modulus=206e3, poisson_ratio=0.3, cache_dir=sys.argv[1]
)
provider = build("dem", {options}, context)
warnings.simplefilter("error")
warnings.filterwarnings("ignore", ".* is doubtful, and so may others be")
print("ready", flush=True)
sys.stdin.readline()
seat, bore = np.divmod(np.arange(12), 4)
print(provider.coefficients(TilePairs(seat, bore, np.zeros(12), np.zeros(12))).tolist())
"""


def test_two_processes_share_a_folder(tmp_path: Path) -> None:
    """Both start on the same twelve pairs at once; either way they agree, and leave whole files behind."""
    program = TWO.replace("{options}", repr(SMALL))
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    both = [subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], text=True, **pipes) for _ in range(2)]
    try:
        for each in both:
            assert each.stdout is not None
            assert each.stdout.readline() == "ready\n", each.communicate()[1]
        for each in both:
            assert each.stdin is not None
            each.stdin.write("go\n")
            each.stdin.flush()
        told = [each.communicate(timeout=60) for each in both]
    finally:
        for each in both:
            each.kill()
    assert [each.returncode for each in both] == [0, 0], told
    assert told[0][0] == told[1][0]
    third = made(tmp_path)
    pairs = [(k // 4, k % 4) for k in range(12)]
    assert answers(third, *pairs) == msgspec.json.decode(told[0][0])
    assert third.runs == 0
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]


def test_a_folder_that_cannot_be_made_is_done_without(tmp_path: Path, expected: list[float]) -> None:
    """A file stands where the folder should be: that stops even root."""
    (tmp_path / "coefficients").write_text("not a folder")
    provider = made(tmp_path)
    with pytest.warns(UserWarning, match="cannot be read and is computed again: Not a directory") as told:
        assert answers(provider, *PAIRS) == expected
    kept = [str(each.message) for each in told if "are not kept" in str(each.message)]
    assert len(kept) == 1
    assert "cannot be written" in kept[0]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_done_without(tmp_path: Path, expected: list[float]) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.warns(UserWarning, match="are not kept"):
            assert answers(made(tmp_path), *PAIRS) == expected
    finally:
        tmp_path.chmod(0o700)


def _other(value: Any) -> Any:
    if isinstance(value, float):
        return 1.25 * value + 0.01
    if isinstance(value, int):
        return value + 1
    return 0.5 if value is None else f"not {value}"


def test_every_setting_has_its_own_files() -> None:
    """Each key of each table moves the folder, but for the seeds (they name the file) and the title."""
    base = Settings()
    found = {"": fingerprint(base)}
    for table in ("surface", "plates", "material", "contact", "load", "engine"):
        keys = getattr(base, table)
        for key in keys.__struct_fields__:
            changed = msgspec.structs.replace(keys, **{key: _other(getattr(keys, key))})
            found[f"{table}.{key}"] = fingerprint(msgspec.structs.replace(base, **{table: changed}))
    for free in ("surface.axle_seed", "surface.wheel_seed", "plates.packing_seed", "plates.axle_packing_seed"):
        assert found.pop(free) == found[""]
    assert len(found) > 25
    assert len(set(found.values())) == len(found)


def test_options_and_context_reach_the_key(tmp_path: Path) -> None:
    variants: list[dict[str, Any]] = [
        {},
        {"micro_friction": 0.08},
        {"seed": 2},
        {"surface": {"levels": 2}},
        {"plates": {"spheres": 500, "thickness": 0.25}},
        {"contact": {"tangential_ratio": 0.7}},
        {"load": {"pressure": 100.0}},
        {"engine": {"increment": 0.1}},
        {"modulus": 210e3},
        {"tile_size": 1.0},
    ]
    files = {file_of(made(tmp_path, **variant), 2, 5) for variant in variants}
    files |= {file_of(made(tmp_path), 5, 2), file_of(made(tmp_path), 2, 6)}
    assert len(files) == len(variants) + 2
    assert file_of(made(tmp_path, plates={"thickness": 0.25, "spheres": 400}), 2, 5) in files


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the package, which the code's hash now looks at."""
    package = tmp_path / "meso"
    shutil.copytree(coefficient_cache.PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(coefficient_cache, "PACKAGE", package)
    return package


def test_the_code_is_part_of_the_key(copied: Path) -> None:
    """What computes counts, in whatever folder it lies; what only shows does not."""
    code = coefficient_cache.code.__wrapped__
    seen = {code()}
    assert seen == {coefficient_cache.code()}
    run = {source(copied, name) for name in reached_names()}
    names = {"kernels.py", "surface.py", "explicit.py", "provider.py", "steel.toml"}
    files = [file for name in names for file in copied.rglob(name)]
    assert {file.name for file in files} == names
    assert {file for file in files if file.suffix == ".py"} <= run
    for file in files:
        with file.open("a") as text:
            text.write("\n")
        assert code() not in seen, file
        seen.add(code())
    before = code()
    (copied / "cli.py").write_text("")
    assert code() == before


def test_one_number_in_a_kernel_of_a_subfolder_is_another_code(copied: Path) -> None:
    """The module moves into a room of its own: the old file is a door to it."""
    (copied / "room").mkdir()
    (copied / "room" / "__init__.py").write_text("")
    kernels = source(copied, next(name for name in reached_names() if name.endswith("kernels")))
    (copied / "room" / "law.py").write_text("STIFFNESS = 2.0\n")
    kernels.write_text("from meso.room.law import STIFFNESS\n" + kernels.read_text())
    code = coefficient_cache.code.__wrapped__
    before = code()
    (copied / "room" / "law.py").write_text("STIFFNESS = 2.1\n")
    assert code() != before


def reached_names() -> list[str]:
    return sorted(reached(coefficient_cache.PACKAGE, "meso.provider"))


def test_no_module_is_left_out_of_the_key() -> None:
    engines = [name for name in reached_names() if name.rpartition(".")[2] in ("quasistatic", "explicit")]
    program = f"import sys, meso.provider, {', '.join(engines)}\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = {name for name in done.stdout.split() if name.split(".")[0] == "meso"}
    assert len(engines) == 2
    assert loaded <= set(reached_names())
    assert {"kernels", "explicit"} <= {name.rpartition(".")[2] for name in loaded}


@pytest.mark.parametrize("what", ["version", "code"])
def test_what_computes_is_part_of_the_key(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = fingerprint(Settings())
    monkeypatch.setattr(coefficient_cache, what, lambda: "another")
    assert fingerprint(Settings()) != before


# Pairs that fail


@pytest.mark.parametrize(
    ("error", "told"),
    [(Unsettled("no equilibrium here"), "no equilibrium here"), (ValueError("a bug"), "ValueError: a bug")],
)
def test_a_pair_that_fails_is_named(error: Exception, told: str, tmp_path: Path, monkeypatch: Any) -> None:
    """The second of the batch fails; the solver passes the message on as it is, and the first one is kept."""
    real = friction_test.prepared

    def failing(plates: Plates) -> friction_test.Engine:
        if plates.settings.surface.axle_seed == tile_seed(1, 1):
            raise error
        return real(plates)

    monkeypatch.setattr("meso.provider.prepared", failing)
    field = FrictionField(made(tmp_path), "dem")
    overlaps = tile_overlaps(np.array([0.0, 0.5]), np.array([0.5, 1.0]), 1.0, 0.5, 8, 8)
    with pytest.raises(ProviderError) as caught:
        field.facet_friction(overlaps, np.zeros(2), np.zeros(2))
    assert str(caught.value) == (
        "friction provider 'dem', seat tile 1 (axle_seed = 65537) and bore tile 0 (wheel_seed = 65536): " + told
    )
    assert len(list(tmp_path.rglob("*.json"))) == 1


def test_plates_that_never_touch_have_no_coefficient(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Apart:
        name = "quasi-static"

        def __init__(self, plates: Plates) -> None:
            self.slid = real(plates).slide(0.07)

        def slide(self, micro_friction: float) -> Slide:
            return replace(self.slid, curve=replace(self.slid.curve, normal=0.0 * self.slid.curve.normal))

    real = friction_test.prepared
    monkeypatch.setattr("meso.provider.prepared", Apart)
    with pytest.raises(ProviderError, match=r"seat tile 2 .*bore tile 5 .*do not touch.*take a larger load\.pressure"):
        answers(made(tmp_path), (2, 5))
    assert not list(tmp_path.rglob("*.json"))


# A press fit


def small_fit(**friction: Any) -> Scene:
    """Six tiles of seat, pressed 5 mm: 24 pairs. The plates are of 1 mm, the length of a tile."""
    return build_scene(
        {
            "axle": {"seat_radius": 95.0, "seat_length": 6.0, "taper_length": 2.0, "taper_height": 0.5},
            "wheel": {"bore_radius": 94.85, "hub_length": 5.0, "hub_outer_radius": 140.0},
            "motion": {"travel": 5.0, "increment": 1.0},
            "mesh": {"seat_facet": 0.5, "bore_facet": 0.47, "coarse": 20.0},
            "output": {"stress": False, "fields_at": []},
            "friction": friction,
        }
    )


@pytest.mark.mpi
def test_a_press_fit_on_computed_friction(shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ranks share the pairs, and agree to the bit with one that computes them all; a second run computes none."""
    world, folder = MPI.COMM_WORLD, shared_tmp_path
    options = {"plates": {"spheres": 400}, "engine": {"increment": 0.05}}
    scene = small_fit(provider="dem", options=options)
    monkeypatch.setenv("MACROFIT_CACHE", str(folder))
    fit = solve(scene, world)
    files = list(folder.rglob("coefficients/*/*/*.json"))
    assert len(files) == fit.counters["pairs_asked"] == 24
    found = [msgspec.json.decode(file.read_bytes())["entry"]["coefficient"] for file in files]
    facets = fit.increments[-1].facets
    pressed = facets.friction[facets.pressure > 0.0]
    assert min(found) <= pressed.min() < pressed.max() <= max(found)
    world.Barrier()
    monkeypatch.setattr(TileFriction, "_slide", None)
    assert (solve(scene, world).force == fit.force).all()
    monkeypatch.undo()
    monkeypatch.setenv("MACROFIT_CACHE", str(folder / f"rank{world.rank}"))
    alone = solve(small_fit(provider="dem", options=options | {"cache": False}), MPI.COMM_SELF)
    assert (alone.force == fit.force).all()
    uniform = solve(small_fit(options={"coefficient": float(np.mean(found))}), MPI.COMM_SELF)
    moved = slice(1, None)  # in place no force is left
    assert np.abs(fit.force[moved] / uniform.force[moved] - 1.0).max() < 0.5 * (max(found) / min(found) - 1.0)


# Uncertainty


@pytest.mark.parametrize("kept", [False, True], ids=["computed each time", "from the cache"])
def test_its_uncertainty_costs_no_second_run(kept: bool, tmp_path: Path) -> None:
    provider = made(tmp_path if kept else None)
    assert provider.uncertainty(asked(*PAIRS).take(np.zeros(0, dtype=np.int64))).size == 0
    field = FrictionField(provider, "dem")
    field.facet_friction(tile_overlaps(np.array([0.0]), np.array([1.0]), 1.0, 0.5, 8, 8), np.zeros(1), np.zeros(1))
    known, runs = field.state(), provider.runs
    assert runs == known.seat.size == 2
    expected = [
        provider.entry(*pair).uncertainty for pair in zip(known.seat.tolist(), known.bore.tolist(), strict=True)
    ]
    assert known.uncertainty.tolist() == expected
    assert min(expected) > 0.0
