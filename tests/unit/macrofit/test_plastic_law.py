"""The law of one point: every hardening against its closed form under shear, tension and cycles; nothing created."""

from __future__ import annotations

import numpy as np
import pytest

from macrofit.base.arrays import FloatArray
from macrofit.plasticity.law import Hardening, PointState, deviator, equivalent, flow, overshoot
from macrofit.plasticity.material import limit_load
from macrofit.scene import load_scene

E, NU = 206e3, 0.3
G = E / (2.0 * (1.0 + NU))
LAME = E * NU / ((1.0 + NU) * (1.0 - 2.0 * NU))
MODULI = np.full((4, 4), LAME)
MODULI[3, :] = MODULI[:, 3] = 0.0
MODULI += np.diag([2 * G, 2 * G, 2 * G, G])

IDEAL = Hardening(yield_stress=300.0)
LAWS = {
    "ideal": IDEAL,
    "isotropic": Hardening(yield_stress=300.0, isotropic=4000.0),
    "kinematic": Hardening(yield_stress=300.0, moduli=(6000.0,), recalls=(0.0,)),
    "voce": Hardening(yield_stress=300.0, saturation=80.0, rate=25.0, isotropic=500.0),
    "chaboche": Hardening(
        yield_stress=250.0, moduli=(90e3, 20e3, 2e3), recalls=(900.0, 120.0, 0.0), saturation=40.0, rate=8.0
    ),
    "table": Hardening(yield_stress=300.0, curve=((0.0, 0.01, 0.05), (0.0, 60.0, 100.0))),
}


def sheared(law: Hardening, strains: FloatArray) -> tuple[FloatArray, PointState]:
    """Shear stress [MPa] at each of the engineering shears, one after the other, and the last state."""
    state, stresses = PointState.virgin(1, law.backs), []
    for strain in strains:
        state = flow(np.array([[[0.0, 0.0, 0.0, strain]]]), state, law, G)
        stresses.append(G * (strain - state.strain[0, 3]))
    return np.array(stresses), state


def back_stress(law: Hardening, p: float) -> float:
    """Uniaxial back-stress after plastic strain p in one direction: sum of C (1 - exp(-g p)) / g."""
    parts = zip(law.moduli, law.recalls, strict=True)
    return sum(c * p if g == 0.0 else c / g * (1.0 - np.exp(-g * p)) for c, g in parts)


@pytest.mark.parametrize("name", LAWS)
def test_the_limit_is_what_is_borne_after_any_flow(name: str) -> None:
    """R + back-stress at a plastic strain of a million; what grows by a line has none."""
    law = LAWS[name]
    last = float(law.radius(np.array([1e6]))[0][0]) + back_stress(law, 1e6)
    assert law.limit == (pytest.approx(last) if name in ("ideal", "table") else np.inf)
    recalled = Hardening(yield_stress=250.0, moduli=(90e3, 20e3), recalls=(900.0, 120.0), saturation=40.0, rate=8.0)
    assert recalled.limit == pytest.approx(250.0 + 100.0 + 20e3 / 120.0 + 40.0)
    assert Hardening(yield_stress=250.0, moduli=(0.0,), recalls=(0.0,)).limit == 250.0  # a line of no slope


@pytest.mark.parametrize("softer", ["axle", "wheel"])
def test_a_limit_load_is_that_of_the_softer_surface(softer: str) -> None:
    """Friction up to it slides; an elastic body, or one that hardens, has none."""
    stresses = {"axle": 500.0, "wheel": 500.0} | {softer: 250.0}
    keys = [f"{body}.material.yield_stress={stress}" for body, stress in stresses.items()]
    k = 250.0 / np.sqrt(3.0)
    assert limit_load(load_scene("wheelset", keys), np.array([0.0, 0.999 * k])) == ""
    assert "at 144 MPa, its limit load" in limit_load(load_scene("wheelset", keys), np.array([0.0, 1.001 * k]))
    rigid = load_scene("wheelset", [*keys, f"{softer}.material.elastic=true"])
    assert "at 289 MPa" in limit_load(rigid, np.array([1e3]))
    assert limit_load(load_scene("wheelset"), np.array([1e9])) == ""
    assert limit_load(load_scene("wheelset", keys), np.empty(0)) == ""


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("steps", [1, 7])
def test_monotonic_shear_is_exact_whatever_the_steps(name: str, steps: int) -> None:
    """sqrt(3) tau = R(p) + X(p) with p = plastic shear / sqrt(3): the direction does not turn, so one step is exact."""
    law = LAWS[name]
    stress, state = sheared(law, np.linspace(0.0, 0.06, steps + 1)[1:])
    p = float(state.accumulated[0])
    assert np.sqrt(3.0) * stress[-1] == pytest.approx(law.radius(np.array([p]))[0][0] + back_stress(law, p), rel=1e-12)
    assert p == pytest.approx(state.strain[0, 3] / np.sqrt(3.0), rel=1e-14)


