"""The design of a database: which surfaces and micro coefficients its samples have."""

from __future__ import annotations

import warnings
from typing import Any, Literal

import msgspec
import numpy as np
from scipy.stats import qmc

from macrofit.base.arrays import FloatArray
from meso.settings import POINTS_OF_A_GROOVE
from meso.surfaces.surface import TILES, tile_seed

from ..errors import DesignError

FRICTION_RANGE = (0.01, 0.09)
"""Range of the micro coefficients of a design [-]; each pair takes one of every equal part of it."""
PLACES = 4
"""Distance of two samples on one strip, in tiles: two for the axle's face, one on each side for what it depends on."""
SEEDS_OF_A_STRIP = TILES
"""Seeds that share a strip, and no sample of one is independent of the others."""
LAYS = ("turned", "ground")
"""Lays that a design deals to its share of pairs with one, each as likely."""
FEED = 0.15, 0.6
"""Range of the distance of turned grooves, log-uniform [mm]; at least `POINTS_OF_A_GROOVE` spacings of the grid."""
DEPTH = 0.1, 0.8
"""Range of the depth of turned grooves over R, log-uniform [-]."""
ANISOTROPY = 2.0, 20.0
"""Range of the anisotropy of ground faces, log-uniform [-]."""
FINEST_LEVEL = 5
"""Largest number of levels: the 33 points of a matrix along an edge leave out nothing of 2^n + 1 up to here."""


