"""Runs in lockstep are the runs by themselves: forces to 1e-9 of the largest, the status of every facet the same."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
import rippled
from mpi4py import MPI
from small import YIELDING, small_path, small_press

from macrofit import press
from macrofit.assembly import assemble
from macrofit.contact.interface import MortarCoupling, couple_lines
from macrofit.contact.law import Status
from macrofit.contact.newton import RESIDUAL, Report, settled_status
from macrofit.contact.status import OPEN, SLIP, STICK
from macrofit.errors import MacrofitError, ProviderError
from macrofit.friction import FloatArray, TilePairs, registry
from macrofit.friction.outside import LOOKED_AT
from macrofit.identify.curves import ForwardModel, derivative
from macrofit.lockstep import group
from macrofit.lockstep import solve as lockstep_solve
from macrofit.lockstep.solve import Run, common_to, solve_together
from macrofit.monitor import Silent
from macrofit.results.journal import Journal
from macrofit.scene import Scene, dump_scene, load_scene
from macrofit.solution import Increment, Solution
from macrofit.solve import solve
from macrofit.state import State, Step, accepted
from surrogate.tiles import Tiles, shared_tiles

COEFFICIENT = "friction.options.coefficient"
COEFFICIENTS = (0.0, 0.01, 0.07, 0.11, 0.6)
RIPPLED = ("friction.provider=rippled",)
EVOLVING = ("friction.provider=evolving", "friction.options={base='rippled', flat_coefficient=0.05, work=2e3}")
"""Asked for every pair in every increment, with its pressure and the way it has slid."""
TURNING = (15.0, 25.0, 40.0, 39.99, 39.96, 39.9, 39.7, 20.0, 30.0)
"""Pushed, pulled back a little and a lot, pushed again [mm]."""
NEAR = 1e-9
"""Of the largest force: ten times what Newton's method leaves of the traction."""


@pytest.fixture(autouse=True)
def _rippled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.BUILT_IN, "rippled", rippled.ENTRY)


def together(scenes: Sequence[Scene]) -> list[Solution]:
    """All of them in lockstep."""
    assert len({common_to(scene) for scene in scenes}) == 1
    assert common_to(scenes[0]) is not None
    runs = [Run(scene=scene, monitor=Silent()) for scene in scenes]
    found = solve_together(runs, MPI.COMM_SELF, assemble(scenes[0], MPI.COMM_SELF))
    return [each for each in found if isinstance(each, Solution)]


def alone(scenes: Sequence[Scene]) -> list[Solution]:
    """Each by itself."""
    assembly = assemble(scenes[0], MPI.COMM_SELF)
    return [solve(scene, MPI.COMM_SELF, assembly=assembly) for scene in scenes]


def assert_same(found: Sequence[Solution], wanted: Sequence[Solution], friction: float = 1e-15) -> None:
    """Forces, pressures and slip to 1e-9 of the largest; the status of every facet; the balances.

    ``friction`` is how near its coefficient is, exact where it follows no pressure.
    """
    for own, other in zip(found, wanted, strict=True):
        scale = max(np.abs(other.force).max(), max(each.normal_force for each in other.increments))
        assert own.force == pytest.approx(other.force, abs=NEAR * scale)
        assert own.energy_balance == pytest.approx(other.energy_balance, abs=1e-7)
        most = max(each.max_pressure for each in other.increments)
        for one, two in zip(own.increments, other.increments, strict=True):
            assert one.converged
            assert (one.facets.status == two.facets.status).all()
            assert one.facets.pressure == pytest.approx(two.facets.pressure, abs=1e-7 * most)
            assert one.facets.accumulated_slip == pytest.approx(two.facets.accumulated_slip, abs=1e-8)
            assert one.facets.friction == pytest.approx(two.facets.friction, abs=friction)
            assert one.strain_energy == pytest.approx(two.strain_energy, rel=1e-8, abs=1e-6)
            assert one.work == pytest.approx(two.work, rel=1e-7, abs=1e-3)


def with_coefficients(path: Sequence[float], *overrides: str) -> list[Scene]:
    return [small_path(path, *overrides, f"{COEFFICIENT}={value}") for value in COEFFICIENTS]


def factorisations(found: Sequence[Solution]) -> int:
    """LU factors of interface matrices, of all runs."""
    return sum(solution.counters["interface_factorisations"] for solution in found)


