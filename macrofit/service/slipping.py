"""One step of the rotation: where the fit sticks, slips or opens, by a semismooth Newton method.

With lambda = lambda_0 + loads + S w the tractions of slip and opening w, each point has

    w_n = 0 and lambda_n <= 0, or lambda_n = 0 and w_n <= 0 (open);
    q = lambda_t - rho (w_t - w_t,before),  b = -mu lambda_n:
    w_t = w_t,before where |q| <= b (stick), else lambda_t = b q / |q| (slip)

The unknowns are the slips of the points that slip or open alone. A row of slip is, with e = q / |q| and beta = b / |q|,

    [I - beta (I - e e')] d lambda_t + mu e d lambda_n + rho beta (I - e e') d w_t

Source: Alart, Curnier, Comput. Methods Appl. Mech. Eng. 92 (1991) 353-375 (doi 10.1016/0045-7825(91)90022-X); Hueber,
Stadler, Wohlmuth, SIAM J. Sci. Comput. 30 (2008) 572-596 (doi 10.1137/060671061).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from inspect import signature
from itertools import pairwise

import numpy as np
import scipy.linalg as sla

from ..base.arrays import BoolArray, FloatArray, IntArray
from .elements import ComplexArray
from .kernel import Kernel

RHO = 2e4
"""Weight of a slip against a traction in the law [MPa/mm]."""
TOLERANCE = 1e-9
"""Residual of a step, in the largest pressure."""
ITERATIONS = 40
SHORTENINGS, DECREASE = 8, 0.1
"""How often a way is shortened at most, and how much of the residual a whole way has to take away."""
LOST = 100.0
"""Slip beyond which Newton's method has lost the wheel [mm]."""
DENSE = 400
"""Unknowns from which on a linear problem is solved by GMRES."""
LINEAR, ENOUGH = 1e-5, 0.03
"""What of a residual it may leave: so much of it, or so much of what a step may leave."""
MORE = 1.2
"""How many times as many moments as slip may be kept between Newton's iterations."""
SINGULAR = 1e-13
"""Reciprocal condition number below which a linear problem has no solution of use."""
VISCOUS = 1e-2
"""Resistance that slip gets then, in RHO."""


@dataclass(frozen=True, kw_only=True)
class Solved:
    """A step: tractions and slips (K, 3, m), and whether Newton's method got there."""

    traction: FloatArray  # MPa
    slip: FloatArray  # mm
    iterations: int
    converged: bool