@pytest.mark.parametrize("name", LAWS)
def test_uniaxial_tension(name: str) -> None:
    """Strain in z with free sides: sigma = R(p) + X(p), p = eps - sigma / E."""
    law = LAWS[name]
    state, sides, stress = PointState.virgin(1, law.backs), 0.0, np.zeros((1, 4))
    for axial in np.linspace(0.0, 0.03, 31)[1:]:
        low, high = -axial, 0.0  # the lateral strain that leaves no lateral stress, by bisection
        for _ in range(80):
            sides = 0.5 * (low + high)
            strain = np.array([[sides, axial, sides, 0.0]])
            after = flow(strain[None], state, law, G)
            stress = (strain - after.strain) @ MODULI
            low, high = (low, sides) if stress[0, 0] > 0.0 else (sides, high)
        state = after
    p = float(state.accumulated[0])
    assert stress[0, 1] == pytest.approx(law.radius(np.array([p]))[0][0] + back_stress(law, p), rel=1e-9)
    assert pytest.approx(p + stress[0, 1] / E, rel=1e-9) == 0.03


def test_stabilised_loop_of_chaboche() -> None:
    """Half the range of stress = k + sum of C / g tanh(g half range of plastic strain); Lemaitre and Chaboche 5.4.4."""
    law = Hardening(yield_stress=200.0, moduli=(60e3, 15e3), recalls=(400.0, 150.0))
    cycle = np.concatenate([np.linspace(0.01, -0.01, 60), np.linspace(-0.01, 0.01, 60)])
    stress, _ = sheared(law, np.tile(cycle, 30))
    last = np.sqrt(3.0) * stress[-120:]
    plastic = (np.concatenate([cycle]) - stress[-120:] / G) / np.sqrt(3.0)
    amplitude, half = 0.5 * np.ptp(last), 0.5 * np.ptp(plastic)
    expected = 200.0 + sum(c / g * np.tanh(g * half) for c, g in zip(law.moduli, law.recalls, strict=True))
    assert amplitude == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_random_paths_keep_the_law(name: str) -> None:
    """After every step: stress on or within the surface, no plastic volume, dissipation never negative."""
    law, rng = LAWS[name], np.random.default_rng(3)
    state, strain = PointState.virgin(200, law.backs), np.zeros((200, 4))
    for _ in range(40):
        strain = strain + 2e-3 * rng.standard_normal((200, 4))
        after = flow(strain[None], state, law, G)
        stress = (strain - after.strain) @ MODULI
        assert overshoot(stress, after, law).max() <= 1e-8
        assert np.abs(after.strain[:, :3].sum(axis=1)).max() <= 1e-15 * 40
        gained = after.accumulated - state.accumulated
        assert (gained >= 0.0).all()
        relative = deviator(stress) - (after.back.sum(axis=1) if law.backs else 0.0)
        dissipated = (relative * (after.strain - state.strain)).sum(axis=1)
        assert dissipated == pytest.approx(gained * equivalent(relative), abs=1e-9)
        state = after
    assert (state.accumulated > 0.01).all()


def test_turned_axes_give_turned_stress() -> None:
    """The law knows no axes: a path turned about the hoop axis gives the same accumulated strain."""
    law, rng = LAWS["chaboche"], np.random.default_rng(5)
    angle = 0.7
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array(  # of strains with the engineering shear
        [[c * c, s * s, 0, c * s], [s * s, c * c, 0, -c * s], [0, 0, 1, 0], [-2 * c * s, 2 * c * s, 0, c * c - s * s]]
    )
    states, strain = [PointState.virgin(50, law.backs) for _ in range(2)], np.zeros((50, 4))
    for _ in range(10):
        strain = strain + 2e-3 * rng.standard_normal((50, 4))
        paths = (strain, strain @ turn.T)
        states = [flow(e[None], x, law, G) for e, x in zip(paths, states, strict=True)]
    assert states[1].accumulated == pytest.approx(states[0].accumulated, rel=1e-11)
    assert states[1].strain == pytest.approx(states[0].strain @ turn.T, abs=1e-13)


@pytest.mark.parametrize("name", LAWS)
def test_a_path_is_its_steps(name: str) -> None:
    """Many strains at once give what they give one by one, to the bit."""
    law, rng = LAWS[name], np.random.default_rng(11)
    path = np.cumsum(2e-3 * rng.standard_normal((6, 30, 4)), axis=0)
    state = PointState.virgin(30, law.backs)
    whole = flow(path, state, law, G)
    for strain in path:
        state = flow(strain[None], state, law, G)
    assert (whole.strain == state.strain).all()
    assert (whole.accumulated == state.accumulated).all()
    assert (whole.back == state.back).all()
