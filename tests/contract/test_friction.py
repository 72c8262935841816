"""The friction contract: the conformance check tells good providers from bad ones, and plugins are found."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from macrofit.errors import ProviderError
from macrofit.friction import (
    BuildContext,
    FacingPairs,
    FloatArray,
    TileOverlaps,
    TilePairs,
    Uniform,
    announce,
    build,
    load,
    names,
)
from macrofit.friction.conformance import ConformanceError, check
from macrofit.friction.field import FrictionField

HERE = Path(__file__).resolve().parent
PLUGIN = HERE.parent / "data" / "thirdparty_friction"
CONTEXT = BuildContext(seat_tiles=8, bore_tiles=8, youngs_modulus=206e3, poisson_ratio=0.3)

Law = Callable[[TilePairs], object]


class Provider:
    """A provider made of a law, for the tests."""

    def __init__(self, law: Law, *depends_on: str) -> None:
        self.law = law
        self.depends_on = frozenset(depends_on)

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        return self.law(pairs)  # type: ignore[return-value]


class Doubtful(Provider):
    """A provider that states its uncertainty."""

    def __init__(self, doubt: Law, *depends_on: str) -> None:
        super().__init__(lambda pairs: np.full(pairs.seat.size, 0.1), *depends_on)
        self.doubt = doubt

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        return self.doubt(pairs)  # type: ignore[return-value]


class Hearing(Provider):
    """A provider that hears ahead what it will be asked."""

    def __init__(self, hear: Callable[[Hearing, TilePairs], object]) -> None:
        super().__init__(lambda pairs: stripes(pairs) + self.offset, "tiles", "pressure")
        self.hear, self.offset, self.heard = hear, 0.0, 0

    def announced(self, pairs: TilePairs) -> None:
        self.heard += 1
        self.hear(self, pairs)


def shifting(provider: Hearing, pairs: TilePairs) -> None:
    """What is heard changes the answers."""
    provider.offset += 1e-3


def stripes(pairs: TilePairs) -> FloatArray:
    return 0.1 + 0.01 * pairs.seat + 0.002 * pairs.bore


def heated(pairs: TilePairs) -> FloatArray:
    moved: FloatArray = stripes(pairs) + 1e-4 * pairs.pressure + 1e-4 * pairs.sliding
    return moved


def with_one(value: float) -> Law:
    """Right everywhere but on seat tile 0."""
    return lambda pairs: np.where(pairs.seat == 0, value, 0.1)


def mutating(pairs: TilePairs) -> FloatArray:
    pairs.pressure[:] = 0.0
    return np.full(pairs.seat.size, 0.1)


def raising(pairs: TilePairs) -> FloatArray:
    raise RuntimeError("the furnace is cold")


def failing_when_empty(pairs: TilePairs) -> FloatArray:
    return np.full(pairs.seat.size, 0.1 + 0.0 * pairs.seat[0])


def drifting() -> Law:
    rng = np.random.default_rng(0)
    return lambda pairs: 0.1 + 0.01 * rng.random(pairs.seat.size)


def drifting_in_one_buffer() -> Law:
    rng, buffer = np.random.default_rng(0), np.empty(100)
    return lambda pairs: rng.random(out=buffer[: pairs.seat.size])


def batch_normalised(pairs: TilePairs) -> FloatArray:
    return 0.1 + 0.01 * (pairs.seat - pairs.seat.mean() if pairs.seat.size else pairs.seat)


def by_place(pairs: TilePairs) -> FloatArray:
    return 0.1 + 0.001 * np.arange(pairs.seat.size)


def float32_noise(pairs: TilePairs) -> FloatArray:
    return 0.1 + 1e-8 * pairs.seat.size + 0.0 * pairs.pressure


@pytest.mark.parametrize(
    "provider",
    [
        Uniform(),
        Uniform(coefficient=0.0),
        Provider(stripes, "tiles"),
        Provider(heated, "tiles", "pressure", "sliding"),
        Provider(lambda pairs: stripes(pairs).astype(np.float32), "tiles"),
        Provider(float32_noise),
        Doubtful(lambda pairs: 0.1 * stripes(pairs), "tiles"),
        Doubtful(lambda pairs: np.where(pairs.seat < 3, np.nan, 0.0), "tiles"),
        Hearing(lambda provider, pairs: None),
    ],
    ids=[
        "uniform",
        "frictionless",
        "tiles",
        "everything",
        "single precision",
        "batch rounding",
        "doubtful",
        "in part",
        "hears ahead",
    ],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_good_providers_pass(provider: Provider, seed: int) -> None:
    check(provider, seed=seed)


@pytest.mark.parametrize(
    ("provider", "rule"),
    [
        (Provider(with_one(np.nan), "tiles"), "Provider' answered nan for the pair of seat tile 0"),
        (Provider(with_one(np.inf), "tiles"), "answered inf"),
        (Provider(with_one(-0.01), "tiles"), "answered -0.01"),
        (Provider(with_one(2.0), "tiles"), "answered 2.0"),
        (Provider(lambda pairs: 0.11), r"shape \(\)"),
        (Provider(lambda pairs: np.full((pairs.seat.size, 1), 0.1)), "shape"),
        (Provider(lambda pairs: None), "not with real numbers"),
        (Provider(lambda pairs: np.full(pairs.seat.size, 0.1 + 0j)), "not with real numbers"),
        (Provider(raising), "raised RuntimeError: the furnace is cold"),
        (Provider(failing_when_empty), "an empty batch, raised IndexError"),
        (Provider(mutating), "modified its input 'pressure'"),
        (Provider(drifting(), "tiles"), "not deterministic"),
        (Provider(drifting_in_one_buffer(), "tiles"), "not deterministic"),
        (Provider(by_place, "tiles"), "depends on the order"),
        (Provider(batch_normalised, "tiles"), "depends on the other pairs"),
        (Provider(stripes), "depends on tiles, which"),
        (Provider(stripes, "pressure", "sliding"), "depends on tiles, which"),
        (Provider(lambda pairs: 0.1 + 0.01 * pairs.bore), "depends on tiles, which"),
        (Provider(heated, "tiles", "sliding"), "depends on pressure, which"),
        (Provider(heated, "tiles", "pressure"), "depends on sliding, which"),
        (Provider(stripes, "tiles", "weather"), "depends_on is"),
        (Doubtful(with_one(-0.01), "tiles"), r"uncertainty, -0\.01 for the pair of seat tile 0"),
        (Doubtful(with_one(np.inf), "tiles"), "uncertainty, inf"),
        (Doubtful(lambda pairs: np.zeros((pairs.seat.size, 1))), "uncertainty, with shape"),
        (Doubtful(raising), "raised RuntimeError: the furnace is cold"),
        (Doubtful(mutating), "modified its input 'pressure'"),
        (Doubtful(drifting(), "tiles"), "not deterministic.*as uncertainty"),
        (Doubtful(by_place, "tiles"), "depends on the order.*as uncertainty"),
        (Doubtful(batch_normalised, "tiles"), "depends on the other pairs.*as uncertainty"),
        (Doubtful(stripes), "depends on tiles, which.*as uncertainty"),
        (Doubtful(heated, "tiles", "sliding"), "depends on pressure, which"),
        (
            Doubtful(lambda pairs: np.full(pairs.seat.size, np.nan if pairs.seat.size > 5 else 0.1)),
            "depends on the other pairs",
        ),
        (Hearing(lambda provider, pairs: raising(pairs)), "hears of ahead, raised RuntimeError: the furnace is cold"),
        (Hearing(lambda provider, pairs: mutating(pairs)), "hears of ahead, modified its input 'pressure'"),
        (Hearing(shifting), "answers otherwise once it has heard of pairs"),
    ],
)
def test_broken_providers_are_caught(provider: Provider, rule: str) -> None:
    with pytest.raises(ConformanceError, match=rule) as caught:
        check(provider)
    assert "\n" not in str(caught.value)


def test_equality_to_the_bit_can_be_asked_for() -> None:
    with pytest.raises(ConformanceError, match="depends on the other pairs"):
        check(Provider(float32_noise), tolerance=0.0)


def test_lacking_members_are_named() -> None:
    with pytest.raises(ConformanceError, match="no method coefficients"):
        check(object())  # type: ignore[arg-type]
    listed = Provider(stripes, "tiles")
    listed.depends_on = ["tiles"]  # type: ignore[assignment]
    with pytest.raises(ConformanceError, match="depends_on is"):
        check(listed)


class Counting(Provider):
    """A provider that counts something."""

    def __init__(self, counters: object) -> None:
        super().__init__(lambda pairs: np.full(pairs.seat.size, 0.1))
        self.stated = counters

    @property
    def counters(self) -> object:
        return self.stated() if callable(self.stated) else self.stated


@pytest.mark.parametrize(
    ("counters", "told"),
    [
        ([1, 2], r"counters: TypeError: is \[1, 2\], not a dict"),
        ("many", "counters: TypeError: is 'many', not a dict"),
        ({"a": np.nan}, "counters: TypeError"),
        ({"a": 1.5}, "counters: TypeError"),
        ({"a": "3"}, "counters: TypeError"),
        ({3: 3}, "the name 3 is no word"),
        ({"two words": 3}, "the name 'two words' is no word"),
        ({"calls": 3}, "the name 'calls' is no word or the solver's own"),
        (raising, "counters: "),
    ],
)
def test_counters_are_checked_when_the_provider_is_built(counters: object, told: str) -> None:
    stated = (lambda: counters(None)) if callable(counters) else counters
    for built in (check, FrictionField):
        with pytest.raises(ProviderError, match=told) as caught:
            built(Counting(stated))  # type: ignore[operator]
        assert "\n" not in str(caught.value)
    check(Counting({"clipped": np.int64(3), "tried": True}))


def test_counters_that_go_bad_in_a_run_do_not_end_it() -> None:
    provider = Counting({"clipped": 3})
    field = FrictionField(provider)
    assert field.counters == {"provider_clipped": 3}
    provider.stated = {"clipped": np.nan}
    with pytest.warns(UserWarning, match="left out of the summary"):
        assert field.counters == {}


def leaving(pairs: TilePairs) -> FloatArray:
    raise SystemExit("it will not listen")


@pytest.mark.parametrize(
    ("hear", "told"),
    [
        (raising, "RuntimeError: the furnace is cold"),
        (leaving, "ForeignExit: it asked the program to exit"),
        (lambda pairs: pairs.nothing, "AttributeError: "),
    ],
)
def test_who_fails_at_what_it_hears_is_named_once_and_stops_no_other(hear: Law, told: str) -> None:
    """It is asked all the same; those after it hear of theirs, and what one does with its arrays is its own affair."""
    deaf, mute = Hearing(lambda provider, pairs: hear(pairs)), Hearing(lambda provider, pairs: None)
    mute.announced = 3  # type: ignore[assignment, method-assign]
    providers = deaf, mute, Hearing(lambda provider, pairs: mutating(pairs)), Hearing(lambda provider, pairs: None)
    fields = [FrictionField(provider, f"number {k}") for k, provider in enumerate(providers)]
    one = np.zeros(1, dtype=np.int64)
    facing = FacingPairs.of(TileOverlaps(one, one + 2, one + 1, np.ones(1)))
    asked = [(field, field.question(facing, np.full(1, 80.0), np.zeros(1))) for field in fields]
    with pytest.warns(UserWarning, match="failed at `announced`") as warned:
        announce(3 * asked)
    assert [str(each.message).partition(" failed")[0] for each in warned] == [
        f"friction provider 'number {k}'" for k in (0, 1)
    ]
    assert told in str(warned[0].message)
    assert [provider.heard for provider in providers] == [1, 0, 3, 3]
    assert asked[2][1].pairs.pressure.tolist() == [80.0]
    assert [field.answer(question)[0] for field, question in asked] == [stripes(asked[0][1].pairs)[0]] * 4


def test_each_rank_hears_of_its_part() -> None:
    heard: list[int] = []
    provider = Hearing(lambda provider, pairs: heard.extend(pairs.seat.tolist()))
    field = FrictionField(provider, part=lambda pairs: pairs.take(np.flatnonzero(pairs.seat % 2)))
    field.announce(TilePairs(np.arange(5), np.arange(5), np.zeros(5), np.zeros(5)))
    assert heard == [1, 3]


# Options and the registry


def test_uniform_is_built_in_and_has_the_usual_coefficient() -> None:
    assert ("uniform", "macrofit (built in)") in [(found.name, found.source) for found in names()]
    assert load("uniform", {}) == Uniform(coefficient=0.11)
    provider = build("uniform", {"coefficient": 0}, CONTEXT)
    assert not provider.depends_on
    check(provider)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"coeficient": 0.1}, "friction.options.coeficient.*Its options: coefficient"),
        ({"coefficient": "0.1"}, "friction.options.coefficient"),
        ({"coefficient": True}, "friction.options.coefficient"),
        ({"coefficient": -0.1}, "coefficient = -0.1"),
        ({"coefficient": 2.0}, "coefficient = 2.0"),
        ({"coefficient": float("nan")}, "friction.options.coefficient: nan is not a finite number"),
    ],
)
def test_refused_options_name_the_key(options: dict[str, object], told: str) -> None:
    with pytest.raises(ProviderError, match=told):
        load("uniform", options)


def test_the_context_names_its_fields() -> None:
    assert CONTEXT.tile_size == 1.0
    assert CONTEXT.cache_dir is None
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"seat_tiles": "8"}, BuildContext)


Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Puts a one-module plugin on the path with the metadata an installer would write."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(module: str, entry: str, source: str) -> None:
        dist = f"dist_{module}"
        info = tmp_path / f"{dist}-0.3.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {dist}\nVersion: 0.3\n")
        (info / "entry_points.txt").write_text(f"[macrofit.friction]\n{entry}\n")
        (tmp_path / f"{module}.py").write_text(source)
        monkeypatch.delitem(sys.modules, module, raising=False)

    return write


GOOD = """
import msgspec, numpy as np
class Options(msgspec.Struct, frozen=True):
    micro_friction: float
    depends_on = frozenset()
    def build(self, context): return self
    def coefficients(self, pairs): return np.full(len(pairs.seat), self.micro_friction)
