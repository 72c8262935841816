"""The provider `surrogate`: a network in place of the friction test of each pair, on the surfaces of `dem`.

Where the plates have to answer they are as small as they get (400 spheres, twenty increments: 0.05 s a pair).
"""

from __future__ import annotations

import hashlib
import json
import pickle
import re
import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from mpi4py import MPI
from untrained import untrained

import surrogate.provider
from macrofit.cli import main
from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, TilePairs, answered, build, load, names
from macrofit.friction.conformance import check
from macrofit.scene import build_scene
from macrofit.solve import solve
from meso.plates import make_plate
from meso.presets import PRESETS
from meso.provider import DirectDem, TileFriction
from meso.settings import SurfaceKeys
from meso.surfaces.face import rough_face
from surrogate.data.faces import generated_face, generated_faces
from surrogate.data.faces import sampled_heights as sampled
from surrogate.data.plates import Plates
from surrogate.network.checkpoint import load_checkpoint, save_checkpoint
from surrogate.network.predict import Predictor
from surrogate.network.shipped import SHIPPED
from surrogate.provider import Surrogate, TileNetwork

SMALL_PLATES: dict[str, Any] = {"plates": {"spheres": 400}, "engine": {"increment": 0.05}}
PAIRS = ((2, 5), (0, 1), (2, 3), (2, 5))
TOLERANCE = 0.0
"""Between answers in batches of another make-up: `Predictor` gives the same bits."""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The checkpoint of a network that has learned nothing."""
    return untrained(tmp_path_factory.mktemp("model") / "untrained.safetensors")


@pytest.fixture(scope="module")
def network(model: str) -> Predictor:
    """The same, to be asked directly."""
    return Predictor(Path(model))


def context(**changed: Any) -> BuildContext:
    usual: dict[str, Any] = {"seat_tiles": 8, "bore_tiles": 8, "youngs_modulus": 206e3, "poisson_ratio": 0.3}
    return BuildContext(**usual | changed)


def made(model: str, **options: Any) -> TileNetwork:
    provider = build("surrogate", {"model": model} | options, context())
    assert isinstance(provider, TileNetwork)
    return provider


def asked(*pairs: tuple[int, int]) -> TilePairs:
    seat, bore = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return TilePairs(seat, bore, np.full(len(pairs), 100.0), np.zeros(len(pairs)))


def answers(provider: Any, *pairs: tuple[int, int]) -> list[float]:
    return provider.coefficients(asked(*pairs)).tolist()


class Fake:
    """Tiles that answer every batch alike, and remember how many pairs it had."""

    pressures = None
    predictor = SimpleNamespace(provenance=None)

    def __init__(self, mean: list[float], in_contact: list[bool] | None = None, seen: list[bool] | None = None) -> None:
        self.mean, self.in_contact, self.seen = mean, in_contact, seen
        self.batches: list[int] = []

    def levels(self, pressure: Any) -> Any:
        return np.zeros(len(pressure), dtype=np.int64)

    def predict(self, seat: Any, bore: Any, micro: float, level: Any) -> SimpleNamespace:
        self.batches.append(len(seat))
        all_of_them = [True] * len(self.mean)
        return SimpleNamespace(
            mean=np.array(self.mean),
            spread=np.full(len(self.mean), 0.01),
            in_contact=np.array(self.in_contact or all_of_them),
            seen=np.array(self.seen or all_of_them),
        )


# The answer


def test_it_is_installed() -> None:
    assert ("surrogate", "surrogate.provider:Surrogate") in [(found.name, found.target) for found in names()]


@pytest.mark.usefixtures("quiet")
def test_it_keeps_the_contract(model: str) -> None:
    check(made(model), tolerance=TOLERANCE)


@pytest.mark.usefixtures("quiet")
def test_it_is_the_network_on_the_surfaces_of_the_plates(model: str, network: Predictor) -> None:
    """Faces, seeds, bodies and micro coefficients written out by hand; to the bit, for the batch is the same."""
    keys = SurfaceKeys(levels=4, max_height=0.01, hurst_exponent=0.6)
    axles = [rough_face(keys, "axle", 3 * 65536 + seat, (2.0, 1.0)) for seat in (0, 2)]
    wheels = [rough_face(keys, "wheel", 3 * 65536 + bore, (1.0, 1.0)) for bore in (1, 3, 5)]
    points = network.provenance.points
    expected = network(
        np.stack([face.resampled((points, points)).heights for face in wheels]),
        np.stack([face.resampled((2 * points - 1, points)).heights for face in axles]),
        np.array([0, 1, 2]),
        np.array([0, 1, 1]),
        0.05,
    )
    surface = {"levels": 4, "max_height": 0.01, "hurst_exponent": 0.6}
    provider = made(model, seed=3, micro_friction=0.05, surface=surface)
    assert answers(provider, *PAIRS) == expected.mean[[2, 0, 1, 2]].tolist()
    assert provider.uncertainty(asked(*PAIRS)).tolist() == expected.spread[[2, 0, 1, 2]].tolist()
    assert len(set(expected.mean)) == 3
    assert (provider.clipped, provider.out_of_range, provider.losing_contact) == (0, 0, 0)


def test_surfaces_are_those_of_the_provider_dem(model: str) -> None:
    """Of its very plates, at as many points as the database has; the defaults are the same too."""
    keys: dict[str, Any] = {"seed": 7, "surface": {"levels": 4, "hurst_exponent": 0.7}}
    forms = [{"surface": {"form": form}} for form in ("tiles", "levelled", "strip")]
    for options in ({}, keys, *forms, {"surface": {"generator": "self_affine"}}):
        network = made(model, **options)
        dem = build("dem", options | {"plates": {"spheres": 400}}, context())
        assert isinstance(dem, TileFriction)
        settings = dem.settings(4, 6)
        for body, tile in (("axle", 4), ("wheel", 6)):
            packing, _ = make_plate(settings, body)  # type: ignore[arg-type]
            taken = network.heights(body, tile)  # type: ignore[arg-type]
            assert np.array_equal(taken, sampled(packing.surface, network.tiles.predictor.provenance.points))
            assert taken.std() > 0.0
    assert settings.contact.micro_friction == network.options.micro_friction


def test_defaults_are_those_of_the_provider_dem() -> None:
    plain, dem = Surrogate(), DirectDem()
    both = SurfaceKeys()
    for key, value in msgspec.structs.asdict(plain.faces(1.0)).items():
        assert value == getattr(both, key)
    assert (plain.micro_friction, plain.seed) == (dem.micro_friction, dem.seed)


def test_another_model_can_be_given(tmp_path: Path, model: str) -> None:
    other = made(untrained(tmp_path / "other.safetensors", stiffness=1e4))
    assert np.abs(np.subtract(answers(other, *PAIRS), answers(made(model), *PAIRS))).min() > 1e-5


def test_the_network_that_comes_with_the_package_is_taken() -> None:
    provider = build("surrogate", {}, context())
    assert isinstance(provider, TileNetwork)
    assert provider.tiles.predictor.provenance == Predictor().provenance
    assert 0.03 < min(answers(provider, *PAIRS)) < max(answers(provider, *PAIRS)) < 0.12  # as of the plates


def test_an_empty_batch_has_an_empty_answer() -> None:
    provider = TileNetwork(Fake([]), Surrogate())  # type: ignore[arg-type]
    assert answers(provider) == []
    assert provider.uncertainty(asked()).shape == (0,)


# What is computed how often


def test_a_batch_is_one_call_with_each_pair_once() -> None:
    network = Fake([0.1, 0.2, 0.3])
    provider = TileNetwork(network, Surrogate())  # type: ignore[arg-type]
    assert answers(provider, *PAIRS) == [0.3, 0.1, 0.2, 0.3]  # the distinct ones are sorted
    assert network.batches == [3]


def test_the_last_batch_is_not_predicted_again() -> None:
    network = Fake([0.1, 0.2])
    provider = TileNetwork(network, Surrogate())  # type: ignore[arg-type]
    assert provider.uncertainty(asked((0, 1), (1, 0))).tolist() == [0.01, 0.01]
    answer = provider.coefficients(asked((0, 1), (1, 0)))
    answer[:] = -1.0  # the caller's own
    assert answers(provider, (1, 0), (0, 1), (1, 0)) == [0.2, 0.1, 0.2]
    assert answers(provider, (0, 1), (1, 0)) == [0.1, 0.2]
    assert network.batches == [2]
    answers(provider, (0, 0), (1, 1))  # the same tiles, other pairs
    answers(provider, (0, 1), (1, 0))
    assert network.batches == [2, 2, 2]


def test_a_study_prepares_its_pairs_once(model: str) -> None:
    """Providers built one after the other differ in the micro coefficient, or in what they do with the answers."""
    first = made(model, seed=11, micro_friction=0.05)
    given = [answers(first, *PAIRS)]
    prepared, faces = first.tiles.prepared, first.tiles.faces
    assert (prepared >= 3, faces >= 5) == (True, True)
    for options in ({"micro_friction": 0.08}, {"micro_friction": 0.05, "fallback": "warning"}):
        other = made(model, seed=11, **options)
        given.append(answers(other, *PAIRS))
        assert (other.tiles.prepared, other.tiles.faces) == (prepared, faces)
    assert given[2] == given[0]
    assert np.not_equal(given[1], given[0]).all()
    alone = made(model, seed=12, micro_friction=0.08)
    assert np.not_equal(answers(alone, *PAIRS), given[1]).all()  # another seed
    assert answers(made(model, seed=11, micro_friction=0.08), *PAIRS) == given[1]  # made anew: to the bit


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        ({"surface": {"levels": 4}}, {}),
        ({"surface": {"max_height": 0.01}}, {}),
        ({"surface": {"hurst_exponent": 0.6}}, {}),
        ({}, {"seat_tiles": 9}),
        ({}, {"bore_tiles": 9}),
    ],
)
def test_other_tiles_are_not_shared(model: str, options: dict[str, Any], changed: dict[str, Any]) -> None:
    first = made(model)
    other = build("surrogate", {"model": model} | options, context(**changed))
    assert isinstance(other, TileNetwork)
    assert other.tiles is not first.tiles
    if options:
        assert np.not_equal(answers(other, *PAIRS), answers(first, *PAIRS)).all()


def test_a_tile_that_is_none_is_the_providers_error(model: str) -> None:
    provider = made(model)
    for body, pair in (("axle", (65536, 0)), ("axle", (8, 0)), ("wheel", (0, -1))):
        tile = pair[body == "wheel"]
        told = f"friction provider 'surrogate': there is no tile {tile} of the {body}; they are numbered 0 ... 7"
        with pytest.raises(ProviderError, match=re.escape(told)):
            answers(provider, (1, 1), pair)
        with pytest.raises(ProviderError, match=re.escape(told)):
            provider.heights(body, tile)  # type: ignore[arg-type]


def test_surfaces_that_cannot_be_made_are_the_providers_error(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(body: Any, seed: int, count: int, keys: Any, points: int) -> Any:
        return generated_faces(body, seed, count, msgspec.structs.replace(keys, hurst_exponent=2.0), points)

    monkeypatch.setattr("surrogate.tiles.generated_faces", refused)
    with pytest.raises(ProviderError, match="friction provider 'surrogate': surface of the wheel: hurst_exponent"):
        answers(made(model, seed=13), (0, 0))


def test_coefficients_out_of_the_contract_take_the_nearest_bound() -> None:
    network = Fake([-0.02, 0.1, 2.0])
    provider = TileNetwork(network, Surrogate())  # type: ignore[arg-type]
    told_of = r"'surrogate': .* seat tile 0 and bore tile 1 comes out as -0\.0200 \+- 0\.0100 and is taken as 0, and so"
    with pytest.warns(UserWarning, match=told_of) as told:
        given = answers(provider, (0, 1), (0, 2), (0, 3))
    assert given == [0.0, 0.1, np.nextafter(2.0, 0.0)]
    assert (provider.clipped, len(told)) == (2, 1)
    network.mean = [-0.1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # told already
        assert answers(provider, (3, 3)) == [0.0]
    assert provider.clipped == 3


# Options


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"sede": 1}, "friction.options.sede: unknown option .*Its options: micro_friction, seed, surface, model"),
        ({"seed": 1.5}, "friction.options.seed: "),
        ({"seed": 65536}, "friction.options.seed = 65536 is out of bounds: take 0 ... 65535"),
        ({"micro_friction": -0.1}, "friction.options.micro_friction = -0.1 is out of bounds: take 0 ... 2"),
        ({"micro_friction": float("nan")}, "friction.options.micro_friction: nan is not a finite number"),
        ({"surface": {"wheel_seed": 1}}, "friction.options.surface.wheel_seed: unknown key (known keys: form, gen"),
        ({"surface": {"lay": "turned"}}, "friction.options.surface.feed = 0.25 mm is less than 4 spacings of 0.125"),
        ({"surface": {"levels": 0}}, "friction.options.surface.levels: 0 must not be below 1"),
        ({"surface": {"max_height": -0.1}}, "friction.options.surface.max_height: -0.1 must not be negative"),
        ({"surface": {"hurst_exponent": 1.1}}, "friction.options.surface.hurst_exponent: 1.1 must not exceed 1"),
        ({"fallback": "guess"}, "friction.options.fallback: "),
        ({"dem": {"cache": False}}, "friction.options.dem: goes with fallback = 'dem'; set that, or leave it out"),
        (
            {"fallback": "dem", "dem": {"seed": 2}},
            "friction.options.dem.seed: leave it out, it is friction.options.seed",
        ),
        ({"fallback": "dem", "dem": {"plate": {}}}, "friction.options.dem.plate: unknown option of friction provider"),
        (
            {"fallback": "dem", "dem": {"plates": {"sphere": 3}}},
            "friction.options.dem.plates.sphere: unknown key (did you mean 'spheres'?)",
        ),
    ],
)
def test_refused_options_name_the_key(options: dict[str, object], told: str) -> None:
    with pytest.raises(ProviderError, match=re.escape(told).replace(r"\.\*", ".*")) as caught:
        load("surrogate", options)
    assert "'surrogate'" in str(caught.value)
    assert "\n" not in str(caught.value)


def loaded_by(program: str) -> set[str]:
    """The top-level modules a fresh interpreter has after a program."""
    program += "\nimport sys\nprint(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_options_are_read_without_torch() -> None:
    loaded = loaded_by("from macrofit.friction import load\nload('surrogate', {})")
    assert "surrogate" in loaded
    assert not loaded & {"torch", "safetensors", "numba", "scipy", "h5py", "mpi4py", "dolfinx"}


def test_the_energy_network_answers_without_torch() -> None:
    program = """
