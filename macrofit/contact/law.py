"""The traction law of frictional contact in Nitsche or penalty form, moment by moment.

On the seat, with n the outward normal of the axle, lambda_n <= 0 the normal and lambda_t the tangential traction on
the axle, J the jump u_axle - u_wheel, g the gap and slip of the undeformed bodies, T u the traction of the bulk stress:

    trial    = (T u - Q) - gamma J u + gamma g
    lambda_n = min(0, trial_n)
    lambda_t = clip(trial_t, -mu |lambda_n|, mu |lambda_n|)
    tau      = lambda + Q

and tau loads the axle, -tau the wheel (Chouly, Hild, Renard, Math. Comp. 84 (2015) for the formulation;
gamma = gamma0 E / h). Penalty is the same with T = 0 and no Q in the trial.

The tangential g is the slip since the increment before plus the elastic slip (lambda - T u + Q)_t / gamma that was left
then, which the discrete law has as any with a finite gamma: a traction that sticks is kept over any number of
increments. The slip that dissipates is (trial - lambda)_t / gamma.

Q is the axial share q of the pressure p = -lambda_n that the reference normal leaves out. The force conjugate to the
travel U is F = -dL/dU at fixed displacements; the normal gap depends on U through the bore's shape and displacement
at z - U, which gives

    q = p kappa,   kappa = (dr_w/dz + du_wr/dz) n_r + (du_wz/dz) n_z + n_z

so that the axial traction tau . e_z = lambda . e_z + q is that of the sloping, deformed interface: a frictionless push
costs exactly the strain energy it stores. kappa vanishes where the gap is axial.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..base.arrays import FloatArray
from .interface import MortarCoupling
from .seat import CoveredSeat
from .status import SLIP, STICK

StatusArray = npt.NDArray[np.int8]


@dataclass(frozen=True)
class Status:
    """Status of each moment (OPEN, STICK, SLIP) and the sign of its slip (0 where it does not slip)."""

    kind: StatusArray
    sign: StatusArray

    def same(self, other: Status) -> bool:
        """Whether two states are alike in every moment."""
        alike = self.kind.tobytes() == other.kind.tobytes() and self.sign.tobytes() == other.sign.tobytes()
        return self is other or alike


@dataclass(frozen=True)
class LinearSolution:
    """What a linear solve at given status and kappa returns; (2, n) normal and tangential."""

    traction: FloatArray  # lambda [MPa]
    trial: FloatArray  # MPa
    total: FloatArray  # tau = lambda + Q [MPa]
    kappa: FloatArray  # (n,) at the new displacements


@dataclass(frozen=True, kw_only=True)
class EigenMoments:
    """What the plastic strains of both bodies add to the linear problem.

    With their displacements u_p on both lines and the traction T_p = n . D eps_p, the trial traction of a displacement
    u + u_p is that of u with g - (J - T / gamma) u_p + N u_p - T_p / gamma in place of g.
    """

    approach: FloatArray  # (2, n) added to g [mm]
    slope: FloatArray  # (n,) added to kappa


@dataclass(frozen=True, kw_only=True)
class ContactProblem:
    """The two lines facing each other at one displacement, n moments, and how far they would interpenetrate.

    Runs that differ in friction and history alone are one problem: (2, n) is (2, runs, n) then, (n,) is (runs, n), and
    a vector of a body's nodes (2 nodes,) is (2, runs, nodes).
    """

    covered: CoveredSeat
    coupling: MortarCoupling
    undeformed: FloatArray  # (2, n) gap and slip of the undeformed bodies [mm]
    radial: bool
    nitsche: bool
    eigen: EigenMoments | None = None  # of bodies that yielded

    @cached_property
    def approach(self) -> FloatArray:
        """g (2, n): gap and slip of the bodies under the traction alone [mm]."""
        return self.undeformed if self.eigen is None else self.undeformed + self.eigen.approach

    @property
    def moments(self) -> int:
        """Number of moments n."""
        return len(self.covered.weight)

    @cached_property
    def _axial(self) -> FloatArray:
        """The axial direction in the frame of each facet, (n_z, n_r) (2, n)."""
        return np.ascontiguousarray(self.covered.normals.T[::-1])

    def total(self, traction: FloatArray, kappa: FloatArray) -> FloatArray:
        """tau = lambda + Q (2, n)."""
        axial = self._axial if traction.ndim == 2 else self._axial[:, None]
        return np.asarray(traction - traction[0] * kappa * axial)

    def residual(self, traction: FloatArray, total: FloatArray, response: FloatArray) -> FloatArray:
        """(2, n) (trial - lambda) / gamma = g - A W tau - (lambda [+ Q]) / gamma, for the response A W tau [mm]."""
        return self.approach - response - (total if self.nitsche else traction) / self.covered.gamma

    def loads(self, total: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nodal forces [N] on the axle's loaded nodes and on the bore's nodes."""
        forces = self.covered.weight * total
        return self.covered.loads(forces), -self.coupling.bore_loads(forces)

    def axial_force(self, total: FloatArray) -> FloatArray:
        """Axial resultant on the axle [N]: the pushing force."""
        n_r, n_z = self.covered.normals.T
        return np.asarray((total[0] * n_z + total[1] * n_r) @ self.covered.weight)

    def kappa(self, bore: FloatArray) -> FloatArray:
        """kappa (n,) at a displacement (2 bore nodes,) of the bore under the traction alone [mm]."""
        if not self.radial:
            share = self.coupling.axial_share_undeformed
            return share if bore.ndim == 1 else np.tile(share, (bore.shape[1], 1))
        share = self.coupling.axial_share_undeformed + self.coupling.bore_slope(bore)
        return share if self.eigen is None else share + self.eigen.slope

    def opening(self, seat: FloatArray, bore: FloatArray) -> FloatArray:
        """(2, n) gap and slip of the deformed bodies, at their whole displacements [mm]."""
        return self.undeformed - self.covered.seat_moments(seat) + self.coupling.bore_moments(bore)


def classify(trial: FloatArray, friction: FloatArray, before: Status | None = None) -> Status:
    """The status that a trial traction (2, n) asks for, with coefficients of friction (n,).

    A slip that would turn its sign against ``before`` goes through stick: a plain semismooth Newton step flips
    between the two signs on the first reversed increment and ends in a wrong state.
    """
    normal, tangential = trial
    bound = friction * np.maximum(-normal, 0.0)
    slips = (np.abs(tangential) > bound) | (friction == 0.0)
    kind: StatusArray = (slips.view(np.int8) * np.int8(SLIP - STICK) + np.int8(STICK)) * ~(normal >= 0.0)
    sign: StatusArray = ((kind == SLIP) & (friction > 0.0)) * np.sign(tangential).astype(np.int8)
    if before is not None:
        reversed_ = before.sign * sign < 0
        kind[reversed_], sign[reversed_] = STICK, 0
    return Status(kind, sign)


def return_mapping(trial: FloatArray, friction: FloatArray) -> FloatArray:
    """The traction (2, n) of a trial traction (2, n): Coulomb's law by return mapping."""
    traction = np.empty_like(trial)
    np.minimum(trial[0], 0.0, out=traction[0])
    bound = -friction * traction[0]
    np.minimum(np.maximum(trial[1], -bound), bound, out=traction[1])
    return traction
