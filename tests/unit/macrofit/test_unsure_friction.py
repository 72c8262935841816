"""A provider of friction that says where it may be wrong: what of it is a doubt, and of whom."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI
from serving import SHORT
from small import small_press

from macrofit.friction import BuildContext, TilePairs
from macrofit.friction.contract import FloatArray
from macrofit.friction.evolving import FlatteningPairs
from macrofit.identify.fit import identify
from macrofit.identify.measured import Measured
from macrofit.identify.output import doubts as doubts_of_value
from macrofit.results.doubts import doubts
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
