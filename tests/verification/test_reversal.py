"""Motion that turns back: the loop of the bar held by friction, and a wheel pressed on and pulled back."""

from __future__ import annotations

import numpy as np
import pytest
from found import Found
from scipy.integrate import simpson
from scipy.optimize import brentq
from small import small_press
from verification.test_push_out import bar_of

from macrofit.contact.status import SLIP, STICK
from macrofit.scene import load_scene
from macrofit.solution import Solution
from macrofit.solve import solve

NO_FIELDS = ("output.stress=false", "output.fields_at=[]")
STEPS = 12  # of each branch of the loop
TURN = 60.0  # mm, where press-and-pull turns back


@pytest.fixture(scope="module")
def loop() -> Solution:
    up = [380.0, 380.04, 380.08, 380.12]
    down = np.linspace(380.12, 380.0, STEPS + 1)[1:]
    again = np.linspace(380.0, 380.12, STEPS + 1)[1:]
    path = [*up, *(round(float(u), 12) for u in (*down, *again))]
    return solve(load_scene("push-out", [*NO_FIELDS, f"motion.displacements={path}"]))


@pytest.fixture(scope="module")
def pulled() -> Solution:
    return solve(load_scene("press-and-pull", NO_FIELDS))


def branches(loop: Solution) -> tuple[slice, slice]:
    turn = len(loop.force) - 1 - 2 * STEPS
    return slice(turn, turn + STEPS + 1), slice(turn + STEPS, None)


def test_loop_branches(loop: Solution) -> None:
    """Each branch is D L / (E A) + D^2 / (4 E A q) from where it starts.

    1 % of the branch's end, as for the first loading: the sleeve's edge adds friction over a quarter of a radius.
    """
    bar = bar_of(loop)
    for branch in branches(loop):
        force, moved = loop.force[branch], loop.displacement[branch]
        exact = np.array([bar.turned(change) for change in np.abs(force - force[0])])
        error = exact - np.abs(moved - moved[0])
        print("branch, error over its length:", np.round(error / exact[-1], 5))
        assert np.abs(error).max() < 0.01 * exact[-1]


@pytest.mark.parametrize("back", [0.02, 0.06])
def test_a_traction_kept_at_the_edge_of_the_cone_sticks(back: float, found: Found) -> None:
    """Turned back after the whole bar slid: slip reverses over l = D / (2 q) from its end, the rest keeps +mu p.

    D from ``back`` = D L / (E A) + D^2 / (4 E A q). Three facets: the front and the sleeve's edge at either end.
    Status by the distance to the cone counted what slips by 1e-8 of the motion, 36 sticking facets for 160.
    """
    solution = solve(
        load_scene("push-out", [*NO_FIELDS, f"motion.displacements={[380.0, 380.5, 381.0, 381.0 - back]}"])
    )
    bar, slid, last = bar_of(solution), solution.increments[-2], solution.increments[-1]
    assert slid.sticking_facets == 0
    change = brentq(lambda change: bar.turned(change) - back, 0.0, 2.0 * slid.force)
    facet = float(np.diff(solution.seat).max())
    wanted = last.active_facets - 0.5 * change / bar.resistance / facet
    print(f"turned by {back}: {last.sticking_facets} of {last.active_facets} facets stick, closed form {wanted:.1f}")
    assert found("reversal: facets that stick, off the closed form", abs(last.sticking_facets - wanted), 3.0)
    facets = last.facets
    assert ((facets.slip != 0.0) == (facets.status == SLIP)).all()
    kept = (facets.status == STICK) & (facets.traction > 0.999 * facets.friction * facets.pressure)
    assert kept.sum() > 0.5 * last.active_facets


@pytest.mark.parametrize(
    "contact",
    [("mesh.order=1",), ("contact.gamma0=1",), ("contact.formulation=penalty", "contact.penalty_stiffness=2e5")],
    ids=["P1", "gamma0 1", "soft penalty"],
)
def test_stick_keeps_its_traction(contact: tuple[str, ...], found: Found) -> None:
    """Turned back within stick, the force does not depend on the number of increments: 1e-4, facets at its ends slip.

    The traction of a sticking moment is T u plus gamma times the elastic slip; one that started from zero at each
    increment would creep with their number: by 10 to 70 % in 300 of them.
    """
    ends = []
    for count in (1, 300):
        path = [55.0, 60.0, *(round(60.0 - 0.02 * k / count, 12) for k in range(1, count + 1))]
        plain = ("motion.start=0", "motion.travel=0", "motion.increment=1")
        run = solve(small_press(*NO_FIELDS, *contact, *plain, f"motion.displacements={path}"))
        assert run.increments[-1].sticking_facets > 0.5 * run.increments[-1].active_facets
        ends.append(run.force[-1] / run.force[1])
    assert found("stick: force after 300 increments and after one", abs(ends[1] / ends[0] - 1.0), 1e-4)