def differing(found: Sequence[Solution], kind: int) -> int:
    """Increments in which this status is on other facets in one run than in another."""
    return sum(
        len({(each.facets.status == kind).tobytes() for each in same}) > 1
        for same in zip(*(solution.increments for solution in found), strict=True)
    )


@pytest.mark.parametrize(
    "overrides",
    [(), ("mesh.order=1",), ("contact.theta=1",), ("contact.theta=-1",), ("contact.formulation=penalty",)],
    ids=lambda each: " ".join(each) or "default",
)
def test_five_coefficients(overrides: tuple[str, ...]) -> None:
    """From none to 0.6, along a path that turns: other facets stick in one run than in another."""
    scenes = with_coefficients(TURNING, *overrides)
    found, wanted = together(scenes), alone(scenes)
    assert_same(found, wanted)
    assert factorisations(found) < factorisations(wanted)  # they were not solved again, each by itself
    for kind in (STICK, SLIP):
        assert differing(found, kind) >= 2, kind


def rough(micro: float) -> Scene:
    """On the network, nine increments, one surface for every micro coefficient."""
    return small_press("friction.provider=surrogate", f"friction.options={{micro_friction={micro}, seed=3}}")


def test_runs_on_one_surface_prepare_a_pair_once_and_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not once for each run: one batch of foundations an increment, of pairs that no run has asked for before.

    When a run is over some of its pairs are looked at once more, at the pressure that they had in the end.
    """
    scenes = [rough(micro) for micro in (0.03, 0.07, 0.09)]
    wanted = alone(scenes)
    shared_tiles.cache_clear()
    prepared: list[tuple[int, ...]] = []
    batches: list[int] = []
    prepare = Tiles._prepare

    def counted(tiles: Tiles, model: Any, *pairs: Any) -> None:
        prepared.extend(zip(*(column.tolist() for column in pairs), strict=True))
        batches.append(len(pairs[0]))
        prepare(tiles, model, *pairs)

    monkeypatch.setattr(Tiles, "_prepare", counted)
    found = together(scenes)
    assert_same(found, wanted, friction=1e-9)
    asked = [increment for increment in found[0].increments if increment.normal_force]
    assert len(batches) <= len(asked) + len(scenes) * (LOOKED_AT + 1)
    assert sum(batches[len(asked) :]) < 0.15 * sum(batches)
    assert len(prepared) == len(set(prepared)) < 1.3 * found[0].counters["pairs_asked"]


def test_one_surface_in_runs_of_several_bodies_is_made_once() -> None:
    """Surfaces in turn on one mesh, then on another: bodies are no part of what a pair of tiles depends on."""
    shared_tiles.cache_clear()
    for facet in (5.0, 6.0):
        scenes = [
            small_path((25.0, 30.0), "friction.provider=surrogate", f"friction.options.seed={seed}",
                       f"mesh.seat_facet={facet}")
            for seed in (1, 2, 3)
        ]  # fmt: skip
        together(scenes)
        assert shared_tiles.cache_info().misses == 3


class Listener:
    """A provider that hears of its questions, and remembers what it heard before it was asked."""

    depends_on = frozenset({"tiles", "pressure"})
    heard: ClassVar[list[str]] = []

    def __init__(self, name: str, *, deaf: bool = False) -> None:
        self.name, self.deaf = name, deaf

    def announced(self, pairs: TilePairs) -> None:
        if self.deaf:
            raise SystemExit("it will not listen")
        self.heard.append(f"{self.name} hears of {len(pairs.seat)}")

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        self.heard.append(f"{self.name} is asked for {len(pairs.seat)}")
        return 0.05 + 1e-4 * pairs.pressure


def test_all_hear_of_their_questions_before_one_is_asked() -> None:
    """In every increment that is solved together; one that cannot listen answers nevertheless."""
    scene = small_path((25.0, 30.0, 35.0))
    Listener.heard.clear()
    runs = [
        Run(scene=scene, monitor=Silent(), friction=each)
        for each in (Listener("a"), Listener("b"), Listener("c", deaf=True))
    ]
    with pytest.warns(UserWarning, match="failed at `announced`, with ForeignExit: .* asked all the same"):
        found = solve_together(runs, MPI.COMM_SELF, assemble(scene, MPI.COMM_SELF))
    assert all(isinstance(each, Solution) for each in found)
    steps = [" ".join(line.split()[:2]) for line in Listener.heard[-10:]]
    assert steps == 2 * ["a hears", "b hears", "a is", "b is", "c is"]
    counts = [line.split()[-1] for line in Listener.heard[-5:]]
    assert len(set(counts)) == 1


def test_bodies_apart_are_faced_once_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not once for each run."""
    faced: list[float] = []

    def counted(*given: Any) -> MortarCoupling | None:
        faced.append(given[2])
        return couple_lines(*given)

    monkeypatch.setattr(group, "couple_lines", counted)
    monkeypatch.setattr(press, "couple_lines", counted)
    scenes = with_coefficients((0.0, 1.0, 2.0, 3.0))
    assert all(not each.increments[-1].normal_force for each in together(scenes))
    assert [faced.count(at) for at in (1.0, 2.0, 3.0)] == [1, 1, 1]


