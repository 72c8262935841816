"""A fit in place: shrunk on without friction and free along the axis, then held by friction and moved.

With nu = 0 the flush rings have an exact sliding force. By reciprocity with Lamé's state, which has no axial
displacement then, the mean pressure is Lamé's under any friction, and the force is mu 2 pi a L p.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from found import Found
from small import plain_shaft, solved
from verification.closed_forms import drawn_rings_pressure
from verification.test_cone import cone
from verification.test_lame import HOLLOW_AND_SOFT, bodies, mean_pressure_error, rings

from macrofit.contact.status import STICK
from macrofit.friction import TilePairs
from macrofit.scene import Scene, build_scene
from macrofit.solve import solve

MU = 0.12
NO_POISSON = ("axle.material.poisson_ratio=0", "wheel.material.poisson_ratio=0")


def pulled_rings(steps: list[float]) -> Scene:
    """Flush rings without Poisson effect, shrunk on and then pulled off by ``steps`` [mm]."""
    path = [40.0, *(40.0 - step for step in steps)]
    motion = ("motion.start=0", "motion.travel=0", f"motion.displacements={path}")
    return rings(2, 2.0, *NO_POISSON, *motion, f"friction.options.coefficient={MU}")


def overhung(**keys: object) -> Scene:
    """A hub that overhangs its seat's entrance: its end slopes, and a fit without friction would push itself off."""
    return build_scene(
        {
            "axle": {"seat_radius": 50.0, "seat_length": 60.0, "tail_length": 50.0, "inner_radius": 10.0},
            "wheel": {"bore_radius": 49.95, "hub_length": 60.0, "hub_outer_radius": 90.0},
            "mesh": {"seat_facet": 2.0, "coarse": 10.0, **keys.pop("mesh", {})},  # type: ignore[dict-item]
            "motion": {"displacements": [40.0, 40.002, 40.1]},
            "friction": {"options": {"coefficient": MU}},
            "output": {"stress": False, "fields_at": []},
            **keys,
        }
    )


@pytest.mark.parametrize("overrides", [(), HOLLOW_AND_SOFT], ids=["solid", "hollow-soft"])
def test_pressure_is_lames_and_no_force_is_left(overrides: tuple[str, ...], found: Found) -> None:
    """With friction as without: the bars are those of the rings without friction, and 1e-9 of the sliding force."""
    solution = solved(rings(2, 2.0, f"friction.options.coefficient={MU}", *overrides))
    record = solution.increments[0]
    assert found("shrink fit with friction: mean pressure against Lamé", abs(mean_pressure_error(solution)), 1e-7)
    assert found("shrink fit: force over the sliding force", abs(record.force) / (MU * record.normal_force), 1e-9)
    assert record.sticking_facets == record.active_facets
    assert not record.facets.accumulated_slip.any()


@pytest.mark.parametrize(
    "keys",
    [{}, {"mesh": {"order": 1}}, {"contact": {"theta": 1}}, {"contact": {"formulation": "penalty"}}],
    ids=["P2", "P1", "theta 1", "penalty"],
)
def test_the_axial_share_of_the_pressure_is_held_by_friction(keys: dict[str, object]) -> None:
    """An overhanging hub: without friction its support carries a force, with friction nothing, at the same pressure."""
    free = solve(overhung(**keys, friction={"options": {"coefficient": 0.0}})).increments[0]
    fit = solve(overhung(**keys)).increments[0]
    assert abs(free.force) > 1e-3 * MU * free.normal_force
    assert abs(fit.force) < 1e-9 * MU * fit.normal_force
    assert fit.friction_force == pytest.approx(-free.force, rel=2e-2)
    assert fit.normal_force == pytest.approx(free.normal_force, rel=1e-3)


def test_the_condensed_fit_is_the_plain_one() -> None:
    """Both engines release the same fit and go on alike, within 1e-9 of the sliding force."""
    condensed, plain = (solve(overhung(solver=solver)).force for solver in ("condensed", "monolithic"))
    assert condensed == pytest.approx(plain, abs=1e-9 * condensed.max())


def test_the_force_rises_with_the_stick_stiffness_to_the_sliding_force(found: Found) -> None:
    """Proportional to the travel from the first step on, then mu 2 pi a L p of Lamé's p.

    The sliding force is taken 0.025 mm off flush, 6e-4 of the length, which costs the friction 2e-5; the whole force
    lacks 0.2 %, what the strain energy gives back as the hub leaves the seat.
    """
    small = [1e-4, 2e-4, 3e-4]
    solution = solve(pulled_rings([*small, 0.025]))
    axle, wheel = bodies(solution.scene)
    wanted = MU * 2.0 * math.pi * axle.seat_radius * wheel.hub_length * drawn_rings_pressure(axle, wheel)
    force, friction = -solution.force, -solution.increments[-1].friction_force
    assert abs(force[0]) < 1e-9 * wanted
    stiffness = force[1:4] / np.array(small)
    print("stick stiffness [N/mm]", stiffness, "sliding force over mu 2 pi a L p - 1:", force[-1] / wanted - 1.0)
    assert found("shrink fit: change of the stick stiffness", float(np.ptp(stiffness) / stiffness[0]), 1e-4)
    assert found("shrink fit: friction that slides against mu 2 pi a L p", abs(friction / wanted - 1.0), 1e-4)
    assert force[-1] == pytest.approx(wanted, rel=3e-3)
    assert solution.increments[-1].sticking_facets == 0


@pytest.mark.parametrize("taper", [0.1, 0.4])
@pytest.mark.parametrize("share", [0.94, 1.06])
def test_a_cone_holds_itself_below_the_angle_of_friction(taper: float, share: float) -> None:
    """Free along the axis where mu > tan a; below that its support holds it with N (sin a), as without friction.

    The slopes that the interference makes change sin a by 5e-4 (see test_cone), 1 % of tan a = 0.05.
    """
    slope = 0.5 * taper
    scene = cone(taper, share * slope, start=0.5)
    first = solve(scene).increments[0]
    if share > 1.0:
        assert abs(first.force) < 1e-9 * first.mean_friction * first.normal_force
    else:
        assert first.force / first.normal_force == pytest.approx(math.sin(math.atan(slope)), abs=5e-4)


@dataclass
class Watched:
    """A constant coefficient that remembers the pressures it was asked with."""

    asked: list[np.ndarray] = field(default_factory=list)
    depends_on: frozenset[str] = frozenset({"tiles", "pressure"})

    def coefficients(self, pairs: TilePairs) -> np.ndarray:
        self.asked.append(pairs.pressure.copy())
        return np.full(len(pairs.pressure), MU)


def test_friction_is_asked_with_the_pressure_of_the_fit() -> None:
    """And once, as in any increment: the fit is what friction finds when it comes in."""
    scene = plain_shaft()
    watched = Watched()
    first = solve(scene, friction=watched).increments[0]
    pressure = first.facets.pressure[first.facets.status == STICK]
    assert watched.asked[0].max() == pytest.approx(pressure.max(), rel=0.05)
    assert watched.asked[0].min() > 0.5 * pressure.min()