@dataclass(frozen=True, kw_only=True)
class Law:
    """Coulomb's law at all points of the ring for one step."""

    friction: FloatArray  # (m,)
    before: FloatArray  # (K, 3, m) slip before the step [mm]

    def trial(self, traction: FloatArray, slip: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
        """q (K, 2, m), b (K, m), and which points are open and which slip."""
        q = traction[:, 1:] - RHO * (slip[:, 1:] - self.before[:, 1:])
        bound = self.friction * np.maximum(-traction[:, 0], 0.0)
        opens = traction[:, 0] - RHO * slip[:, 0] > 0.0
        size = np.hypot(q[:, 0], q[:, 1])
        return q, bound, opens, ~opens & ((size > bound) | (self.friction == 0.0))

    def settled(self, slip: FloatArray, opens: BoolArray, slips: BoolArray) -> FloatArray:
        """The slips with those of closed and of sticking points as the law has them."""
        out = slip.copy()
        out[:, 0][~opens] = 0.0
        stick = ~(opens | slips)
        for i in (1, 2):
            out[:, i][stick] = self.before[:, i][stick]
        return out


def solve_step(kernel: Kernel, law: Law, still: FloatArray, guess: FloatArray) -> Solved:
    """Solve a step from a guess of the slips (K, 3, m); ``still`` are the tractions (K, 3, m) without any slip."""
    return _solved(Problem(kernel=kernel, law=law, still=still), guess, search=False)


def search_step(kernel: Kernel, law: Law, still: FloatArray, guess: FloatArray) -> Solved:
    """The same by shorter ways, each to where less of the law is left: where much opens, whole ways lead astray."""
    return _solved(Problem(kernel=kernel, law=law, still=still), guess, search=True)


def _solved(problem: Problem, guess: FloatArray, *, search: bool) -> Solved:
    here, done = problem.at(guess), None
    for iteration in range(ITERATIONS):
        if done is not None and here.error <= problem.tolerance and (here.status == done).all():
            return Solved(traction=here.traction, slip=here.slip, iterations=iteration, converged=True)
        done = here.status
        correction = problem.correction(here)
        here = problem.searched(here, correction) if search else problem.at(here.slip + here.rest + correction)
        if not (np.isfinite(here.traction).all() and float(np.abs(here.slip).max()) < LOST):
            break
    return Solved(traction=here.traction, slip=here.slip, iterations=iteration + 1, converged=False)


@dataclass(frozen=True, kw_only=True)
class Place:
    """Slips (K, 3, m) on the way to a solution, and what the law leaves there."""

    slip: FloatArray  # mm
    traction: FloatArray  # MPa
    q: FloatArray  # (K, 2, m)
    bound: FloatArray  # (K, m)
    opens: BoolArray
    slips: BoolArray
    rest: FloatArray  # from the slip of closed and sticking points to that of the law [mm]
    residual: FloatArray  # of the others [MPa]

    @property
    def status(self) -> IntArray:
        """1 where a point is open, 2 where it slips."""
        return np.asarray(self.opens.astype(np.int8) + 2 * self.slips)

    @property
    def error(self) -> float:
        """The largest residual [MPa]."""
        return max(float(np.abs(self.residual).max(initial=0.0)), RHO * float(np.abs(self.rest).max()))

    @property
    def size(self) -> float:
        """The residual as a length [MPa]."""
        return float(np.hypot(np.linalg.norm(self.residual), RHO * np.linalg.norm(self.rest)))


@dataclass(frozen=True, kw_only=True)
class Problem:
    """What one step has to solve."""

    kernel: Kernel
    law: Law
    still: FloatArray  # (K, 3, m)

    @cached_property
    def tolerance(self) -> float:
        """The largest residual that may be left [MPa]."""
        return TOLERANCE * max(float(np.abs(self.still[:, 0]).max()), 1e-300)

    @cached_property
    def nearby(self) -> Nearby:
        """S between the moments that slip in this step."""
        return Nearby(self.kernel)

    def at(self, slip: FloatArray) -> Place:
        """What the law leaves of slips."""
        traction = self.still + _respond(self.kernel, slip)
        q, bound, opens, slips = self.law.trial(traction, slip)
        rest = self.law.settled(slip, opens, slips) - slip
        residual = _residual(traction, q, bound, opens, slips)
        return Place(
            slip=slip, traction=traction, q=q, bound=bound, opens=opens, slips=slips, rest=rest, residual=residual
        )

    def correction(self, here: Place) -> FloatArray:
        """What Newton's method adds to the slips of points that slip or open, once the others have settled."""
        if not (here.opens.any() or here.slips.any()):
            return np.zeros_like(here.slip)
        moved = here.traction + (_respond(self.kernel, here.rest) if here.rest.any() else 0.0)
        return _correction(self, here, moved)

    def searched(self, here: Place, correction: FloatArray) -> Place:
        """The first place on the way, half as far each time, that leaves enough less; or the best of them."""
        way, found = here.rest + correction, []
        for halvings in range(SHORTENINGS):
            share = 0.5**halvings
            found.append(self.at(here.slip + share * way))
            if found[-1].size < (1.0 - DECREASE * share) * here.size:
                return found[-1]
        return min(found, key=lambda place: np.nan_to_num(place.size, nan=np.inf))


def _respond(kernel: Kernel, slip: FloatArray) -> FloatArray:
    return kernel.respond(slip.reshape(len(slip), -1)).reshape(slip.shape)


def _unit(q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """e = q / |q| and |q|; e = 0 where q vanishes."""
    size = np.hypot(q[:, 0], q[:, 1])
    safe = np.where(size > 0.0, size, 1.0)
    return q / safe[:, None], safe


def _residual(traction: FloatArray, q: FloatArray, bound: FloatArray, opens: BoolArray, slips: BoolArray) -> FloatArray:
    """What the law leaves at points that slip or open (K, 3, m) [MPa]."""
    e, _ = _unit(q)
    out = np.zeros_like(traction)
    out[:, 1:] = np.where(slips[:, None], traction[:, 1:] - bound[:, None] * e, 0.0)
    return np.where(opens[:, None], traction, out)


def _correction(problem: Problem, here: Place, moved: FloatArray) -> FloatArray:
    """The change of the slips (K, 3, m) of points that slip or open; ``moved`` are tractions when others settled."""
    k, j = np.nonzero(here.opens | here.slips)
    free = here.opens[k, j]
    e, size = _unit(here.q)
    e, beta = e[k, :, j], (here.bound / size)[k, j]
    across = np.eye(2) - e[:, :, None] * e[:, None, :]
    mixing = np.zeros((len(k), 3, 3))  # of d lambda
    mixing[:, 1:, 1:] = np.eye(2) - beta[:, None, None] * across
    mixing[:, 1:, 0] = problem.law.friction[j, None] * e
    mixing[free] = np.eye(3)
    own = np.zeros((len(k), 3, 3))  # of d w
    own[:, 1:, 1:] = RHO * beta[:, None, None] * across
    own[free] = 0.0
    residual = here.residual[k, :, j] + np.einsum("pij,pj->pi", mixing, (moved - here.traction)[k, :, j])
    unknown = np.stack([free, np.ones_like(free), np.ones_like(free)], axis=1)
    linear = Linear(nearby=problem.nearby, points=(k, j), mixing=mixing, own=own, unknown=unknown)
    step = linear.solve(residual, DENSE, ENOUGH * problem.tolerance)
    out = np.zeros_like(here.slip)
    out[k, :, j] = step
    return out


class Nearby:
    """S of all harmonics between the moments that slip somewhere, taken out anew where others do."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self._moments: IntArray = np.zeros(0, dtype=np.int64)
        self._matrices: list[FloatArray] = []

    def among(self, moments: IntArray) -> tuple[IntArray, list[FloatArray]]:
        """These moments, in ascending order, and perhaps a few more; and S between them (3 q, 3 q) [MPa/mm]."""
        missing = np.setdiff1d(moments, self._moments)
        if len(missing) or len(self._moments) > MORE * len(moments):
            every = np.union1d(moments, self._moments)
            self._moments = every if len(every) <= MORE * len(moments) else moments
            self._matrices = self.kernel.between(self.places)
        return self._moments, self._matrices

    @property
    def places(self) -> IntArray:
        """The components of these moments among 3 m."""
        return (np.arange(3)[:, None] * self.kernel.fit.moments + self._moments).ravel()


@dataclass(frozen=True, kw_only=True)
class Linear:
    """mixing (S d w) + own d w = -residual at p points, for the unknown components of d w (p, 3)."""

    nearby: Nearby
    points: tuple[IntArray, IntArray]  # angle and moment of each
    mixing: FloatArray  # (p, 3, 3)
    own: FloatArray  # (p, 3, 3)
    unknown: BoolArray  # (p, 3)

    @property
    def kernel(self) -> Kernel:
        """The fit around the whole ring."""
        return self.nearby.kernel

    @cached_property
    def chosen(self) -> IntArray:
        """The unknown components among all."""
        return np.flatnonzero(self.unknown.ravel())

    @cached_property
    def places(self) -> tuple[IntArray, IntArray]:
        """Angle, and place among 3 m, of all components (3 p,)."""
        k, j = self.points
        return np.repeat(k, 3), (np.arange(3) * self.kernel.fit.moments + j[:, None]).ravel()

    def solve(self, residual: FloatArray, most: int, enough: float = 0.0) -> FloatArray:
        """d w (p, 3): by elimination, or by GMRES where there are more than ``most`` unknowns, to ``enough`` [MPa]."""
        right, out = -residual.ravel()[self.chosen], np.zeros(residual.size)
        found = self._iterated(right, enough) if len(right) > most else None
        out[self.chosen] = (
            _regular_solution(self.rows(slice(0, len(self.points[0]))), right) if found is None else found
        )
        return out.reshape(residual.shape)

    def rows(self, part: slice) -> FloatArray:
        """The matrix of the unknowns of consecutive points."""
        angle, place = (each[3 * part.start : 3 * part.stop] for each in self.places)
        inside = np.flatnonzero(self.unknown[part].ravel())
        influence = self.kernel.gathered((angle, place), (angle[inside], place[inside]))
        count = len(influence) // 3
        rows = (self.mixing[part] @ influence.reshape(count, 3, -1)).reshape(3 * count, -1)[inside]
        point, component = np.divmod(inside, 3)
        r, c = np.nonzero(point[:, None] == point[None, :])
        rows[r, c] += self.own[part][point[r], component[r], component[c]]
        return np.asarray(rows)

    def times(self, unknowns: FloatArray) -> FloatArray:
        """The matrix times the unknowns, by the harmonics."""
        matrices, turn, places = self._near
        moved = np.zeros(3 * len(self.points[0]))
        moved[self.chosen] = unknowns
        slip = np.zeros((self.kernel.angles, len(turn)))
        slip[places] = moved
        traction = self.kernel.product(matrices, turn, slip)[places].reshape(-1, 3)
        both = np.einsum("pij,pj->pi", self.mixing, traction) + np.einsum("pij,pj->pi", self.own, moved.reshape(-1, 3))
        return np.asarray(both.ravel()[self.chosen])

    @cached_property
    def _near(self) -> tuple[list[FloatArray], ComplexArray, tuple[IntArray, IntArray]]:
        """S between the moments that slip somewhere, their factor around the axle, and where all components stand."""
        k, j = self.points
        moments, matrices = self.nearby.among(np.unique(j))
        places = (np.arange(3) * len(moments) + np.searchsorted(moments, j)[:, None]).ravel()
        return matrices, self.kernel.turn[self.nearby.places], (np.repeat(k, 3), places)

    def _iterated(self, right: FloatArray, enough: float) -> FloatArray | None:
        """By GMRES, its preconditioner the points of each angle by themselves; None where it does not get there."""
        from scipy.sparse.linalg import LinearOperator, gmres  # 0.1 s that small problems need not wait for

        ends = np.searchsorted(self.points[0], np.arange(self.kernel.angles + 1))
        parts = [slice(int(a), int(b)) for a, b in pairwise(ends) if b > a]
        factors = [sla.lapack.dgetrf(self.rows(part))[:2] for part in parts]
        counts = np.cumsum([0, *(int(self.unknown[part].sum()) for part in parts)])

        def by_angle(vector: FloatArray) -> FloatArray:
            shares = zip(factors, pairwise(counts), strict=True)
            return np.concatenate([sla.lapack.dgetrs(*lu, vector[a:b])[0] for lu, (a, b) in shares])

        size = (len(right), len(right))
        exact = {"rtol" if "rtol" in signature(gmres).parameters else "tol": LINEAR}
        found, info = gmres(
            LinearOperator(size, self.times),
            right,
            M=LinearOperator(size, by_angle),
            restart=60,
            maxiter=2,
            atol=enough,
            **exact,
        )
        return None if info or not np.isfinite(found).all() else np.asarray(found)


def _regular_solution(rows: FloatArray, right: FloatArray) -> FloatArray:
    """The solution; where the guess has everything slip, which leaves the wheel free, with viscous slip instead."""
    norm = float(np.abs(rows).sum(axis=0).max())
    lu, pivots, info = sla.lapack.dgetrf(rows)
    if info or sla.lapack.dgecon(lu, norm)[0] < SINGULAR:
        rows[np.diag_indices(len(rows))] += VISCOUS * RHO
        lu, pivots, info = sla.lapack.dgetrf(rows)
    return np.asarray(sla.lapack.dgetrs(lu, pivots, right)[0])
