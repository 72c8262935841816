"""The checks of the stability sweep see planted faults, and nothing where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from benchmarks._stability_cases import BASE, THERE_AND_BACK, Case, Scatter
from benchmarks._stability_checks import examine, wrong
from benchmarks._stability_energy import energy, probe
from benchmarks._stability_views import Run, Taken, views_of
from benchmarks.stability import Bodies, Tally, asked, broken_mappings, judge, run

from macrofit.contact import newton
from macrofit.contact.status import OPEN, SLIP
from macrofit.state import Step

CASE = Case("planted", {"mesh.order": 1, "motion.displacements": THERE_AND_BACK}, BASE, Scatter(3))


@pytest.fixture(scope="module")
def pressed() -> Run:
    return run(CASE, Bodies())


def faults(done: Run) -> list[str]:
    return wrong(examine(done, asked(CASE, done.scene, done.assembly)))


def planted(done: Run, fault: Callable[[Step], Step]) -> Run:
    """The run with a fault in its last step, and in the record of it."""
    taken = done.taken[-1]
    step = fault(taken.step)
    record = replace(done.records[-1], facets=step.facets, force=step.force, strain_energy=step.strain_energy)
    return replace(done, taken=[*done.taken[:-1], Taken(taken.before, step)], records=[*done.records[:-1], record])


def with_facets(step: Step, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Step:
    return replace(step, facets=replace(step.facets, **{name: change(getattr(step.facets, name))}))


def with_traction(step: Step, change: Callable[[np.ndarray], np.ndarray]) -> Step:
    answer = step.report.answer
    return replace(step, report=replace(step.report, answer=replace(answer, traction=change(answer.traction))))


def lost(traction: np.ndarray) -> np.ndarray:
    """Contact lost where it presses most."""
    return np.where(np.arange(traction.shape[1]) == traction[0].argmin(), 0.0, traction)


def test_nothing_is_found_where_nothing_is_wrong(pressed: Run) -> None:
    assert pressed.error is None
    assert (pressed.records[-1].facets.status == SLIP).any()
    assert faults(pressed) == []


FAULTS: dict[str, tuple[Callable[[Step], Step], str]] = {
    "pressure of a facet": (lambda step: with_facets(step, "pressure", lambda p: 1.001 * p), "facets"),
    "status of a facet": (lambda step: with_facets(step, "status", lambda s: np.where(s == SLIP, OPEN, s)), "facets"),
    "slip of the wrong sign": (lambda step: with_facets(step, "slip", lambda s: -s), "facets"),
    "friction before a cutback": (lambda step: with_facets(step, "friction", lambda mu: np.roll(mu, 1)), "friction"),
    "a lost moment": (lambda step: with_traction(step, lost), "law"),
    "tension": (lambda step: with_traction(step, np.negative), "cone"),
    "shear that pushes": (lambda step: with_traction(step, lambda t: t * [[1.0], [-1.0]]), "law"),
    "shear above the bound": (lambda step: with_traction(step, lambda t: t * [[1.0], [1.01]]), "cone"),
    "force": (lambda step: replace(step, force=1.0001 * step.force), "force"),
    "energy": (lambda step: replace(step, strain_energy=1.001 * step.strain_energy), "stored"),
    "energy below zero": (lambda step: replace(step, strain_energy=-step.strain_energy), "stored"),
    "loads": (lambda step: replace(step, state=replace(step.state, bore_load=1.001 * step.state.bore_load)), "loads"),
    "displacements": (
        lambda step: replace(step, state=replace(step.state, seat_displacement=1.001 * step.state.seat_displacement)),
        "bulk",
    ),
    "friction that gives energy": (lambda step: replace(step, dissipation=-abs(step.dissipation) - 1e3), "dissipated"),
    "no number": (lambda step: with_facets(step, "gap", lambda gap: gap * np.nan), "finite"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_planted_fault_is_found(pressed: Run, name: str) -> None:
    fault, where = FAULTS[name]
    assert where in faults(planted(pressed, fault))


def test_increment_that_did_not_converge_is_found(pressed: Run) -> None:
    records = [*pressed.records[:-1], replace(pressed.records[-1], converged=False)]
    assert faults(replace(pressed, records=records)) == ["converged"]


def test_work_that_goes_nowhere_is_found() -> None:
    """Small steps, and a force that is 5 % too large in all of them."""
    path = (0.0, 12.0, *(float(25.0 + 0.1 * k) for k in range(8)))
    done = run(Case("planted", {"mesh.order": 1, "motion.displacements": path}, BASE), Bodies())
    true = list(views_of(done, done.taken))[2:]
    more = [
        replace(v, taken=replace(v.taken, step=replace(v.taken.step, force=1.05 * v.taken.step.force))) for v in true
    ]
    assert energy(done, true, 0.2) < 1e-3
    assert energy(done, more, 0.2) > 2e-2


SOFT_AXLE = {"axle.material.youngs_modulus": 505.5, "wheel.bore_radius": 59.056, "friction.options.coefficient": 0.033}
ALL_OF_THE_WORK: dict[str, dict[str, object]] = {
    "theta's energy where the bore does not face the seat": {
        "mesh.order": 1, "mesh.seat_facet": 4.0, "mesh.bore_facet": 0.59, "wheel.bore_radius": 59.988,
        "axle.taper_blend": 10.0, "axle.material.poisson_ratio": 0.4999, "contact.theta": -1, "contact.gamma0": 0.41,
        "motion.displacements": (0.0, 8.717, 10.088), "friction.options.coefficient": 0.0,
    },
    "a soft axle that follows the wheel": SOFT_AXLE | {
        "mesh.order": 2, "contact.formulation": "penalty", "contact.penalty_stiffness": 8.4e6,
        "motion.displacements": (30.46, 32.72, 32.4),
    },
}  # fmt: skip


@pytest.mark.parametrize("name", ALL_OF_THE_WORK)
def test_all_of_the_work_is_found(name: str) -> None:
    """Of a force that is the energy's derivative hardly anything is missing, however coarse or soft."""
    done = run(Case("planted", ALL_OF_THE_WORK[name]), Bodies())
    assert done.error is None
    assert probe(done) < 1e-3


