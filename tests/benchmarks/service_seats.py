"""How far does the scatter of friction from one rough seat to the next move slip and fatigue criteria in service?

    python -m tests.benchmarks service_seats [--quick] [--seats 200]

`wheelset` with a bore of 94.85 mm on facets of 4 mm, pressed, released and turned for two revolutions of 14 steps
under half the default loads, with the network's coefficient for each millimetre at a micro coefficient of 0.09, within
its range, seat after seat; and with the same coefficient everywhere: the mean of all seats, and that less and more by
the scatter of a place. The last columns say how closely a value follows the mean coefficient of a seat, and that of its
30 mm at the inner edge.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from macrofit.assembly import Assembly, assemble
from macrofit.scene import load_scene
from macrofit.service.journal import Kept
from macrofit.service.output.numbers import numbers
from macrofit.service.run import Course, Shared, Turned
from macrofit.service.study.record import record_of

from ._measure import head, lines, row

FloatArray = npt.NDArray[np.float64]

FIT = ("wheel.bore_radius=94.85", "mesh.seat_facet=4", "service.steps=14", "service.revolutions=2",
       "service.journal_force=55e3", "service.journal_moment=3e7")  # fmt: skip
TINY = ("mesh.seat_facet=8", "mesh.coarse=40", "motion.start=90", "motion.increment=30", "service.harmonics=1",
        "service.steps=9", "service.revolutions=1")  # fmt: skip
NETWORK = ("friction.provider=surrogate", "friction.options.micro_friction=0.09")
EDGE = 30.0
"""Length at the inner edge over which friction is averaged [mm]; about what slips there."""
SHOWN = {
    "friction_work_N_mm": ("friction work of a revolution [J]", 1e-3),
    "front_slip_range_mm": ("slip range at the front edge [um]", 1e3),
    "inner_slip_range_mm": ("slip range at the inner edge [um]", 1e3),
    "inner_slip_zone_mm": ("slip zone at the inner edge [mm]", 1.0),
    "axial_stress_amplitude_MPa": ("largest amplitude of axial stress [MPa]", 1.0),
    "crossland": ("Crossland [of the limit]", 1.0),
    "dang_van": ("Dang Van [of the limit]", 1.0),
    "findley": ("Findley [of the limit]", 1.0),
    "ruiz_MPa2_mm": ("Ruiz and Chen [MPa2 mm]", 1.0),
}


@dataclass(frozen=True, kw_only=True)
class Seat:
    """One seat in service."""

    values: dict[str, float]
    friction: FloatArray  # (m,) coefficients where it is in contact
    mean: float
    inner: float  # mean of EDGE mm at the inner edge


def turned(shared: Shared, changes: Sequence[str]) -> Seat:
    """A seat, its press and its revolutions."""
    found = Course(load_scene("wheelset", changes), lambda _: None, Kept(), shared).carry_out()
    assert isinstance(found.turned, Turned)
    touches, z = found.turned.fretting.touches, found.whole.fit.z
    mu, weight, place = found.turned.friction[touches], found.whole.fit.weight[touches], z[touches]
    last = place > place.max() - EDGE
    return Seat(
        values={name: float(value or 0.0) for name, value in record_of("", numbers(found), None, 0.0).values.items()},
        friction=mu,
        mean=float(np.average(mu, weights=weight)),
        inner=float(np.average(mu[last], weights=weight[last])),
    )


def rows(small: Sequence[str], count: int) -> Iterator[str]:
    """The table, line by line."""
    made: list[Assembly] = [assemble(load_scene("wheelset", small), MPI.COMM_SELF)]
    shared = Shared(lambda _: made[0])
    seats = [turned(shared, [*small, *NETWORK, f"friction.options.seed={seed}"]) for seed in range(1, count + 1)]
    mean, inner = (np.array([getattr(seat, name) for seat in seats]) for name in ("mean", "inner"))
    scatter = float(np.mean([seat.friction.std(ddof=1) for seat in seats]))
    levels = [float(mean.mean()) + part * scatter for part in (-1.0, 0.0, 1.0)]
    uniform = [turned(shared, [*small, f"friction.options.coefficient={level!r}"]) for level in levels]
    yield head(
        "", f"uniform {levels[0]:.3f}, {levels[1]:.3f}, {levels[2]:.3f}", f"{count} seats, mean and standard deviation",
        "least to largest", "with the mean", "with the inner edge",
    )  # fmt: skip
    yield row("coefficient of a seat, its mean", "", spread(mean), span(mean), "", correlation(mean, inner))
    yield row(
        f"that of its {EDGE:.0f} mm at the inner edge", "", spread(inner), span(inner), correlation(inner, mean), ""
    )
    for name, (said, factor) in SHOWN.items():
        values = factor * np.array([seat.values[name] for seat in seats])
        alike = ", ".join(f"{factor * seat.values[name]:.4g}" for seat in uniform)
        yield row(said, alike, spread(values), span(values), correlation(values, mean), correlation(values, inner))


def spread(values: FloatArray) -> str:
    """Mean, standard deviation, and the latter in the former."""
    deviation = values.std(ddof=1)
    return f"{values.mean():.4g} ± {deviation:.2g} ({deviation / values.mean():.1%})"


def span(values: FloatArray) -> str:
    """Least to largest."""
    return f"{values.min():.4g} to {values.max():.4g}"


def correlation(values: FloatArray, others: FloatArray) -> str:
    """Coefficient of correlation; a dash where nothing varies."""
    if values.std() == 0.0 or others.std() == 0.0:
        return "-"
    return f"{np.corrcoef(values, others)[0, 1]:+.2f}"


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks service_seats", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, one revolution, three seats")
    parser.add_argument("--seats", type=int, default=200)
    options = parser.parse_args(words)
    lines(rows([*FIT, *(TINY if options.quick else ())], 3 if options.quick else options.seats))
    return 0
