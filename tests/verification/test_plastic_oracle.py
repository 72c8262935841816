"""The fixed point on the kept factor against Newton's method with a true tangent on both bodies and the contact.

The oracle assembles K - d f_p / d u from the tangent of the law at every point (by differences), in one sparse system
with the contact, and factors it in every iteration. It shares the operators of the body and the law of a point, which
have tests of their own, and nothing of the acceleration, the watched points, the condensed interface or the kept
factors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from mpi4py import MPI
from scipy.sparse.linalg import spsolve
from small import small_press

from macrofit.assembly import assemble, friction_field, yielding_of
from macrofit.base.arrays import FloatArray, IntArray
from macrofit.bodies.discretisation import Discretisation
from macrofit.contact.eigen import Eigen, shifted
from macrofit.contact.interface import couple_lines
from macrofit.contact.law import ContactProblem, Status, classify
from macrofit.contact.monolithic import Monolithic, MonolithicProblem
from macrofit.plasticity import body as body_module
from macrofit.plasticity import yielding as yielding_module
from macrofit.plasticity.body import PlasticBody
from macrofit.plasticity.law import PointState, flow
from macrofit.press import REACH, Press
from macrofit.scene import Scene

YIELD = tuple(
    f"{body}.material.{key}"
    for body in ("axle", "wheel")
    for key in ("yield_stress=300", "hardening.law=linear", "hardening.kinematic=4000", "hardening.isotropic=3000")
)


def point_matrix(space: Discretisation, cell: IntArray, values: FloatArray) -> sp.csr_matrix:
    """Values (n, 4, 2 b) on the unknowns of each point's cell (n,) as a matrix (4 n, dofs), point after point."""
    count, columns = len(cell), space.unknowns(cell)[:, None]
    rows = np.arange(4 * count).reshape(count, 4, 1)
    data, place, columns = np.broadcast_arrays(values, rows, columns)
    shape = (4 * count, 2 * len(space.nodes))
    return sp.csr_matrix((data.ravel(), (place.ravel(), columns.ravel())), shape=shape)


def press_of(scene: Scene) -> Press:
    assembly = assemble(scene, MPI.COMM_SELF)
    field = friction_field(scene, MPI.COMM_SELF, assembly.seat, assembly.wheel)
    yielding = yielding_of(scene, assembly)
    return Press(scene, assembly.seat, assembly.wheel.line, assembly.engine, field, yielding)