def test_answers_that_differ_from_their_reference_are_found() -> None:
    tally, bodies = Tally(), Bodies()
    for mu in (0.12, 0.12001):
        keys = {"mesh.order": 1, "motion.displacements": (0.0, 20.0), "friction.options.coefficient": mu}
        judge(Case("planted", keys, like=("same",), tolerance=1e-6), bodies, tally)
    assert tally.converged == 2
    assert [why.split()[0] for _, why in tally.failed] == ["reference"]


@pytest.mark.parametrize(
    ("formulation", "remedy"), [("nitsche", "contact.gamma0 nearer to 10"), ("penalty", "contact.penalty_stiffness")]
)
def test_an_error_names_a_key_of_its_formulation(
    formulation: str, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*words: object) -> newton.Report:
        return replace(newton.newton(*words), converged=False)  # type: ignore[arg-type]

    monkeypatch.setattr("macrofit.press.newton", never)
    keys = {"mesh.order": 1, "motion.displacements": (0.0, 20.0), "contact.formulation": formulation}
    error = run(Case("planted", keys), Bodies()).error
    assert str(error).endswith(f"try a smaller motion.increment, or {remedy}")


def test_exceptions_and_unclear_errors_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    tally, bodies = Tally(), Bodies()
    judge(replace(CASE, keys={"wheel.bore_radius": 30.0}), bodies, tally)
    assert (tally.errors, tally.failed) == (1, [])

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("macrofit.press.newton", broken)
    judge(CASE, bodies, tally)
    assert "ZeroDivisionError" in tally.failed[0][1]


def test_a_broken_law_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    assert broken_mappings() == 0
    monkeypatch.setattr(
        "benchmarks.stability.return_mapping", lambda trial, friction: 0.999 * newton.return_mapping(trial, friction)
    )
    assert broken_mappings() > 0