def test_loop_area(loop: Solution, found: Found) -> None:
    """The area between the branches is D^3 / (12 E A q) within 1 %.

    The branches are smooth in the displacement, so that Simpson's rule on 12 steps leaves less than 1e-4.
    """
    bar = bar_of(loop)
    down, up = branches(loop)
    lost = sum(float(simpson(loop.force[branch], x=loop.displacement[branch])) for branch in (down, up))
    change = float(loop.force[down][0] - loop.force[down][-1])
    closing = abs(loop.force[-1] - loop.force[down][0]) / change
    print(f"loop area {lost:.6g}, closed form {bar.loop_area(change):.6g} N mm; gap where it closes {closing:.1e}")
    assert found("loop of a reversal: its area", abs(lost / bar.loop_area(change) - 1.0), 0.01)
    assert closing < 1e-3  # the cycle forgets the first loading (Masing); what is left is the slip front's facet


def test_pull_converges_everywhere(pulled: Solution) -> None:
    assert all(record.converged for record in pulled.increments)
    assert sum(record.cutbacks for record in pulled.increments) == 0


def test_pull_starts_by_sticking(pulled: Solution) -> None:
    """The force changes its sign while nine tenths of the contact stick, at a constant stiffness.

    1 % of the stiffness: the ends of the contact already slip.
    """
    after = [record for record in pulled.increments if record.index > pulled.displacement.argmax()]
    first = after[:5]
    assert first[0].force > 0.0 > first[-1].force
    for record in first:
        assert record.sticking_facets >= 0.9 * record.active_facets
    stiffness = np.diff([record.force for record in first]) / np.diff([record.displacement for record in first])
    assert np.ptp(stiffness) < 0.01 * stiffness.mean()


def test_pull_changes_sign_once(pulled: Solution) -> None:
    """No spurious flips: slip backwards spreads, slip forwards dies out, and neither returns."""
    turn = int(pulled.displacement.argmax())
    forward, backward = [], []
    for record in pulled.increments[turn + 1 :]:
        slipping = record.facets.status == SLIP
        forward.append(slipping & (record.facets.traction > 0.0))
        backward.append(slipping & (record.facets.traction < 0.0))
    assert not any(facets.any() for facets in forward[2:])
    records = pulled.increments[turn + 2 :]
    for before, after, record in zip(backward[:-1], backward[1:], records, strict=True):
        left = before & ~after
        assert (record.facets.pressure[left] == 0.0).all()  # only facets the wheel leaves stop slipping
    spread = pulled.increments[turn + 9 :]
    assert all(record.sticking_facets == 0 for record in spread)


def test_pull_is_as_hard_as_push_but_for_the_stored_energy(pulled: Solution) -> None:
    """Half the force's jump is the friction: mu N, with N between that of pushing and that of pulling.

    Half the sum is what the strain energy gives back, 2 % of the force; it is not the same in both directions because
    a pulled axle is thinner, which leaves 0.5 % in the difference.
    """
    turn = int(pulled.displacement.argmax())
    push = pulled.increments[turn]
    pull = next(record for record in pulled.increments[turn + 1 :] if record.sticking_facets == 0)
    bound = 0.11 * 0.5 * (push.normal_force + pull.normal_force)
    print(f"push {push.force:.0f}, pull {pull.force:.0f}, mu N {bound:.0f} N")
    assert 0.5 * (push.force - pull.force) == pytest.approx(bound, rel=5e-3)
    assert 0.0 < 0.5 * (push.force + pull.force) < 0.06 * push.force
    assert push.displacement == TURN


def test_friction_never_gives_energy(pulled: Solution) -> None:
    """Dissipation is not negative in any increment; 1e-12 of the largest is rounding."""
    lost = np.array([record.dissipation for record in pulled.increments])
    assert lost.min() > -1e-12 * lost.max()
    assert (pulled.increments[int(pulled.displacement.argmax()) + 1].facets.status == STICK).any()