"""


def test_only_the_asked_plugin_is_imported(install: Install) -> None:
    install("plugin_kept", "kept = plugin_kept:Options", GOOD)
    install("plugin_asleep", "asleep = plugin_asleep:Options", "raise RuntimeError('woken')")
    listed = {found.name: found for found in names()}
    assert listed["asleep"].source == "dist_plugin_asleep 0.3"
    assert listed["kept"].target == "plugin_kept:Options"
    check(build("kept", {"micro_friction": 0.07}, CONTEXT))
    load("uniform", {})
    assert "plugin_kept" in sys.modules
    assert "plugin_asleep" not in sys.modules
    with pytest.raises(ProviderError, match="micro_friction"):
        load("kept", {})


def test_an_unknown_name_lists_what_is_installed(install: Install) -> None:
    install("plugin_kept", "kept = plugin_kept:Options", GOOD)
    with pytest.raises(
        ProviderError, match=r"no friction provider 'sandpaper'.*'kept' from dist_plugin_kept.*'uniform'"
    ):
        load("sandpaper", {})


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("import a_module_nobody_has", r"of dist_plugin_bad 0\.3 is broken.*a_module_nobody_has"),
        ("raise ValueError('at import')", r"of dist_plugin_bad 0\.3 is broken.*at import"),
        ("", "is broken.*Options"),
        ("Options = 0.11", "breaks the contract.*not a subclass of msgspec.Struct"),
        ("class Options: pass", "breaks the contract.*not a subclass of msgspec.Struct"),
        ("import msgspec\nclass Options(msgspec.Struct): pass", "frozen=True"),
        ("import msgspec\nclass Options(msgspec.Struct, frozen=True): pass", "no method build"),
    ],
)
def test_a_broken_plugin_is_named(install: Install, source: str, told: str) -> None:
    install("plugin_bad", "bad = plugin_bad:Options", source)
    with pytest.raises(ProviderError, match=told) as caught:
        load("bad", {})
    assert "'bad'" in str(caught.value)


@pytest.mark.parametrize(
    ("built", "told"),
    [
        ("0.11", "'bad' breaks the contract.*no method coefficients"),
        ("1 / 0", "'bad' cannot be built: ZeroDivisionError"),
    ],
)
def test_a_plugin_that_builds_no_provider_is_named(install: Install, built: str, told: str) -> None:
    source = f"""
