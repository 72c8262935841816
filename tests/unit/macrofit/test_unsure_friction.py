"""A provider of friction that says where it may be wrong: what of it is a doubt, and of whom."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI
from serving import SHORT
from small import small_path, small_press

from macrofit.friction import BuildContext, TilePairs
from macrofit.friction.conformance import ConformanceError, check
from macrofit.friction.contract import FloatArray
from macrofit.friction.evolving import FlatteningPairs
from macrofit.identify.fit import identify
from macrofit.identify.measured import Measured
from macrofit.identify.output import doubts as doubts_of_value
from macrofit.results.doubts import doubts
from macrofit.results.folder import CurveFile, read_table
from macrofit.results.summary import sentences, summary
from macrofit.scene import load_scene
from macrofit.service.residual import pressed_and_released, restored
from macrofit.solution import Solution
from macrofit.solve import solve

SAID = "odd tiles: are unlike any; take others"


class Unsure(msgspec.Struct, frozen=True):
    """One coefficient, that may be wrong by a share for tiles of the seat from a number on; options and provider."""

    coefficient: float = 0.1
    first: int = 0
    off: float = 0.02
    depends_on = frozenset({"tiles"})
    digest = "unsure"

    def build(self, context: BuildContext) -> Unsure:
        return self

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        return np.full(len(pairs.seat), self.coefficient)

    def outside(self, pairs: TilePairs) -> Any:
        return {SAID: np.where(pairs.seat >= self.first, self.off, 0.0)}


class Broken(Unsure):
    """It does not give a number for each pair."""

    def outside(self, pairs: TilePairs) -> Any:
        return {SAID: np.ones(3)}


def pressed(friction: Unsure) -> Solution:
    return solve(small_press(), MPI.COMM_SELF, friction=friction)


def odd(fit: Solution) -> list[str]:
    """The doubts that its friction gives rise to; facets of 5 mm give rise to others."""
    return [sentence for sentence in doubts(fit) if sentence.startswith("odd tiles")]


def test_what_may_make_the_force_wrong_is_a_doubt() -> None:
    (said,) = odd(pressed(Unsure()))
    assert said.startswith("odd tiles: ")
    assert "at 60 mm, with 100% of the largest normal force and " in said
    assert said.endswith(" MPa, are unlike any; take others")


@pytest.mark.parametrize(("first", "off", "doubted"), [(0, 0.009, False), (0, 0.011, True), (60, 0.2, False)])
def test_a_per_cent_of_the_force_counts(first: int, off: float, doubted: bool) -> None:
    """Tiles behind the wheel's leading edge carry nothing."""
    fit = pressed(Unsure(first=first, off=off))
    assert bool(odd(fit)) is doubted
    for each in fit.outside:
        assert each.error == pytest.approx(off * each.share)


def test_a_part_of_the_pairs_counts_by_its_force() -> None:
    fit = pressed(Unsure(first=35, off=1.0))
    (found,) = fit.outside
    start, end = fit.seat[:-1], np.minimum(fit.seat[1:], 60.0)  # where the wheel's leading edge is
    whole, part = np.maximum(0.0, end - start), np.maximum(0.0, end - np.maximum(start, fit.seat[0] + 35.0))
    pressure = fit.increments[-1].facets.pressure
    assert found.share == pytest.approx(float(pressure @ part) / float(pressure @ whole), rel=1e-9)
    assert 0.1 < found.share < 0.9
    assert 0 < found.pairs < found.of


def test_a_provider_that_fails_at_it_is_not_judged() -> None:
    with pytest.warns(UserWarning, match="failed at `outside`.*a number of 0 or more for each pair is wanted"):
        assert odd(pressed(Broken())) == []


class Fickle(Unsure, frozen=True):
    """Its reasons follow the pairs."""

    def outside(self, pairs: TilePairs) -> Any:
        return {f"odd tiles: {len(pairs.seat)}": np.zeros(len(pairs.seat))}


def test_the_contract_is_checked() -> None:
    check(Unsure(), tolerance=0.0)
    with pytest.raises(ConformanceError, match="a number of 0 or more for each pair is wanted"):
        check(Broken())
    with pytest.raises(ConformanceError, match="Fickle names other reasons for other pairs"):
        check(Fickle())


def test_one_that_wraps_another_says_it_too() -> None:
    none = np.zeros(2, dtype=np.int64)
    pairs = TilePairs(none, none, none.astype(float), none.astype(float))
    assert FlatteningPairs(Unsure(), "unsure", 0.05, 1e3).outside(pairs)[SAID].tolist() == [0.02, 0.02]


def test_an_identified_value_is_doubted() -> None:
    fit = solve(small_press(), MPI.COMM_SELF)
    measured = Measured(fit.displacement[1:], fit.force[1:])
    changes = ["mesh.seat_facet=5.0", "mesh.bore_facet=4.7", "mesh.coarse=40", "motion.start=15", "motion.travel=60"]
    found = identify(
        "wheelset",
        measured,
        [*changes, "motion.increment=5", "friction.options.coefficient=0.1"],
        key="friction.options.coefficient",
        bounds=(0.0, 1.0),
        comm=MPI.COMM_SELF,
        friction=Unsure,
    )
    assert any(line.startswith("odd tiles: ") for line in doubts_of_value(found))


