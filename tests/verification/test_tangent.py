"""The tangent of the contact problem against central differences, in open, stick, slip and mixed states."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from mpi4py import MPI
from small import small_press

from macrofit.assembly import condense_bodies, discretise_bodies
from macrofit.base.arrays import FloatArray
from macrofit.contact.condensed import Condensed
from macrofit.contact.interface import couple_lines
from macrofit.contact.law import ContactProblem, Status, classify, return_mapping
from macrofit.contact.monolithic import Monolithic, MonolithicProblem
from macrofit.contact.seat import Seat
from macrofit.contact.status import OPEN, SLIP, STICK

MU = 0.11


def facing_and_engines(theta: int) -> tuple[ContactProblem, Monolithic, Condensed]:
    scene = small_press(f"contact.theta={theta}", 'solver="monolithic"')
    bodies = discretise_bodies(scene, MPI.COMM_SELF)
    seat, axle, wheel = condense_bodies(scene, MPI.COMM_SELF, bodies)
    pairing = couple_lines(seat.line, wheel.line, 43.3)
    assert pairing is not None
    covered = Seat(seat.line, scene.contact).cover(pairing.portions)
    approach = np.stack([pairing.gap, np.full(len(covered.weight), 0.02)])
    facing = ContactProblem(covered=covered, coupling=pairing, undeformed=approach, radial=True, nitsche=True)
    return facing, Monolithic(seat, bodies["axle"], bodies["wheel"]), Condensed(seat, axle, wheel)


def law_of(facing: ContactProblem, relative: FloatArray, kappa: FloatArray) -> FloatArray:
    """lambda for y = gamma (g - B u) with the share of kappa in the trial solved for."""
    n_r, n_z = facing.covered.normals.T
    normal = np.minimum(relative[0] / (1.0 - kappa * n_z), 0.0)
    bound = -MU * normal
    return np.stack([normal, np.clip(relative[1] + kappa * n_r * normal, -bound, bound)])


def unbalance(problem: MonolithicProblem, u: FloatArray, kappa: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residual K u - L' W tau(u) and the trial traction."""
    facing = problem.contact
    gamma, weight = np.tile(facing.covered.gamma, 2), np.tile(facing.covered.weight, 2)
    relative = (gamma * (facing.approach.ravel() - problem.gap @ u)).reshape(2, -1)
    total = facing.total(law_of(facing, relative, kappa), kappa)
    trial = relative - (total - law_of(facing, relative, kappa))
    return problem.engine.stiffness @ u - problem.test.T @ (weight * total.ravel()), trial


def state(kind: str, problem: MonolithicProblem, rng: np.random.Generator) -> FloatArray:
    """A displacement whose moments are open, sticking, slipping, or all three."""
    facing, n = problem.contact, problem.contact.moments
    friction = np.full(n, MU)
    wanted = {"open": OPEN, "stick": STICK, "slip": SLIP}
    kinds = np.full(n, wanted[kind]) if kind in wanted else np.arange(n) % 3
    signs = np.where(kinds == SLIP, np.where(np.arange(n) % 2, 1, -1), 0)
    status = Status(kinds.astype(np.int8), signs.astype(np.int8))
    problem.solve(status, np.zeros(n), friction)
    if kind == "open":
        problem.displacement = np.zeros_like(problem.displacement)
        facing.approach[0] = 1.0
    return problem.displacement * (1.0 + 1e-3 * rng.standard_normal(len(problem.displacement)))


@pytest.mark.parametrize("theta", [0, 1, -1])
@pytest.mark.parametrize("kind", ["open", "stick", "slip", "mixed"])
def test_sparse_tangent(kind: str, theta: int) -> None:
    """J v = (R(u + h v) - R(u - h v)) / 2 h; the law is piecewise linear, so that only rounding is left."""
    rng = np.random.default_rng(1)
    facing, engine, _ = facing_and_engines(theta)
    kappa = 0.02 * rng.standard_normal(facing.moments)
    problem = engine.problem(facing)
    u = state(kind, problem, rng)
    friction = np.full(facing.moments, MU)
    _, trial = unbalance(problem, u, kappa)
    status = classify(trial, friction)
    if kind == "mixed":
        assert {OPEN, STICK, SLIP} == set(status.kind.tolist())
    gamma, weight = np.tile(facing.covered.gamma, 2), np.tile(facing.covered.weight, 2)
    jacobian = (
        engine.stiffness
        + problem.test.T @ sp.diags(weight) @ problem._response(status, kappa, friction) @ sp.diags(gamma) @ problem.gap
    )
    direction = rng.standard_normal(len(u))
    h = 1e-11
    plus, trial_plus = unbalance(problem, u + h * direction, kappa)
    minus, trial_minus = unbalance(problem, u - h * direction, kappa)
    assert classify(trial_plus, friction).same(classify(trial_minus, friction)), "a kink lies within the difference"
    difference = (plus - minus) / (2.0 * h)
    exact = jacobian @ direction
    assert np.abs(difference - exact).max() < 1e-4 * np.abs(exact).max()


@pytest.mark.parametrize("kind", ["stick", "slip", "mixed"])
def test_condensed_matrix(kind: str) -> None:
    """The condensed matrix is minus the derivative of the residual on the unknowns it solves for."""
    rng = np.random.default_rng(2)
    facing, _, engine = facing_and_engines(0)
    problem, n = engine.problem(facing), facing.moments
    kinds = {"stick": np.full(n, STICK), "slip": np.full(n, SLIP), "mixed": np.arange(n) % 3}[kind]
    signs = np.where(kinds == SLIP, 1 - 2 * (np.arange(n) % 2), 0)
    status = Status(kinds.astype(np.int8), signs.astype(np.int8))
    kappa, friction = 0.02 * rng.standard_normal(n), np.full(n, MU)
    active, sticking = np.flatnonzero(kinds != OPEN), np.flatnonzero(kinds == STICK)
    matrix = problem.matrix(status, kappa, friction, active, sticking)

    def residual(x: FloatArray) -> FloatArray:
        traction = np.zeros((2, n))
        traction[0, active], traction[1, sticking] = x[: len(active)], x[len(active) :]
        slip = kinds == SLIP
        traction[1, slip] = -signs[slip] * friction[slip] * traction[0, slip]
        total = facing.total(traction, kappa)
        response, _ = problem.respond(facing.covered.weight * total)
        rest = facing.residual(traction, total, response)
        return np.concatenate([rest[0, active], rest[1, sticking]])

    x, direction = rng.standard_normal((2, len(matrix)))
    difference = residual(x + direction) - residual(x)
    assert np.abs(difference + matrix @ direction).max() < 1e-12 * np.abs(difference).max()


def test_law_keeps_its_bound() -> None:
    """1e4 random trials: the bound is kept, dissipation is never negative, the law is continuous (Lipschitz 2)."""
    rng = np.random.default_rng(3)
    trial = rng.standard_normal((2, 10_000)) * np.array([[100.0], [50.0]])
    friction = rng.uniform(0.0, 0.9, 10_000)
    traction = return_mapping(trial, friction)
    assert (traction[0] <= 0.0).all()
    assert (np.abs(traction[1]) <= -friction * traction[0] * (1.0 + 1e-15)).all()
    assert (traction[1] * (trial[1] - traction[1]) >= 0.0).all()
    nudge = rng.standard_normal(trial.shape) * 1e-6
    moved = np.abs(return_mapping(trial + nudge, friction) - traction).sum(axis=0)
    assert (moved <= 2.0 * np.abs(nudge).sum(axis=0)).all()