def test_what_opens_differs_from_run_to_run() -> None:
    """On facets of 1 mm the front of the contact is elsewhere where friction pulls the bore in."""
    fine = ("mesh.seat_facet=1", "mesh.bore_facet=1.3", "motion.start=0", "motion.travel=24", "motion.increment=3")
    scenes = [small_press(*fine, f"{COEFFICIENT}={value}") for value in COEFFICIENTS]
    found = together(scenes)
    assert_same(found, alone(scenes))
    assert differing(found, OPEN) >= 1


def test_five_surfaces() -> None:
    """Coefficients that differ from tile to tile, by run: 30 % either way."""
    scenes = [small_press(*RIPPLED, f"friction.options.seed={seed}") for seed in range(1, 6)]
    found = together(scenes)
    assert_same(found, alone(scenes))
    assert len({solution.force[-1] for solution in found}) == 5


@pytest.mark.parametrize("first", [0, 1, 2], ids=["uniform", "per pair", "per pair and pressure"])
def test_friction_of_every_kind_together(first: int) -> None:
    """Whichever is first: one coefficient for all, one for each pair of tiles, one that changes with the work."""
    kinds = [small_press(f"{COEFFICIENT}=0.07"), small_press(*RIPPLED), small_press(*EVOLVING)]
    scenes = [*kinds[first:], *kinds[:first]]
    found, wanted = together(scenes), alone(scenes)
    assert_same(found, wanted, NEAR)
    assert factorisations(found) < factorisations(wanted)
    for name in ("provider_calls", "pairs_asked"):
        assert [own.counters[name] for own in found] == [other.counters[name] for other in wanted], name


def test_a_run_in_no_company_is_solved_once() -> None:
    """It is the run by itself to the bit, and its provider is asked no more than there."""
    scene = small_press(*EVOLVING, "output.stress=true")
    (found,), (wanted,) = together([scene]), alone([scene])
    assert (found.force == wanted.force).all()
    assert found.counters == wanted.counters
    assert found.counters["provider_calls"] == len(found.increments)


def test_a_step_taken_apart_has_its_own_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Status and traction of every moment are those of Newton's method for the run by itself."""
    reports: list[Report] = []

    def kept(index: int, before: State, steps: list[Step], *rest: Any) -> Increment:
        reports.append(steps[-1].report)
        return accepted(index, before, steps, *rest)

    monkeypatch.setattr(press, "accepted", kept)
    scenes = with_coefficients(TURNING[:5])
    together(scenes)  # one increment of each after the other
    found = [reports[first :: len(scenes)] for first in range(len(scenes))]
    reports.clear()
    alone(scenes)
    for own, other in zip([report for run in found for report in run], reports, strict=True):
        assert own.status.same(other.status)
        scale = np.abs(other.answer.traction).max()
        for name in ("traction", "trial", "total"):
            assert getattr(own.answer, name) == pytest.approx(getattr(other.answer, name), abs=1e-7 * scale)
        assert own.answer.kappa == pytest.approx(other.answer.kappa, abs=1e-9)