def test_service_doubts_the_press_and_goes_on_with_it() -> None:
    scene = load_scene("wheelset", [change for change in SHORT if "coefficient" not in change])
    left, bodies = pressed_and_released(scene, Unsure(coefficient=0.2))
    (said,) = left.doubts
    assert said.startswith("odd tiles: ")
    assert restored(left.scalars, left.arrays, bodies).doubts == left.doubts


class Spread(Unsure, frozen=True):
    """Every pair with the same standard deviation."""

    spread: float = 0.005

    def outside(self, pairs: TilePairs) -> Any:
        return {}

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        return np.full(len(pairs.seat), self.spread)


class Pressed(Spread, frozen=True):
    """The same, asked at every increment."""

    depends_on = frozenset({"tiles", "pressure"})


@pytest.mark.parametrize("friction", [Spread(), Pressed()])
def test_the_force_has_the_deviation_of_independent_pairs(friction: Spread) -> None:
    """Facets of 2 mm that face two pairs each share none: sigma over N = s sqrt(sum w_p^2) / sum w_p, w_p = p_p l_p."""
    fit = solve(small_press("mesh.seat_facet=2.0"), MPI.COMM_SELF, friction=friction)
    assert fit.friction is not None
    record = fit.increments[-1]
    met = fit.friction.tiling.facing(fit.seat, record.displacement)
    pair = met.seat * 1000 + met.bore
    forces = np.bincount(np.unique(pair, return_inverse=True)[1], met.weight * record.facets.pressure[met.facet])
    expected = friction.spread * float(np.sqrt(forces @ forces) / forces.sum())
    assert record.friction_sd == pytest.approx(expected, rel=1e-3)  # facets that stand open are left out by the press
    assert record.force_sd == pytest.approx(expected * record.normal_force, rel=1e-3)
    assert 0.05 < record.friction_sd / friction.spread < 0.3  # about one over the root of the pairs


def test_what_sticks_has_no_deviation(tmp_path: Path) -> None:
    """It bears what the bodies ask for, whatever its coefficients: a push that turns, and a press that lets go."""
    scene = small_path([55.0, 60.0, 59.99, 59.98], "motion.release=true")
    fit = solve(scene, MPI.COMM_SELF, friction=Spread())
    pushed, turned, last = (fit.increments[k] for k in (1, 2, -1))
    assert pushed.sticking_facets == 0
    assert turned.sticking_facets > 0.5 * turned.active_facets
    assert turned.force_sd < 0.7 * pushed.force_sd
    assert last.force_sd == 0.0
    said = " ".join(sentences(summary(fit)))
    assert "kN at the peak" in said
    assert "kN at the end: standard" not in said


class Silent(Spread, frozen=True):
    """Has the method, and states nothing."""

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        return np.full(len(pairs.seat), np.nan)


def test_a_method_that_states_nothing_gives_no_column(tmp_path: Path) -> None:
    fit = pressed(Silent())
    assert np.isnan([record.friction_sd for record in fit.increments]).all()
    assert "force_sd_N" not in CurveFile(tmp_path, fit.increments).path.read_text()


def test_a_reason_without_advice_is_a_whole_sentence() -> None:
    class Curt(Unsure, frozen=True):
        def outside(self, pairs: TilePairs) -> Any:
            return {"odd\ntiles": np.full(len(pairs.seat), 0.5)}

    (said,) = odd(pressed(Curt()))
    assert said.startswith("odd tiles: ")
    assert said.endswith(" MPa")


def test_there_is_none_where_none_is_stated(tmp_path: Path) -> None:
    fit = pressed(Unsure())
    assert np.isnan([record.friction_sd for record in fit.increments]).all()
    curve = CurveFile(tmp_path, fit.increments)
    assert "force_sd_N" not in curve.path.read_text()
    assert summary(fit)["final_force_sd_N"] is None


def test_the_curve_gets_a_column_with_the_first_deviation(tmp_path: Path) -> None:
    fit = pressed(Spread())
    curve, fresh = CurveFile(tmp_path), fit.increments
    curve.increment(replace(fresh[0], friction_sd=float("nan")))
    for record in fresh[1:]:
        curve.increment(record)
    curve.finished()
    columns = read_table(curve.path)
    assert np.isnan(columns["force_sd_N"][0])
    assert columns["force_sd_N"][1:].tolist() == [record.force_sd for record in fresh[1:]]
    assert columns["force_N"].tolist() == [record.force for record in fresh]
    numbers = summary(fit)
    assert numbers["final_force_sd_N"] == fresh[-1].force_sd
    assert any(line.startswith("Uncertain by    ") for line in sentences(numbers))