class Oracle:
    """One step from rest, everything at once."""

    def __init__(self, press: Press, displacement: float) -> None:
        assert press.yielding is not None
        self.bodies: dict[str, PlasticBody] = press.yielding.bodies
        axle, wheel = (self.bodies[name].body for name in ("axle", "wheel"))
        self.engine = Monolithic(press.seat, axle, wheel)
        coupling = couple_lines(press.seat.line, press.bore, displacement, REACH)
        assert coupling is not None
        covered = press.seat.cover(coupling.portions)
        start = displacement - press.scene.displacements[0]
        self.contact = ContactProblem(
            covered=covered,
            coupling=coupling,
            undeformed=np.stack([coupling.gap, start * covered.normals[:, 0]]),
            radial=True,
            nitsche=press.seat.nitsche,
        )
        self.friction = np.full(self.contact.moments, 0.11)
        self.coordinate = press.seat.line.coordinate

    def point_law(self, body: PlasticBody, strain: FloatArray) -> tuple[PointState, FloatArray]:
        """The state at total strains (points, 4), and d eps_p / d eps (points, 4, 4)."""
        rest = body.rest().state

        def law(total: FloatArray) -> PointState:
            return flow(total[None], rest, body.law, body.shear_modulus)

        state, step = law(strain), 1e-8
        columns = [
            (law(strain + step * unit).strain - law(strain - step * unit).strain) / (2 * step) for unit in np.eye(4)
        ]
        return state, np.stack(columns, axis=2)

    def solve(self, near: FloatArray, status: Status) -> tuple[float, dict[str, PointState]]:
        """Force and states at the solution, from free displacements near it: a cold start overshoots and cycles."""
        split = self.engine.trace.shape[1]
        u = near
        kappa = self.contact.kappa(self.engine.bore @ u[split:])
        for _ in range(80):
            states, eigen, forces, tangents = {}, {}, [], []
            for name, part in (("axle", slice(0, split)), ("wheel", slice(split, None))):
                body = self.bodies[name]
                whole = np.zeros(body.body.dofs)
                whole[body.body.free] = u[part]
                gauss = body.body.gauss
                strains = point_matrix(body.body.space, gauss.cell, gauss.strain)
                state, rate = self.point_law(body, (strains @ whole).reshape(-1, 4))
                free = strains[:, body.body.free]
                inner = sp.block_diag([w * body.moduli @ each for w, each in zip(body.weight, rate, strict=True)])
                tangents.append(free.T @ inner @ free)
                forces.append(body.load(state.strain)[body.body.free])
                states[name] = state
                eigen[name] = Eigen(
                    displacement=0.0 * whole[body.body.trace_dofs], traction=body.traction(state.strain)
                )
            contact = shifted(self.contact, self.coordinate, eigen)
            problem = MonolithicProblem(self.engine, contact)
            weight, gamma = np.tile(contact.covered.weight, 2), np.tile(contact.covered.gamma, 2)
            spread = (
                problem.test.T @ sp.diags(weight) @ problem._response(status, kappa, self.friction) @ sp.diags(gamma)
            )
            tangent = sp.block_diag(tangents, format="csr")
            matrix = self.engine.stiffness + spread @ problem.gap - tangent
            inner_force = np.concatenate(forces)
            new = spsolve(matrix.tocsc(), spread @ contact.approach.ravel() + inner_force - tangent @ u)
            relative = (gamma * (contact.approach.ravel() - problem.gap @ new)).reshape(2, -1)
            traction = problem._traction(status, kappa, self.friction, relative)
            total = contact.total(traction, kappa)
            trial = relative - (total - traction) if contact.nitsche else relative
            asked = classify(trial, self.friction, status)
            turned = self.contact.kappa(self.engine.bore @ new[split:])
            change = np.abs(new - u).max() / np.abs(new).max()
            done = asked.same(status) and change < 1e-11 and np.abs(turned - kappa).max() < 1e-13
            u, status, kappa = new, asked, turned
            if done:
                return contact.axial_force(total), states
        raise AssertionError("the oracle does not converge")


@pytest.mark.parametrize("formulation", ["penalty", "nitsche"])
@pytest.mark.parametrize("order", [1, 2])
def test_condensed_equals_the_monolithic_oracle(formulation: str, order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first step of a push, from rest into contact that yields: force to 1e-8, plastic strain to 1e-6."""
    monkeypatch.setattr(yielding_module, "TOLERANCE", 1e-11)
    monkeypatch.setattr(yielding_module, "LIMIT", 300)
    monkeypatch.setattr(body_module, "MOST_PARTS", 1)  # the oracle knows no path within the step
    scene = small_press(*YIELD, f"contact.formulation={formulation}", f"mesh.order={order}", "motion.start=20")
    press = press_of(scene)
    rest = replace(press.rest(), displacement=19.0)
    step = press.trial(rest, 20.0)
    assert step.report.converged
    assert step.state.flow is not None
    oracle = Oracle(press, 20.0)
    oracle.contact = replace(
        oracle.contact, undeformed=np.stack([oracle.contact.coupling.gap, oracle.contact.covered.normals[:, 0]])
    )
    bodies = {
        name: body.ended(step.state.flow[name].state, loads).displacement
        for (name, body), loads in zip(oracle.bodies.items(), (step.state.seat_load, step.state.bore_load), strict=True)
    }
    near = np.concatenate([bodies[name][body.body.free] for name, body in oracle.bodies.items()])
    force, states = oracle.solve(near * (1.0 + 1e-5 * np.sin(np.arange(len(near)))), step.report.status)
    assert step.force == pytest.approx(force, rel=1e-8)
    for name, state in states.items():
        found = step.state.flow[name].state.strain
        assert np.abs(found).max() > 1e-3
        assert np.abs(found - state.strain).max() <= 1e-6 * np.abs(found).max()