def test_bodies_that_move_farther_than_what_was_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ends that stand open by less than the bodies move belong to the problem, in lockstep too."""
    scenes = [small_press(f"{COEFFICIENT}={value}") for value in (0.07, 0.11, 0.2)]
    for each in (press, group):
        monkeypatch.setattr(each, "REACH", 0.05)
    wanted, whole = alone(scenes), []

    def coupled(*lines: Any) -> MortarCoupling | None:
        whole.append(len(lines) == 3)
        return couple_lines(*lines)

    monkeypatch.setattr(group, "couple_lines", coupled)
    assert_same(together(scenes), wanted)
    assert any(whole)


def test_slip_is_seen_by_the_traction_of_its_own_run() -> None:
    """Two runs slip alike, one under a thousand times the traction, whose rounding hides such a slip."""
    contact: Any = SimpleNamespace(covered=SimpleNamespace(gamma=np.ones(3)))
    slipping = np.full((2, 3), SLIP, dtype=np.int8)
    traction = np.stack([np.full((2, 3), 1.0), np.full((2, 3), 1e3)], axis=1)
    report: Any = SimpleNamespace(status=Status(slipping, slipping), answer=SimpleNamespace(traction=traction))
    slip = np.full((2, 3), 30.0 * RESIDUAL)
    found = settled_status(report, contact, np.full((2, 3), 0.1), slip, 0.0)
    assert found.tolist() == [[SLIP] * 3, [STICK] * 3]


def test_each_turn_is_counted_where_it_belongs(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock that reads 1, 4, 9 ... the turns take 3, 7, 11 ...: set-up first, ten increments, stresses last."""
    ticks = itertools.count(1)
    monkeypatch.setattr(lockstep_solve, "time", SimpleNamespace(process_time=lambda: next(ticks) ** 2))
    (found,) = together([small_press()])
    took = [4 * turn - 1 for turn in range(1, 13)]
    assert len(found.increments) == 10
    assert (found.setup_cpu_s, found.increments_cpu_s, found.stress_cpu_s) == (took[0], sum(took[1:-1]), took[-1])


@pytest.mark.parametrize("overrides", [("motion.release=true",), ("wheel.temperature=120", "motion.cooling=4")])
def test_what_a_press_does_in_its_own_way(overrides: tuple[str, ...]) -> None:
    """A press that lets go and a wheel that cools are solved run by run, between increments in lockstep."""
    scenes = [small_press(*overrides, f"{COEFFICIENT}={value}") for value in (0.07, 0.11, 0.2)]
    assert_same(together(scenes), alone(scenes))


@pytest.mark.parametrize("name", ["hertz-sphere", "push-out", "contact-patch", "lame-rings"])
def test_other_scenes(name: str) -> None:
    """A gap along the axis, a front of slip, a fit in place: sixty moments and more change their status."""
    changes = ("output.stress=false", "output.fields_at=[]")
    scenes = [load_scene(name, [*changes, f"{COEFFICIENT}={value}"]) for value in (0.05, 0.11, 0.3)]
    assert_same(together(scenes), alone(scenes))


def test_factors_are_shared() -> None:
    """The counter of LU factors: of five runs fewer than two runs need, and counted with the first of them."""
    values = (0.09, 0.1, 0.11, 0.12, 0.13)
    scenes = [small_press("motion.start=0", f"{COEFFICIENT}={value}") for value in values]
    name = "interface_factorisations"
    shared = [solution.counters[name] for solution in together(scenes)]
    each = [solution.counters[name] for solution in alone(scenes)]
    assert 0 < sum(shared) < 2 * min(each)
    assert shared[1:] == [0] * 4


def test_runs_that_do_not_converge_together_are_solved_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes = with_coefficients(TURNING[:4])
    wanted, real, asked = alone(scenes), group.newton, []

    def failing(*arguments):  # type: ignore[no-untyped-def]
        asked.append(1)
        return replace(real(*arguments), converged=False)

    monkeypatch.setattr(group, "newton", failing)
    found = together(scenes)
    assert len(asked) == 3
    assert [own.force.tolist() for own in found] == [other.force.tolist() for other in wanted]  # to the bit


def test_a_run_that_fails_ends_alone() -> None:
    """The provider of the second run of three fails half way: the others are what they are without it."""
    scenes = [
        small_press(*RIPPLED, f"friction.options.seed={seed}", "friction.options.fail_at=2") for seed in (1, 2, 3)
    ]
    runs = [Run(scene=scene, monitor=Silent()) for scene in scenes]
    found = solve_together(runs, MPI.COMM_SELF, assemble(scenes[0], MPI.COMM_SELF))
    assert isinstance(found[1], ProviderError)
    assert "no such surface" in str(found[1])
    left = [each for each in found if isinstance(each, Solution)]
    assert_same(left, alone([scenes[0], scenes[2]]))


class Broken:
    """A provider that answers nothing, and counts how often it is asked."""

    depends_on = frozenset({"tiles"})

    def __init__(self) -> None:
        self.asked = 0

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        self.asked += 1
        raise RuntimeError("broken")


