"""What a slide leaves behind: curves, work, and the coefficient with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from macrofit.base.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Forces on the wheel along the slide, n rows."""

    displacement: FloatArray
    """Slide of the wheel, shape (n,) [mm]."""
    start: float
    """Where the slide starts [mm]."""
    normal: FloatArray
    """N, pushing the plates apart, shape (n,) [N]."""
    tangential: FloatArray
    """T, against the slide, shape (n,) [N]."""
    lateral: FloatArray
    """T_y, across the slide, shape (n,) [N]; its mean is near 0."""
    height: FloatArray
    """Height of the wheel's plate over the position in which the nominal faces coincide, shape (n,) [mm]."""
    share: FloatArray
    """Part of the slide that each row stands for, shape (n,), sum 1."""
    tangential_work: float
    """Work done against T over the slide [N mm]; the quasi-static engine has it from energies, not from the rows."""

    @property
    def friction(self) -> FloatArray:
        """T/N, shape (n,); nan where contact is lost."""
        held = self.normal > 0.0
        return np.where(held, self.tangential / np.where(held, self.normal, 1.0), np.nan)

    @property
    def mean_normal(self) -> float:
        """Mean N over the slide [N]."""
        return float(self.share @ self.normal)

    @property
    def mean_tangential(self) -> float:
        """Mean T over the slide [N]."""
        return self.tangential_work / float(self.displacement[-1] - self.start)

    @property
    def coefficient(self) -> float:
        """The meso coefficient: mean T over mean N [-]; nan where there is never contact."""
        return self.mean_tangential / self.mean_normal if self.mean_normal > 0.0 else float("nan")

    @property
    def mean_of_ratio(self) -> float:
        """Mean of T/N where there is contact [-]; it differs from `coefficient` where N varies much."""
        held = self.normal > 0.0
        return float(self.share[held] @ self.friction[held] / self.share[held].sum()) if held.any() else float("nan")

    @property
    def resultant(self) -> float:
        """Mean of sqrt(T^2 + T_y^2) over mean N [-]: another reading of "tangential"; every swing counts in full."""
        if not self.mean_normal > 0.0:
            return float("nan")
        return float(self.share @ np.hypot(self.tangential, self.lateral)) / self.mean_normal

    @property
    def uncertainty(self) -> float:
        """Standard error of `coefficient` along the slide [-], by block averaging."""
        if not self.mean_normal > 0.0:
            return float("nan")
        rest = self.tangential - self.coefficient * self.normal
        return block_error(rest, self.share) / self.mean_normal


def block_error(values: FloatArray, share: FloatArray | None = None) -> float:
    """Standard error of the mean of a correlated series, by block averaging.

    Blocks of 1, 2, 4, ... rows are averaged while at least eight remain; independent blocks would give the same
    error at every length, correlated rows make it grow until the blocks are longer than the memory of the series.
    The largest is returned. Flyvbjerg and Petersen 1989, J. Chem. Phys. 91, 461.
    """
    weight = np.full(len(values), 1.0 / len(values)) if share is None else share.astype(np.float64)
    mean = float(weight @ values) / float(weight.sum())
    part, weight = (values - mean) * weight, weight.copy()
    largest = 0.0
    while len(part) >= 8:
        blocks = len(part)
        # sum of squares of what each block adds to the mean, with the bias of the estimated mean taken out
        largest = max(largest, float(np.sum(part**2)) * blocks / (blocks - 1.0))
        even = 2 * (blocks // 2)
        part = part[:even:2] + part[1:even:2]
    return float(np.sqrt(largest))


@dataclass(frozen=True, kw_only=True)
class Sums:
    """Over some time steps: what the explicit engine adds up."""

    force: FloatArray
    """Mean force on the wheel, shape (3,) [N]."""
    work: float
    """Done by the drive [N mm]."""
    friction: float
    """Lost in the contacts [N mm]."""
    damping: float
    """Lost in damping [N mm]."""
    released: float
    """By beams that broke [N mm]."""


UNBALANCED = 0.02
"""Share of the work left over above which an answer is not to be relied on [-]."""


class Work(msgspec.Struct, frozen=True, kw_only=True):
    """The account of a slide [N mm]: drive = friction + damping + broken + changes of what is stored + imbalance."""

    drive: float
    """Done by the carriage of the wheel."""
    friction: float
    """Lost in the contacts."""
    damping: float = 0.0
    """Lost in viscous damping (explicit engine)."""
    broken: float = 0.0
    """Given up by beams that broke."""
    elastic: float
    """Change of the energy stored in the beams."""
    contact: float
    """Change of the energy stored in the contacts."""
    kinetic: float = 0.0
    """Change of the kinetic energy (explicit engine)."""

    @property
    def imbalance(self) -> float:
        """What is left over, over the work lost in friction and the work of the drive, whichever is larger [-]."""
        stored = self.elastic + self.contact + self.kinetic
        rest = self.drive - self.friction - self.damping - self.broken - stored
        return rest / max(abs(self.drive), self.friction, 1e-300)


class Breaks(msgspec.Struct, frozen=True, kw_only=True):
    """Beams that broke, in the order in which they did."""

    time: list[float]
    """[s] from the start of the squeeze."""
    slide: list[float]
    """Slide at which each broke [mm]."""
    mode: list[str]
    """"tension" or "shear"."""
    place: list[tuple[float, float, float]]
    """Middle of the beam before any motion [mm]."""


@dataclass(frozen=True, kw_only=True)
class Slide:
    """One friction test: a micro coefficient, and what came of it."""

    micro_friction: float
    engine: str
    """ "quasi-static" or "explicit"."""
    squeeze: Curve
    """Before the slide; its displacement is the approach after the first touch [mm]."""
    curve: Curve
    work: Work
    steps: int
    """Time steps, or increments, of squeeze and slide."""
    bond_steps: int
    """Beams times time steps (explicit engine)."""
    unconverged_increments: int
    """Increments accepted with a residual above the tolerance: always 0, they are never accepted."""
    largest_residual: float
    """Over all increments, over the largest contact force [-]; 0 for the explicit engine."""
    cpu_s: float
    """CPU time of squeeze and slide, set-up left out [s]."""
    breaks: Breaks | None = None
    remark: str = ""
    """Why another engine than the one asked for gave the answer, or why the load is another, if so."""