import sys
sys.modules["torch"] = None
import numpy as np
from macrofit.friction import BuildContext, TilePairs, build
context = BuildContext(seat_tiles=2, bore_tiles=2, youngs_modulus=206e3, poisson_ratio=0.3)
tiles, none = np.arange(2), np.zeros(2)
print(*build("surrogate", {}, context).coefficients(TilePairs(tiles, tiles, none, none)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert all(0.01 < float(mu) < 0.2 for mu in done.stdout.split())


@pytest.mark.parametrize(("missing", "network"), [("torch", "cnn"), ("safetensors", "energy")])
def test_without_the_extra_it_says_what_to_install(missing: str, network: str) -> None:
    program = f"""
import sys
sys.modules[{missing!r}] = None
from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, build
context = BuildContext(seat_tiles=1, bore_tiles=1, youngs_modulus=206e3, poisson_ratio=0.3)
try:
    build("surrogate", {{"network": {network!r}}}, context)
except ProviderError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.count("\n") == 1
    assert "friction provider 'surrogate' cannot be built" in done.stdout
    assert "pip install 'macrofit[surrogate]'" in done.stdout
    assert f"{missing}" in done.stdout.partition("(")[2].partition(")")[0]


# Checkpoints that are none


def test_a_checkpoint_that_is_none_is_refused(tmp_path: Path, model: str) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return pytest.fail, ("it was unpickled",)

    (tmp_path / "pickle.safetensors").write_bytes(pickle.dumps(Trap()))
    (tmp_path / "empty").write_bytes(b"")
    whole = Path(model).read_bytes()
    (tmp_path / "torn").write_bytes(whole[: len(whole) // 2])
    for name, told in (
        ("none", "there is no such file"),
        ("pickle.safetensors", "is no checkpoint of macrofit-surrogate"),
        ("empty", "is no checkpoint of macrofit-surrogate"),
        ("torn", "is no checkpoint of macrofit-surrogate"),
        (".", "is no checkpoint of macrofit-surrogate"),
    ):
        with pytest.raises(ProviderError, match=rf"friction\.options\.model: .*{told}") as caught:
            made(str(tmp_path / name))
        assert "\n" not in str(caught.value)


def test_a_network_of_envelopes_is_refused(tmp_path: Path) -> None:
    """Tiles have no spheres; nor would another fallback help."""
    path = untrained(tmp_path / "e.safetensors", faces="envelope")
    with pytest.raises(ProviderError, match=r"friction\.options\.model: .*e\.safetensors was trained on envelopes"):
        made(path, fallback="warning")


# Inputs the network has not seen

FOREIGN: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "micro": ({"micro_friction": 0.5}, {}, "micro_friction = 0.5 is outside 0.01"),
    "levels": ({"surface": {"levels": 7}}, {}, "levels = 7 is outside"),
    "height": ({"surface": {"max_height": 0.2}}, {}, "max_height = 0.2 is outside 0.00"),
    "exponent": ({"surface": {"hurst_exponent": 0.02}}, {}, "hurst_exponent = 0.02 is outside"),
    "spectral": (
        {"surface": {"generator": "self_affine", "rms_height": 0.02}},
        {},
        "rms_height = 0.02 is outside 0.00",
    ),
    "lay": ({"surface": {"lay": "ground"}}, {}, "lay = 'ground' is not 'isotropic'"),
    "tile": ({}, {"tile_size": 0.5}, "tile_size = 0.5 is not 1 mm"),
    "modulus": ({}, {"youngs_modulus": 70e3}, "youngs_modulus = 70000 is outside 199820 ... 212180 MPa"),
    "ratio": ({}, {"poisson_ratio": 0.28}, "poisson_ratio = 0.28 is not 0.3"),
}


@pytest.mark.parametrize(("options", "changed", "told"), FOREIGN.values(), ids=FOREIGN.keys())
def test_unseen_inputs_are_refused(model: str, options: dict[str, Any], changed: dict[str, Any], told: str) -> None:
    with pytest.raises(ProviderError, match=f"has not seen such inputs: {re.escape(told)}") as caught:
        build("surrogate", options | {"model": model}, context(**changed))
    assert "fallback = 'dem' (slow) or 'warning'" in str(caught.value)
    assert str(caught.value).count(";") == 0  # one reason alone
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("quiet")
def test_the_ends_of_what_was_seen_are_not_refused(model: str) -> None:
    made(model, micro_friction=0.01, surface={"levels": 3, "max_height": 0.005, "hurst_exponent": 0.5})
    made(model, micro_friction=0.09, surface={"levels": 4, "max_height": 0.04, "hurst_exponent": 1.0})
    for modulus in (206e3, 210e3):
        build("surrogate", {"model": model}, context(youngs_modulus=modulus))


@pytest.mark.parametrize(("options", "changed", "told"), FOREIGN.values(), ids=FOREIGN.keys())
def test_unseen_inputs_can_be_predicted_with_a_warning(
    options: dict[str, Any],
    changed: dict[str, Any],
    told: str,
    model: str,
    network: Predictor,
    recwarn: pytest.WarningsRecorder,
) -> None:
    with pytest.warns(UserWarning, match=re.escape(told)) as warned:
        provider = build("surrogate", options | {"model": model, "fallback": "warning"}, context(**changed))
    assert isinstance(provider, TileNetwork)
    keys = provider.options.faces(1.0)
    wheel, axle = generated_face("wheel", 65538, keys), generated_face("axle", 65537, keys)
    one = np.zeros(1, dtype=np.int64)
    expected = max(0.0, network(wheel[None], axle[None], one, one, provider.options.micro_friction).mean[0])
    assert answers(provider, (1, 2), (1, 2)) == [expected, expected]
    answers(provider, (1, 3), (0, 0))
    assert (provider.out_of_range, len(warned)) == (3, 1)
    assert not [each for each in recwarn if "asked nevertheless" in str(each.message)]


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("form", ["tiles", "levelled", "strip"])
def test_every_form_is_within_what_was_seen(model: str, form: str) -> None:
    """A network sees slopes, whatever a face was cut from; forms have faces, and so coefficients, of their own."""
    found = made(model, surface={"form": form})
    assert found.trusted
    others = [made(model, surface={"form": other}) for other in ("tiles", "levelled", "strip") if other != form]
    for other in others:
        assert answers(other, *PAIRS) != answers(found, *PAIRS)
    assert made(model, surface={"form": form, "generator": "self_affine"}).trusted


@pytest.mark.usefixtures("quiet")
def test_seen_inputs_are_not_counted(model: str) -> None:
    provider = made(model, fallback="warning")
    answers(provider, (0, 0))
    assert provider.out_of_range == 0


def test_unseen_inputs_can_go_to_the_plates(tmp_path: Path, model: str) -> None:
    """The same surfaces, micro coefficient and options; its cache too."""
    own: dict[str, Any] = {"micro_friction": 0.3, "seed": 5, "surface": {"levels": 2, "hurst_exponent": 0.7}}
    given = context(cache_dir=str(tmp_path))
    with pytest.warns(UserWarning, match=r"micro_friction = 0\.3 is outside .*'dem' answers for all pairs") as told:
        provider = build("surrogate", own | {"model": model, "fallback": "dem", "dem": SMALL_PLATES}, given)
    assert len(told) == 1
    dem = build("dem", own | SMALL_PLATES | {"cache": False}, context())
    assert isinstance(provider, TileFriction)
    assert answers(provider, *PAIRS) == answers(dem, *PAIRS)
    assert len(list(tmp_path.rglob("*.json"))) == 3


@pytest.mark.filterwarnings("ignore:friction provider 'surrogate'")
def test_plates_that_cannot_be_built_either_are_one_line(model: str) -> None:
    told_of = "'surrogate' cannot be built: .*'dem' cannot be built: .*poisson_ratio"
    with pytest.raises(ProviderError, match=told_of) as told:
        build("surrogate", {"model": model, "fallback": "dem"}, context(poisson_ratio=0.28))
    assert "\n" not in str(told.value)


# Other plates


def learned_from(path: Path, **plates: Any) -> str:
    """The network that has learned nothing, with other plates in its provenance."""
    model, about = load_checkpoint(Path(untrained(path)))
    save_checkpoint(path, model, msgspec.structs.replace(about, plates=Plates(**plates)))
    return str(path)


@pytest.mark.parametrize(
    ("plates", "told"),
    [
        ({"spheres": 1000}, "plates.spheres = 1000 is not 3000"),
        ({"thickness": 0.4}, "plates.thickness = 0.4 is not 0.3"),
        ({"cube": 1.2}, "plates.cube = 1.2 is not 1"),
        ({"external_modulus": "paper"}, "plates.external_modulus = 'paper' is not 'series'"),
    ],
)
def test_other_plates_than_learned_from_are_named(plates: dict[str, Any], told: str, tmp_path: Path) -> None:
    model = learned_from(tmp_path / "m.safetensors")
    with pytest.raises(ProviderError, match=f"has not seen such inputs: {re.escape(told)}") as caught:
        build("surrogate", {"model": model, "plates": plates}, context())
    assert str(caught.value).count(";") == 0  # one reason alone
    assert "\n" not in str(caught.value)
    fitting = learned_from(tmp_path / "m.safetensors", **plates)
    build("surrogate", {"model": fitting, "plates": plates}, context())
    build("surrogate", {"model": fitting}, context())  # whose plates are then its own


def test_the_speed_of_the_plates_is_compared(tmp_path: Path) -> None:
    published: dict[str, Any] = {
        "spheres": 1000, "thickness": 0.4, "external_face": "beams", "external_modulus": "paper", "engine": "explicit",
    }  # fmt: skip
    options = {"plates": "as-published"}
    build("surrogate", options | {"model": learned_from(tmp_path / "m.safetensors", speed=1e4, **published)}, context())
    for changed, told in (
        ({"speed": 2e4}, "engine.speed = 10000 is not 20000"),
        ({"engine": "quasi-static"}, "engine.name = 'explicit' is not 'quasi-static'"),
        ({"speed": 0.0, "resonance": 0.75}, "engine.resonance = 0 is not 0.75"),
    ):
        model = learned_from(tmp_path / "m.safetensors", **{"speed": 1e4} | published | changed)
        with pytest.raises(ProviderError, match=f"such inputs: {re.escape(told)}. Take"):
            build("surrogate", options | {"model": model}, context())


def test_a_preset_brings_its_own_surfaces(model: str) -> None:
    """As for the plates of `dem`, so that both see the same."""
    options: dict[str, Any] = {"plates": "as-published", "surface": {"levels": 4}}
    faces = Surrogate(**options).faces(1.0)
    dem = DirectDem(**options).settings(1.0).surface
    for key in faces.__struct_fields__:
        assert getattr(faces, key) == getattr(dem, key)
    assert (faces.form, faces.levels, faces.max_height) == ("tiles", 4, 0.04)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"plates": "as-printed"}, "friction.options.plates = 'as-printed': take slow or as-published, or keys"),
        ({"plates": {"sphere": 3}}, "friction.options.plates.sphere: unknown key (did you mean 'spheres'?)"),
        ({"plates": {"preset": []}}, "friction.options.plates = []: take slow or as-published, or keys"),
        (
            {"plates": {"packing_seed": 3}},
            "friction.options.plates.packing_seed: leave it out, the network gives the mean over packings",
        ),
        ({"plates": {"edge": 2.0}}, "friction.options.plates.edge: leave it out, it is the length of a tile"),
        (
            {"fallback": "dem", "dem": {"plates": "as-published"}},
            "friction.options.dem.plates: a preset of plates is friction.options.plates",
        ),
        ({"network": "rnn"}, "friction.options.network: "),
        ({"network": "cnn", "model": "m"}, "friction.options.network: leave it out, it is friction.options.model"),
    ],
)
def test_plates_and_networks_that_are_none_are_named(options: dict[str, object], told: str) -> None:
    with pytest.raises(ProviderError, match=re.escape(told)):
        load("surrogate", options)


@pytest.mark.parametrize("plates", SHIPPED)
@pytest.mark.parametrize("network", ["energy", "cnn"])
def test_plates_and_name_choose_the_network_that_comes_with_the_package(plates: str, network: str) -> None:
    provider = build("surrogate", {"plates": plates, "network": network}, context())
    assert isinstance(provider, TileNetwork)
    about = provider.tiles.predictor.provenance
    assert about.architecture == {"energy": "energy", "cnn": "paper"}[network]
    assert (about.plates.speed, about.plates.spheres) == {"slow": (0.0, 3000), "as-published": (1e4, 1000)}[plates]
    low, high = {"slow": (0.06, 0.09), "as-published": (0.09, 0.135)}[plates]
    assert low < np.mean(answers(provider, *PAIRS)) < high
    assert np.all(provider.uncertainty(asked(*PAIRS)) > 1e-4)


def test_plates_that_answer_for_lost_contact_are_those_of_the_network(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=r"other plates than the network has learned from: plates\.spheres = 400 is"):
        made(learned_from(tmp_path / "m.safetensors"), fallback="dem", dem={"plates": {"spheres": 400}})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made(learned_from(tmp_path / "m.safetensors"), fallback="dem")
        given = {"plates": {"spheres": 400}, "fallback": "dem"}
        made(learned_from(tmp_path / "m.safetensors", spheres=400), **given)


def test_every_preset_of_plates_has_networks() -> None:
    assert list(SHIPPED) == list(PRESETS)


# Pairs that lose contact


def test_pairs_that_lose_contact_are_counted() -> None:
    provider = TileNetwork(Fake([0.1, 0.2, 0.3], [True, False, False]), Surrogate())  # type: ignore[arg-type]
    assert answers(provider, *PAIRS) == [0.3, 0.1, 0.2, 0.3]
    assert provider.losing_contact == 2
    assert provider.uncertainty(asked(*PAIRS)).tolist() == 4 * [0.01]


def test_pairs_that_lose_contact_go_to_the_plates(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """These alone; and the plates are not even made before there is one."""
    options: dict[str, Any] = {"micro_friction": 0.08, "fallback": "dem", "dem": SMALL_PLATES}
    dem = build("dem", {"micro_friction": 0.08} | SMALL_PLATES, context())
    built: list[str] = []

    def counted(name: str, *given: Any) -> Any:
        built.append(name)
        return build(name, *given)

    monkeypatch.setattr(surrogate.provider, "build", counted)
    provider = made(model, **options)
    monkeypatch.setattr(provider, "tiles", Fake([0.1, 0.2, 0.3], [True, True, True]))
    assert answers(provider, *PAIRS) == [0.3, 0.1, 0.2, 0.3]
    assert built == []
    monkeypatch.setattr(provider, "tiles", Fake([0.1, 0.2, 0.3, 0.4], [True, False, True, False]))
    found = answers(provider, (5, 5), *PAIRS)
    expected = answers(dem, (5, 5), (2, 3))
    assert found == [expected[0], 0.3, 0.1, expected[1], 0.3]
    assert (provider.losing_contact, built) == (2, ["dem"])
    spread = provider.uncertainty(asked((5, 5), *PAIRS))
    stated = answered(dem, asked((5, 5), (2, 3)), "dem").uncertainty
    assert np.array_equal(spread, [stated[0], 0.01, 0.01, stated[1], 0.01], equal_nan=True)
    assert 0.01 not in stated
    monkeypatch.setattr(provider, "tiles", Fake([0.1, 0.2, 0.3], seen=[True, False, True]))
    assert answers(provider, *PAIRS) == [0.3, 0.1, expected[1], 0.3]  # nor is one unlike all that were learned from


# A press fit


def small_tables(**friction: Any) -> dict[str, Any]:
    """Six tiles of seat, pressed 5 mm: 24 pairs."""
    return {
        "axle": {"seat_radius": 95.0, "seat_length": 6.0, "taper_length": 2.0, "taper_height": 0.5},
        "wheel": {"bore_radius": 94.85, "hub_length": 5.0, "hub_outer_radius": 140.0},
        "motion": {"travel": 5.0, "increment": 1.0},
        "mesh": {"seat_facet": 0.5, "bore_facet": 0.47, "coarse": 20.0},
        "output": {"stress": False, "fields_at": []},
        "friction": friction,
    }


def toml(tables: dict[str, Any]) -> str:
    lines = []
    for name, table in tables.items():
        lines += [f"[{name}]", *(f"{key} = {msgspec.json.encode(value).decode()}" for key, value in table.items())]
    return "\n".join(lines)


def test_a_press_fit_on_predicted_friction(model: str) -> None:
    fit = solve(build_scene(small_tables(provider="surrogate", options={"model": model, "seed": 2})), MPI.COMM_SELF)
    assert fit.counters["pairs_asked"] == 24
    found = answers(made(model, seed=2), *((seat, bore) for seat in range(8) for bore in range(8)))
    facets = fit.increments[-1].facets
    pressed = facets.friction[facets.pressure > 0.0]
    assert min(found) - TOLERANCE <= pressed.min() < pressed.max() <= max(found) + TOLERANCE
    uniform = solve(build_scene(small_tables(options={"coefficient": float(np.mean(found))})), MPI.COMM_SELF)
    moved = slice(1, None)  # in place no force is left
    assert np.abs(fit.force[moved] / uniform.force[moved] - 1.0).max() < max(found) / min(found) - 1.0
    other = solve(build_scene(small_tables(provider="surrogate", options={"model": model, "seed": 3})), MPI.COMM_SELF)
    assert not np.array_equal(fit.force, other.force)


def test_what_was_never_seen_is_said_and_counted(tmp_path: Path, model: str) -> None:
    options = {"model": model, "micro_friction": 0.2, "fallback": "warning"}
    scene = tmp_path / "scene.toml"
    scene.write_text(toml(small_tables(provider="surrogate", options=options)).replace('":', '" ='))
    done = subprocess.run(
        [sys.executable, "-m", "macrofit", "run", str(scene), "-o", str(tmp_path / "out"), "--quiet"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert re.match(r"macrofit: warning: friction provider 'surrogate': .*micro_friction = 0\.2", done.stderr)
    warned = [line for line in done.stderr.splitlines() if "Doubtful" not in line]
    assert len(warned) == 1  # no place in the code, whoever else takes warnings
    counters = json.loads((tmp_path / "out" / "summary.json").read_text())["counters"]
    assert counters["provider_out_of_range"] == counters["pairs_asked"] == 24


@pytest.mark.parametrize(
    ("command", "override", "told"),
    [
        ("check", "friction.options={sede=1}", "macrofit: friction.options.sede: unknown option"),
        ("check", "friction.options.surface={level=3}", "macrofit: options of friction provider 'surrogate': "),
        ("run", "friction.options.micro_friction=0.5", "macrofit: friction provider 'surrogate' cannot be built: "),
        ("run", "friction.options.model='none.safetensors'", "macrofit: friction provider 'surrogate' cannot be built"),
    ],
)
def test_a_mistake_is_one_line_and_code_2(
    command: str, override: str, told: str, model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(toml(small_tables(provider="surrogate")))
    arguments = [command, "small.toml", "--set", f"friction.options.model='{model}'", "--set", override]
    shown = CliRunner(mix_stderr=False).invoke(main, [*arguments, *(["-o", "out"] if command == "run" else [])])
    assert shown.exit_code == 2
    assert shown.stderr.startswith(told)
    assert shown.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_network_and_plates_agree(tmp_path: Path) -> None:
    """Six pairs it has not learned from, within four of the standard deviations it states; seeds as of a run."""
    pairs = [(3, 1), (10, 8), (47, 20), (90, 33), (120, 77), (179, 150)]
    network = build("surrogate", {}, context(seat_tiles=190, bore_tiles=190))
    dem = build("dem", {}, context(cache_dir=str(tmp_path)))
    error = np.subtract(answers(network, *pairs), answers(dem, *pairs))
    assert isinstance(network, TileNetwork)
    assert (np.abs(error) <= 4.0 * network.uncertainty(asked(*pairs))).all()


def test_the_digest_is_that_of_the_networks_file(tmp_path):
    """For the record of a run: another network is another digest, and one that is not there has none."""
    given = tmp_path / "own.safetensors"
    given.write_bytes(b"weights")
    assert Surrogate(model=str(given)).digest == hashlib.sha256(b"weights").hexdigest()
    assert Surrogate(model=str(tmp_path / "none")).digest == ""
    shipped = {Surrogate(plates=name).digest for name in PRESETS} | {Surrogate(network="cnn").digest}
    assert len(shipped) == len(list(PRESETS)) + 1
