"""What do steps, harmonics, facets, stiffness and formulation change in service, and how steady is it?

    python -m tests.benchmarks service_convergence [--friction 0.2] [--quick]

`wheelset` with a bore of 94.85 mm under the loads of its defaults, facets of 4 mm, corners of 0.5 mm: the defaults (63
steps, harmonics up to 4, Nitsche's press) and one thing changed at a time. Slip is the range along the axle over the
last revolution, at 15 and at 155 mm, some 10 mm inside the contact. Second table: what each revolution leaves of the
slip, as a mean all around and as what differs from angle to angle, and how far tractions repeat, in the largest shear;
then how far they are from a wave that turns with the loads, all of them, and without the shear that each place keeps.
Third table: from which revolution on so much is left at most.
What it must show: friction work and slip at the defaults within 1 % of the finest; work that repeats within 1e-3.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import numpy as np

from macrofit.base.arrays import BoolArray
from macrofit.scene import load_scene
from macrofit.service.history import Fretting, fretting, slip_left, wave_error
from macrofit.service.rotation import Revolution
from macrofit.service.run import Service, serve

from ._measure import head, row

PLACES = (15.0, 155.0)
"""Places of the seat where slip is compared, some 10 mm inside either end of the contact [mm]."""
SIZES = ("mesh.seat_facet=4", "mesh.corner_facet=0.5", "wheel.bore_radius=94.85", "motion.increment=10")
COARSE = ("mesh.seat_facet=12", "mesh.coarse=60", "motion.increment=60", "service.harmonics=1", "service.steps=6")
STIFFNESS = 206e3
DEFAULT = "defaults"
CHANGES: dict[str, tuple[str, ...]] = {
    DEFAULT: (),
    "18 steps": ("service.steps=18",),
    "36 steps": ("service.steps=36",),
    "126 steps": ("service.steps=126",),
    "252 steps": ("service.steps=252",),
    "harmonics up to 1": ("service.harmonics=1",),
    "up to 2, 65 steps": ("service.harmonics=2",),
    "up to 3": ("service.harmonics=3",),
    "up to 6, 65 steps": ("service.harmonics=6",),
    "up to 8, 68 steps": ("service.harmonics=8",),
    "facets of 2 mm": ("mesh.seat_facet=2",),
    "facets of 1 mm": ("mesh.seat_facet=1",),
    "penalty, 3 E per mm": ("contact.formulation=penalty", f"contact.penalty_stiffness={3 * STIFFNESS}"),
    "penalty, 10 E per mm": ("contact.formulation=penalty",),
    "penalty, 30 E per mm": ("contact.formulation=penalty", f"contact.penalty_stiffness={30 * STIFFNESS}"),
    "press in steps of 2 mm": ("motion.increment=2",),
}
"""What is changed in each row; fewer than the default's steps and harmonics, then more."""
QUICK = (DEFAULT, "penalty, 10 E per mm")
REVOLUTIONS = 9
BARS = (5e-3, 2e-3, 1e-3)
"""What is left of the slip, for the third table."""


def told(found: Service) -> tuple[float, float, float]:
    """Friction work [J] of the last revolution, and slip [um] at the front and inside."""
    assert found.turned is not None
    wear, z = found.turned.fretting, found.whole.fit.z
    slips = np.interp(PLACES, z, 1e3 * wear.axial_range)
    return 1e-3 * found.turned.revolutions[-1].friction_work, float(slips[0]), float(slips[1])


def by_choice(names: Sequence[str], sizes: Sequence[str], friction: str) -> Service:
    """Print the first table; gives the defaults' computation, of more revolutions."""
    print(head("what", "friction work [J]", "difference", "front slip [um]", "difference", "inner slip [um]",
               "difference", "Newton iterations", "CPU [s]"))  # fmt: skip
    reference: tuple[float, ...] = ()
    for name in names:
        started = time.process_time()
        found = serve(load_scene("wheelset", [*sizes, friction, *CHANGES[name]]))
        taken, values = time.process_time() - started, told(found)
        reference = reference or values
        assert found.turned is not None
        cells: list[str] = []
        for value, default in zip(values, reference, strict=True):
            cells += [f"{value:.2f}", "" if name == DEFAULT else f"{value / default - 1.0:+.2%}"]
        print(row(name, *cells, sum(each.iterations for each in found.turned.revolutions), f"{taken:.1f}"), flush=True)
    more = load_scene("wheelset", [*sizes, friction, f"service.revolutions={REVOLUTIONS}"])
    return serve(more)


def by_revolution(found: Service) -> None:
    """Print the second table."""
    assert found.turned is not None
    print(head("revolution", "friction work [J]", "work of the loads / of friction - 1", "left along, mean",
               "left around, mean", "left from angle to angle", "tractions repeat within", "wave, along",
               "wave, around", "wave of what varies, around"))  # fmt: skip
    for count, each in enumerate(found.turned.revolutions, 1):
        wear = fretting(found.whole, each)
        left = (*left_over(each, wear.always), *wear.wave_errors, varying_wave(each, wear))
        print(
            row(
                count, f"{1e-3 * each.friction_work:.3f}", f"{each.load_work / each.friction_work - 1.0:.1e}",
                *(f"{value:.1e}" for value in left),
            )
        )  # fmt: skip


def by_bar(found: Service) -> None:
    """Print the third table."""
    assert found.turned is not None
    left = np.array([slip_left(each) for each in found.turned.revolutions])
    print(head("left of the slip at most", "along, from revolution", "around, from revolution"))
    for bar in BARS:
        over = [np.flatnonzero(column > bar) for column in left.T]
        last = [int(each[-1]) + 2 if len(each) else 1 for each in over]
        print(row(f"{bar:g}", *(str(k) if k <= len(left) else f"beyond {len(left)}" for k in last)))


def varying_wave(revolution: Revolution, wear: Fretting) -> float:
    """How far the shear around, without its mean at each place, is from a wave, in the largest shear."""
    traction = np.stack([moment.traction for moment in revolution.moments])[..., wear.always]
    around = traction[:, :, 2:] - traction[1:, :, 2:].mean(axis=0)
    return wave_error(around) / max(float(np.abs(traction[:, :, 1:]).max()), 1e-300)


def left_over(revolution: Revolution, always: BoolArray) -> tuple[float, float, float, float]:
    """Slip that a revolution leaves where nothing opens, in the largest range: see the table; and of the tractions."""
    slip = np.stack([moment.slip for moment in revolution.moments])[..., always]
    size = max(float(np.ptp(slip[:, :, 1], axis=0).max()), 1e-300)
    left = (slip[-1] - slip[0])[:, 1:] / size
    mean = left.mean(axis=0)
    ends = [revolution.moments[k].traction[..., always] for k in (0, -1)]
    largest = max(float(np.abs(ends[0][:, 1:]).max()), 1e-300)
    along, around = np.abs(mean).max(axis=1)
    return (
        float(along),
        float(around),
        float(np.abs(left - mean).max()),
        float(np.abs(ends[1] - ends[0]).max()) / largest,
    )


def main(words: Sequence[str]) -> int:
    """Print the three tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks service_convergence", description=__doc__)
    parser.add_argument("--friction", type=float, default=0.2, help="coefficient")
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, few rows")
    options = parser.parse_args(words)
    friction = f"friction.options.coefficient={options.friction}"
    sizes = (*SIZES, *COARSE) if options.quick else SIZES
    found = by_choice(QUICK if options.quick else tuple(CHANGES), sizes, friction)
    print()
    by_revolution(found)
    print()
    by_bar(found)
    return 0
