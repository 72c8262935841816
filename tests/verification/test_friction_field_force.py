"""The force that a field of friction gives: of a constant one, of one along the seat; and how often it is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI
from small import plain_shaft, small_press, solved

from macrofit.contact.status import SLIP
from macrofit.errors import ProviderError, SceneError
from macrofit.figures.friction import facet_uncertainty
from macrofit.friction import FieldState, FloatArray, TilePairs, Uniform
from macrofit.scene import Scene, build_scene
from macrofit.solution import Solution
from macrofit.solve import solve

MU = 0.11


class Counted:
    """Coefficients by a rule; remembers every batch."""

    digest = "the rules of this file"

    def __init__(self, rule: Callable[[TilePairs], FloatArray], *depends_on: str) -> None:
        self.rule, self.depends_on = rule, frozenset(depends_on)
        self.batches: list[list[tuple[int, int]]] = []

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        self.batches.append(list(zip(pairs.seat.tolist(), pairs.bore.tolist(), strict=True)))
        return self.rule(pairs)


def constant(pairs: TilePairs) -> FloatArray:
    return np.full(pairs.seat.size, MU)


def rough(pairs: TilePairs) -> FloatArray:
    return 0.05 + 0.01 * ((7 * pairs.seat + 3 * pairs.bore) % 10)


def chosen(provider: str, options: str) -> Scene:
    return small_press(f"friction.provider={provider}", f"friction.options={options}")


@pytest.fixture(scope="module")
def uniform() -> Solution:
    return solved(small_press(f"friction.options.coefficient={MU}"))


def assert_same_bits(one: Solution, other: Solution) -> None:
    assert (one.force == other.force).all()
    for a, b in zip(one.increments, other.increments, strict=True):
        assert (a.facets.pressure == b.facets.pressure).all()
        assert (a.facets.friction == b.facets.friction).all()
        assert a.mean_friction == b.mean_friction


ALONG = f"z_mm,coefficient\n-10,{MU}\n30,{MU}\n31.7,{MU}\n200,{MU}\n"
PAIRS = "seat,bore,coefficient\n" + "".join(f"{k},{j},{MU}\n" for k in range(75) for j in range(75))
TABLE = "{file='FILE'}"
EVOLVING = f"{{base='uniform', options={{coefficient={MU}}}, flat_coefficient="


@pytest.mark.parametrize(
    ("provider", "options", "text"),
    [
        ("table", TABLE, f"z_mm,coefficient\n7,{MU}\n"),
        ("table", TABLE, ALONG),
        ("table", TABLE, PAIRS),
        ("evolving", EVOLVING + "0.03}", ""),
        ("evolving", EVOLVING + f"{MU}, work=1e3}}", ""),
        ("evolving", f"{{base='table', options={TABLE}, flat_coefficient={MU}, work=1e3}}", ALONG),
    ],
    ids=["one value", "equal values", "equal pairs", "evolving, off", "evolving to itself", "evolving table"],
)
def test_a_constant_of_any_kind_is_uniform_to_the_bit(
    provider: str, options: str, text: str, uniform: Solution, tmp_path: Path
) -> None:
    file = tmp_path / "mu.csv"
    file.write_text(text)
    assert_same_bits(solve(chosen(provider, options.replace("FILE", str(file))), MPI.COMM_SELF), uniform)


@pytest.mark.parametrize("depends_on", [(), ("tiles",), ("pressure",), ("tiles", "pressure", "sliding")])
def test_a_third_party_constant_is_uniform_to_the_bit(depends_on: tuple[str, ...], uniform: Solution) -> None:
    provider = Counted(constant, *depends_on)
    assert_same_bits(solve(small_press(), MPI.COMM_SELF, friction=provider), uniform)
    assert provider.batches


def test_a_coefficient_that_is_not_constant_is_seen(uniform: Solution) -> None:
    """What the comparisons above can tell: 1e-12 of the coefficient on one seat tile."""
    nearly = Counted(lambda pairs: np.where(pairs.seat == 30, MU * (1.0 + 1e-12), MU), "tiles")
    solution = solve(small_press(), MPI.COMM_SELF, friction=nearly)
    assert (solution.force != uniform.force).any()


def test_the_force_of_a_coefficient_along_the_seat(tmp_path: Path) -> None:
    """F(s) = 2 pi R int mu(z) p dz to 1e-10, with the run's own pressure and mu from the table.

    On the plain shaft the facets of 1 mm are the tiles, mu is that of the facet's middle, and a facet's pressure is
    its mean over the part that the ring covers: the integral is a sum. Everything slides. The pushing force has an
    elastic part besides, which facets in part covered leave: below 1e-4.
    """
    file = tmp_path / "mu.csv"
    file.write_text("z_mm,coefficient\n0,0.06\n25,0.16\n60,0.1\n")
    solution = solve(plain_shaft("table", file=str(file)), MPI.COMM_SELF)
    middle = 0.5 * (solution.seat[1:] + solution.seat[:-1])
    mu = np.interp(middle, [0.0, 25.0, 60.0], [0.06, 0.16, 0.1])
    for record in solution.increments[1:]:
        held = record.facets.pressure > 0.0
        assert (record.facets.status[held] == SLIP).all()
        ends = np.clip(solution.seat, record.displacement - 30.0, record.displacement)
        force = 2.0 * math.pi * 50.0 * float(np.sum(mu * record.facets.pressure * np.diff(ends)))
        assert record.friction_force == pytest.approx(force, rel=1e-10)
        assert record.force == pytest.approx(force, rel=1e-4)
    assert np.ptp([record.mean_friction for record in solution.increments[1:]]) > 0.005


def test_new_pairs_only_are_asked_in_one_batch() -> None:
    """The second increment of a place asks for nothing; no pair is asked twice; at most one batch for an increment."""
    provider = Counted(rough, "tiles")
    scene = small_press("motion={displacements=[40, 45, 50, 45, 50, 55]}")
    sizes: list[int] = []

    class Watch:
        def started(self, *_: object) -> None: ...

        def increment(self, record: object) -> None:
            sizes.append(len(provider.batches))

        def finished(self) -> None: ...

    solution = solve(scene, MPI.COMM_SELF, Watch(), friction=provider)
    assert sizes == [1, 2, 3, 3, 3, 4]
    asked = [pair for batch in provider.batches for pair in batch]
    assert len(asked) == len(set(asked)) == solution.counters["pairs_asked"]
    assert solution.counters["provider_calls"] == 4
    assert solution.friction is not None
    assert sorted(asked) == list(zip(solution.friction.seat.tolist(), solution.friction.bore.tolist(), strict=True))


class Memory:
    """A journal in memory that can be cut short."""

    def __init__(self, kept: list[Any]) -> None:
        self.kept = kept

    def records(self) -> list[Any]:
        return list(self.kept)

    def append(self, record: object, state: dict[str, Any]) -> None:
        self.kept.append((record, {name: array.copy() for name, array in state.items()}))


def test_a_resumed_run_asks_for_new_pairs_only() -> None:
    """What the journal knows is not asked again, and the run is the uninterrupted one."""
    whole, first, rest = Memory([]), Counted(rough, "tiles"), Counted(rough, "tiles")
    uninterrupted = solve(small_press(), MPI.COMM_SELF, journal=whole, friction=first)
    resumed = solve(small_press(), MPI.COMM_SELF, journal=Memory(whole.kept[:6]), friction=rest)
    assert_same_bits(uninterrupted, resumed)
    assert rest.batches == first.batches[6:]
    assert uninterrupted.friction is not None
    assert resumed.friction is not None
    for name in ("seat", "bore", "coefficient"):
        assert (getattr(uninterrupted.friction, name) == getattr(resumed.friction, name)).all()


def test_a_journal_without_pairs_still_resumes() -> None:
    """One of an earlier version: its pairs are asked again."""
    whole, columns = Memory([]), [f"friction.{column}" for column in FieldState._fields]
    provider = Counted(rough, "tiles")
    uninterrupted = solve(small_press(), MPI.COMM_SELF, journal=whole, friction=provider)
    old = [
        (record, {name: values for name, values in state.items() if name not in columns})
        for record, state in whole.kept[:6]
    ]
    assert_same_bits(uninterrupted, solve(small_press(), MPI.COMM_SELF, journal=Memory(old), friction=provider))


def test_a_journal_is_of_one_friction() -> None:
    """That of an object is resumed neither with the scene's own friction nor with another digest, nor the reverse."""
    first, other, own = Counted(rough, "tiles"), Counted(rough, "tiles"), Memory([])
    other.digest = "another rule"
    whole = Memory([])
    solve(small_press(), MPI.COMM_SELF, journal=whole, friction=first)
    solve(small_press(), MPI.COMM_SELF, journal=own)
    for kept, friction in ((whole, None), (whole, other), (own, first)):
        with pytest.raises(ProviderError, match="another friction provider"):
            solve(small_press(), MPI.COMM_SELF, journal=Memory(kept.kept[:6]), friction=friction)


