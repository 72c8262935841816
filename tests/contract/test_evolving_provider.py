"""The provider `evolving`: another one's coefficients, flattened with the work done on a tile."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from small import plain_shaft, small_press

from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, TilePairs, Uniform, build, load
from macrofit.friction.conformance import check
from macrofit.friction.contract import FloatArray
from macrofit.friction.evolving import Evolving, FlatteningPairs
from macrofit.scene import Scene
from macrofit.solution import Solution
from macrofit.solve import solve

CONTEXT = BuildContext(seat_tiles=8, bore_tiles=8, youngs_modulus=206e3, poisson_ratio=0.3)


class Base:
    """0.1 + seat / 100 + bore / 1000, a tenth of it uncertain; remembers what it was asked."""

    depends_on = frozenset({"tiles"})

    def __init__(self) -> None:
        self.asked: list[tuple[int, int]] = []

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        self.asked += zip(pairs.seat.tolist(), pairs.bore.tolist(), strict=True)
        return 0.1 + 0.01 * pairs.seat + 0.001 * pairs.bore

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        return 0.1 * (0.1 + 0.01 * pairs.seat + 0.001 * pairs.bore)


def pairs(*rows: tuple[int, int, float, float]) -> TilePairs:
    seat, bore, pressure, sliding = (np.array(column) for column in zip(*rows, strict=True))
    return TilePairs(seat, bore, pressure, sliding)


def enriched(tmp_path: Path, *, work: float | None, flat: float = 0.02, wrapped: bool = True) -> Scene:
    """The small press with a table along the seat, 0.1 to 0.14."""
    file = tmp_path / "mu.csv"
    file.write_text("z_mm,coefficient,uncertainty\n0,0.1,0.01\n60,0.14,0.01\n")
    table = f"{{file='{file}'}}"
    if not wrapped:
        return small_press("friction.provider=table", f"friction.options={table}")
    given = "" if work is None else f", work={work!r}"
    options = f"{{base='table', options={table}, flat_coefficient={flat}{given}}}"
    return small_press("friction.provider=evolving", f"friction.options={options}")


def test_it_keeps_the_contract_to_the_bit() -> None:
    check(FlatteningPairs(Base(), "base", 0.05, 1e3), tolerance=0.0)
    check(FlatteningPairs(Uniform(), "uniform", 0.05, 1e3), tolerance=0.0)


def test_the_closed_form() -> None:
    """mu_flat + (mu_pair - mu_flat) exp(-p s / w), with p s / w = 0, 1/2, 1, 40: rounding of one sum."""
    provider = FlatteningPairs(Base(), "base", 0.05, 1000.0)
    seen = pairs((0, 0, 100.0, 0.0), (1, 2, 100.0, 5.0), (3, 0, 50.0, 20.0), (1, 2, 400.0, 100.0), (1, 2, 0.0, 9.0))
    first = np.array([0.1, 0.112, 0.13, 0.112, 0.112])
    left = np.exp([-0.0, -0.5, -1.0, -40.0, -0.0])
    np.testing.assert_allclose(provider.coefficients(seen), 0.05 + (first - 0.05) * left, rtol=1e-14)
    np.testing.assert_allclose(provider.uncertainty(seen), 0.1 * first * left, rtol=1e-12, atol=1e-17)
    fresh = seen._replace(sliding=np.zeros(5))
    assert provider.coefficients(fresh).tolist() == Base().coefficients(fresh).tolist()


def test_smooth_faces_may_rub_more_than_rough_ones() -> None:
    provider = FlatteningPairs(Base(), "base", 0.3, 1000.0)
    found = provider.coefficients(pairs(*((2, 0, 100.0, s) for s in (0.0, 5.0, 20.0, 1e4))))
    assert (np.diff(found) > 0.0).all()
    assert found[-1] == pytest.approx(0.3, rel=1e-15)


def test_the_base_is_asked_once_about_each_pair() -> None:
    base = Base()
    provider = FlatteningPairs(base, "base", 0.05, 1000.0)
    provider.coefficients(pairs((0, 0, 1.0, 1.0), (3, 1, 1.0, 1.0), (0, 0, 2.0, 2.0)))
    provider.uncertainty(pairs((0, 0, 1.0, 1.0), (3, 1, 1.0, 1.0)))
    provider.coefficients(pairs((3, 1, 7.0, 7.0), (2, 2, 1.0, 1.0)))
    assert base.asked == [(0, 0), (3, 1), (2, 2)]


def test_a_bad_answer_of_the_base_is_told_with_its_name() -> None:
    class Bad(Base):
        def coefficients(self, pairs: TilePairs) -> FloatArray:
            return np.full(pairs.seat.size, np.nan)

    with pytest.raises(ProviderError, match="'sand' answered nan for the pair of seat tile 2 and bore tile 1"):
        FlatteningPairs(Bad(), "sand", 0.05, 1e3).coefficients(pairs((2, 1, 1.0, 1.0)))


# Options


def test_without_work_the_base_answers_itself() -> None:
    for more in ({}, {"work": None}):
        options = {"base": "uniform", "options": {"coefficient": 0.2}, "flat_coefficient": 0.1, **more}
        assert build("evolving", options, CONTEXT) == Uniform(coefficient=0.2)
    assert Evolving(base="uniform", flat_coefficient=0.1, work=math.inf).build(CONTEXT) == Uniform()


def test_the_work_of_archards_law() -> None:
    """The example of the docstring: w = R H / K = 0.02 mm 2000 MPa / 1e-3 = 4e4 N/mm."""
    options = {"wear_coefficient": 1e-3, "hardness": 2000.0, "height": 0.02}
    provider = build("evolving", {"base": "uniform", "flat_coefficient": 0.1, **options}, CONTEXT)
    assert isinstance(provider, FlatteningPairs)
    assert provider.work == pytest.approx(4e4, rel=1e-15)
    assert math.exp(-120.0 * 180.0 / provider.work) == pytest.approx(0.58, abs=0.005)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({}, "base"),
        ({"base": "uniform"}, "flat_coefficient"),
        ({"flat_coefficient": -0.1}, "flat_coefficient = -0.1 is out of bounds"),
        ({"flat_coefficient": 2.0}, "flat_coefficient = 2.0"),
        ({"work": 0.0}, "work = 0.0 must be positive"),
        ({"hardness": -1.0}, "hardness = -1.0 must be positive"),
        ({"hardness": 2000.0, "work": 1e4}, "work: leave out either it or hardness"),
        ({"hardness": 2000.0}, "wear_coefficient and height: needed beside hardness"),
        ({"base": "sandpaper"}, "no friction provider 'sandpaper' is installed.*Set friction.options.base"),
        ({"options": {"coeficient": 0.1}}, "friction.options.options.coeficient: unknown option"),
        ({"options": {"coefficient": -0.1}}, "coefficient = -0.1"),
    ],
)
def test_refused_options_name_the_key(options: dict[str, object], told: str) -> None:
    good = {} if not options or options == {"base": "uniform"} else {"base": "uniform", "flat_coefficient": 0.1}
    with pytest.raises(ProviderError, match=told):
        load("evolving", good | options)


def test_a_base_that_evolves_itself_is_refused() -> None:
    inner = {"base": "uniform", "flat_coefficient": 0.1, "work": 1e3}
    options = {"base": "evolving", "options": inner, "flat_coefficient": 0.1, "work": 1e3}
    with pytest.raises(ProviderError, match="'evolving' depends on pressure and sliding itself"):
        build("evolving", options, CONTEXT)


def test_a_network_asked_for_own_pressures_says_how_to_give_it_one() -> None:
    options: dict[str, Any] = {"base": "surrogate", "flat_coefficient": 0.07, "work": 1e4}
    with pytest.raises(ProviderError, match=r"give it one, friction\.options\.options\.pressure = 170\.0 \[MPa\], or"):
        build("evolving", options, CONTEXT)
    build("evolving", options | {"options": {"pressure": 170.0}}, CONTEXT)


# In a run


def same(one: Solution, other: Solution) -> bool:
    pressures = zip(one.increments, other.increments, strict=True)
    return (one.force == other.force).all() and all(
        (a.facets.pressure == b.facets.pressure).all() for a, b in pressures
    )


def test_without_work_a_run_is_that_of_the_base_to_the_bit(tmp_path: Path) -> None:
    plain = solve(enriched(tmp_path, work=None, wrapped=False))
    off = solve(enriched(tmp_path, work=None))
    assert same(plain, off)
    assert plain.counters["pairs_asked"] == off.counters["pairs_asked"]
    assert not same(plain, solve(enriched(tmp_path, work=1e6)))


def test_the_force_falls_with_the_work_needed(tmp_path: Path) -> None:
    """The less work flattens the roughness, the lower every force once something has slid."""
    forces = np.array([solve(enriched(tmp_path, work=work)).force for work in (1e6, 1e5, 1e4, 1e3)])
    assert (np.diff(forces[:, 3:], axis=0) < 0.0).all()
    smooth = solve(small_press("friction.options.coefficient=0.02")).force
    assert (forces[:, 3:] > smooth[3:]).all()


def test_each_facet_follows_the_law_with_the_run_s_own_pressure_and_sliding(tmp_path: Path) -> None:
    """What a tile has at the last increment is what it gets: its pressure, and the sum of |slip| of all before.

    On the plain shaft facets are tiles, so that a facet's mu is the law of its own pressure and accumulated slip.
    """
    file = tmp_path / "mu.csv"
    file.write_text("z_mm,coefficient\n0,0.1\n60,0.16\n")
    work, flat = 200.0, 0.02
    table = {"base": "table", "options": {"file": str(file)}}
    solution = solve(plain_shaft("evolving", back=(48.0, 45.0), **table, flat_coefficient=flat, work=work))
    first = 0.1 + 1e-3 * 0.5 * (solution.seat[1:] + solution.seat[:-1])
    slid = np.zeros(len(first))
    least = 1.0
    for before, after in zip(solution.increments, solution.increments[1:], strict=False):
        slid += np.abs(before.facets.slip)
        held = after.facets.pressure > 0.0
        left = np.exp(-before.facets.pressure * slid / work)
        np.testing.assert_allclose(after.facets.friction[held], (flat + (first - flat) * left)[held], rtol=1e-12)
        np.testing.assert_allclose(before.facets.accumulated_slip, slid, rtol=1e-12)
        least = min(least, float(left[held].min()))
    assert least < 0.5
    assert solution.increments[-1].facets.slip.min() < -2.0


class Memory:
    """A journal in memory that can be cut short."""

    def __init__(self, kept: list) -> None:  # type: ignore[type-arg]
        self.kept = kept

    def records(self) -> list:  # type: ignore[type-arg]
        return list(self.kept)

    def append(self, record: object, state: dict[str, np.ndarray]) -> None:  # type: ignore[type-arg]
        self.kept.append((record, {name: array.copy() for name, array in state.items()}))


@pytest.mark.parametrize("kept", [1, 5])
def test_a_resumed_run_is_the_same_to_the_bit(tmp_path: Path, kept: int) -> None:
    scene = enriched(tmp_path, work=1e4)
    whole = Memory([])
    uninterrupted = solve(scene, MPI.COMM_SELF, journal=whole)
    resumed = solve(scene, MPI.COMM_SELF, journal=Memory(whole.kept[:kept]))
    assert same(uninterrupted, resumed)
    assert uninterrupted.friction is not None
    assert resumed.friction is not None
    for name in ("seat", "bore", "coefficient", "uncertainty"):
        assert getattr(uninterrupted.friction, name).tolist() == getattr(resumed.friction, name).tolist()