def test_a_provider_that_fails_is_not_asked_again() -> None:
    scene, broken = small_path((25.0, 30.0)), Broken()
    runs = [Run(scene=scene, monitor=Silent(), friction=each) for each in (Listener("a"), broken, Listener("b"))]
    found = solve_together(runs, MPI.COMM_SELF, assemble(scene, MPI.COMM_SELF))
    assert [type(each) for each in found] == [Solution, ProviderError, Solution]
    assert broken.asked == 1


def test_journals_of_different_lengths_are_resumed(tmp_path: Path) -> None:
    """One run was killed after two increments, one after five, one did not begin: they meet again."""
    scenes = [small_press(f"{COEFFICIENT}={value}") for value in (0.07, 0.11, 0.2)]
    wanted = alone(scenes)
    paths = [tmp_path / f"{number}.bin" for number in range(3)]
    for scene, path, kept in zip(scenes, paths, (2, 5, 0), strict=True):
        short = small_path(scene.displacements[:kept], f"{COEFFICIENT}={scene.friction.options['coefficient']}")
        whole = Journal.start(path, scene, replace=True)
        with whole:
            if kept:
                solve(short, MPI.COMM_SELF, journal=whole)
    journals = [Journal.resume(path, scene) for path, scene in zip(paths, scenes, strict=True)]
    runs = [
        Run(scene=scene, monitor=Silent(), journal=journal) for scene, journal in zip(scenes, journals, strict=True)
    ]
    found = solve_together(runs, MPI.COMM_SELF, assemble(scenes[0], MPI.COMM_SELF))
    for journal in journals:
        journal.close()
    assert_same([each for each in found if isinstance(each, Solution)], wanted)


def test_what_goes_together() -> None:
    """Friction and output may differ; bodies, motion, steel that yields and the monolithic solver may not."""
    own = common_to(small_press())
    assert own == common_to(small_press(f"{COEFFICIENT}=0.3", "output.stress=true"))
    assert own != common_to(small_press("motion.increment=2"))
    assert own != common_to(small_press("wheel.bore_radius=94.8"))
    assert common_to(small_press(*YIELDING)) is None
    assert common_to(small_press("solver=monolithic")) is None


def test_the_derivative_is_that_of_finite_differences(tmp_path: Path) -> None:
    """dF/dp of the first pair against central differences of runs by themselves: 1e-3, of the forward step of 1 %."""
    path = tmp_path / "small.toml"
    path.write_text(dump_scene(small_press(*RIPPLED)))
    key, value = "friction.options.micro_friction", 0.06
    model = ForwardModel(path, [], key, MPI.COMM_SELF, bounds=(0.0, 0.5))
    model.force(value)
    assert len(model.known) == 2
    assert model.factorisations == 2
    low, high = alone([small_press(*RIPPLED, f"{key}={value + step}") for step in (-1e-4, 1e-4)])
    central = (high.force - low.force) / 2e-4
    assert derivative(model.known, value, 1e-5).slope == pytest.approx(central, abs=1e-3 * np.abs(central).max())
    model.force(0.075)  # with a third curve the parabola is nearer by two orders
    exact = derivative(model.known, value, 1e-5)
    assert exact.slope == pytest.approx(central, abs=2e-5 * np.abs(central).max())
    assert exact.bend is not None


def test_a_first_value_that_fails_is_an_error(tmp_path: Path) -> None:
    """That of the value beside it is not: the first curve alone is known then."""
    path = tmp_path / "small.toml"
    path.write_text(dump_scene(small_press(*RIPPLED)))
    seeded = ForwardModel(path, ["friction.options.fail_at=1"], "friction.options.micro_friction", MPI.COMM_SELF,
                          bounds=(0.0, 0.5))  # fmt: skip
    with pytest.raises(MacrofitError, match="no such surface"):
        seeded.force(0.06)
    uniform = tmp_path / "uniform.toml"
    uniform.write_text(dump_scene(small_press()))
    edge = ForwardModel(uniform, [], COEFFICIENT, MPI.COMM_SELF, bounds=(0.0, 3.0))
    edge.force(1.99)  # 2.0099 is no coefficient of friction
    assert len(edge.known) == 1
    upper = ForwardModel(uniform, [], COEFFICIENT, MPI.COMM_SELF, bounds=(0.0, 0.1))
    upper.force(0.1)
    assert sorted(upper.known) == pytest.approx([0.099, 0.1])  # none beyond the bounds