import msgspec
class Options(msgspec.Struct, frozen=True):
    def build(self, context): return {built}
"""
    install("plugin_bad", "bad = plugin_bad:Options", source)
    with pytest.raises(ProviderError, match=told):
        build("bad", {}, CONTEXT)


def test_two_plugins_of_one_name_are_refused(install: Install) -> None:
    install("plugin_one", "twin = plugin_one:Options", GOOD)
    install("plugin_two", "twin = plugin_two:Options", GOOD)
    with pytest.raises(ProviderError, match=r"claimed by dist_plugin_one 0\.3 .* and dist_plugin_two 0\.3"):
        load("twin", {"micro_friction": 0.1})


def test_a_plugin_cannot_take_over_a_built_in_name(install: Install) -> None:
    install("plugin_thief", "uniform = plugin_thief:Options", GOOD)
    assert isinstance(load("uniform", {}), Uniform)
    assert [found.name for found in names()].count("uniform") == 1


# A package of somebody else, installed as a user would


def test_a_third_party_package_is_listed_and_keeps_the_contract(tmp_path: Path) -> None:
    package, site = tmp_path / "package", tmp_path / "site"
    shutil.copytree(PLUGIN, package, ignore=shutil.ignore_patterns("__pycache__"))  # the build writes into it
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index"]
    offline = [*pip, "--no-deps", "--no-build-isolation", "--target", str(site), str(package)]
    _run(offline, tmp_path, os.environ)
    path = os.pathsep.join([str(site), str(HERE.parents[1])])
    program = (
        "from macrofit.friction import *\n"
        "print([tuple(found) for found in names() if found.name == 'stripes'])\n"
        "context = BuildContext(seat_tiles=8, bore_tiles=8, youngs_modulus=206e3, poisson_ratio=0.3)\n"
        "print(build('stripes', {'rough': 0.2}, context))\n"
    )
    told = _run([sys.executable, "-c", program], tmp_path, {**os.environ, "PYTHONPATH": path})
    assert "[('stripes', 'stripes-friction 1.2.0', 'stripes_friction:Stripes')]" in told
    assert "Stripes(smooth=0.08, rough=0.2)" in told
    (package / "stripes_friction.py").unlink()  # so that its test meets the installed module
    its_test = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_stripes.py"]
    assert "1 passed" in _run(its_test, package, {**os.environ, "PYTHONPATH": path})


def _run(command: list[str], folder: Path, environment: os._Environ[str] | dict[str, str]) -> str:
    done = subprocess.run(command, cwd=folder, env=dict(environment), capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
