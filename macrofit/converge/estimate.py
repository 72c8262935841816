"""Richardson's estimate from three meshes, whose sizes are as 4 : 2 : 1, and two step lengths, as 2 : 1.

With f(h) = f* + C h^p and the sizes 2 h, h, h/2:

    p  = log2(|f(h) - f(2h)| / |f(h/2) - f(h)|)
    f* = f(h/2) + (f(h/2) - f(h)) / (2^p - 1)

(P. J. Roache, Verification and Validation in Computational Science and Engineering, 1998, chapter 5). A curve or a
profile is taken as a whole: |.| is its norm. An order above that of the elements, q, is not believed, and one below
q / 2 is called irregular: the differences do not fall as the formula has them. Of a largest value, which jumps from
point to point of the mesh, f* then takes q, so that the difference of the two finer meshes decides; of a curve or a
profile q / 2, since a sharp edge makes it slow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..base.arrays import FloatArray
from ..solution import Solution
from .ladder import RATIO

SAMPLES = 8001
"""Points of the seat where pressures are compared."""
GROWS, FALLS = 0.03, 0.7
"""A stress that grows by more than the first with a finer mesh, and by more than the second of the growth before."""
SHARP, GROWING = "none: sharp corner", "none: still grows"
"""What stands in the place of the order of a stress without a limit."""
STEP_ORDER = 1.0
"""Order of the error in the increment: of friction's path, and of a peak that falls between two of them."""
EXACT = 1e-6
"""Relative error below which nothing is said of an order."""
LEAST_FORCE = 1e-3
"""Share of the normal force beside which a smaller pushing force is judged."""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What is compared of a run, each an array with a norm of its own."""

    force: FloatArray  # N, largest in size
    curve: FloatArray  # N, at the given displacements
    pressure: FloatArray  # MPa, along the seat at the end, linearly between the facets' middles
    axle: FloatArray  # MPa, largest von Mises stress
    wheel: FloatArray  # MPa

    least_force: float  # N
    dofs: int
    cpu_s: float


@dataclass(frozen=True)
class Quantity:
    """A row of the table: what it is called, and which of the `Figures` it is."""

    key: str
    label: str
    unit: str
    kind: Literal["force", "pressure", "stress"]

    @property
    def whole(self) -> bool:
        """Whether it is a curve or a profile, not a single number."""
        return self.key in ("curve", "pressure")


QUANTITIES = (
    Quantity("force", "largest force", "N", "force"),
    Quantity("curve", "force along the curve", "N", "force"),
    Quantity("pressure", "pressure along the seat, rms", "MPa", "pressure"),
    Quantity("axle", "largest stress, axle", "MPa", "stress"),
    Quantity("wheel", "largest stress, wheel", "MPa", "stress"),
)


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One quantity of the scene as given, and how far it is from its limit."""

    quantity: Quantity
    value: float  # of the scene as given; the norm of a curve or profile
    limit: FloatArray  # extrapolated
    order: float | None  # observed; None where the differences do not fall as a power
    mesh_error: float | None  # relative; None where there is no limit
    step_error: float
    remark: str = ""

    @property
    def error(self) -> float | None:
        """Relative error of mesh and step together, as if they added up; None without a limit."""
        return None if self.mesh_error is None else self.mesh_error + self.step_error


def figures(solution: Solution, displacement: FloatArray) -> Figures:
    """What is compared of a solution, its curve at these displacements [mm]."""
    seat, last = solution.seat, solution.increments[-1]
    at = np.linspace(seat[0], seat[-1], SAMPLES)
    normal = max(record.normal_force for record in solution.increments)
    stress = {name: extreme.value for name, extreme in solution.max_von_mises.items()}
    order = _along(solution.displacement, displacement)
    return Figures(
        force=solution.force[np.abs(solution.force).argmax(keepdims=True)],
        curve=solution.force[order],
        pressure=np.interp(at, 0.5 * (seat[1:] + seat[:-1]), last.facets.pressure),
        axle=np.array([stress.get("axle", 0.0)]),
        wheel=np.array([stress.get("wheel", 0.0)]),
        least_force=LEAST_FORCE * normal,
        dofs=solution.dofs,
        cpu_s=solution.setup_cpu_s + solution.increments_cpu_s + solution.stress_cpu_s,
    )


def _along(here: FloatArray, wanted: FloatArray) -> list[int]:
    """Numbers of the increments at these displacements, in their order, which may turn around."""
    found, k = [], 0
    for place in wanted.tolist():
        while k < len(here) - 1 and abs(here[k] - place) > 1e-9:
            k += 1
        found.append(k)
    return found


def norm(key: str, values: FloatArray) -> float:
    """The largest value of a curve, the root mean square of a profile, the size of a number."""
    if key == "pressure":
        return float(np.sqrt(np.mean(values**2)))
    return float(np.abs(values).max(initial=0.0))


def distance(key: str, found: Figures, limit: FloatArray) -> float:
    """Relative difference of a quantity of a run from a limit."""
    scale = norm(key, limit)
    if key in ("force", "curve"):
        scale = max(scale, found.least_force)
    return norm(key, getattr(found, key) - limit) / scale if scale > 0.0 else 0.0


def estimate(
    quantity: Quantity, meshes: tuple[Figures, Figures, Figures], halved: Figures, formal: int, *, sharp: bool
) -> Estimate:
    """How far one quantity of the scene is from its limit.

    Args:
        quantity: which one.
        meshes: of the coarser mesh, the scene's own and the finer one.
        halved: of the own mesh in half steps.
        formal: order of the elements, above which no observed order is believed.
        sharp: a corner that has no blend is pressed: stresses there have no limit.
    """
    coarse, own, fine = (getattr(each, quantity.key) for each in meshes)
    before, after = norm(quantity.key, own - coarse), norm(quantity.key, fine - own)
    order = observed_order(before, after, turned=not quantity.whole and float(((own - coarse) * (fine - own))[0]) < 0.0)
    least = 0.5 * formal
    order = order if order is not None and order >= least else None
    believed = min(order or (least if quantity.whole else formal), formal)
    limit = fine + (fine - own) / (RATIO**believed - 1.0)
    error = distance(quantity.key, meshes[1], limit)
    unlimited = quantity.kind == "stress" and (sharp or grows(before, after, own, fine))
    growing = SHARP if sharp else GROWING
    remark = growing if unlimited else "exact" if error < EXACT else "irregular"
    return Estimate(
        quantity=quantity,
        value=norm(quantity.key, own) if quantity.whole else float(own[0]),
        limit=fine if unlimited else limit,
        order=order if error >= EXACT and not unlimited else None,
        mesh_error=None if unlimited else error,
        step_error=distance(quantity.key, halved, own) / (1.0 - RATIO**-STEP_ORDER),
        remark="" if order is not None and remark == "irregular" else remark,
    )


def observed_order(before: float, after: float, *, turned: bool) -> float | None:
    """The power of the size with which differences fall; None where they change sign or one of them is 0."""
    if turned or before <= 0.0 or after <= 0.0:
        return None
    return math.log2(before / after)


def grows(before: float, after: float, own: FloatArray, fine: FloatArray) -> bool:
    """Whether a stress goes on growing with every finer mesh, as it does in a sharp corner."""
    return float(fine[0]) > (1.0 + GROWS) * float(own[0]) and after > FALLS * before