def test_an_object_without_a_digest_keeps_no_journal() -> None:
    nameless = Counted(rough, "tiles")
    nameless.digest = ""
    with pytest.raises(ProviderError, match=r"Counted' is an object without a digest"):
        solve(small_press(), MPI.COMM_SELF, journal=Memory([]), friction=nameless)


@pytest.mark.parametrize(
    ("answer", "told"), [(np.full(3, 0.1), "with shape"), (None, "not with real numbers"), (2.5, "a coefficient has")]
)
def test_the_answers_of_an_object_are_checked(answer: Any, told: str) -> None:
    given = Counted(lambda pairs: np.full(pairs.seat.size, answer) if isinstance(answer, float) else answer, "tiles")
    with pytest.raises(ProviderError, match=rf"test_friction_field_force:Counted.*{told}"):
        solve(small_press(), MPI.COMM_SELF, friction=given)


def test_options_and_their_class_are_as_good_as_a_provider(uniform: Solution) -> None:
    """The scene that is handed back names what was given, so that no file tells of another friction."""
    named = [f"friction.provider={Uniform.__module__}:Uniform", "friction.options.coefficient=0.11"]
    for scene, given in ((small_press(*named), Uniform), (small_press(), Uniform(0.11))):
        solution = solve(scene, MPI.COMM_SELF, friction=given)
        assert_same_bits(solution, uniform)
        assert solution.scene.friction.provider == "macrofit.friction.uniform:Uniform"
        assert solution.scene.friction.options == {"coefficient": 0.11}
        with pytest.raises(ProviderError, match="is an object of a script, not installed"):
            solve(build_scene(msgspec.to_builtins(solution.scene)), MPI.COMM_SELF)


