"""The friction field: what is asked of a provider, how often, and the mean over each facet."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from macrofit.errors import ProviderError
from macrofit.friction import (
    FieldState,
    FloatArray,
    FrictionField,
    IntArray,
    PairFriction,
    TileOverlaps,
    TilePairs,
    Uniform,
    tile_overlaps,
)
from macrofit.scene import load_scene
from macrofit.solve import solve


class Recorder:
    """A provider that remembers what it was asked."""

    def __init__(self, law: Callable[[TilePairs], object], *depends_on: str) -> None:
        self.law = law
        self.depends_on = frozenset(depends_on)
        self.asked: list[TilePairs] = []

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        self.asked.append(pairs)
        return self.law(pairs)  # type: ignore[return-value]


def law(pairs: TilePairs) -> FloatArray:
    return 0.05 + 0.01 * pairs.seat + 0.001 * pairs.bore


def overlaps(*rows: tuple[int, int, int, float]) -> TileOverlaps:
    facet, seat, bore, weight = (np.array(column) for column in zip(*rows, strict=True))
    return TileOverlaps(facet, seat, bore, weight.astype(np.float64))


TWO = overlaps((0, 0, 3, 1.0), (0, 1, 3, 3.0), (2, 1, 3, 0.5))
NONE = TWO.take(np.empty(0, dtype=np.int64))
PRESSURE, SLIDING = np.array([10.0, 20.0, 40.0]), np.array([1.0, 2.0, 4.0])


# Geometry


def test_overlaps_by_hand() -> None:
    # Facets [0, 1.5], [1.5, 3] and [-2, 0.25]; the bore's leading edge at 1.75: bore tile 0 is [0.75, 1.75],
    # tile 1 is [-0.25, 0.75]. All lengths are exact in binary.
    start, end = np.array([0.0, 1.5, -2.0]), np.array([1.5, 3.0, 0.25])
    found = tile_overlaps(start, end, 1.75, 1.0, seat_tiles=2, bore_tiles=2)
    rows = sorted(zip(*(column.tolist() for column in found), strict=True))
    expected = [(0, 0, 0, 0.25), (0, 0, 1, 0.75), (0, 1, 0, 0.5), (1, 1, 0, 0.25), (2, 0, 1, 0.25)]
    assert rows == expected
    assert [column.dtype for column in found] == [np.int64, np.int64, np.int64, np.float64]


@pytest.mark.parametrize("travel", [-1.0, 0.0, 0.3, 17.31, 40.0, 65.7, 200.0])
def test_overlaps_against_sampling(travel: float) -> None:
    """Each length against 4000 points a facet: two ends of 1/4000 of a facet each, so 5e-4 of its length."""
    rng = np.random.default_rng(3)
    start, size, seat_origin, bore_origin = np.sort(rng.uniform(-3.0, 45.0, 30)), 1.3, -2.1, 0.7
    end, points = start + rng.uniform(0.0, 5.0, 30), 4000
    found = tile_overlaps(start, end, travel, size, 30, 25, seat_origin=seat_origin, bore_origin=bore_origin)
    dense = np.zeros((30, 30, 25))
    np.add.at(dense, (found.facet, found.seat, found.bore), found.weight)
    sampled = np.zeros_like(dense)
    for i in range(30):
        z = start[i] + (end[i] - start[i]) * (np.arange(points) + 0.5) / points
        k = np.floor((z - seat_origin) / size).astype(int)
        j = np.floor((travel - bore_origin - z) / size).astype(int)
        inside = (k >= 0) & (k < 30) & (j >= 0) & (j < 25)
        np.add.at(sampled, (i, k[inside], j[inside]), (end[i] - start[i]) / points)
    assert np.abs(dense - sampled).max() <= 5e-4 * (end - start).max()
    assert (dense.sum() > 0.0) == (sampled.sum() > 0.0)


def test_facets_on_the_tiles_have_one_pair_each() -> None:
    """Steps of 0.1 mm do not add up exactly: rounding must not make pairs of no length."""
    travel = float(np.sum(np.full(70, 0.1)))
    assert travel != 7.0
    edges = np.arange(8.0)
    found = tile_overlaps(edges[:-1], edges[1:], travel, 1.0, 7, 20)
    assert found.facet.tolist() == found.seat.tolist() == list(range(7))
    assert found.bore.tolist() == list(range(6, -1, -1))


def test_impossible_facets_are_refused() -> None:
    with pytest.raises(ValueError, match="facet 1 ends before it starts"):
        tile_overlaps(np.array([0.0, 2.0]), np.array([1.0, 1.0]), 1.0, 1.0, 4, 4)
    with pytest.raises(ValueError, match="tile_size"):
        tile_overlaps(np.array([0.0]), np.array([1.0]), 1.0, 0.0, 4, 4)


# What is asked, and how often


def test_a_provider_of_nothing_is_asked_once() -> None:
    provider = Recorder(lambda pairs: np.full(pairs.seat.size, 0.11))
    field = FrictionField(provider)
    for seen in (TWO, NONE, TWO):
        assert field.facet_friction(seen, PRESSURE, SLIDING).tolist() == [0.11] * 3
    assert (field.calls, field.pairs_asked) == (1, 1)
    assert [(pairs.seat.tolist(), pairs.bore.tolist()) for pairs in provider.asked] == [([0], [0])]


def test_a_provider_of_tiles_is_asked_for_new_pairs_only() -> None:
    provider = Recorder(law, "tiles")
    field = FrictionField(provider)
    assert field.facet_friction(NONE, PRESSURE, SLIDING).tolist() == [0.0] * 3
    assert field.calls == 0
    first = field.facet_friction(TWO, PRESSURE, SLIDING)
    np.testing.assert_allclose(first, [0.0605, 0.0, 0.063], rtol=1e-14)  # (0.053 + 3 x 0.063) / 4
    again = field.facet_friction(TWO, 2.0 * PRESSURE, SLIDING)
    assert again.tolist() == first.tolist()
    assert (field.calls, field.pairs_asked) == (1, 2)
    more = overlaps((1, 0, 2, 1.0), (1, 0, 3, 1.0), (0, 5, 0, 1.0), (2, 1, 3, 1.0))
    for _ in range(2):
        found = field.facet_friction(more, PRESSURE, SLIDING)
        np.testing.assert_allclose(found, [0.1, 0.0525, 0.063], rtol=1e-14)
    assert (field.calls, field.pairs_asked) == (2, 4)
    assert [list(zip(pairs.seat, pairs.bore, strict=True)) for pairs in provider.asked] == [
        [(0, 3), (1, 3)],
        [(0, 2), (5, 0)],
    ]


@pytest.mark.parametrize("quantity", ["pressure", "sliding"])
def test_a_provider_of_the_state_is_asked_for_all_pairs_each_time(quantity: str) -> None:
    provider = Recorder(lambda pairs: law(pairs) + 1e-3 * getattr(pairs, quantity), "tiles", quantity)
    field = FrictionField(provider)
    seen = overlaps((0, 0, 3, 1.0), (0, 1, 3, 3.0), (2, 1, 3, 1.0), (1, 9, 9, 0.0))
    for _ in range(2):
        found = field.facet_friction(seen, PRESSURE, SLIDING)
        # pair (1, 3) is faced by facets 0 (weight 3) and 2 (weight 1): pressure 17.5 MPa, slid 1.75 mm
        mean = {"pressure": np.array([10.0, 17.5]), "sliding": np.array([1.0, 1.75])}[quantity]
        by_pair = np.array([0.053, 0.063]) + 1e-3 * mean
        expected = [(by_pair[0] + 3.0 * by_pair[1]) / 4.0, 0.0, by_pair[1]]
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    assert (field.calls, field.pairs_asked) == (2, 4)
    assert provider.asked[0].pressure.tolist() == [10.0, 17.5]
    assert provider.asked[0].sliding.tolist() == [1.0, 1.75]
    calls = field.calls
    assert field.facet_friction(NONE, PRESSURE, SLIDING).tolist() == [0.0] * 3
    assert field.calls == calls


def test_equal_values_are_kept_to_the_bit() -> None:
    """0.1 has no exact binary form: a plain weighted mean of 0.1 with these weights differs from it."""
    rng = np.random.default_rng(0)
    facet, weight = rng.integers(50, size=400), rng.uniform(1e-6, 1.0, 400)
    seen = TileOverlaps(facet, rng.integers(9, size=400), rng.integers(9, size=400), weight)
    field = FrictionField(Recorder(lambda pairs: np.full(pairs.seat.size, 0.1), "tiles"))
    found = field.facet_friction(seen, np.zeros(50), np.zeros(50))
    assert set(found.tolist()) == {0.1}
    assert set((np.bincount(facet, 0.1 * weight) / np.bincount(facet, weight)).tolist()) != {0.1}


def test_a_mean_is_never_negative() -> None:
    """A facet almost wholly on a frictionless tile: 0.7 - (0.7 w) / w is a rounding error of either sign."""
    weight = np.random.default_rng(0).uniform(0.1, 1.0, 100)
    assert np.any(0.7 - (0.7 * weight) / weight < 0.0)
    facet, zeros, ones = np.arange(100), np.zeros(100, dtype=np.int64), np.ones(100, dtype=np.int64)
    seen = TileOverlaps(
        np.tile(facet, 2), np.tile(zeros, 2), np.append(zeros, ones), np.append(np.full(100, 1e-18), weight)
    )
    field = FrictionField(Recorder(lambda pairs: np.where(pairs.bore == 0, 0.7, 0.0), "tiles"))
    found = field.facet_friction(seen, np.zeros(100), np.zeros(100))
    assert np.all((found >= 0.0) & (found < 1e-15))


def test_the_cache_is_its_own_copy() -> None:
    buffer = np.empty(2)

    def reuse(pairs: TilePairs) -> FloatArray:
        buffer[: pairs.seat.size] = law(pairs)
        pairs.seat[:] = 99
        return buffer[: pairs.seat.size]

    field = FrictionField(Recorder(reuse, "tiles"))
    first = field.facet_friction(TWO, PRESSURE, SLIDING)
    buffer[:] = 1.0
    field.state().coefficient[:] = 1.0
    assert field.facet_friction(TWO, PRESSURE, SLIDING).tolist() == first.tolist()
    assert field.state().seat.tolist() == [0, 1]


# Checkpoints


@pytest.mark.parametrize("depends_on", [(), ("tiles",)])
def test_a_restored_field_does_not_ask_again(depends_on: tuple[str, ...]) -> None:
    constant = Recorder(law if depends_on else (lambda pairs: np.full(pairs.seat.size, 0.3)), *depends_on)
    field = FrictionField(constant)
    expected = field.facet_friction(TWO, PRESSURE, SLIDING)
    known = field.state()
    saved = FieldState(*(column[::-1] for column in known))
    resumed = FrictionField(Recorder(law, *depends_on))
    resumed.restore(saved)
    assert resumed.facet_friction(TWO, PRESSURE, SLIDING).tolist() == expected.tolist()
    assert resumed.calls == 0
    saved.coefficient[:] = 1.0
    assert resumed.facet_friction(TWO, PRESSURE, SLIDING).tolist() == expected.tolist()


def test_a_damaged_state_is_refused() -> None:
    field, one = FrictionField(Uniform()), np.zeros(1, dtype=np.int64)
    good = np.array([0.1])
    with pytest.raises(ProviderError, match="shape"):
        field.restore(FieldState(one, one, np.array([0.1, 0.2]), good))
    with pytest.raises(ProviderError, match="nan"):
        field.restore(FieldState(one, one, np.array([np.nan]), good))
    with pytest.raises(ProviderError, match="bore tiles"):
        field.restore(FieldState(one, np.zeros(2, dtype=np.int64), good, good))
    with pytest.raises(ProviderError, match=r"saved.*uncertainty.*-0\.1"):
        field.restore(FieldState(one, one, good, -good))


@pytest.mark.parametrize("quantity", ["tiles", "pressure"])
def test_a_journal_gives_everything_back(quantity: str) -> None:
    """What is told after each increment, and again after the run goes on, is all that is known."""
    more = overlaps((0, 0, 3, 1.0), (1, 7, 2, 1.0))
    field = FrictionField(Doubtful(lambda pairs: law(pairs) + 1e-3 * pairs.pressure, quantity))
    journal: list[Mapping[str, FloatArray | IntArray]] = []
    for seen, pressure in ((TWO, PRESSURE), (NONE, PRESSURE), (more, 2.0 * PRESSURE)):
        field.facet_friction(seen, pressure, SLIDING)
        journal.append({"displacement": np.zeros(3), **field.news()})
    sizes = [entry["friction.seat"].size for entry in journal]
    assert sizes == ([2, 0, 1] if quantity == "tiles" else [2, 0, 2])
    resumed = FrictionField(Recorder(law, quantity))
    resumed.recall([{"displacement": np.zeros(3)}, *journal])
    first = dict(zip(*(column.tolist() for column in field.state()[:3:2]), strict=True))[0]
    latest = 0.053 + (0.0 if quantity == "tiles" else 0.02)  # at twice the pressure
    assert first == pytest.approx(latest, rel=1e-12)
    for before, after in zip(field.state(), resumed.state(), strict=True):
        assert before.tolist() == after.tolist()
    assert (resumed.calls, resumed.news()["friction.seat"].size) == (0, 0)


def test_the_last_answer_about_a_pair_stands() -> None:
    """Whatever was looked up in between; and what is restored takes the place of all of them."""
    field = FrictionField(Recorder(lambda pairs: law(pairs) + 1e-3 * pairs.pressure, "pressure"))
    known = []
    for scale in (1.0, 2.0, 3.0):
        field.facet_friction(TWO, scale * PRESSURE, SLIDING)
        known.append(field.state())
    assert [state.coefficient[0] for state in known] == pytest.approx([0.063, 0.073, 0.083])
    field.facet_friction(TWO, 4.0 * PRESSURE, SLIDING)
    field.restore()
    assert field.state().seat.size == 0
    field.restore(known[0])
    assert field.state().coefficient.tolist() == known[0].coefficient.tolist()


# Uncertainty


class Doubtful(Recorder):
    """A provider that states its uncertainty."""

    def __init__(
        self, law: Callable[[TilePairs], object], *depends_on: str, doubt: Callable[[TilePairs], object] | None = None
    ) -> None:
        super().__init__(law, *depends_on)
        self.doubt = doubt or (lambda pairs: 0.001 * (1.0 + pairs.seat))
        self.doubted: list[list[int]] = []

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        self.doubted.append(pairs.seat.tolist())
        return self.doubt(pairs)  # type: ignore[return-value]


@pytest.mark.parametrize("quantity", ["tiles", "sliding"])
def test_uncertainty_is_asked_with_the_coefficients_and_kept(quantity: str) -> None:
    provider = Doubtful(law, quantity)
    field = FrictionField(provider)
    plain = FrictionField(Recorder(law, quantity))
    for _ in range(2):
        found = field.facet_friction(TWO, PRESSURE, SLIDING)
        assert found.tolist() == plain.facet_friction(TWO, PRESSURE, SLIDING).tolist()
    assert provider.doubted == [pairs.seat.tolist() for pairs in provider.asked]
    assert field.calls == plain.calls == len(provider.asked)
    known = field.state()
    assert (known.seat.tolist(), known.uncertainty.tolist()) == ([0, 1], [0.001, 0.002])
    assert np.isnan(plain.state().uncertainty).all()
    assert plain.state().coefficient.tolist() == known.coefficient.tolist()
    resumed = FrictionField(Recorder(law, quantity))
    resumed.restore(known)
    assert resumed.state().uncertainty.tolist() == [0.001, 0.002]


@pytest.mark.parametrize(
    ("doubt", "told"),
    [
        (lambda pairs: np.where(pairs.seat == 1, -0.01, 0.0), r"uncertainty, -0\.01 .* seat tile 1 and bore tile 3"),
        (lambda pairs: np.where(pairs.seat == 1, np.inf, 0.0), "uncertainty, inf .* seat tile 1"),
        (lambda pairs: np.zeros(1), r"uncertainty, with shape \(1,\) to 2 tile pairs"),
        (lambda pairs: None, "uncertainty, with NoneType"),
        (lambda pairs: 1 / 0, "'sand' failed on 2 tile pairs.*ZeroDivisionError"),
    ],
)
def test_bad_uncertainties_are_refused(doubt: Callable[[TilePairs], object], told: str) -> None:
    field = FrictionField(Doubtful(law, "tiles", doubt=doubt), name="sand")
    with pytest.raises(ProviderError, match=f"'sand'.*{told}|{told}"):
        field.facet_friction(TWO, PRESSURE, SLIDING)
    assert field.state().coefficient.size == 0


def test_a_bad_uncertainty_of_another_way_to_ask_is_refused() -> None:
    field = FrictionField(Recorder(law, "tiles"), ask=lambda _, pairs: PairFriction(law(pairs), -law(pairs)))
    with pytest.raises(ProviderError, match="uncertainty"):
        field.facet_friction(TWO, PRESSURE, SLIDING)


def test_the_pairs_are_the_field_s_own() -> None:
    def scribble(pairs: TilePairs) -> FloatArray:
        pairs.seat[:] = 99
        return np.zeros(pairs.seat.size)

    field = FrictionField(Doubtful(law, "tiles", doubt=scribble))
    field.facet_friction(TWO, PRESSURE, SLIDING)
    assert field.state().seat.tolist() == [0, 1]


def test_an_uncertainty_may_be_stated_for_some_pairs_only() -> None:
    field = FrictionField(Doubtful(law, "tiles", doubt=lambda pairs: np.where(pairs.seat == 1, np.nan, 0.01)))
    field.facet_friction(TWO, PRESSURE, SLIDING)
    np.testing.assert_array_equal(field.state().uncertainty, [0.01, np.nan])


def test_an_uncertainty_that_is_no_method_is_refused() -> None:
    provider = Recorder(law, "tiles")
    provider.uncertainty = 0.02  # type: ignore[attr-defined]
    with pytest.raises(ProviderError, match=r"uncertainty is 0\.02, not a method"):
        FrictionField(provider)


# Bad answers


@pytest.mark.parametrize(
    ("bad", "told"),
    [
        (
            lambda pairs: np.where(pairs.seat == 1, np.nan, 0.1),
            "'sand' answered nan .* seat tile 1 and bore tile 3",
        ),
        (
            lambda pairs: np.where(pairs.seat == 1, -0.2, 0.1),
            "'sand' answered -0.2 .* seat tile 1 and bore tile 3",
        ),
        (
            lambda pairs: np.where(pairs.seat == 1, 2.0, 0.1),
            "'sand' answered 2.0 .* seat tile 1 and bore tile 3",
        ),
        (lambda pairs: np.array([0.1]), r"'sand' answered with shape \(1,\) to 2 tile pairs"),
        (lambda pairs: ["slippery", "rough"], "'sand' answered with list"),
        (lambda pairs: [[0.1], [0.1, 0.2]], "'sand' answered with list"),
        (lambda pairs: None, "'sand' answered with NoneType"),
    ],
)
@pytest.mark.parametrize("quantity", ["tiles", "pressure"])
def test_bad_answers_are_refused(bad: Callable[[TilePairs], object], told: str, quantity: str) -> None:
    field = FrictionField(Recorder(bad, quantity), name="sand")
    with pytest.raises(ProviderError, match=told):
        field.facet_friction(TWO, PRESSURE, SLIDING)
    assert field.state().coefficient.size == 0


def test_the_message_has_the_pair_that_was_asked() -> None:
    def scribble(pairs: TilePairs) -> FloatArray:
        pairs.seat[:] = 99
        return np.full(pairs.seat.size, np.nan)

    with pytest.raises(ProviderError, match="seat tile 0 and bore tile 3"):
        FrictionField(Recorder(scribble, "tiles")).facet_friction(TWO, PRESSURE, SLIDING)


def test_an_exception_of_the_provider_is_wrapped() -> None:
    def fail(pairs: TilePairs) -> FloatArray:
        raise KeyError("no such plate")

    field = FrictionField(Recorder(fail, "tiles"), name="sand")
    with pytest.raises(ProviderError, match=r"'sand' failed on 2 tile pairs.*seat tile 0.*KeyError") as caught:
        field.facet_friction(TWO, PRESSURE, SLIDING)
    assert isinstance(caught.value.__cause__, KeyError)


def test_a_provider_without_the_contract_is_refused() -> None:
    with pytest.raises(ProviderError, match="no method coefficients"):
        FrictionField(object())  # type: ignore[arg-type]
    with pytest.raises(ProviderError, match="depends_on is"):
        FrictionField(Recorder(law, "weather"))


def test_batches_go_through_the_hook() -> None:
    """A hook that shares the batch out in two halves, as two ranks would."""
    provider, shared = Recorder(law, "tiles"), []

    def halves(asked: object, pairs: TilePairs) -> PairFriction:
        shared.append(pairs.seat.size)
        parts = np.array_split(np.arange(pairs.seat.size), 2)
        answer = np.concatenate([provider.coefficients(pairs.take(part)) for part in parts])
        return PairFriction(answer, 0.1 * answer)

    field = FrictionField(provider, ask=halves)
    direct = FrictionField(Recorder(law, "tiles"))
    expected = direct.facet_friction(TWO, PRESSURE, SLIDING)
    assert field.facet_friction(TWO, PRESSURE, SLIDING).tolist() == expected.tolist()
    assert shared == [2]
    assert field.state().uncertainty.tolist() == (0.1 * field.state().coefficient).tolist()
    assert len(provider.asked) == 2
    assert field.calls == 1


def test_an_error_of_another_rank_keeps_its_sentence() -> None:
    said = "friction provider 'sand' answered nan for the pair of seat tile 7 and bore tile 1"

    def elsewhere(provider: object, pairs: TilePairs) -> PairFriction:
        raise ProviderError(said)

    field = FrictionField(Recorder(law, "tiles"), name="sand", ask=elsewhere)
    with pytest.raises(ProviderError) as caught:
        field.facet_friction(TWO, PRESSURE, SLIDING)
    assert str(caught.value) == said


def test_one_coefficient_for_all_needs_no_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which tiles face each other is not looked for where the provider does not tell them apart."""
    monkeypatch.setattr("macrofit.solution.Tiling.overlaps", lambda *_: pytest.fail("pairs were looked for"))
    assert solve(load_scene("contact-patch")).increments[-1].normal_force > 0.0