class Design(msgspec.Struct, frozen=True, kw_only=True):
    """Where samples lie: a scrambled Sobol sequence over log R, level, exponent and micro coefficients.

    Pair i has surfaces of its own, number first_surface + i (`surface_seed`), and the point of the sequence with that
    number: a split by pair is a split by seed, and databases of disjoint numbers continue one design.
    """

    seed: int = 0
    """Seed of the scrambling."""
    first_surface: int = 0
    """Number of the surfaces of the first pair."""
    first_packing: int = 0
    """Smallest seed of a packing; see `packing_seed`."""
    packings: int = 1
    """Packings of the same pair of surfaces."""
    packing_seeds: int = 256
    """Flat packings, of two plates each, that share the pairs. With 16 of them a network of envelopes learns these very
    spheres: its error on others was 0.86 % where cross-validation among them had promised 0.62 %."""
    max_height: tuple[float, float] = (0.005, 0.04)
    """Range of R, the range of the random heights, log-uniform [mm]."""
    levels: tuple[int, ...] = (3, 4)
    """Numbers of subdivisions, each as likely."""
    hurst_exponent: tuple[float, float] = (0.5, 1.0)
    """Range of the Hurst exponent H, uniform [-]."""
    micro_friction: int | tuple[float, ...] = 2
    """How many, one in each part of `friction_range`; or the coefficients themselves, the same for all pairs."""
    friction_range: tuple[float, float] = FRICTION_RANGE
    """Range of the micro coefficients [-]."""
    friction_scale: Literal["linear", "log"] = "linear"
    """Parts of the range of equal width, or of equal ratio."""
    pressure: tuple[float, float] | None = None
    """Range of the pressure before the slide, log-uniform [MPa]; None: that of the settings. At another modulus E it
    stands for pressure x E / youngs_modulus: a coefficient depends on p/E alone."""
    forms: tuple[str, ...] = ()
    """Forms of the faces, each as likely; none: that of the settings."""
    with_lay: float = 0.0
    """Share of the pairs whose faces are turned or ground [-]; 0: the lay of the settings."""

    def __post_init__(self) -> None:
        limits = {
            "--seed": (self.seed, 0, 2**32 - 1),
            "--first-surface": (self.first_surface, 0, 2**30 - 1),
            "--first-packing": (self.first_packing, 0, 2**30 - 1),
            "--packings": (self.packings, 1, 10_000),
            "packing_seeds": (self.packing_seeds, 1, 10_000),
            "--micro-friction": (self.count, 1, 100),
        }
        for option, (value, low, high) in limits.items():
            if not low <= value <= high:
                raise DesignError(f"{option} = {value} is out of bounds: take {low} ... {high}")
        if not 0.0 < self.max_height[0] <= self.max_height[1]:
            raise DesignError(f"--max-height = {self.max_height}: take two heights in mm, 0 < the lower <= the upper")
        if not 0.0 <= self.hurst_exponent[0] <= self.hurst_exponent[1] <= 1.0:
            raise DesignError(f"--hurst = {self.hurst_exponent}: take two exponents, 0 <= the lower <= the upper <= 1")
        if self.pressure is not None and not 0.0 < self.pressure[0] <= self.pressure[1]:
            raise DesignError(f"--pressure = {self.pressure}: take two pressures in MPa, 0 < the lower <= the upper")
        if not 0.0 <= self.with_lay <= 1.0:
            raise DesignError(f"with_lay = {self.with_lay}: take a share, 0 ... 1")
        if not self.levels or not all(1 <= level <= FINEST_LEVEL for level in self.levels):
            raise DesignError(f"--levels = {self.levels}: take one or more of 1 ... {FINEST_LEVEL}")
        given = self.micro_friction
        if isinstance(given, tuple) and (list(given) != sorted(set(given)) or not all(0 <= mu <= 2 for mu in given)):
            raise DesignError(f"--micro-friction = {given}: take rising numbers from 0 to 2")

    @property
    def count(self) -> int:
        """Number of micro coefficients per sample, k."""
        return self.micro_friction if isinstance(self.micro_friction, int) else len(self.micro_friction)

    @property
    def wide(self) -> bool:
        """Whether pairs differ in more than R, level, exponent and micro coefficients."""
        return bool(self.pressure is not None or self.forms or self.with_lay)

    def points(self, pairs: int) -> list[Point]:
        """The first pairs of the design; more pairs have the same beginning.

        Raises:
            DesignError: there are not so many pairs.
        """
        if not 1 <= pairs <= 2**30 - self.first_surface:
            raise DesignError(f"--pairs = {pairs}: take 1 ... {2**30 - self.first_surface}")
        sequence = qmc.Sobol(3 + self.count + 5 * self.wide, scramble=True, seed=self.seed)
        if self.first_surface:  # by 0 it fails
            sequence.fast_forward(self.first_surface)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that their number is no power of two
            return [self._point(u) for u in sequence.random(pairs)]

    def _point(self, u: FloatArray) -> Point:
        """The pair at a point of the unit cube."""
        max_height, count = _between(*self.max_height, u[0]), self.count
        levels = self.levels[int(u[1] * len(self.levels))]
        given = self.micro_friction
        if isinstance(given, int):
            shares = ((np.arange(count) + u[3 : 3 + count]) / count).tolist()
            start, end = self.friction_range
            linear = self.friction_scale == "linear"
            given = tuple(start + (end - start) * at if linear else _between(start, end, at) for at in shares)
        more = u[3 + count :]
        return Point(
            max_height=max_height,
            levels=levels,
            hurst_exponent=float(self.hurst_exponent[0] + (self.hurst_exponent[1] - self.hurst_exponent[0]) * u[2]),
            micro_friction=given,
            pressure=None if self.pressure is None else _between(*self.pressure, more[0]),
            face=self._face(more[1:], max_height, levels) if self.wide else {},
        )

    def _face(self, u: FloatArray, max_height: float, levels: int) -> dict[str, float | str]:
        """Form and lay of a pair's faces, from four numbers of the unit interval."""
        keys: dict[str, float | str] = {}
        if self.forms:
            keys["form"] = self.forms[int(u[0] * len(self.forms))]
        if u[1] >= self.with_lay:
            return keys
        keys["lay"] = lay = LAYS[int(u[1] / self.with_lay * len(LAYS))]
        if lay == "ground":
            return keys | {"anisotropy": _between(*ANISOTROPY, u[2])}
        narrowest = max(FEED[0], POINTS_OF_A_GROOVE / 2**levels)
        return keys | {
            "feed": _between(narrowest, FEED[1], u[2]),
            "groove_depth": max_height * _between(*DEPTH, u[3]),
        }

    def surface_seed(self, pair: int, form: str) -> int:
        """Seed of both surfaces of a pair; the streams of the two bodies are independent.

        Tiles by themselves have the number of the pair. Of strips each pair has one of its own, for neighbours on one
        strip are no independent samples: they would stand on both sides of a split. The face lies at its far end, where
        no press-fit reaches; where all strips are taken, the next pairs lie `PLACES` before.
        """
        number = self.first_surface + pair
        if form != "strip":
            return number
        turn, strip = divmod(number, TILES)
        return tile_seed(strip, TILES - PLACES * (turn + 1))

    def packing_seed(self, pair: int, packing: int) -> int:
        """Seed of a packing: a block of them for each pair in turn, so that pairs share all their packings or none."""
        blocks = max(1, self.packing_seeds // self.packings)
        return self.first_packing + (pair % blocks) * self.packings + packing


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """What the design chooses for a pair."""

    max_height: float
    """Range R of the random heights [mm]."""
    levels: int
    """Subdivisions of a surface, n."""
    hurst_exponent: float
    """Hurst exponent H [-]."""
    micro_friction: tuple[float, ...]
    """Micro coefficients [-], rising."""
    pressure: float | None = None
    """Pressure before the slide [MPa]; None: that of the settings."""
    face: dict[str, float | str] = {}
    """Form, lay and what goes with it: keys of `meso.settings.FaceKeys` that differ from the settings."""


def _between(low: float, high: float, share: float) -> float:
    """The place of a share of the way between two numbers, by ratio."""
    return float(low * (high / low) ** share)


DESIGNS: dict[str, dict[str, Any]] = {
    "narrow": {},
    "wide": {
        "max_height": (0.001, 0.1),
        "levels": (3, 4, 5),
        "hurst_exponent": (0.2, 1.0),
        "friction_range": (0.01, 0.3),
        "friction_scale": "log",
        "pressure": (20.0, 520.0),
        "forms": ("strip", "tiles"),
        "with_lay": 1.0 / 3.0,
    },
}
"""Designs that go by a name: the ranges of real seats are wide (at 210 GPa 520 MPa is 170 MPa on aluminium)."""
SETTINGS_OF_DESIGN: dict[str, tuple[str, ...]] = {"narrow": (), "wide": ("load.control=force",)}
"""Settings of the plates that go with a design, as `key=value`: at constant force contact is never lost."""