def test_what_is_no_provider_is_refused() -> None:
    with pytest.raises(ProviderError, match=r"friction = 0\.1: is no provider"):
        solve(small_press(), MPI.COMM_SELF, friction=0.1)  # type: ignore[arg-type]
    given = ["friction.provider=macrofit.friction.uniform:Uniform", "friction.options.coefficient=0.2"]
    with pytest.raises(SceneError, match=r"friction\.options\.coefficient: cannot change"):
        solve(small_press(*given), MPI.COMM_SELF, friction=Uniform(0.11))


def test_the_uncertainty_of_a_facet(tmp_path: Path) -> None:
    """Independent pairs: sqrt(sum (w s)^2) / sum w. At 36.7 mm a facet of 1 mm faces pairs over 0.7 and 0.3 mm."""
    file = tmp_path / "mu.csv"
    rows = [f"{k},{j},0.1,{0.01 if (k + j) % 2 else 0.03}" for k in range(60) for j in range(31)]
    file.write_text("\n".join(["seat,bore,coefficient,uncertainty", *rows]))
    solution = solve(plain_shaft("table", file=str(file)), MPI.COMM_SELF)
    assert solution.friction is not None
    spread = facet_uncertainty(solution, solution.friction, 36.7)
    # facet k covers [k, k + 1]; tile j = 35 - k faces [k + 0.7, k + 1], with k + j odd, tile 36 - k the rest
    expected = math.hypot(0.3 * 0.01, 0.7 * 0.03)
    np.testing.assert_allclose(spread[7:36], expected, rtol=1e-9)
    assert np.isnan(spread[:6]).all()
    assert np.isnan(spread[37:]).all()
